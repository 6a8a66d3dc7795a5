//! Parameterization: the map from raw parameters to activated Gaussians, and its VJP.
//!
//! To add one, implement [`Parameterization`] for a type in a file of its own, which documents the meaning of
//! the parameters. A [`crate::model::Part`] built with it can be trained on the CPU, and on a GPU if it has a
//! [`DeviceTwin`], whose module documents the kernels.

use std::fmt;

use glam::Vec3;

use super::{
    ActivatedGaussians, device_twin::DeviceTwin, temporal::TemporalFeatures,
    temporal_gaussians::TemporalGaussians, tracked::ObjectGaussians,
};
use crate::{
    camera::View,
    clock::TimeSpan,
    parameters::{ParameterTable, SharedParameters},
};

/// Time and camera position at which Gaussians are activated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Viewpoint {
    /// Presentation time of the view, seconds.
    pub seconds: f64,
    /// Temporal shift: frames before that time at which the Gaussians are activated.
    pub shift_frames: f32,
    /// Centre of the camera, normalized units.
    pub centre: Vec3,
    /// The camera's vertical in the world, from zenith to nadir; a unit vector.
    pub down: Vec3,
    /// Iteration of the schedule, in training; `None` for rendering without training.
    pub scheduled: Option<u64>,
}

impl Viewpoint {
    /// Creates the viewpoint of a view for rendering without training.
    pub fn of_image(view: &View) -> Self {
        Self {
            seconds: view.time_seconds,
            shift_frames: 0.0,
            centre: view.centre,
            down: view.rotation.transpose() * Vec3::Y,
            scheduled: None,
        }
    }

    /// Creates a viewpoint of a moment without a camera.
    pub fn of_moment(seconds: f64) -> Self {
        Self {
            seconds,
            shift_frames: 0.0,
            centre: Vec3::ZERO,
            down: Vec3::Y,
            scheduled: None,
        }
    }

    /// Creates the viewpoint of a training step.
    pub fn of_step(view: &View, shift_frames: f32, scheduled: u64) -> Self {
        Self {
            shift_frames,
            scheduled: Some(scheduled),
            ..Self::of_image(view)
        }
    }
}

/// Map from the raw parameters of a table, and from parameters shared by all its Gaussians, to activated
/// Gaussians.
pub trait Parameterization: fmt::Debug + Send {
    /// Returns the name in messages and checkpoints.
    fn id(&self) -> &'static str;

    /// Activates a table into the entries of `out` from `first` on, for which `out` has room; `features` are
    /// its feature channels.
    fn activate(
        &mut self,
        table: &ParameterTable,
        at: &Viewpoint,
        features: &TemporalFeatures,
        first: usize,
        out: &mut ActivatedGaussians,
    );

    /// Computes the VJP of [`Parameterization::activate`], whose last call had the same arguments: overwrites
    /// the gradients of the table and of the shared parameters. The entries of `activated` and `gradient` are
    /// consumed.
    fn activate_backward(
        &mut self,
        table: &mut ParameterTable,
        at: &Viewpoint,
        features: &TemporalFeatures,
        first: usize,
        activated: &mut ActivatedGaussians,
        gradient: &mut ActivatedGaussians,
    );

    /// Clamps values that a step moved out of their bounds.
    fn keep_within_bounds(&mut self, _table: &mut ParameterTable) {}

    /// Returns parameters shared by all Gaussians of a table, such as the weights of a network.
    fn shared(&self) -> Option<&SharedParameters> {
        None
    }

    /// Returns the shared parameters for reading them from a file.
    fn shared_mut(&mut self) -> Option<&mut SharedParameters> {
        None
    }

    /// Returns the shared parameters if the last step gave them gradients.
    fn stepped_shared(&mut self) -> Option<&mut SharedParameters> {
        None
    }

    /// Returns the temporal model of Gaussians with their own times, for density control in time, the losses
    /// on velocities and lifespans, and the static and dynamic layers.
    fn temporal(&self) -> Option<&TemporalGaussians> {
        None
    }

    /// Returns the time in which its Gaussians change; `None` if they do not depend on it.
    fn time_span(&self) -> Option<TimeSpan> {
        None
    }

    /// Returns true if each Gaussian is either static or dynamic; false for a network that moves all of them.
    fn tells_static_from_dynamic(&self) -> bool {
        true
    }

    /// Returns the unit of its Gaussians' sizes in density control, in units of its table; `None` for the
    /// scene's.
    fn unit_length(&self) -> Option<f32> {
        None
    }

    /// Returns the rigid objects to which its Gaussians belong, if any, for the layers and the order of density
    /// control.
    fn tracked(&self) -> Option<&dyn ObjectGaussians> {
        None
    }

    /// Returns the lifespan of Gaussians without times of their own, frames, for the losses of masks: those that rest
    /// are there for ever, and those on a path are as dynamic as can be.
    fn untimed_lifespan(&self) -> f32 {
        if self.tracked().is_some() {
            0.0
        } else {
            f32::INFINITY
        }
    }

    /// Returns its kernels on a GPU; `None` without GPU support.
    fn device_twin(&self) -> Option<&dyn DeviceTwin> {
        None
    }

    /// Returns a copy.
    fn boxed(&self) -> Box<dyn Parameterization>;
}

impl Clone for Box<dyn Parameterization> {
    fn clone(&self) -> Self {
        self.boxed()
    }
}
