//! Detectors of vehicles in images: one file each, one line in [`DETECTORS`].

pub mod command;
pub mod depth_of_points;
pub mod files;
pub mod motion;
mod pixels_around;

use std::path::{Path, PathBuf};

use glam::DVec3;
use omnilife_schemas::{
    ground_plane::Plane,
    posed_view::PosedView,
    progress::Progress,
    records::{Detection, Scene},
};

use super::TrackOptions;
use crate::error::TracksError;

/// Input of a detector.
#[derive(Debug)]
pub struct DetectorInput<'a> {
    /// The scene's folder.
    pub folder: &'a Path,
    /// The scene.
    pub scene: &'a Scene,
    /// The frames to search, in order of time.
    pub views: &'a [PosedView],
    /// Points of static content, world.
    pub points: &'a [DVec3],
    /// The ground of most of the scene.
    pub ground: Plane,
    /// Metres per unit of the world.
    pub metres_per_unit: f64,
    /// A file of boxes, for those that read one.
    pub file: Option<&'a PathBuf>,
    /// A TOML of a program, for those that run one.
    pub program: Option<&'a PathBuf>,
    /// The folder of the tracks, where a detector may keep its output.
    pub out: &'a Path,
}

/// Output of a detector.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DetectorOutput {
    /// Boxes of vehicles.
    pub boxes: Vec<Detection>,
    /// The record's text on the detection; empty if the detector's name is enough.
    pub said: String,
}

impl From<Vec<Detection>> for DetectorOutput {
    fn from(boxes: Vec<Detection>) -> Self {
        let said = String::new();
        Self { boxes, said }
    }
}

/// Finds vehicles in frames.
pub type Detect = fn(&DetectorInput<'_>, &dyn Progress) -> Result<DetectorOutput, TracksError>;

/// A method of finding vehicles.
#[derive(Debug, Clone, Copy)]
pub struct Detector {
    /// Name on the command line.
    pub id: &'static str,
    /// Its principle and its use.
    pub about: &'static str,
    /// True if it leaves files in the folder of the tracks.
    pub keeps_files: bool,
    /// Finds them.
    pub detect: Detect,
}

impl Detector {
    /// Checks that it has the files it needs, and none that only another one reads.
    pub(super) fn check_files(&self, options: &TrackOptions) -> Result<(), String> {
        let is_command = self.id == command::ID;
        if options.program.is_some() && !is_command {
            return Err(format!(
                "--program is for the detector command, not for {}",
                self.id
            ));
        }
        if is_command && options.program.is_none() {
            return Err("the detector command runs a program: --program FILE.toml".to_owned());
        }
        if self.id == files::DETECTOR.id && options.detections.is_none() {
            return Err("the detector files reads a file: --detections FILE".to_owned());
        }
        Ok(())
    }
}

/// All of them.
pub const DETECTORS: &[Detector] = &[motion::DETECTOR, files::DETECTOR, command::DETECTOR];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn detectors_are_unique_and_described() {
        for (index, detector) in DETECTORS.iter().enumerate() {
            assert!(
                DETECTORS[..index]
                    .iter()
                    .all(|other| other.id != detector.id)
            );
            assert!(detector.about.len() > 40, "{}", detector.id);
        }
    }
}
