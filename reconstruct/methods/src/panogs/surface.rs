//! Fused surface of all views, and the distances of their samples from it.

use omnilife_engine::losses::scaffold::{Scaffold, fuse::FusedView};

use glam::Vec3;

use super::samples::Samples;
use omnilife_training::{components::Decision, seeds::depth::incidence};

/// Minimum share of the samples that are off by more than a voxel, for a loss on the field.
const LEAST_MISREGISTERED: f64 = 0.01;

/// The field with its measures of the samples.
#[derive(Debug)]
pub(super) struct Surface {
    pub(super) field: Scaffold,
    /// Share of the samples with a value that are farther than a voxel from the surface.
    pub(super) misregistered: f64,
    /// Mean signed distance of each view's samples, in voxels.
    pub(super) bias_voxels: Vec<f64>,
}

impl Surface {
    /// Fuses the views' distances; a voxel is as wide as the median radius of a sample.
    pub(super) fn of(samples: &Samples) -> Self {
        let incidences: Vec<Vec<f32>> = samples.distance_views().iter().map(incidence).collect();
        let fused: Vec<FusedView<'_>> = samples
            .views
            .iter()
            .zip(&incidences)
            .map(|(source, incidence)| FusedView {
                view: &source.view.view,
                distances: &source.distances,
                incidence,
            })
            .collect();
        let field = Scaffold::fuse(&fused, samples.median_radius, Vec3::ZERO);
        let (mut off, mut known) = (0_usize, 0_usize);
        let mut bias = vec![(0_usize, 0.0); samples.views.len()];
        let positions = samples.gaussians.positions.iter();
        for (&position, &view) in positions.zip(&samples.view_of) {
            if let Some(value) = field.value(Vec3::from_array(position)) {
                let voxels = f64::from(value.distance / field.voxel);
                known += 1;
                off += usize::from(voxels.abs() > 1.0);
                let (count, sum) = &mut bias[view as usize];
                *count += 1;
                *sum += voxels;
            }
        }
        Self {
            field,
            misregistered: off as f64 / known.max(1) as f64,
            bias_voxels: bias
                .into_iter()
                .map(|(count, sum)| sum / count.max(1) as f64)
                .collect(),
        }
    }

    /// Decides on the scaffold by the share of samples that are off.
    pub(super) fn decision(&self) -> Decision {
        let most = self
            .bias_voxels
            .iter()
            .copied()
            .fold(
                0.0,
                |most: f64, bias| {
                    if bias.abs() > most.abs() { bias } else { most }
                },
            );
        let reason = format!(
            "{:.1} % of the samples are more than a voxel from the fused surface (limit {:.0} %); a \
             view's mean is at most {most:+.2} voxels off; {:.0} MB",
            100.0 * self.misregistered,
            100.0 * LEAST_MISREGISTERED,
            self.field.bytes() as f64 / 1e6
        );
        Decision::new(self.misregistered > LEAST_MISREGISTERED, reason)
    }
}
