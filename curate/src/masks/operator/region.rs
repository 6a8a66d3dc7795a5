//! Region of what is carried, from the evidence of single pixels.
//!
//! Evidence lies on outlines: skin, cloth and plastic inside of them look alike. What carries the camera stands below it,
//! so that the region goes from the upper outline down. What shows in most directions below, such as a car or a head,
//! surrounds the nadir, and its outline goes on between its parts.

use omnilife_schemas::{camera::ErpCamera, rgb::Mask};

use super::super::{field::Field, vote};
use crate::opencv_images::grown;

/// Content above this latitude does not carry the camera, degrees.
const TOP_DEGREES: f64 = -15.0;
/// Columns with an outline below this latitude alone are not filled, degrees.
const LOWEST_TOP_DEGREES: f64 = -65.0;
/// The region ends here, degrees: a stand is narrow, and the floor below it shows. Set on one clip.
const BOTTOM_DEGREES: f64 = -78.0;
/// Least share of the columns of a region that surrounds the nadir, and goes down to it.
const LEAST_AROUND: f64 = 0.5;
/// Pixels of evidence that are so far apart belong together.
const NEAR_PIXELS: usize = 1;
/// Outlines have this many times the evidence that they have without slow shades, or less. Even floors have more.
const SHARP_SCALE: f64 = 4.0;
/// Regions with a smaller share of the evidence of the best one are left out.
const LEAST_SHARE: f64 = 0.3;
/// Gaps and spikes up to twice as wide are smoothed away, pixels.
const SMOOTHING_PIXELS: usize = 3;

#[derive(Debug, Clone)]
pub(super) struct Region {
    /// Its pixels, at the size of the evidence.
    pub(super) mask: Mask,
    /// Evidence of its strongest part, at most [`SHARP_SCALE`] times that without slow shades: grey levels of 255 times
    /// steradians.
    pub(super) evidence: f64,
}

/// Finds the region of what is carried from the evidence, and that without slow shades; `None` without any evidence.
pub(super) fn find(stays: &Field, sharp: &Field) -> opencv::Result<Option<Region>> {
    let (width, height) = (stays.width, stays.height);
    let camera = ErpCamera::new(width as u32, height as u32);
    let row_at = |degrees: f64| row_at(degrees, height);
    let is_seed = |pixel: usize| stays.values[pixel] > 0.0 && pixel / width >= row_at(TOP_DEGREES);
    let seeds: Vec<u8> = (0..stays.values.len())
        .map(|pixel| 255 * u8::from(is_seed(pixel)))
        .collect();
    let near: Vec<bool> = grown(&seeds, width, NEAR_PIXELS)?
        .iter()
        .map(|&value| value != 0)
        .collect();
    let evidence = |region: &[usize], of: &Field| -> f64 {
        let seeds = region.iter().filter(|&&pixel| is_seed(pixel));
        let weighted = seeds.map(|&pixel| {
            let row = (pixel / width) as u32;
            255.0 * f64::from(of.values[pixel]) * camera.pixel_solid_angle(row)
        });
        weighted.sum()
    };
    let regions = vote::regions(&near, width, true);
    let regions: Vec<(f64, Vec<usize>)> = regions
        .into_iter()
        .map(|region| (evidence(&region, stays), region))
        .collect();
    let strongest = regions.iter().max_by(|a, b| a.0.total_cmp(&b.0));
    let Some((most, strongest)) = strongest.filter(|(found, _)| *found > 0.0) else {
        return Ok(None);
    };
    let of_outlines = SHARP_SCALE * evidence(strongest, sharp);
    let strong = regions
        .iter()
        .filter(|(found, _)| *found >= LEAST_SHARE * most);
    let mut tops: Vec<Option<usize>> = vec![None; width];
    for (_, region) in strong {
        for &pixel in region.iter().filter(|&&pixel| is_seed(pixel)) {
            let (column, row) = (pixel % width, pixel / width);
            if row < row_at(LOWEST_TOP_DEGREES) {
                let top = tops[column].map_or(row, |top| top.min(row));
                tops[column] = Some(top);
            }
        }
    }
    let data = match surrounds(tops.iter().flatten().count(), width) {
        true => filled(&joined_around(&tops), height, height),
        false => filled(&tops, row_at(BOTTOM_DEGREES), height),
    };
    Ok(Some(Region {
        mask: Mask::new(width, height, smoothed(&data, width, SMOOTHING_PIXELS)?),
        evidence: f64::min(*most, of_outlines),
    }))
}

/// Returns the row at a latitude, of an image of so many rows.
fn row_at(degrees: f64, height: usize) -> usize {
    ((0.5 - degrees / 180.0) * height as f64) as usize
}

fn surrounds(columns: usize, width: usize) -> bool {
    columns as f64 >= LEAST_AROUND * width as f64
}

/// Marks each column from its top to a row, without that one.
fn filled(tops: &[Option<usize>], bottom: usize, height: usize) -> Vec<u8> {
    let width = tops.len();
    let mut data = vec![0; width * height];
    for (column, top) in tops.iter().enumerate() {
        for row in top.unwrap_or(bottom)..bottom {
            data[row * width + column] = 255;
        }
    }
    data
}

/// Fills a mask that surrounds the nadir down to it, and over gaps; returns other masks as they are.
pub(super) fn filled_around(mask: Mask) -> Mask {
    let (width, height) = (mask.width, mask.height);
    let is_marked = |column: usize, row: usize| mask.data[row * width + column] != 0;
    let lowest = row_at(BOTTOM_DEGREES, height);
    let reaching = (0..width).filter(|&column| is_marked(column, lowest));
    if !surrounds(reaching.count(), width) {
        return mask;
    }
    let tops: Vec<Option<usize>> = (0..width)
        .map(|column| (0..height).find(|&row| is_marked(column, row)))
        .collect();
    Mask::new(width, height, filled(&joined_around(&tops), height, height))
}

/// Fills the gaps of an outline around the sphere by straight lines between the columns beside them.
fn joined_around(tops: &[Option<usize>]) -> Vec<Option<usize>> {
    let width = tops.len();
    let beside = |column: usize, step: usize| {
        let column_at = |distance: usize| (column + distance * step) % width;
        let top_at = |distance: usize| Some((distance as f64, tops[column_at(distance)]? as f64));
        (0..width).find_map(top_at)
    };
    let filled = |column: usize| {
        let (left, right) = (beside(column, width - 1)?, beside(column, 1)?);
        let share = left.0 / (left.0 + right.0).max(1.0);
        Some((left.1 + share * (right.1 - left.1)) as usize)
    };
    (0..width).map(filled).collect()
}

/// Closes gaps up to twice as wide as this reach, pixels, then removes spikes.
pub(super) fn smoothed(marks: &[u8], width: usize, reach: usize) -> opencv::Result<Vec<u8>> {
    let closed = closed(marks, width, reach)?;
    grown(&shrunk(closed, width, reach)?, width, reach)
}

/// Closes gaps up to twice as wide as this reach, pixels.
pub(super) fn closed(marks: &[u8], width: usize, reach: usize) -> opencv::Result<Vec<u8>> {
    shrunk(grown(marks, width, reach)?, width, reach)
}

fn shrunk(mut marks: Vec<u8>, width: usize, reach: usize) -> opencv::Result<Vec<u8>> {
    marks.iter_mut().for_each(|value| *value = !*value);
    let mut free = grown(&marks, width, reach)?;
    free.iter_mut().for_each(|value| *value = !*value);
    Ok(free)
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 128;
    const HEIGHT: usize = 64;

    /// Evidence on the upper outline of a body across the seam, and a weak spot elsewhere.
    fn evidence(above: f32, spot: f32) -> Field {
        let mut values = vec![0.0; WIDTH * HEIGHT];
        for column in (0..12).chain(WIDTH - 12..WIDTH) {
            values[40 * WIDTH + column] = 0.2;
            values[10 * WIDTH + column] = above;
        }
        values[45 * WIDTH + 60] = spot;
        Field {
            width: WIDTH,
            height: HEIGHT,
            values,
        }
    }

    #[test]
    fn a_body_goes_from_its_upper_outline_down() {
        let evidence = evidence(0.0, 0.01);
        let found = |share: f32| {
            let mut sharp = evidence.clone();
            sharp.values.iter_mut().for_each(|value| *value *= share);
            find(&evidence, &sharp)
                .expect("filtered")
                .expect("a region")
        };
        let (region, all) = (found(0.125), found(1.0));
        assert!((region.evidence / all.evidence - 0.5).abs() < 1e-6);
        assert_eq!(region.mask, all.mask);
        let at = |column: usize, row: usize| region.mask.data[row * WIDTH + column];
        assert!(region.evidence > 0.0);
        assert_eq!([at(0, 50), at(WIDTH - 1, 50), at(10, 41)], [255; 3]);
        assert_eq!(
            [at(0, 38), at(30, 50), at(60, 50), at(0, HEIGHT - 1)],
            [0; 4]
        );
    }

    #[test]
    fn what_surrounds_the_nadir_goes_down_to_it_and_on_over_gaps() {
        let of_columns = |count: usize| {
            let mut values = vec![0.0; WIDTH * HEIGHT];
            for column in 0..count {
                values[(40 + column / 50) * WIDTH + column] = 0.2;
            }
            let field = Field {
                width: WIDTH,
                height: HEIGHT,
                values,
            };
            find(&field, &field)
                .expect("filtered")
                .expect("a region")
                .mask
                .data
        };
        let lowest = |data: &[u8], column: usize| data[(HEIGHT - 1) * WIDTH + column];
        let around = of_columns(100);
        assert_eq!([lowest(&around, 20), lowest(&around, 114)], [255; 2]);
        // Between the rows 41 and 40, on both sides of the gap.
        assert_eq!(
            [around[45 * WIDTH + 114], around[37 * WIDTH + 114]],
            [255, 0]
        );
        let beside = of_columns(50);
        assert_eq!([lowest(&beside, 20), beside[45 * WIDTH + 20]], [0, 255]);
        assert_eq!(beside[45 * WIDTH + 114], 0);
    }

    #[test]
    fn masks_around_the_nadir_are_filled_and_others_are_not() {
        let of_columns = |count: usize| {
            let mut mask = Mask::new(WIDTH, HEIGHT, vec![0; WIDTH * HEIGHT]);
            for row in (40..45).chain(50..HEIGHT) {
                mask.data[row * WIDTH..row * WIDTH + count].fill(255);
            }
            mask
        };
        let around = filled_around(of_columns(100));
        let at = |column: usize, row: usize| around.data[row * WIDTH + column];
        assert_eq!([at(20, 47), at(114, 40), at(114, 63)], [255; 3]);
        assert_eq!(at(20, 39), 0);
        let beside = of_columns(50);
        assert_eq!(filled_around(beside.clone()), beside);
    }

    #[test]
    fn gaps_of_an_outline_are_bridged_by_straight_lines_across_the_seam() {
        let mut tops = vec![None; 8];
        tops[2] = Some(10);
        tops[6] = Some(20);
        let joined = joined_around(&tops);
        let expected: [Option<usize>; 8] = [15, 12, 10, 12, 15, 17, 20, 17].map(Some);
        assert_eq!(joined, expected);
        assert!(joined_around(&[None; 2]).iter().all(Option::is_none));
    }

    #[test]
    fn the_sky_carries_no_camera() {
        let mut above = evidence(0.5, 0.0);
        for value in &mut above.values[40 * WIDTH..] {
            *value = 0.0;
        }
        assert!(find(&above, &above).expect("filtered").is_none());
    }
}
