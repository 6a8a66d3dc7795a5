//! What training knows of time; static methods have none of it.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::{
    camera::View,
    clock::Clock,
    gaussians::{
        temporal::{TemporalFeatures, TimeModel},
        temporal_gaussians::TemporalGaussians,
    },
};

/// Time, motion and what is demanded of them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DynamicSettings {
    /// From seconds to frames.
    pub clock: Clock,
    /// How Gaussians depend on time.
    pub time: TimeModel,
    /// The mean vertical of the input cameras, from zenith to nadir.
    pub down: [f32; 3],
    /// `theta_dgm`: Gaussians whose staticness is below it are dynamic.
    pub dynamic_below_staticness: f32,
    /// Dynamic Gaussians alone against the masked images.
    pub dynamic_loss: Option<DynamicLoss>,
    /// Velocity regularization.
    pub velocity_loss: Option<VelocityLoss>,
    /// Weight of the lifespan loss (PVG); 0 for none.
    pub lifespan_weight: f32,
    /// What is rendered beside colours for these losses.
    pub features: TemporalFeatures,
    /// Weight of the motion regularization of static Gaussians; 0 for none.
    pub motion_weight: f32,
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
    /// First iteration of the schedule that has it.
    pub begin_iteration: u64,
}

/// `L_v` (Omni4DGS Eq. 9, PVG).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct VelocityLoss {
    /// Its weight.
    pub weight: f32,
    /// Whether it holds only outside the masks; elsewhere views without a mask do not have it.
    pub outside_masks: bool,
}

/// Renders of another moment, moved on, against a view's image (PVG).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TemporalSmoothing {
    /// Share of the steps that have it.
    pub probability: f64,
    /// Moments are drawn evenly within this many frames before and after the view's.
    pub reach_frames: f32,
}

/// Density control in time (PVG `scene/gaussian_model.py`), with `|dL/dtau|`: the mean of signed
/// gradients, which PVG takes, cancels what one view pulls against what another one pushes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TemporalDensity {
    /// Mean `|dL/dtau|` per frame from which a Gaussian is cloned or split.
    pub gradient_threshold: f32,
    /// Lifespan up to which it is cloned, frames.
    pub clone_lifespan_frames: f32,
    /// Iteration of the schedule from which a split shortens lifespans and has three children.
    pub shorten_from_iteration: u64,
}

impl TemporalDensity {
    /// Whether splits shorten lifespans by an iteration of the schedule.
    pub(crate) fn shortens(&self, scheduled: u64) -> bool {
        scheduled >= self.shorten_from_iteration
    }
}

impl DynamicSettings {
    /// The parameterization of the Gaussians that these settings are of.
    pub fn parameterization(&self) -> TemporalGaussians {
        TemporalGaussians {
            clock: self.clock,
            time: self.time,
            down: self.down,
            dynamic_below_staticness: self.dynamic_below_staticness,
        }
    }
}

/// The mean vertical of some views; the world's y axis where they cancel.
pub fn mean_vertical<'a>(views: impl Iterator<Item = &'a View>) -> [f32; 3] {
    let sum: Vec3 = views.map(|view| view.rotation.transpose() * Vec3::Y).sum();
    sum.normalize_or(Vec3::Y).to_array()
}
