//! Clothes, boards and bags of people who carry the camera: pixels unlike the rest of their latitude, joined to them.
//!
//! The network knows people, and not what they stand on. A board on the water, or a bag over a pavement, has colours
//! that its latitude has nowhere else. Each frame is looked at by itself, because a board turns below its rider. The
//! limits were set on people painted over real and rendered clips, by `scripts/calibrate/operators.py`.

use omnilife_schemas::{RgbImage, camera::ErpCamera, rgb::Mask};

use super::{
    super::{field::Field, vote},
    evidence::WIDTH,
    people::{self, Seen},
    region::{closed, filled_around, smoothed},
};
use crate::opencv_images::grown;

/// Least distance from the median colour of a latitude for what is unlike it, standard deviations.
const UNLIKE: f32 = 2.5;
/// Least standard deviation of colours, of values of [0, 1].
const NOISE: f32 = 0.03;
/// Standard deviation of a normal distribution over its median distance from the median.
const DEVIATION_PER_MEDIAN: f32 = 1.4826;
/// Variances are averaged over so many rows above and below.
const NEAR_ROWS: usize = 2;
/// Distances are averaged over squares that reach so many pixels.
const AVERAGED_PIXELS: usize = 1;
/// Content farther than this from people is not theirs, pixels: 39 degrees.
const REACH_PIXELS: usize = 28;
/// Gaps and spikes up to twice as wide are smoothed away in frames, pixels.
const SMOOTHING_PIXELS: usize = 1;
/// Gaps up to twice as wide are closed in the mask of all frames, pixels.
const CLOSED_PIXELS: usize = 3;
/// Least share of the frames in which a pixel is joined to people.
const LEAST_SHARE: f64 = 0.4;

/// Returns the limits in words, for records.
pub(super) fn settings() -> String {
    format!(
        "joined in {LEAST_SHARE} to what is unlike its latitude by {UNLIKE} deviations within {REACH_PIXELS} px"
    )
}

/// Marks people who stay, with what is joined to them in enough frames.
pub(super) fn grown_from(core: &Mask, seen: &[Seen]) -> opencv::Result<Mask> {
    if !core.marks_anything() {
        return Ok(core.clone());
    }
    let near = grown(&core.data, WIDTH, REACH_PIXELS)?;
    let joined = seen.iter().map(|frame| joined(frame, core, &near));
    let joined: Vec<Vec<u8>> = joined.collect::<opencv::Result<_>>()?;
    let joined: Vec<&[u8]> = joined.iter().map(Vec::as_slice).collect();
    let often = people::marked_in(&joined, LEAST_SHARE);
    let marks: Vec<u8> = often.iter().map(|&often| 255 * u8::from(often)).collect();
    let all = Mask::new(WIDTH, WIDTH / 2, marks).united(core);
    let data = closed(&all.data, WIDTH, CLOSED_PIXELS)?;
    Ok(filled_around(without_holes(Mask { data, ..all })))
}

/// Marks everything but the largest part of the sphere that a mask leaves free: what people surround is theirs.
fn without_holes(mut mask: Mask) -> Mask {
    let camera = ErpCamera::new(mask.width as u32, mask.height as u32);
    let free: Vec<bool> = mask.data.iter().map(|&value| value == 0).collect();
    let width = mask.width;
    let area = |region: &[usize]| -> f64 {
        let areas = region
            .iter()
            .map(|&pixel| camera.pixel_solid_angle((pixel / width) as u32));
        areas.sum()
    };
    let mut regions = vote::regions(&free, width, true);
    regions.sort_by(|a, b| area(b).total_cmp(&area(a)));
    for pixel in regions.into_iter().skip(1).flatten() {
        mask.data[pixel] = 255;
    }
    mask
}

/// Marks what is joined to people in a frame, with them.
fn joined(frame: &Seen, core: &Mask, near: &[u8]) -> opencv::Result<Vec<u8>> {
    let unlike = distances(&frame.image).box_mean(AVERAGED_PIXELS, true)?;
    let foreign = unlike.values.iter().zip(near);
    let foreign: Vec<u8> = foreign
        .map(|(&distance, &near)| 255 * u8::from(distance > UNLIKE && near != 0))
        .collect();
    let foreign = smoothed(&foreign, WIDTH, SMOOTHING_PIXELS)?;
    let is_person =
        |pixel: usize| core.data[pixel] != 0 || (frame.people[pixel] != 0 && near[pixel] != 0);
    let marks: Vec<bool> = (0..foreign.len())
        .map(|pixel| foreign[pixel] != 0 || is_person(pixel))
        .collect();
    let mut joined = vec![0; marks.len()];
    for region in vote::regions(&marks, WIDTH, true) {
        if region.iter().any(|&pixel| is_person(pixel)) {
            for pixel in region {
                joined[pixel] = 255;
            }
        }
    }
    Ok(joined)
}

/// Returns the distance of each pixel's colour from the median of its row: the root of the mean over the channels of
/// squares, in standard deviations.
fn distances(image: &RgbImage) -> Field {
    let (width, height) = (image.width, image.height);
    let rows: Vec<[[f32; 2]; 3]> = (0..height)
        .map(|row| std::array::from_fn(|channel| median_and_variance(image, row, channel)))
        .collect();
    let mut values = Vec::with_capacity(width * height);
    for (row, colours) in image.data.chunks_exact(3 * width).enumerate() {
        let around = &rows[row.saturating_sub(NEAR_ROWS)..(row + NEAR_ROWS + 1).min(height)];
        let scales: [f32; 3] = std::array::from_fn(|channel| {
            let variances = around.iter().map(|channels| channels[channel][1]);
            variances.sum::<f32>() / around.len() as f32 + NOISE * NOISE
        });
        for colour in colours.chunks_exact(3) {
            let squares = (0..3).map(|channel| {
                let difference = colour[channel] - rows[row][channel][0];
                difference * difference / scales[channel]
            });
            values.push((squares.sum::<f32>() / 3.0).sqrt());
        }
    }
    Field {
        width,
        height,
        values,
    }
}

/// Returns the median of a channel in a row, and its variance by the median distance from that.
fn median_and_variance(image: &RgbImage, row: usize, channel: usize) -> [f32; 2] {
    let row = &image.data[3 * row * image.width..3 * (row + 1) * image.width];
    let values: Vec<f32> = row.iter().skip(channel).step_by(3).copied().collect();
    let middle = median(values.clone());
    let distance = median(values.iter().map(|value| (value - middle).abs()).collect());
    [middle, (DEVIATION_PER_MEDIAN * distance).powi(2)]
}

/// Returns the upper median; 0 of nothing.
fn median(mut values: Vec<f32>) -> f32 {
    values.sort_unstable_by(f32::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEIGHT: usize = WIDTH / 2;
    /// Water, board and a person's shirt.
    const WATER: f32 = 0.2;
    const BOARD: f32 = 0.9;
    const SHIRT: f32 = 0.25;

    /// A shirt in columns 100 to 109 of rows 70 to 89, a board below it, and one on the water by itself.
    fn frame() -> Seen {
        let is_shirt =
            |column: usize, row: usize| (100..110).contains(&column) && (70..90).contains(&row);
        let is_board = |column: usize, row: usize| {
            let own = (90..120).contains(&column) && (90..100).contains(&row);
            own || ((124..128).contains(&column) && (70..80).contains(&row))
        };
        let level = |at: usize| match (at % WIDTH, at / WIDTH) {
            (column, row) if is_shirt(column, row) => SHIRT,
            (column, row) if is_board(column, row) => BOARD,
            // Ripples.
            (column, _) => WATER + 0.01 * (column % 3) as f32,
        };
        let levels = (0..WIDTH * HEIGHT).flat_map(|at| [level(at); 3]);
        let people = (0..WIDTH * HEIGHT).map(|at| 255 * u8::from(is_shirt(at % WIDTH, at / WIDTH)));
        Seen {
            image: RgbImage::new(WIDTH, HEIGHT, levels.collect()),
            people: people.collect(),
        }
    }

    #[test]
    fn a_board_below_a_person_is_joined_and_one_apart_is_not() {
        let seen = vec![frame(); 5];
        let core = Mask::new(WIDTH, HEIGHT, seen[0].people.clone());
        let mask = grown_from(&core, &seen).expect("filtered");
        let at = |column: usize, row: usize| mask.data[row * WIDTH + column];
        assert_eq!([at(105, 75), at(93, 95), at(116, 95)], [255; 3]);
        assert_eq!(
            [at(126, 75), at(150, 95), at(105, 110), at(105, 60)],
            [0; 4]
        );
    }

    #[test]
    fn what_is_joined_in_few_frames_is_left_out() {
        let still = Seen {
            image: RgbImage::new(WIDTH, HEIGHT, vec![WATER; 3 * WIDTH * HEIGHT]),
            ..frame()
        };
        let core = Mask::new(WIDTH, HEIGHT, still.people.clone());
        let share = |with_board: usize| {
            let mut seen = vec![still.clone(); 10 - with_board];
            seen.resize(10, frame());
            grown_from(&core, &seen).expect("filtered").data[95 * WIDTH + 93]
        };
        assert_eq!([share(3), share(4)], [0, 255]);
        let empty = Mask::new(WIDTH, HEIGHT, vec![0; WIDTH * HEIGHT]);
        assert!(!grown_from(&empty, &[]).expect("filtered").marks_anything());
    }

    #[test]
    fn holes_are_filled_and_the_largest_part_stays_free() {
        // A ring around the nadir, with a notch above and a hole.
        let is_ring = |row: usize| (11..14).contains(&row);
        let is_hole =
            |column: usize, row: usize| (row == 11 && column == 20) || (row == 12 && column == 31);
        let marks = (0..32 * 16).map(|at| {
            let (column, row) = (at % 32, at / 32);
            255 * u8::from(is_ring(row) && !is_hole(column, row))
        });
        let mask = without_holes(Mask::new(32, 16, marks.collect()));
        let at = |column: usize, row: usize| mask.data[row * 32 + column];
        assert_eq!([at(20, 11), at(5, 10)], [0, 0]);
        assert_eq!([at(31, 12), at(5, 13), at(3, 15)], [255; 3]);
    }

    #[test]
    fn distances_are_in_deviations_of_a_latitude() {
        // Levels 0.1 to 0.5 in every row: the median is 0.3, the median distance from it 0.1.
        let levels = [0.1, 0.2, 0.3, 0.4, 0.5];
        let row = || levels.into_iter().flat_map(|level| [level; 3]);
        let image = RgbImage::new(5, 2, row().chain(row()).collect());
        let found = distances(&image);
        let deviation = ((DEVIATION_PER_MEDIAN * 0.1_f32).powi(2) + NOISE * NOISE).sqrt();
        for (value, level) in found.values.iter().zip(levels.into_iter().chain(levels)) {
            assert!((value - (level - 0.3_f32).abs() / deviation).abs() < 1e-4);
        }
    }
}
