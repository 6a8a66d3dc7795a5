//! What learns a scene: all that the training loop, the trace, the checkpoint and the job know of a
//! model.
//!
//! To add one that is not made of Gaussians: a type that implements [`Learner`], made by a method's
//! `prepare`.

pub mod gaussians;

use std::{fmt, path::Path};

use omnilife_engine::{
    EngineError,
    camera::View,
    gaussians::ActivatedGaussians,
    model::{Model, TrainedArray, saved::LoadError},
    schedule::Position,
    step::StepStatistics,
};
use omnilife_schemas::{RgbImage, records::Backend};

use crate::error::ReconstructError;

/// How large a model is at the moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ModelSize {
    /// Gaussians, or whatever else the model is made of.
    pub primitives: u64,
    /// How many of them have times of their own.
    pub with_times: u64,
    /// Objects that move as one, where the model tells any apart.
    pub objects: Option<u64>,
    /// Bytes of everything that is trained, with gradients and moments.
    pub bytes: u64,
}

/// A learner in a checkpoint.
#[derive(Debug, Clone, PartialEq)]
pub struct SavedLearner {
    /// What the words of the body are, and where schedules stand; one line of text.
    pub header: String,
    /// Parameters with their moments, 32-bit words in little-endian order.
    pub body: Vec<u8>,
}

/// A model with what trains it.
///
/// A step need not be over when [`Learner::step`] returns; all other calls wait for it. On the CPU what
/// it does depends on its settings and the views alone, not on the number of threads.
pub trait Learner: fmt::Debug {
    /// What computes, for the run's record.
    fn backend(&self) -> Backend;

    /// How large the model is.
    fn size(&self) -> ModelSize;

    /// Everything that is trained, by name, in the order of [`StepStatistics::refused`].
    fn arrays(&self) -> Vec<TrainedArray>;

    /// Renders input view number `view`, takes the losses and moves the parameters.
    ///
    /// # Errors
    /// When a loss is found not to be finite, or the backend fails.
    fn step(&mut self, view: usize, at: &Position) -> Result<(), EngineError>;

    /// What happens between steps: density control. It is not called after the last one.
    ///
    /// # Errors
    /// When the backend fails.
    fn maintain(&mut self, _at: &Position) -> Result<(), EngineError> {
        Ok(())
    }

    /// Sums over the steps since the last call.
    ///
    /// # Errors
    /// When a loss was not finite, or the backend fails.
    fn take_statistics(&mut self) -> Result<StepStatistics, EngineError>;

    /// An image of the scene as a camera of its clip would have taken it, in [0, 1].
    ///
    /// # Errors
    /// When the backend fails.
    fn image(&mut self, view: &View) -> Result<RgbImage, EngineError>;

    /// The Gaussians, where the model is made of any, read back from wherever they live.
    ///
    /// # Errors
    /// When the backend fails.
    fn gaussians(&mut self) -> Result<Option<&Model>, EngineError> {
        Ok(None)
    }

    /// The Gaussians as a view sees them, where the model is made of any, and the distance (normalized
    /// units) within which none is drawn.
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

    /// Everything that training needs to go on as if it had never stopped.
    ///
    /// # Errors
    /// When a parameter is not finite: a poisoned model is no checkpoint. When the backend fails.
    fn save(&mut self) -> Result<SavedLearner, EngineError>;

    /// Goes on from what was saved. What was saved by another learner changes nothing; after any other error
    /// the learner is not to be used.
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

    /// Whether its first primitives are put at the scene's points.
    fn begins_with_points(&self) -> bool {
        true
    }

    /// What a reader of the scores should know of the model.
    fn warnings(&self) -> Vec<String> {
        Vec::new()
    }
}
