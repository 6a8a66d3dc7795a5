//! The matching cost of every pixel at every inverse distance.
//!
//! A pixel with the unit ray `r` at inverse distance `w` (per distance between the cameras) is seen
//! by the other camera in the direction `Q r + w s`, with the rotation `Q` between the cameras and
//! the first centre `s` in the other camera's frame. The other image is brought onto the first one's
//! grid for every `w`, and compared there (AD-Census: Mei et al., On building an accurate stereo
//! matching system on graphics hardware, 2011):
//!
//! ```text
//! cost = (1 - exp(-difference / 10)) + (1 - exp(-census / 8))
//! ```
//!
//! with the mean absolute difference of the channels in 1/255 and the number of the 24 neighbours
//! that are darker than the pixel in one image and not in the other. Comparing on one grid makes the
//! cost indifferent to how the cameras are turned, also near the poles.

use std::f32::consts::TAU;

use glam::{Mat3, Vec3};
use omnilife_schemas::RgbImage;
use rayon::prelude::*;

use crate::stereo::SweepSettings;
use crate::stereo::warp::{ErpRays, erp_pixel, sample};

/// Costs are 0 to this.
pub(super) const LARGEST_COST: u8 = 254;
/// Difference of colours at which its part of the cost has reached 63 %, in 1/255.
const COLOUR_SCALE: f32 = 10.0;
/// The same for differing neighbours.
const CENSUS_SCALE: f32 = 8.0;
/// Rows and columns of neighbours on each side.
const CENSUS_REACH: i64 = 2;
/// Hypotheses, at least and at most.
const COUNT: (usize, usize) = (16, 192);

/// The inverse distances that are tried: from infinity in equal steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Hypotheses {
    count: usize,
    largest: f32,
}

impl Hypotheses {
    pub(super) fn new(width: usize, settings: &SweepSettings) -> Self {
        let largest = 1.0 / settings.nearest_baselines;
        // A point at inverse distance w has a parallax of w radians where it is largest.
        let parallax = largest * width as f32 / TAU;
        let steps = (parallax / settings.step_pixels).ceil() as usize;
        Self {
            count: (steps + 1).clamp(COUNT.0, COUNT.1),
            largest,
        }
    }

    pub(super) fn count(&self) -> usize {
        self.count
    }

    /// From one hypothesis to the next.
    pub(super) fn step(&self) -> f32 {
        self.largest / (self.count - 1) as f32
    }

    /// The inverse distance at a number of steps, which may be a fraction.
    pub(super) fn inverse_distance(&self, steps: f32) -> f32 {
        steps * self.step()
    }
}

/// Costs by pixel: `count` values in a row for every pixel, row by row.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct CostVolume {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) count: usize,
    pub(super) costs: Vec<u8>,
}

/// The costs of `image` against `other`; `turn` and `shift` lead from its camera's frame to the
/// other's.
pub(super) fn costs(
    image: &RgbImage,
    other: &RgbImage,
    turn: Mat3,
    shift: Vec3,
    hypotheses: &Hypotheses,
) -> CostVolume {
    let (width, height, count) = (image.width, image.height, hypotheses.count());
    let rays = ErpRays::new(width, height);
    let tables = Tables::new();
    let census = census(image);
    let planes: Vec<Vec<u8>> = (0..count)
        .into_par_iter()
        .map(|hypothesis| {
            let shift = shift * hypotheses.inverse_distance(hypothesis as f32);
            let warped = warped(other, &rays, turn, shift, width, height);
            plane(image, &census, &warped, &tables)
        })
        .collect();
    let mut costs = vec![0; width * height * count];
    costs
        .par_chunks_mut(width * count)
        .enumerate()
        .for_each(|(row, costs)| {
            for (column, costs) in costs.chunks_exact_mut(count).enumerate() {
                for (cost, plane) in costs.iter_mut().zip(&planes) {
                    *cost = plane[row * width + column];
                }
            }
        });
    CostVolume {
        width,
        height,
        count,
        costs,
    }
}

fn warped(
    other: &RgbImage,
    rays: &ErpRays,
    turn: Mat3,
    shift: Vec3,
    width: usize,
    height: usize,
) -> RgbImage {
    let mut warped = RgbImage::black(width, height);
    for row in 0..height {
        let line = &mut warped.data[row * width * 3..(row + 1) * width * 3];
        for (column, pixel) in line.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let direction = turn * rays.ray(column, row) + shift;
            *pixel = sample(other, erp_pixel(direction, width as f32, height as f32));
        }
    }
    warped
}

fn plane(image: &RgbImage, census_of_image: &[u32], warped: &RgbImage, tables: &Tables) -> Vec<u8> {
    let census_of_warped = census(warped);
    image
        .data
        .as_chunks::<3>()
        .0
        .iter()
        .zip(warped.data.as_chunks::<3>().0)
        .zip(census_of_image.iter().zip(&census_of_warped))
        .map(|((a, b), (census_a, census_b))| {
            let difference: f32 = a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum();
            let differing = (census_a ^ census_b).count_ones() as usize;
            tables.colour[(difference * 255.0 / 3.0).min(255.0) as usize] + tables.census[differing]
        })
        .collect()
}

/// For every pixel, one bit for each of its 24 neighbours: whether it is darker.
fn census(image: &RgbImage) -> Vec<u32> {
    let (width, height) = (image.width, image.height);
    let grey: Vec<f32> = image
        .data
        .as_chunks::<3>()
        .0
        .iter()
        .map(|[red, green, blue]| 0.299 * red + 0.587 * green + 0.114 * blue)
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
                // The row is a circle: what is beyond its end is its beginning.
                let (before, after) = line.split_at(step_x.rem_euclid(width as i64) as usize);
                let begin = row as usize * width;
                let (bits, grey) = (&mut bits[begin..begin + width], &grey[begin..begin + width]);
                let (bits_of_after, bits_of_before) = bits.split_at_mut(after.len());
                let (grey_of_after, grey_of_before) = grey.split_at(after.len());
                add_bits(bits_of_after, grey_of_after, after);
                add_bits(bits_of_before, grey_of_before, before);
            }
        }
    }
    bits
}

fn add_bits(bits: &mut [u32], grey: &[f32], neighbours: &[f32]) {
    for ((bits, grey), neighbour) in bits.iter_mut().zip(grey).zip(neighbours) {
        *bits = (*bits << 1) | u32::from(neighbour < grey);
    }
}

/// The two parts of the cost for every value of what they depend on.
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
