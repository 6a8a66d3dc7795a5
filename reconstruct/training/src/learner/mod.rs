//! Learners of scenes: the interface of a model for the training loop, the trace, the checkpoint and the job.
//!
//! A new one without Gaussians needs a type that implements [`Learner`], made by a method's `prepare`.

pub mod gaussians;
pub mod work;

use std::{fmt, path::Path};

use omnilife_engine::{
    EngineError,
    camera::View,
    gaussians::ActivatedGaussians,
    model::{Model, TrainedArray, saved::LoadError},
    schedule::Position,
    step::{StepStatistics, gpu::memory::DevicePlan},
};
use omnilife_schemas::{RgbImage, records::Backend};

use self::work::StepWork;
use crate::error::ReconstructError;

/// Current size of a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ModelSize {
    /// Number of Gaussians, or of other primitives of the model.
    pub primitives: u64,
    /// Number of those with times of their own.
    pub with_times: u64,
    /// Number of objects that move as one, if the model distinguishes objects.
    pub objects: Option<u64>,
    /// Bytes of everything that is trained, with gradients and moments.
    pub bytes: u64,
}

/// A learner in a checkpoint.
#[derive(Debug, Clone, PartialEq)]
pub struct SavedLearner {
    /// Layout of the body, and position of the schedules; one line of text.
    pub header: String,
    /// Parameters with their moments, 32-bit words in little-endian order.
    pub body: Vec<u8>,
}

/// A model with its training state.
///
/// A step may still run when [`Learner::step`] returns; all other calls wait for it. On the CPU its result
/// depends on its settings and the views alone, not on the number of threads.
pub trait Learner: fmt::Debug {
    /// Returns the backend, for the run's record.
    fn backend(&self) -> Backend;

    /// Returns the size of the model.
    fn size(&self) -> ModelSize;

    /// Returns the mean work of the steps of its schedule; `None` for models whose work is not counted.
    fn work(&self) -> Option<StepWork> {
        None
    }

    /// Returns the memory of its training on a GPU; `None` on the CPU, and for models of Gaussians, whose memory
    /// [`DevicePlan::of`] counts.
    ///
    /// # Errors
    /// When the backend fails.
    fn device_plan(&self) -> Result<Option<DevicePlan>, EngineError> {
        Ok(None)
    }

    /// Returns all trained arrays, by name, in the order of [`StepStatistics::refused`].
    fn arrays(&self) -> Vec<TrainedArray>;

    /// Renders input view number `view`, takes the losses and moves the parameters.
    ///
    /// # Errors
    /// When a loss is not finite, or the backend fails.
    fn step(&mut self, view: usize, at: &Position) -> Result<(), EngineError>;

    /// Runs density control between steps. It is not called after the last one.
    ///
    /// # Errors
    /// When the backend fails.
    fn maintain(&mut self, _at: &Position) -> Result<(), EngineError> {
        Ok(())
    }

    /// Returns sums over the steps since the last call, and resets them.
    ///
    /// # Errors
    /// When a loss was not finite, or the backend fails.
    fn take_statistics(&mut self) -> Result<StepStatistics, EngineError>;

    /// Renders an image of the scene from a camera of its clip, in [0, 1].
    ///
    /// # Errors
    /// When the backend fails.
    fn image(&mut self, view: &View) -> Result<RgbImage, EngineError>;

    /// Returns the Gaussians of the model, read back from the device; `None` for other models.
    ///
    /// # Errors
    /// When the backend fails.
    fn gaussians(&mut self) -> Result<Option<&Model>, EngineError> {
        Ok(None)
    }

    /// Returns the Gaussians as a view sees them, and their minimum visible distance (normalized units); `None`
    /// for other models.
    ///
    /// # Errors
    /// When the backend fails.
    fn activated(
        &mut self,
        _view: &View,
        _out: &mut ActivatedGaussians,
    ) -> Result<Option<f32>, EngineError> {
        Ok(None)
    }

    /// Saves all state that training needs to resume exactly.
    ///
    /// # Errors
    /// When a parameter is not finite: such a model must not be saved. When the backend fails.
    fn save(&mut self) -> Result<SavedLearner, EngineError>;

    /// Resumes from saved state. State of another kind of learner changes nothing; after any other error the
    /// learner must not be used.
    ///
    /// # Errors
    /// When it was saved by a learner of another kind, or is damaged.
    fn restore(&mut self, saved: &SavedLearner) -> Result<(), LoadError>;

    /// Writes the model's files into a run's folder, and removes those of an earlier model there;
    /// returns their names.
    ///
    /// # Errors
    /// When a file cannot be written, or the backend fails.
    fn export(&mut self, folder: &Path) -> Result<Vec<String>, ReconstructError>;

    /// Returns true if its first primitives are placed at the scene's points.
    fn begins_with_points(&self) -> bool {
        true
    }

    /// Returns warnings about the model for readers of the scores.
    fn warnings(&self) -> Vec<String> {
        Vec::new()
    }
}
