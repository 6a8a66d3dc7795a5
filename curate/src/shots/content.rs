//! Measures of one frame that tell a scene from a single colour and from text on one.

use crate::video::Rgb8Image;

/// Means of luma are over cells of a 128th of the width, so that noise does not count as contrast.
const CELLS_ACROSS: usize = 128;
/// The background is searched for in blocks of a 32nd of the width.
const BLOCKS_ACROSS: usize = 32;
/// Largest span of luma in a flat block, 8-bit levels.
const FLAT_LEVELS: u8 = 6;
/// Largest deviation of flat blocks of one colour from its mean, 8-bit levels.
const SAME_LEVELS: usize = 3;
/// Difference from the sample before beyond which a cell has changed, 8-bit levels.
const CHANGED_LEVELS: f32 = 12.0;

/// Measures of one frame.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Content {
    /// From the darkest to the brightest cell, 8-bit levels.
    pub(super) spread_levels: f32,
    /// Share of the blocks, 0 to 1, that are flat and of the most frequent flat colour.
    pub(super) background_share: f32,
    /// Mean luma of the cells, 8-bit levels, by rows.
    pub(super) cells: Vec<f32>,
}

impl Content {
    pub(super) fn of(image: &Rgb8Image) -> Self {
        let luma = luma(image);
        let cells: Vec<f32> = squares(&luma, image.width, CELLS_ACROSS)
            .map(|square| square.mean)
            .collect();
        let darkest = cells.iter().copied().fold(f32::INFINITY, f32::min);
        let brightest = cells.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        Self {
            spread_levels: (brightest - darkest).max(0.0),
            background_share: background_share(&luma, image.width),
            cells,
        }
    }

    /// Returns the share of the cells, 0 to 1, that have changed since an earlier frame of the same size.
    pub(super) fn changed_share(&self, earlier: &[f32]) -> f32 {
        let pairs = self.cells.iter().zip(earlier);
        let changed = pairs.filter(|(now, before)| (*now - *before).abs() > CHANGED_LEVELS);
        changed.count() as f32 / self.cells.len().max(1) as f32
    }
}

/// Returns luma in 8-bit levels by the weights of BT.601.
fn luma(image: &Rgb8Image) -> Vec<u8> {
    let pixels = image.data.as_chunks::<3>().0.iter();
    pixels
        .map(|&[red, green, blue]| {
            let sum = 77 * u32::from(red) + 150 * u32::from(green) + 29 * u32::from(blue);
            ((sum + 128) >> 8) as u8
        })
        .collect()
}

/// A square of pixels.
struct Square {
    mean: f32,
    darkest: u8,
    brightest: u8,
}

/// Returns the whole squares of a `width / across`th of an image, by rows.
fn squares(luma: &[u8], width: usize, across: usize) -> impl Iterator<Item = Square> {
    let width = width.max(1);
    let height = luma.len() / width;
    let side = (width / across).clamp(1, height.max(1));
    let corners = (0..height / side).flat_map(move |y| (0..width / side).map(move |x| (x, y)));
    corners.map(move |(x, y)| {
        let (mut sum, mut darkest, mut brightest) = (0_u32, u8::MAX, u8::MIN);
        for row in y * side..(y + 1) * side {
            for &level in &luma[row * width + x * side..][..side] {
                sum += u32::from(level);
                darkest = darkest.min(level);
                brightest = brightest.max(level);
            }
        }
        Square {
            mean: sum as f32 / (side * side) as f32,
            darkest,
            brightest,
        }
    })
}

fn background_share(luma: &[u8], width: usize) -> f32 {
    let mut all = 0_u32;
    let mut by_level = [0_u32; 256];
    for square in squares(luma, width, BLOCKS_ACROSS) {
        all += 1;
        if square.brightest - square.darkest <= FLAT_LEVELS {
            by_level[square.mean.round() as usize] += 1;
        }
    }
    let around = |level: usize| {
        let last = (level + SAME_LEVELS).min(by_level.len() - 1);
        by_level[level.saturating_sub(SAME_LEVELS)..=last]
            .iter()
            .sum::<u32>()
    };
    let most = (0..by_level.len()).map(around).max().unwrap_or(0);
    most as f32 / all.max(1) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(level: impl Fn(usize, usize) -> u8) -> Rgb8Image {
        let (width, height) = (256, 128);
        Rgb8Image {
            width,
            height,
            data: (0..width * height)
                .flat_map(|at| [level(at % width, at / width); 3])
                .collect(),
        }
    }

    #[test]
    fn noise_is_no_contrast_and_letters_are() {
        let noise = Content::of(&image(|x, y| 16 + ((x * 7 + y * 13) % 4) as u8));
        assert!(noise.spread_levels < 3.0, "{noise:?}");
        assert!(noise.background_share > 0.99, "{noise:?}");
        let is_letter =
            |x: usize, y: usize| (96..160).contains(&x) && (60..68).contains(&y) && x % 8 < 4;
        let card = Content::of(&image(|x, y| if is_letter(x, y) { 240 } else { 20 }));
        assert!(card.spread_levels > 200.0, "{card:?}");
        assert!(card.background_share > 0.9, "{card:?}");
        let slope = Content::of(&image(|x, _| x as u8));
        assert!(slope.background_share < 0.1, "{slope:?}");
    }

    #[test]
    fn what_changes_is_counted_where_it_changes() {
        let with_square = |left: usize| {
            Content::of(&image(|x, y| {
                let inside = (left..left + 32).contains(&x) && (32..64).contains(&y);
                if inside { 200 } else { 30 }
            }))
        };
        let [before, after] = [with_square(0), with_square(128)];
        assert_eq!(before.changed_share(&before.cells), 0.0);
        // Two squares of 32 by 32 pixels in 256 by 128.
        assert!((after.changed_share(&before.cells) - 2.0 / 32.0).abs() < 1e-6);
    }
}
