//! Models that trained methods leave in a run's folder: files, layers, edits and exports.
//!
//! To add a kind of model: a [`ModelFormat`] in a file of its own, named in the row of each method that trains it.

pub mod gaussians;
pub mod objects;
pub mod run_views;
pub mod script;

use std::path::Path;

use omnilife_engine::camera::{Camera, View};
use omnilife_schemas::{RgbImage, Similarity, progress::Progress, records::RunRecord};

use crate::{error::ReconstructError, models::script::Script};

/// Kind of model: everything that commands ask of a run's model, whatever method trained it.
#[derive(Debug, Clone, Copy)]
pub struct ModelFormat {
    /// All files that models of this kind may consist of, relative to the run's folder.
    pub files: &'static [&'static str],
    /// Opens a model to render one of its layers.
    pub open: OpenModel,
    /// Applies an edit script; `None` for models without parts that could be edited.
    pub edit: Option<EditModel>,
    /// Exports beside rendered views.
    pub exports: &'static [Export],
}

/// Opens a run's model.
pub type OpenModel = fn(&OpenRequest<'_>) -> Result<Box<dyn OpenedModel>, ReconstructError>;
/// Checks all edits of a script on a run's model; nothing is written yet.
pub type EditModel =
    for<'a> fn(&'a Path, &RunRecord, &Script) -> Result<EditedModel<'a>, ReconstructError>;
/// Lists and writes images of a model's surfaces.
pub type PlanTextures = fn(&Path) -> Result<PlannedFiles<'static>, ReconstructError>;

/// Export of a model.
#[derive(Debug, Clone, Copy)]
pub enum Export {
    /// Gaussians for web viewers, by `reconstruct export`.
    Splats,
    /// An RGBA image of each surface, by `reconstruct atlas`.
    Textures(PlanTextures),
}

impl ModelFormat {
    /// Returns true where `reconstruct export` can write the model for web viewers.
    pub fn has_splats(&self) -> bool {
        let mut exports = self.exports.iter();
        exports.any(|export| matches!(export, Export::Splats))
    }

    /// Returns the export of surface images, where the model has any.
    pub fn textures(&self) -> Option<PlanTextures> {
        self.exports.iter().find_map(|export| match export {
            Export::Textures(plan) => Some(*plan),
            Export::Splats => None,
        })
    }
}

/// Model to open, with the layer and camera it is rendered by.
#[derive(Clone, Copy)]
pub struct OpenRequest<'a> {
    /// The run's folder, or a file of Gaussians.
    pub path: &'a Path,
    /// The run's record; `None` for a file.
    pub run: Option<&'a RunRecord>,
    /// Name of the layer.
    pub layer: &'a str,
    /// Normalization by the cameras, for files, which carry none.
    pub of_cameras: Similarity,
    /// Camera of the images.
    pub camera: Camera,
    /// Receives notes on what is not valid in the files.
    pub progress: &'a dyn Progress,
}

/// Model that was opened for rendering.
pub trait OpenedModel {
    /// Returns the map from world to normalized coordinates.
    fn normalization(&self) -> Similarity;

    /// Renders a view; values in [0, 1].
    ///
    /// # Errors
    /// When the backend fails.
    fn image(&mut self, view: &View) -> Result<RgbImage, ReconstructError>;

    /// Returns the speed that a velocity map shows at most, world units per second; `None` for other layers.
    fn largest_speed(&self) -> Option<f64> {
        None
    }
}

/// Writes checked files into a folder.
pub type WriteFiles<'a> = Box<dyn FnOnce(&Path) -> Result<(), ReconstructError> + 'a>;

/// Files that were checked and not yet written.
pub struct PlannedFiles<'a> {
    /// Names of the files, relative to the folder.
    pub files: Vec<String>,
    /// Writes them into a folder.
    pub write: WriteFiles<'a>,
}

/// Edited model that was checked and not yet written.
pub struct EditedModel<'a> {
    /// Files of the model.
    pub planned: PlannedFiles<'a>,
    /// Changes, one line each.
    pub changes: Vec<String>,
    /// Lines that a reader of the edited run should know.
    pub warnings: Vec<String>,
}
