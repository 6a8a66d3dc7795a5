//! Training steps: the interface of a backend to the training loop, one step on one view.

pub mod camera_response;
pub mod cpu;
mod dynamic_losses;
pub mod gpu;
pub mod memory;
pub mod pose_refinement;
pub mod settings;
pub mod shards;
mod size_limit;

use std::{fmt, sync::Arc};

use omnilife_schemas::{RgbImage, records::Backend};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

use self::{cpu::CpuStepper, gpu::GpuStepper, settings::TrainSettings, shards::Shards};
use crate::{
    EngineError,
    camera::View,
    density::{Densification, Densified, reset_opacities},
    device::Gpu,
    model::{Model, TrainedArray},
    render::settings::RendererChoice,
    schedule::StepSchedule,
    training_view::InputViews,
};

/// Backend of training steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BackendChoice {
    /// The CPU.
    #[default]
    Cpu,
    /// A GPU.
    Gpu,
}

/// Creates the training steps of a backend.
///
/// # Errors
/// If the backend lacks kernels for this model under these settings; the error names the part or component. If
/// there is no GPU, or its memory does not suffice.
pub fn stepper<'a>(
    inputs: InputViews<'a>,
    model: Model,
    settings: &TrainSettings,
    backend: BackendChoice,
) -> Result<Box<dyn Stepper + 'a>, EngineError> {
    if settings.shards.is_some() {
        Shards::check(settings)?;
    }
    match backend {
        BackendChoice::Cpu => Ok(Box::new(CpuStepper::new(inputs, model, settings))),
        BackendChoice::Gpu => {
            check_gpu(settings)?;
            let gpu = Arc::new(Gpu::open()?);
            Ok(Box::new(GpuStepper::new(gpu, inputs, model, settings)?))
        }
    }
}

/// Returns an error for settings, other than parameterizations, without GPU kernels.
fn check_gpu(settings: &TrainSettings) -> Result<(), EngineError> {
    let missing = [
        (
            settings.renderer != RendererChoice::Exact,
            "the renderer with the published quirks",
        ),
        (settings.response.is_some(), "a camera's response"),
    ];
    match missing.iter().find(|(is_asked, _)| *is_asked) {
        Some((_, what)) => Err(EngineError::Backend {
            reason: format!("{what} has no GPU kernels; use the backend cpu"),
        }),
        None => Ok(()),
    }
}

/// Sums over several steps.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct StepStatistics {
    /// Number of steps.
    pub steps: u64,
    /// Sum of the training loss.
    pub loss: f64,
    /// Sum of the mean squared error.
    pub squared_error: f64,
    /// Number of gradient values per array that were not finite and were not applied.
    pub refused: Vec<u64>,
}

impl StepStatistics {
    /// Adds further steps.
    pub fn add(&mut self, other: &Self) {
        self.steps += other.steps;
        self.loss += other.loss;
        self.squared_error += other.squared_error;
        self.refused
            .resize(other.refused.len().max(self.refused.len()), 0);
        for (sum, refused) in self.refused.iter_mut().zip(&other.refused) {
            *sum += refused;
        }
    }
}

/// Takes training steps and keeps the model in memory or on a device.
///
/// One implementation per backend. A step renders an input view, computes the loss and its gradients, adds to
/// the density statistics and updates every parameter with Adam. It may still run when [`Stepper::step`]
/// returns; all other calls wait for it.
pub trait Stepper: fmt::Debug {
    /// Returns the backend for the run's record.
    fn backend(&self) -> Backend;

    /// Returns the model in its current size; its values may be out of date.
    fn sizes(&self) -> &Model;

    /// Returns the current number of Gaussians.
    fn gaussians(&self) -> usize {
        self.sizes().len()
    }

    /// Returns the number of Gaussians with their own times.
    fn gaussians_with_times(&self) -> usize {
        self.sizes().len_with_times()
    }

    /// Returns the number of rigid objects; `None` for a model without tracked objects.
    fn objects(&self) -> Option<usize> {
        self.sizes().objects()
    }

    /// Returns all trained arrays of the model by name, with their current sizes.
    fn arrays(&self) -> Vec<TrainedArray> {
        self.sizes().trained_arrays()
    }

    /// Takes one step on input view number `view` of the scene.
    ///
    /// # Errors
    /// If the loss is found not to be finite, or the backend fails.
    fn step(&mut self, view: usize, schedule: &StepSchedule) -> Result<(), EngineError>;

    /// Returns the sums over the steps since the last call.
    ///
    /// # Errors
    /// If a loss was not finite, or the backend fails.
    fn take_statistics(&mut self) -> Result<StepStatistics, EngineError>;

    /// Returns the current model, read back if it is on a device.
    ///
    /// # Errors
    /// If the backend fails.
    fn model(&mut self) -> Result<&Model, EngineError>;

    /// Returns the current model for changes, from which the next step continues.
    ///
    /// # Errors
    /// If the backend fails.
    fn model_mut(&mut self) -> Result<&mut Model, EngineError>;

    /// Densifies the model, as [`Densification::run`] does, for the stepper's input views.
    ///
    /// # Errors
    /// If the backend fails.
    fn densify(
        &mut self,
        asked: &Densification<'_>,
        random: &mut Pcg64Mcg,
    ) -> Result<Densified, EngineError> {
        Ok(asked.run(self.model_mut()?, random))
    }

    /// Resets all opacities, as [`reset_opacities`] does.
    ///
    /// # Errors
    /// If the backend fails.
    fn reset_opacities(&mut self) -> Result<(), EngineError> {
        reset_opacities(self.model_mut()?);
        Ok(())
    }

    /// Returns the approximate maximum number of Gaussians, if more than memory limits it.
    fn most_gaussians(&self) -> Option<usize> {
        None
    }

    /// Renders a view of the scene at a degree of spherical harmonics, clamped to `[0, 1]`; with its
    /// corrected pose if poses are refined.
    ///
    /// # Errors
    /// If the backend fails.
    fn image(&mut self, view: &View, sh_degree: usize) -> Result<RgbImage, EngineError>;
}
