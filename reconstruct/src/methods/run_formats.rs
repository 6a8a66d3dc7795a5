//! What runs leave behind, and how it is opened: one line in [`RUN_FORMATS`] for each kind of model.
//!
//! A kind of model is told by the file that marks it in a run's folder. It is opened for rendering, with
//! what is to be shown of it, and edited, where it can be.

use std::path::Path;

use omnilife_engine::camera::View;
use omnilife_schemas::{RgbImage, Similarity};

use super::neural_atlas;
use crate::error::ReconstructError;

/// A model that was opened for rendering.
pub trait OpenedModel {
    /// World to normalized coordinates.
    fn normalization(&self) -> Similarity;

    /// An image of what a view shows, in [0, 1].
    ///
    /// # Errors
    /// When the backend fails.
    fn image(&mut self, view: &View) -> Result<RgbImage, ReconstructError>;

    /// What a velocity map shows at most, world units per second, where that is what is shown.
    fn largest_speed(&self) -> Option<f64> {
        None
    }
}

/// What is done to a run.
#[derive(Debug, Clone, Copy)]
pub struct EditRequest<'a> {
    /// The run's folder.
    pub run: &'a Path,
    /// The script.
    pub script: &'a Path,
    /// Folder of the edited run; the run's record is there already.
    pub out: &'a Path,
}

/// Opens a run, to show the layer of this name.
pub type OpenRun = fn(&Path, &str) -> Result<Box<dyn OpenedModel>, ReconstructError>;
/// Edits a run; returns the names of the files that it wrote, and what it did, line by line.
pub type EditRun = fn(&EditRequest<'_>) -> Result<(Vec<String>, Vec<String>), ReconstructError>;

/// A kind of model that runs leave.
#[derive(Debug, Clone, Copy)]
pub struct RunFormat {
    /// The file that marks it in a run's folder.
    pub file: &'static str,
    /// All files that it consists of.
    pub files: &'static [&'static str],
    /// Which layers it has.
    pub layers: &'static str,
    /// Opens it.
    pub open: OpenRun,
    /// Edits it.
    pub edit: EditRun,
}

/// All kinds of models beside Gaussians, which [`crate::jobs`] opens itself.
pub const RUN_FORMATS: &[RunFormat] = &[neural_atlas::outputs::RUN_FORMAT];

/// The kind of model that a run's folder holds; `None` for Gaussians.
pub fn of_run(folder: &Path) -> Option<&'static RunFormat> {
    RUN_FORMATS
        .iter()
        .find(|format| folder.join(format.file).is_file())
}
