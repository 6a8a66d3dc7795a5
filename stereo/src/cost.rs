//! The matching cost of every pixel (AD-Census: Mei et al., On building an accurate stereo matching system
//! on graphics hardware, 2011):
//!
//! ```text
//! cost = (1 - exp(-difference / 10)) + (1 - exp(-census / 8))
//! ```
//!
//! with the mean absolute difference of the channels in 1/255 and the number of the 24 neighbours that are
//! darker than the pixel in one image and not in the other.

use rayon::prelude::*;

use crate::RowEnds;

/// Largest cost; the least is 0.
pub const LARGEST_COST: u8 = 254;
/// Difference of colours at which its part of the cost has reached 63 %, in 1/255.
const COLOUR_SCALE: f32 = 10.0;
/// The same for the number of differing neighbours.
const CENSUS_SCALE: f32 = 8.0;
/// Rows and columns of neighbours on each side.
const CENSUS_REACH: i64 = 2;

/// Costs by pixel: `count` values in a row for every pixel, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct CostVolume {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Hypotheses.
    pub count: usize,
    /// `width * height * count` values, 0 to [`LARGEST_COST`].
    pub costs: Vec<u8>,
}

impl CostVolume {
    /// Arranges the costs of all pixels by hypothesis.
    pub fn of_planes(width: usize, height: usize, planes: &[Vec<u8>]) -> Self {
        let count = planes.len();
        let mut costs = vec![0; width * height * count];
        costs
            .par_chunks_mut(width * count)
            .enumerate()
            .for_each(|(row, costs)| {
                for (column, costs) in costs.chunks_exact_mut(count).enumerate() {
                    for (cost, plane) in costs.iter_mut().zip(planes) {
                        *cost = plane[row * width + column];
                    }
                }
            });
        Self {
            width,
            height,
            count,
            costs,
        }
    }
}

/// The cost of a pixel that is missing in the other image.
pub const UNKNOWN_COST: u8 = u8::MAX;

/// An image of `C` channels (1 or 3, in [0, 1]), prepared for comparison with others.
#[derive(Debug)]
pub struct Matcher<'a, const C: usize> {
    pixels: &'a [[f32; C]],
    width: usize,
    census: Vec<u32>,
    ends: RowEnds,
    tables: Tables,
}

impl<'a, const C: usize> Matcher<'a, C> {
    /// Prepares an image: its pixels row by row.
    pub fn new(pixels: &'a [[f32; C]], width: usize, ends: RowEnds) -> Self {
        Self {
            pixels,
            width,
            census: census(pixels, width, ends),
            ends,
            tables: Tables::new(),
        }
    }

    /// Returns the cost of every pixel against an image of the same size on the same grid, 0 to [`LARGEST_COST`];
    /// [`UNKNOWN_COST`] for NaN.
    pub fn costs(&self, other: &[[f32; C]]) -> Vec<u8> {
        let census = census(other, self.width, self.ends);
        let pixels = self.pixels.iter().zip(other);
        let differences: Vec<f32> = pixels
            .map(|(a, b)| {
                let difference: f32 = a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum();
                difference * 255.0 / C as f32
            })
            .collect();
        combined(&differences, [&self.census, &census], &self.tables)
    }
}

/// Combines the costs of colour differences, in 1/255, and of the census bits of both images.
#[multiversion::multiversion(targets("x86_64+avx2+popcnt"))]
fn combined(differences: &[f32], [a, b]: [&[u32]; 2], tables: &Tables) -> Vec<u8> {
    differences
        .iter()
        .zip(a.iter().zip(b))
        .map(|(difference, (a, b))| {
            let differing = (a ^ b).count_ones() as usize;
            let cost = tables.colour[difference.min(255.0) as usize] + tables.census[differing];
            if difference.is_nan() {
                UNKNOWN_COST
            } else {
                cost
            }
        })
        .collect()
}

/// Returns for every pixel one bit for each of its 24 neighbours: set if it exists and is darker.
fn census<const C: usize>(pixels: &[[f32; C]], width: usize, ends: RowEnds) -> Vec<u32> {
    let height = pixels.len() / width;
    let grey: Vec<f32> = pixels
        .iter()
        .map(|pixel| match pixel[..] {
            [red, green, blue] => 0.299 * red + 0.587 * green + 0.114 * blue,
            _ => pixel[0],
        })
        .collect();
    let mut bits = vec![0; width * height];
    for row in 0..height as i64 {
        for step_y in -CENSUS_REACH..=CENSUS_REACH {
            let other_row = (row + step_y).clamp(0, height as i64 - 1) as usize;
            for step_x in -CENSUS_REACH..=CENSUS_REACH {
                if step_x == 0 && step_y == 0 {
                    continue;
                }
                let line = &grey[other_row * width..(other_row + 1) * width];
                let (before, after) = line.split_at(step_x.rem_euclid(width as i64) as usize);
                let begin = row as usize * width;
                let (bits, grey) = (&mut bits[begin..begin + width], &grey[begin..begin + width]);
                let (bits_of_after, bits_of_before) = bits.split_at_mut(after.len());
                let (grey_of_after, grey_of_before) = grey.split_at(after.len());
                // For a step to the left, `after` is beyond the end; for one to the right, `before`.
                let is_open = ends == RowEnds::Open;
                add_bits(bits_of_after, grey_of_after, after, is_open && step_x < 0);
                add_bits(
                    bits_of_before,
                    grey_of_before,
                    before,
                    is_open && step_x > 0,
                );
            }
        }
    }
    bits
}

#[multiversion::multiversion(targets("x86_64+avx2"))]
fn add_bits(bits: &mut [u32], grey: &[f32], neighbours: &[f32], are_beyond: bool) {
    if are_beyond {
        bits.iter_mut().for_each(|bits| *bits <<= 1);
        return;
    }
    for ((bits, grey), neighbour) in bits.iter_mut().zip(grey).zip(neighbours) {
        *bits = (*bits << 1) | u32::from(neighbour < grey);
    }
}

/// The two parts of the cost, tabulated over their arguments.
#[derive(Debug)]
struct Tables {
    colour: [u8; 256],
    census: [u8; 25],
}

impl Tables {
    fn new() -> Self {
        let part = |value: usize, scale: f32| {
            let share = 1.0 - (-(value as f32) / scale).exp();
            (f32::from(LARGEST_COST / 2) * share).round() as u8
        };
        Self {
            colour: std::array::from_fn(|value| part(value, COLOUR_SCALE)),
            census: std::array::from_fn(|value| part(value, CENSUS_SCALE)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 12;

    fn image() -> Vec<[f32; 3]> {
        (0..12 * 7)
            .map(|at| [f32::from((at * 37 % 101) as u8) / 101.0; 3])
            .collect()
    }

    #[test]
    fn an_image_costs_nothing_against_itself_and_most_against_its_opposite() {
        let image = image();
        let opposite: Vec<[f32; 3]> = image.iter().map(|pixel| pixel.map(|v| 1.0 - v)).collect();
        for ends in [RowEnds::Joined, RowEnds::Open] {
            let matcher = Matcher::new(&image, WIDTH, ends);
            assert!(matcher.costs(&image).iter().all(|&cost| cost == 0));
            let costs = matcher.costs(&opposite);
            let mean = costs.iter().map(|&cost| f32::from(cost)).sum::<f32>() / 84.0;
            assert!(mean > 0.75 * f32::from(LARGEST_COST), "{mean}");
        }
    }

    #[test]
    fn what_is_not_shown_has_no_cost() {
        let image = image();
        let mut other = image.clone();
        other[40] = [f32::NAN; 3];
        let costs = Matcher::new(&image, WIDTH, RowEnds::Open).costs(&other);
        let unknown: Vec<usize> = (0..84).filter(|&at| costs[at] == UNKNOWN_COST).collect();
        assert_eq!(unknown, [40]);
    }

    /// Compares the bits with the definition.
    #[test]
    fn census_bits_are_of_the_neighbours_that_are_there() {
        let image = image();
        let grey = |x: i64, y: i64| image[(y * 12 + x) as usize][0];
        for ends in [RowEnds::Joined, RowEnds::Open] {
            let bits = census(&image, WIDTH, ends);
            for y in 0..7_i64 {
                for x in 0..12_i64 {
                    let mut expected = 0_u32;
                    for step_y in -2..=2 {
                        for step_x in (-2..=2).filter(|&step_x| step_x != 0 || step_y != 0) {
                            let is_there =
                                ends == RowEnds::Joined || (0..12).contains(&(x + step_x));
                            let other = grey((x + step_x).rem_euclid(12), (y + step_y).clamp(0, 6));
                            expected = (expected << 1) | u32::from(is_there && other < grey(x, y));
                        }
                    }
                    assert_eq!(bits[(y * 12 + x) as usize], expected, "{ends:?} {x} {y}");
                }
            }
        }
    }
}
