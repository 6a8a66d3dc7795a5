//! Training settings of dynamic methods; static methods have none.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::{
    camera::{Camera, CameraKernels, View},
    clock::Clock,
    gaussians::{
        temporal::{TemporalFeatures, TimeModel},
        temporal_gaussians::TemporalGaussians,
    },
};

/// Time, motion and their losses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DynamicSettings {
    /// Conversion from seconds to frames.
    pub clock: Clock,
    /// Dependence of Gaussians on time.
    pub time: TimeModel,
    /// The mean vertical of the input cameras, from zenith to nadir.
    pub down: [f32; 3],
    /// `theta_dgm`: Gaussians whose staticness is below it are dynamic.
    pub dynamic_below_staticness: f32,
    /// Loss of the dynamic Gaussians alone against the masked images.
    pub dynamic_loss: Option<DynamicLoss>,
    /// Velocity regularization.
    pub velocity_loss: Option<VelocityLoss>,
    /// Weight of the lifespan loss (PVG); 0 disables it.
    pub lifespan_weight: f32,
    /// Feature channels that these losses need.
    pub features: TemporalFeatures,
    /// Motion regularization of static Gaussians.
    pub motion_loss: Option<MotionLoss>,
    /// Temporal smoothing.
    pub smoothing: Option<TemporalSmoothing>,
    /// Density control in time.
    pub density: Option<TemporalDensity>,
}

/// `L_d + L_o` (Omni4DGS Eqs. 4, 6, 7).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DynamicLoss {
    /// Weight of the sum, `lambda_dyn`.
    pub weight: f32,
    /// Weight of `1 - SSIM` against L1 within `L_d`.
    pub ssim_weight: f32,
    /// First iteration of the schedule with this loss.
    pub begin_iteration: u64,
}

/// `L_v` (Omni4DGS Eq. 9, PVG).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct VelocityLoss {
    /// Weight of the loss.
    pub weight: f32,
    /// True if it applies only outside the masks; then views without a mask do not have it.
    pub outside_masks: bool,
}

/// `L_m` (Omni4DGS Eqs. 10, 11).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MotionLoss {
    /// Weight of the loss, `lambda_m`.
    pub weight: f32,
    /// Sum over the static Gaussians.
    pub form: MotionForm,
}

/// Sum of the motion regularization over the static Gaussians.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MotionForm {
    /// The published form, a mean over all of them of squared radians per frame. The gradient of one Gaussian falls
    /// with their number.
    Mean,
    /// A sum over those in the view's image, of squared pixels per frame, over the number of pixels. One Gaussian
    /// counts as one pixel of the photometric loss.
    Seen,
}

impl MotionLoss {
    /// Returns the weight of the squared radians per frame of each of so many Gaussians.
    pub(crate) fn of_each(&self, gaussians: usize, camera: &Camera) -> f32 {
        match self.form {
            MotionForm::Mean => self.weight / gaussians.max(1) as f32,
            MotionForm::Seen => {
                let [width, height] = camera.size();
                self.weight / ((width * height) as f32 * camera.pixel_radians().powi(2))
            }
        }
    }
}

/// Temporal smoothing: renders of another moment, moved on, compared with a view's image (PVG).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TemporalSmoothing {
    /// Share of the steps with smoothing.
    pub probability: f64,
    /// Moments are drawn uniformly within this many frames before and after the view's.
    pub reach_frames: f32,
}

/// Density control in time (PVG `scene/gaussian_model.py`), with `|dL/dtau|`. PVG takes the mean of signed
/// gradients, in which opposite pulls of different views cancel.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TemporalDensity {
    /// Mean `|dL/dtau|` per frame at which a Gaussian is cloned or split.
    pub gradient_threshold: f32,
    /// Lifespan up to which it is cloned, and above which it is split, frames.
    pub clone_lifespan_frames: f32,
    /// Iteration of the schedule from which a split shortens lifespans and has three children.
    pub shorten_from_iteration: u64,
}

impl TemporalDensity {
    /// Returns true if splits shorten lifespans at an iteration of the schedule.
    pub(crate) fn shortens(&self, scheduled: u64) -> bool {
        scheduled >= self.shorten_from_iteration
    }
}

impl DynamicSettings {
    /// Returns the parameterization of Gaussians with these settings.
    pub fn parameterization(&self) -> TemporalGaussians {
        TemporalGaussians {
            clock: self.clock,
            time: self.time,
            down: self.down,
            dynamic_below_staticness: self.dynamic_below_staticness,
        }
    }
}

/// Returns the mean vertical of some views, from zenith to nadir; the world's y axis where they cancel.
pub fn mean_vertical<'a>(views: impl Iterator<Item = &'a View>) -> [f32; 3] {
    let sum: Vec3 = views.map(|view| view.rotation.transpose() * Vec3::Y).sum();
    sum.normalize_or(Vec3::Y).to_array()
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::camera::ErpCamera;

    use super::*;

    #[test]
    fn a_gaussian_that_moves_by_a_pixel_costs_a_pixel_however_many_there_are() {
        let camera = Camera::Erp(ErpCamera::new(128, 64));
        let loss = |form| MotionLoss { weight: 0.5, form };
        let pixel = std::f32::consts::PI / 64.0;
        for gaussians in [0, 1, 1_000, 1_000_000] {
            let cost = loss(MotionForm::Seen).of_each(gaussians, &camera) * pixel * pixel;
            assert!((cost * 128.0 * 64.0 - 0.5).abs() < 1e-6, "{cost}");
            let mean = loss(MotionForm::Mean).of_each(gaussians, &camera);
            assert_eq!(mean, 0.5 / gaussians.max(1) as f32);
        }
    }
}
