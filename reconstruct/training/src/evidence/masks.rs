//! Evidence of motion in masks.

use std::{f64::consts::PI, fmt};

use omnilife_engine::camera::Camera;
use omnilife_schemas::mask_survey::INVERTED_SHARE;
use rayon::prelude::*;
use serde::Serialize;

use crate::{
    scene::{TrainingScene, mask_pieces::pieces},
    seeds::depth::lift::pixel_steradians,
};

/// Minimum share of the visible directions for a connected patch larger than a speck: 1.0e-3 sr of the whole
/// sphere, a spot of two degrees. A person 20 m away, two degrees wide and five high, has three times as much.
const LEAST_PATCH_SHARE: f64 = 8e-5;
/// Minimum number of pixels of such a patch. One pixel of a small image is as large as a person, and as large as the
/// noise of a segmenter.
const LEAST_PATCH_PIXELS: usize = 2;
/// Minimum number of views with such a patch: a moving object is visible for longer than an instant.
const LEAST_SHOWING_VIEWS: usize = 2;

/// Coverage of the input views by masks.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MaskEvidence {
    /// Input views.
    pub views: usize,
    /// Input views with a mask.
    pub masked_views: usize,
    /// Input views with a mask that marks more than specks.
    pub showing_views: usize,
    /// Mean share of the sphere that the masks cover, 0 to 1; `None` without masks.
    pub coverage: Option<f64>,
    /// Standard error of that mean over the masks; `None` for fewer than two.
    pub coverage_error: Option<f64>,
}

impl MaskEvidence {
    /// Measures the input views of a scene.
    pub fn of(scene: &TrainingScene) -> Self {
        let views = &scene.input_views;
        let masks: Vec<&[u8]> = views
            .iter()
            .filter_map(|view| view.mask.as_deref())
            .collect();
        Self {
            views: views.len(),
            masked_views: masks.len(),
            showing_views: showing_views(&masks, &scene.camera),
            coverage: scene.mask_coverage(),
            coverage_error: standard_error(&covered_shares(&masks, &scene.camera)),
        }
    }

    /// Returns true if masks show motion. Empty masks, or masks with specks alone, may have missed it.
    pub fn show_something(&self) -> bool {
        self.showing_views >= LEAST_SHOWING_VIEWS
    }

    /// Returns true if masks mark too little for motion.
    fn are_noise(&self) -> bool {
        self.coverage.is_some_and(|coverage| coverage > 0.0) && !self.show_something()
    }

    /// Returns warnings of the run: masks that look inverted, and masks that are taken for noise.
    pub(crate) fn warnings(&self) -> Vec<String> {
        let inverted = self.coverage.filter(|&coverage| coverage > INVERTED_SHARE);
        let inverted = inverted.map(|coverage| {
            format!(
                "the masks cover {:.0} % of the sphere: they look inverted (white is what moves)",
                100.0 * coverage
            )
        });
        let noise = self
            .are_noise()
            .then(|| format!("the masks are taken for noise, as if there were none: {self}"));
        inverted.into_iter().chain(noise).collect()
    }
}

/// Returns the marked share of what the camera sees, mask by mask, 0 to 1.
fn covered_shares(masks: &[&[u8]], camera: &Camera) -> Vec<f64> {
    let seen = seen_steradians(camera);
    let [width, height] = camera.size();
    let solid_angles: Vec<f64> = match camera {
        // All pixels of a row have the same.
        Camera::Erp(_) => (0..height)
            .flat_map(|row| std::iter::repeat_n(pixel_steradians(camera, row * width), width))
            .collect(),
        Camera::Pinhole(_) => (0..width * height)
            .map(|pixel| pixel_steradians(camera, pixel))
            .collect(),
    };
    let share = |mask: &&[u8]| -> f64 {
        let marked = mask.iter().zip(&solid_angles);
        let steradians = marked.map(|(&mark, solid_angle)| f64::from(mark) / 255.0 * solid_angle);
        steradians.sum::<f64>() / seen
    };
    masks.par_iter().map(share).collect()
}

/// Returns the standard error of the mean; `None` for fewer than two values.
fn standard_error(values: &[f64]) -> Option<f64> {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    (values.len() >= 2).then(|| (squares / (count * (count - 1.0))).sqrt())
}

/// Counts the masks with a patch that is more than a speck.
fn showing_views(masks: &[&[u8]], camera: &Camera) -> usize {
    let least = LEAST_PATCH_SHARE * seen_steradians(camera);
    let largest = masks
        .par_iter()
        .map(|mask| largest_patch_steradians(mask, camera));
    largest.filter(|&patch| patch >= least).count()
}

/// Returns the solid angle of the largest connected patch of a mask, steradians; pixels count by the share of them
/// that is marked, single ones do not. All patches at a pole of a panorama are one: the outermost row is one place.
fn largest_patch_steradians(mask: &[u8], camera: &Camera) -> f64 {
    let size = camera.size();
    let (mut largest, mut at_poles) = (0.0_f64, [0.0; 2]);
    for piece in pieces(mask, size, camera.wraps(), 1) {
        let steradians = |&pixel: &usize| {
            let share = f64::from(mask[pixel]) / 255.0;
            share * pixel_steradians(camera, pixel)
        };
        if piece.len() < LEAST_PATCH_PIXELS {
            continue;
        }
        let patch: f64 = piece.iter().map(steradians).sum();
        largest = largest.max(patch);
        if camera.wraps() {
            let rows = [piece.first(), piece.last()].map(|end| end.map(|pixel| pixel / size[0]));
            for (sum, (row, of_pole)) in at_poles
                .iter_mut()
                .zip(rows.into_iter().zip([0, size[1] - 1]))
            {
                if row == Some(of_pole) {
                    *sum += patch;
                }
            }
        }
    }
    at_poles.into_iter().fold(largest, f64::max)
}

/// Returns the solid angle of a camera's image, steradians.
fn seen_steradians(camera: &Camera) -> f64 {
    let [width, height] = camera.size();
    match camera {
        Camera::Erp(_) => 4.0 * PI,
        Camera::Pinhole(_) => (0..width * height)
            .map(|pixel| pixel_steradians(camera, pixel))
            .sum(),
    }
}

impl fmt::Display for MaskEvidence {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(coverage) = self.coverage else {
            return out.write_str("no input view has a mask");
        };
        write!(
            out,
            "{} of {} input views have masks, which cover {:.2} % of the sphere",
            self.masked_views,
            self.views,
            100.0 * coverage
        )?;
        if let Some(error) = self.coverage_error {
            write!(
                out,
                " (standard error over the views {:.2} %)",
                100.0 * error
            )?;
        }
        write!(
            out,
            "; those of {} views mark a patch of {LEAST_PATCH_PIXELS} pixels and {:.3} % of what the camera sees or \
             more (limit {LEAST_SHOWING_VIEWS} views)",
            self.showing_views,
            100.0 * LEAST_PATCH_SHARE
        )?;
        if coverage > INVERTED_SHARE {
            out.write_str("; they look inverted: white is what moves")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
