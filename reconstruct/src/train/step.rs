//! What a backend does for the training loop: one step on one view.

use std::fmt;

use omnilife_schemas::{RgbImage, records::Backend};
use serde::{Deserialize, Serialize};

use crate::{
    camera::{View, corrections::PoseCorrections},
    densify::Statistics,
    error::ReconstructError,
    gaussians::{ArrayShape, GaussianTable, deformable::DeformationWeights},
};

/// What training changes.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// Parameters of the static Gaussians with their moments.
    pub table: GaussianTable,
    /// What their density control goes by.
    pub statistics: Statistics,
    /// Gaussians that depend on time; static methods have none.
    pub moving: Option<MovingGaussians>,
    /// A network that deforms the static Gaussians; most methods have none.
    pub deformation: Option<DeformationWeights>,
    /// Corrections of the input views' poses, where they are refined.
    pub poses: Option<PoseCorrections>,
}

/// Gaussians that depend on time. Their table has the static ones' arrays first.
#[derive(Debug, Clone, PartialEq)]
pub struct MovingGaussians {
    /// Parameters with their moments.
    pub table: GaussianTable,
    /// What density control in space goes by.
    pub statistics: Statistics,
    /// What density control in time goes by: sums of `|dL/dtau|` over the views that saw a Gaussian.
    pub time_gradients: Vec<f32>,
}

impl Model {
    /// A model at the beginning of its training.
    pub fn new(table: GaussianTable) -> Self {
        Self {
            statistics: Statistics::new(table.len()),
            table,
            moving: None,
            deformation: None,
            poses: None,
        }
    }

    /// A model with Gaussians that depend on time, at the beginning of its training.
    pub fn with_moving(table: GaussianTable, moving: GaussianTable) -> Self {
        Self {
            moving: Some(MovingGaussians::new(moving)),
            ..Self::new(table)
        }
    }

    /// Number of Gaussians, static and moving.
    pub fn len(&self) -> usize {
        let moving = self.moving.as_ref().map_or(0, |moving| moving.table.len());
        self.table.len() + moving
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A view of the scene with the pose that it is trained and shown with.
    pub fn corrected(&self, view: &View) -> View {
        match &self.poses {
            Some(poses) => poses.apply(view),
            None => *view,
        }
    }

    /// Names and widths of all arrays: those of static Gaussians, those that only moving ones have,
    /// the weights of a network, a single row, and the corrections of poses.
    pub fn shapes(&self) -> Vec<ArrayShape> {
        let widest = self
            .moving
            .as_ref()
            .map_or(&self.table, |moving| &moving.table);
        let mut shapes = widest.shapes();
        shapes.extend(self.deformation.as_ref().map(|weights| ArrayShape {
            name: weights.array.name,
            width: weights.array.width,
        }));
        shapes.extend(self.poses.iter().flat_map(|poses| poses.table.shapes()));
        shapes
    }
}

impl MovingGaussians {
    /// At the beginning of training.
    pub fn new(table: GaussianTable) -> Self {
        Self {
            statistics: Statistics::new(table.len()),
            time_gradients: vec![0.0; table.len()],
            table,
        }
    }

    /// Begins the statistics anew.
    pub fn forget_statistics(&mut self) {
        self.statistics = Statistics::new(self.table.len());
        self.time_gradients = vec![0.0; self.table.len()];
    }
}

impl From<GaussianTable> for Model {
    fn from(table: GaussianTable) -> Self {
        Self::new(table)
    }
}

/// What the schedule prescribes for one step.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StepSchedule {
    /// Number of the step, from 1: Adam's bias correction depends on it.
    pub iteration: u64,
    /// Degree of the spherical harmonics in use.
    pub sh_degree: usize,
    /// Step size of each array, in the order of [`Model::shapes`].
    pub learning_rates: Vec<f32>,
    /// The iteration of the schedule that the step stands for.
    pub scheduled: u64,
    /// How many frames before the view's moment the drawn state is (temporal smoothing); 0 in static
    /// methods.
    pub shift_frames: f32,
}

/// Sums over some steps.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct StepSums {
    /// Steps.
    pub steps: u64,
    /// Of the training loss.
    pub loss: f64,
    /// Of the mean squared error.
    pub squared_error: f64,
    /// Gradient values that were not finite and were not applied, for each array.
    pub refused: Vec<u64>,
}

impl StepSums {
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

    /// How many of them depend on time.
    fn moving_gaussians(&self) -> usize {
        0
    }

    /// One step on input view number `view` of the scene.
    ///
    /// # Errors
    /// When the loss is found not to be finite, or the backend fails.
    fn step(&mut self, view: usize, schedule: &StepSchedule) -> Result<(), ReconstructError>;

    /// Sums over the steps since the last call.
    ///
    /// # Errors
    /// When a loss was not finite, or the backend fails.
    fn take_sums(&mut self) -> Result<StepSums, ReconstructError>;

    /// The model as it stands, read back where it lives on a device.
    ///
    /// # Errors
    /// When the backend fails.
    fn model(&mut self) -> Result<&Model, ReconstructError>;

    /// The model as it stands, to be changed: the next step goes on from the change.
    ///
    /// # Errors
    /// When the backend fails.
    fn model_mut(&mut self) -> Result<&mut Model, ReconstructError>;

    /// Renders a view of the scene at a degree of spherical harmonics, clamped to `[0, 1]`; with its pose
    /// corrected, where poses are refined.
    ///
    /// # Errors
    /// When the backend fails.
    fn image(&mut self, view: &View, sh_degree: usize) -> Result<RgbImage, ReconstructError>;
}
