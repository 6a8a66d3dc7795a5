//! Limit of sizes in training.
//!
//! A view leaves out a Gaussian whose largest axis is at least as long as its distance
//! ([`crate::render::project`]). There it has no gradient, and nothing makes it smaller again. Where others do
//! not cover its place the image stays dark, so that these grow into the hole until they are left out too. A step
//! therefore cuts the axes of such a Gaussian to half of its distance before it draws its view. Density control
//! removes larger ones, but it ends in the middle of a run. A Gaussian that the view draws keeps its bits.
//!
//! `size_limit.wgsl` is the same for a GPU.

use glam::Vec3;
use rayon::prelude::*;

use super::settings::TrainSettings;
use crate::{
    camera::{CameraKernels, View},
    gaussians::{ActivatedGaussians, static_gaussians::LOG_SCALES},
    model::{Model, Part},
    render::settings::{ALPHA_MIN, Footprint, RendererChoice},
};

/// Axes of a Gaussian that was too large for a view, over its distance. Density control of the baseline removes
/// Gaussians above the same share.
pub(super) const CUT_SHARE: f32 = 0.5;
/// Gaussians per parallel piece of work, at least.
const LEAST_PIECE: usize = 4096;

/// Limit of the sizes in a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SizeLimit {
    /// Centres nearer than this, normalized units, are not drawn at any size.
    near: f32,
}

impl SizeLimit {
    /// Returns the limit for a model under these settings. `None` if the renderer draws all sizes, sizes are
    /// frozen, a network adds to them, or shards learn one after another.
    pub(super) fn of(model: &Model, settings: &TrainSettings) -> Option<Self> {
        let leaves_out = settings.renderer == RendererChoice::Exact
            && settings.rendering.footprint == Footprint::Projected;
        let learns = |part: &Part| {
            let sizes = part.table.arrays.get(LOG_SCALES);
            sizes.is_some_and(|sizes| !sizes.is_frozen())
        };
        let sizes_learn = settings.shards.is_none()
            && settings.deformation.is_none()
            && model.parts.iter().all(learns);
        (leaves_out && sizes_learn).then_some(Self {
            near: settings.rendering.near,
        })
    }

    /// Cuts the Gaussians that are too large for a view, in the model and as activated for the view, and forgets
    /// the first moments of the axes that it cuts.
    pub(super) fn cut(self, model: &mut Model, activated: &mut ActivatedGaussians, view: &View) {
        let ActivatedGaussians {
            positions,
            scales,
            opacities,
            ..
        } = activated;
        let mut first = 0;
        for Part { table, .. } in &mut model.parts {
            let entries = first..first + table.len();
            first = entries.end;
            let sizes = &mut table.arrays[LOG_SCALES];
            (
                sizes.values.par_chunks_exact_mut(3),
                sizes.first_moments.par_chunks_exact_mut(3),
                scales[entries.clone()].par_iter_mut(),
                positions[entries.clone()].par_iter(),
                opacities[entries].par_iter(),
            )
                .into_par_iter()
                .with_min_len(LEAST_PIECE)
                .for_each(|(logarithms, moments, scale, &position, &opacity)| {
                    if opacity >= ALPHA_MIN
                        && let Some(distance) = self.exceeded(view, position, *scale)
                    {
                        cut_axes(logarithms, moments, scale, CUT_SHARE * distance);
                    }
                });
        }
    }

    /// Returns the distance of a Gaussian that a view would draw if it were smaller.
    fn exceeded(self, view: &View, position: [f32; 3], [x, y, z]: [f32; 3]) -> Option<f32> {
        // The length of the rotated offset, which the render compares.
        let point = view.rotation * (Vec3::from_array(position) - view.centre);
        let distance = point.length();
        let is_too_large = x.max(y).max(z) >= distance;
        let is_left_out = is_too_large && view.camera.sees(point, distance, self.near);
        is_left_out.then_some(distance)
    }
}

/// Cuts the axes above a limit.
fn cut_axes(logarithms: &mut [f32], moments: &mut [f32], scale: &mut [f32; 3], limit: f32) {
    for ((logarithm, moment), axis) in logarithms.iter_mut().zip(moments).zip(scale) {
        if *axis > limit {
            *logarithm += (limit / *axis).ln();
            *moment = 0.0;
            *axis = limit;
        }
    }
}

#[cfg(test)]
mod tests;
