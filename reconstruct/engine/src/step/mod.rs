//! What a backend does for the training loop: one step on one view.

pub mod cpu;
mod dynamic_losses;
pub mod gpu;
pub mod memory;
pub mod pose_refinement;
pub mod settings;
pub mod shards;

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

/// What computes training steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BackendChoice {
    /// The CPU.
    #[default]
    Cpu,
    /// A GPU.
    Gpu,
}

/// Training steps on a backend.
///
/// # Errors
/// When the backend cannot train this model under these settings: it says which part or component of
/// a model has no kernels there. When there is no GPU, or its memory does not suffice.
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

/// What a GPU has no kernels for beside parameterizations.
fn check_gpu(settings: &TrainSettings) -> Result<(), EngineError> {
    if settings.shards.is_some() {
        return Err(EngineError::Backend {
            reason: "training in shards has no GPU kernels; use the backend cpu".to_owned(),
        });
    }
    if settings.renderer == RendererChoice::Exact {
        return Ok(());
    }
    Err(EngineError::Backend {
        reason: "the renderer with the published quirks has no GPU kernels; use the backend cpu"
            .to_owned(),
    })
}

/// Sums over some steps.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct StepStatistics {
    /// Steps.
    pub steps: u64,
    /// Of the training loss.
    pub loss: f64,
    /// Of the mean squared error.
    pub squared_error: f64,
    /// Gradient values that were not finite and were not applied, for each array.
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

/// Carries out training steps and keeps the model where they need it: in memory, or on a device.
///
/// One implementation per backend. A step renders an input view, takes the loss and its gradients,
/// adds to the density statistics and lets Adam move every parameter. It need not be over when
/// [`Stepper::step`] returns; all other calls wait for it.
pub trait Stepper: fmt::Debug {
    /// What computes, for the run's record.
    fn backend(&self) -> Backend;

    /// Number of Gaussians at the moment.
    fn gaussians(&self) -> usize;

    /// How many of them have times of their own.
    fn gaussians_with_times(&self) -> usize;

    /// Objects that move as one, where the model tells any apart.
    fn objects(&self) -> Option<usize> {
        None
    }

    /// All arrays of the model by name, with what there is of them at the moment.
    fn arrays(&self) -> Vec<TrainedArray>;

    /// One step on input view number `view` of the scene.
    ///
    /// # Errors
    /// When the loss is found not to be finite, or the backend fails.
    fn step(&mut self, view: usize, schedule: &StepSchedule) -> Result<(), EngineError>;

    /// Sums over the steps since the last call.
    ///
    /// # Errors
    /// When a loss was not finite, or the backend fails.
    fn take_statistics(&mut self) -> Result<StepStatistics, EngineError>;

    /// The model as it stands, read back where it lives on a device.
    ///
    /// # Errors
    /// When the backend fails.
    fn model(&mut self) -> Result<&Model, EngineError>;

    /// The model as it stands, to be changed: the next step goes on from the change.
    ///
    /// # Errors
    /// When the backend fails.
    fn model_mut(&mut self) -> Result<&mut Model, EngineError>;

    /// Densifies the model, as [`Densification::run`] does, for the stepper's input views.
    ///
    /// # Errors
    /// When the backend fails.
    fn densify(
        &mut self,
        asked: &Densification<'_>,
        random: &mut Pcg64Mcg,
    ) -> Result<Densified, EngineError> {
        Ok(asked.run(self.model_mut()?, random))
    }

    /// Sets all opacities down, as [`reset_opacities`] does.
    ///
    /// # Errors
    /// When the backend fails.
    fn reset_opacities(&mut self) -> Result<(), EngineError> {
        reset_opacities(self.model_mut()?);
        Ok(())
    }

    /// About how many Gaussians there can be, where that is limited by more than memory.
    fn most_gaussians(&self) -> Option<usize> {
        None
    }

    /// Renders a view of the scene at a degree of spherical harmonics, clamped to `[0, 1]`; with its pose
    /// corrected, where poses are refined.
    ///
    /// # Errors
    /// When the backend fails.
    fn image(&mut self, view: &View, sh_degree: usize) -> Result<RgbImage, EngineError>;
}
