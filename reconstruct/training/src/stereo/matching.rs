//! Matching cost of every pixel at every inverse distance.
//!
//! A pixel with the unit ray `r` at inverse distance `w` (per distance between the cameras) is seen by the other
//! camera in the direction `Q r + w s`. `Q` is the rotation between the cameras, and `s` the first centre in the
//! other camera's frame. The other image is brought onto the first one's grid for every `w`, and compared there
//! (`omnilife-stereo`). On one grid the cost does not depend on the cameras' rotation, also near the poles.

use std::f32::consts::TAU;

use glam::{Mat3, Vec3};
use omnilife_schemas::RgbImage;
use omnilife_stereo::{CostVolume, Matcher, RowEnds};
use rayon::prelude::*;

use crate::stereo::{
    SweepSettings,
    warp::{ErpRays, erp_pixel, sample},
};

/// Minimum and maximum number of hypotheses.
const COUNT: (usize, usize) = (16, 192);

/// The tried inverse distances: from infinity in equal steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Hypotheses {
    count: usize,
    largest: f32,
}

impl Hypotheses {
    pub(super) fn new(width: usize, settings: &SweepSettings) -> Self {
        let largest = 1.0 / settings.nearest_baselines;
        // A point at inverse distance w has a maximum parallax of w radians.
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

    /// Returns the difference between two hypotheses.
    pub(super) fn step(&self) -> f32 {
        self.largest / (self.count - 1) as f32
    }

    /// Returns the inverse distance at a number of steps, which may be a fraction.
    pub(super) fn inverse_distance(&self, steps: f32) -> f32 {
        steps * self.step()
    }
}

/// Returns the costs of `image` against `other`; `turn` and `shift` lead from its camera's frame to the other's.
pub(super) fn costs(
    image: &RgbImage,
    other: &RgbImage,
    turn: Mat3,
    shift: Vec3,
    hypotheses: &Hypotheses,
) -> CostVolume {
    let (width, height, count) = (image.width, image.height, hypotheses.count());
    let rays = ErpRays::new(width, height);
    let matcher = Matcher::new(image.data.as_chunks::<3>().0, width, RowEnds::Joined);
    let planes: Vec<Vec<u8>> = (0..count)
        .into_par_iter()
        .map(|hypothesis| {
            let shift = shift * hypotheses.inverse_distance(hypothesis as f32);
            let warped = warped(other, &rays, turn, shift, width, height);
            matcher.costs(warped.data.as_chunks::<3>().0)
        })
        .collect();
    CostVolume::of_planes(width, height, &planes)
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
