//! What a parameterization is: from raw parameters to Gaussians as a renderer sees them, and back
//! with gradients.
//!
//! To add one: a type with the parameters' meaning in a file of its own that implements
//! [`Parameterization`]; whoever builds a [`crate::model::Part`] with it trains it. Its GPU twin, where
//! there is one, implements `DeviceParameterization` in a `gpu.rs` of its folder.

use std::fmt;

use glam::Vec3;

use super::{
    ActivatedGaussians, deformable::Deformable, temporal::TemporalFeatures,
    temporal_gaussians::TemporalGaussians, tracked::TrackedGaussians,
};
use crate::{
    camera::View,
    clock::TimeSpan,
    device::{Gpu, GpuError, Program},
    gaussians::{activated_buffers::ActivatedBuffers, static_gaussians::gpu::DeviceRows},
    parameters::{ParameterTable, SharedParameters, device_table::TableBuffers},
};

/// When and from where Gaussians are looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Viewpoint {
    /// Presentation time of the view, seconds.
    pub seconds: f64,
    /// How many frames before it the Gaussians are shown.
    pub shift_frames: f32,
    /// Centre of the camera, normalized units.
    pub centre: Vec3,
    /// The camera's vertical in the world, from zenith to nadir; a unit vector.
    pub down: Vec3,
    /// The iteration of the schedule, in training; images that nobody learns from have none.
    pub scheduled: Option<u64>,
}

impl Viewpoint {
    /// Of an image that nobody learns from.
    pub fn of_image(view: &View) -> Self {
        Self {
            seconds: view.time_seconds,
            shift_frames: 0.0,
            centre: view.centre,
            down: view.rotation.transpose() * Vec3::Y,
            scheduled: None,
        }
    }

    /// Of a moment that nobody looks at from anywhere in particular.
    pub fn of_moment(seconds: f64) -> Self {
        Self {
            seconds,
            shift_frames: 0.0,
            centre: Vec3::ZERO,
            down: Vec3::Y,
            scheduled: None,
        }
    }

    /// Of a training step.
    pub fn of_step(view: &View, shift_frames: f32, scheduled: u64) -> Self {
        Self {
            shift_frames,
            scheduled: Some(scheduled),
            ..Self::of_image(view)
        }
    }
}

/// From the raw parameters of a table, and those that all its Gaussians share, to activated Gaussians.
pub trait Parameterization: fmt::Debug + Send {
    /// Name in messages and checkpoints.
    fn id(&self) -> &'static str;

    /// Activates a table into the entries of `out` that begin with number `first`; `out` has room for
    /// them, and its feature channels are `features`.
    fn activate(
        &mut self,
        table: &ParameterTable,
        at: &Viewpoint,
        features: &TemporalFeatures,
        first: usize,
        out: &mut ActivatedGaussians,
    );

    /// VJP of [`Parameterization::activate`], which was called last with the same arguments: overwrites
    /// the gradients of the table and of the shared parameters. The entries of `activated` and
    /// `gradient` are used up.
    fn activate_backward(
        &mut self,
        table: &mut ParameterTable,
        at: &Viewpoint,
        features: &TemporalFeatures,
        first: usize,
        activated: &mut ActivatedGaussians,
        gradient: &mut ActivatedGaussians,
    );

    /// Puts values that a step moved out of their bounds back onto them.
    fn keep_within_bounds(&mut self, _table: &mut ParameterTable) {}

    /// Parameters that all Gaussians of a table share: the weights of a network.
    fn shared(&self) -> Option<&SharedParameters> {
        None
    }

    /// The same, to be read from a file.
    fn shared_mut(&mut self) -> Option<&mut SharedParameters> {
        None
    }

    /// The same, where the last step gave them gradients.
    fn stepped_shared(&mut self) -> Option<&mut SharedParameters> {
        None
    }

    /// What is known of time, where Gaussians have times of their own: density control in time, the
    /// losses on velocities and lifespans and the layers static and dynamic ask for it.
    fn temporal(&self) -> Option<&TemporalGaussians> {
        None
    }

    /// The time in which its Gaussians change; `None` where they do not depend on it.
    fn time_span(&self) -> Option<TimeSpan> {
        None
    }

    /// Whether each Gaussian by itself is static or dynamic: a network that moves all says nothing
    /// about one.
    fn tells_static_from_dynamic(&self) -> bool {
        true
    }

    /// What the sizes of its Gaussians are relative to in density control, in units of its table, where
    /// those are not the scene's.
    fn unit_length(&self) -> Option<f32> {
        None
    }

    /// The objects that its Gaussians are of, where they are of any that move as one.
    fn tracked(&self) -> Option<&TrackedGaussians> {
        None
    }

    /// Its kernels on a GPU; `None` where it has none.
    fn device_twin(&self) -> Option<DeviceTwin<'_>> {
        None
    }

    /// A copy.
    fn boxed(&self) -> Box<dyn Parameterization>;
}

impl Clone for Box<dyn Parameterization> {
    fn clone(&self) -> Self {
        self.boxed()
    }
}

/// What a parameterization is on a GPU. Only those of this crate are anything there.
#[derive(Debug, Clone, Copy)]
pub struct DeviceTwin<'a>(pub(crate) DeviceKind<'a>);

/// The kernels that there are.
#[derive(Debug, Clone, Copy)]
pub(crate) enum DeviceKind<'a> {
    Static,
    Temporal(&'a TemporalGaussians),
    Deformable(&'a Deformable),
}

/// Which of all activated Gaussians are those of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct DeviceEntries {
    /// The first one's number.
    pub(crate) first: usize,
    /// How many.
    pub(crate) len: usize,
}

/// A parameterization on a GPU. One implementation each, in its folder beside the WGSL.
pub(crate) trait DeviceParameterization: fmt::Debug {
    /// Fills the rows' entries of `buffers.gaussians`, `buffers.harmonics` and `buffers.features`.
    fn activate(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        table: (&TableBuffers, &DeviceRows),
        buffers: &ActivatedBuffers,
    ) -> Result<(), GpuError>;

    /// Fills `table.gradients`.
    fn activate_vjp(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        table: (&TableBuffers, &DeviceRows),
        buffers: &ActivatedBuffers,
    ) -> Result<(), GpuError>;
}
