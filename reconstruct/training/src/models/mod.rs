//! Models of trained methods in a run's folder: files, layers, edits and exports.
//!
//! A new kind of model needs a [`ModelFormat`] in a file of its own, named in the row of each method that trains
//! it.

pub mod gaussians;
pub mod objects;
pub mod run_views;
pub mod script;

use std::{fmt, path::Path};

use glam::DVec3;
use omnilife_engine::{
    camera::{Camera, View},
    clock::TimeSpan,
};
use omnilife_schemas::{RgbImage, Similarity, progress::Progress, records::RunRecord};

use crate::{error::ReconstructError, formats::axes::FileAxes, models::script::Script};

/// Kind of model: the interface of a run's model for commands, for every method.
#[derive(Debug, Clone, Copy)]
pub struct ModelFormat {
    /// All possible files of models of this kind, relative to the run's folder.
    pub files: &'static [&'static str],
    /// Opens a model to render one of its layers.
    pub open: OpenModel,
    /// Applies an edit script; `None` for models without editable parts.
    pub edit: Option<EditModel>,
    /// Exports beside rendered views.
    pub exports: &'static [Export],
}

/// Opens a run's model.
pub type OpenModel = fn(&OpenRequest<'_>) -> Result<Box<dyn OpenedModel>, ReconstructError>;
/// Checks all edits of a script on a run's model, without writing.
pub type EditModel = for<'a> fn(
    &'a Path,
    &RunRecord,
    &Script,
    EditPurpose,
) -> Result<EditedModel<'a>, ReconstructError>;
/// Lists and writes images of a model's surfaces.
pub type PlanTextures = fn(&Path) -> Result<PlannedFiles<'static>, ReconstructError>;

/// Use of an edited model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EditPurpose {
    /// It is kept as a run.
    Run,
    /// Images of it are rendered, and it is removed: findings about it alone are not looked for.
    Preview,
}

/// Export of a model.
#[derive(Debug, Clone, Copy)]
pub enum Export {
    /// Gaussians for web viewers, by `reconstruct export`.
    Splats,
    /// An RGBA image of each surface, by `reconstruct atlas`.
    Textures(PlanTextures),
}

impl ModelFormat {
    /// Returns true if `reconstruct export` can write the model for web viewers.
    pub fn has_splats(&self) -> bool {
        let mut exports = self.exports.iter();
        exports.any(|export| matches!(export, Export::Splats))
    }

    /// Returns the export of surface images, if the model has one.
    pub fn textures(&self) -> Option<PlanTextures> {
        self.exports.iter().find_map(|export| match export {
            Export::Textures(plan) => Some(*plan),
            Export::Splats => None,
        })
    }
}

/// Model to open, with its layer and camera.
#[derive(Clone, Copy)]
pub struct OpenRequest<'a> {
    /// The run's folder, or a file of Gaussians.
    pub path: &'a Path,
    /// The run's record; `None` for a file.
    pub run: Option<&'a RunRecord>,
    /// Name of the layer.
    pub layer: &'a str,
    /// Axes of a file in the world; `None` for those of the world, and for a run.
    pub axes: Option<FileAxes>,
    /// Normalization by the cameras, for files without one.
    pub of_cameras: Similarity,
    /// Camera of the images.
    pub camera: Camera,
    /// Receives notes on invalid values in the files.
    pub progress: &'a dyn Progress,
}

/// Meaning of the values of a map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MapScale {
    /// Maximum of a velocity map, world units per second.
    LargestSpeed(f64),
    /// Half grey of a map of distances, world units.
    MiddleDistance(f64),
}

impl fmt::Display for MapScale {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::LargestSpeed(speed) => write!(
                f,
                "grey is still; 0 and 1 are {speed:.3} world units per second along the axes x, y, z"
            ),
            Self::MiddleDistance(middle) => write!(
                f,
                "a value is {middle:.4} / ({middle:.4} + d) at a distance d along the ray, world units; 0 is unknown"
            ),
        }
    }
}

/// An open model for rendering.
pub trait OpenedModel {
    /// Returns the map from world to normalized coordinates.
    fn normalization(&self) -> Similarity;

    /// Renders a view; values in [0, 1].
    ///
    /// # Errors
    /// When the backend fails.
    fn image(&mut self, view: &View) -> Result<RgbImage, ReconstructError>;

    /// Returns true for a layer that does not cover the view, such as a single object.
    fn has_opacity(&self) -> bool {
        false
    }

    /// Renders the opacity of a layer as a grey image in [0, 1]; its image is over black.
    ///
    /// # Errors
    /// When the backend fails.
    fn opacity(&mut self, view: &View) -> Result<RgbImage, ReconstructError> {
        let (width, height) = (view.camera.width() as usize, view.camera.height() as usize);
        Ok(RgbImage::new(width, height, vec![1.0; 3 * width * height]))
    }

    /// Returns the time in which it changes, with its clip; `None` for models that do not change, or show nothing of
    /// other times.
    fn clip(&self) -> Option<TimeSpan> {
        None
    }

    /// Returns the meaning of the values of a map; `None` for layers that are images.
    fn map_scale(&self) -> Option<MapScale> {
        None
    }

    /// Returns the centres of an object at some times in seconds, world units. Outside of its time it stays at the
    /// nearer end of its path.
    ///
    /// # Errors
    /// When the model has no such object.
    fn object_centres(&self, id: &str, _seconds: &[f64]) -> Result<Vec<DVec3>, ReconstructError> {
        Err(ReconstructError::Request {
            reason: format!("the model must have objects to show {id:?}, and it has none"),
        })
    }

    /// Returns the unit vector up in the world; `None` for models that leave it to the cameras.
    ///
    /// # Errors
    /// When its file is malformed.
    fn up(&self) -> Result<Option<DVec3>, ReconstructError> {
        Ok(None)
    }
}

/// Writes checked files into a folder.
pub type WriteFiles<'a> = Box<dyn FnOnce(&Path) -> Result<(), ReconstructError> + 'a>;

/// Checked files before they are written.
pub struct PlannedFiles<'a> {
    /// Names of the files, relative to the folder.
    pub files: Vec<String>,
    /// Writes them into a folder.
    pub write: WriteFiles<'a>,
}

/// A checked edited model before it is written.
pub struct EditedModel<'a> {
    /// Files of the model.
    pub planned: PlannedFiles<'a>,
    /// Changes, one line each.
    pub changes: Vec<String>,
    /// Warnings for readers of the edited run.
    pub warnings: Vec<String>,
}
