//! `tracks`: moving objects of a scene, in its images and in space.

use std::{collections::BTreeSet, path::Path};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{
    elapsed::Elapsed,
    layout::TRACKS_FILE,
    store::{self, Record, StoreError},
    trajectory::ObjectPath,
};

/// `tracks.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Tracks {
    /// Id of the scene.
    pub scene: String,
    /// Numbers of the frames that were looked at, in order.
    pub frames: Vec<u32>,
    /// Width and height of the images that boxes are in, pixels.
    pub image_size: [u32; 2],
    /// Unit vector of the world that points up.
    pub up: [f64; 3],
    /// Metres in a unit of the world.
    pub metres_per_unit: f64,
    /// Stages that made it, in order.
    pub stages: Vec<TrackStage>,
    /// Everything that was found in the images.
    pub detections: Vec<Detection>,
    /// Resulting tracks: one per object that moves.
    pub tracks: Vec<Track>,
    /// Parts that were left out, with the reason, in words.
    pub warnings: Vec<String>,
}

impl Record for Tracks {
    const SCHEMA: &'static str = "omnilife/tracks/1";
}

impl Tracks {
    /// Name of the stage of tracks that are labels of a dataset.
    pub const LABELS_STAGE: &'static str = "labels";
    /// Name of the stage of the detector.
    pub const DETECTOR_STAGE: &'static str = "detector";
    /// Detector of the true paths of a rendered scene.
    const EXACT_DETECTOR: &'static str = "exact";

    /// Returns true for labels of a dataset: boxes that were given, and not tracked.
    pub fn are_labels(&self) -> bool {
        let mut stages = self.stages.iter();
        stages.any(|stage| stage.stage == Self::LABELS_STAGE)
    }

    /// Returns the detector of the tracks; `None` where they do not tell it.
    pub fn detector(&self) -> Option<&str> {
        let mut stages = self.stages.iter();
        let detector = stages.find(|stage| stage.stage == Self::DETECTOR_STAGE)?;
        Some(&detector.method)
    }

    /// Returns true for paths without error: labels of a dataset, and those of a rendered scene.
    pub fn are_exact(&self) -> bool {
        self.are_labels() || self.detector() == Some(Self::EXACT_DETECTOR)
    }

    /// Returns the tracks of a scene beside a split in `split_folder`; `None` where the file is missing.
    ///
    /// # Errors
    /// When they cannot be read, are unsound or those of another scene.
    pub fn beside_split(scene_id: &str, split_folder: &Path) -> Result<Option<Self>, StoreError> {
        let file = split_folder.join(TRACKS_FILE);
        if !file.is_file() {
            return Ok(None);
        }
        let tracks: Self = store::read_record(&file)?;
        if tracks.scene != scene_id {
            let reason = format!("has the tracks of {}, not of {scene_id}", tracks.scene);
            return Err(StoreError::malformed(&file, reason));
        }
        match tracks.fault() {
            Some(fault) => Err(StoreError::malformed(&file, fault)),
            None => Ok(Some(tracks)),
        }
    }

    /// Returns why they cannot be used; `None` where they are valid: ids are unique, each object has at most one box
    /// in a frame, paths and boxes are sound.
    pub fn fault(&self) -> Option<String> {
        let mut ids = BTreeSet::new();
        let of_tracks = self.tracks.iter().find_map(|track| {
            let fault = if ids.insert(track.id) {
                track.fault()
            } else {
                Some("is there twice".to_owned())
            };
            Some(format!("track {} {}", track.id, fault?))
        });
        let mut seen = BTreeSet::new();
        let of_detections = || {
            self.detections.iter().find_map(|one| {
                let fault = if !one.box_pixels.iter().all(|side| side.is_finite()) {
                    "has a box of numbers that are not finite".to_owned()
                } else if let Some(track) = one.track.filter(|&id| !seen.insert((one.frame, id))) {
                    format!("has two boxes of track {track}")
                } else {
                    return None;
                };
                Some(format!("frame {} {fault}", one.frame))
            })
        };
        of_tracks.or_else(of_detections)
    }
}

/// A stage of the making of tracks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TrackStage {
    /// Its name: detector, distance, association, trajectory; labels alone where a dataset gives the boxes.
    pub stage: String,
    /// Which way was taken.
    pub method: String,
    /// On what evidence.
    pub reason: String,
    /// Time that it took.
    #[serde(flatten)]
    pub took: Elapsed,
}

/// Something that was found in an image.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Detection {
    /// Number of the frame in the scene.
    pub frame: u32,
    /// Left, top, width and height of its box, pixels.
    pub box_pixels: [f64; 4],
    /// Confidence of the detector, in [0, 1]; 0 if it found nothing and the path of a track fills the gap.
    pub confidence: f64,
    /// Class, such as `vehicle`.
    pub class: String,
    /// Distance of its middle from the camera along the ray, world units.
    pub distance: Option<f64>,
    /// Position of its middle in the world.
    pub position: Option<[f64; 3]>,
    /// The track that it is of.
    pub track: Option<u32>,
}

/// An object that moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Track {
    /// Unique in its file; of detections too.
    pub id: u32,
    /// Class of the object.
    pub class: String,
    /// Length, width and height of its box, world units.
    pub dimensions: [f64; 3],
    /// Path over the time at which it is known.
    pub path: ObjectPath,
    /// Detections that it rests on.
    pub detections: u32,
    /// Largest distance from the position at which it is first seen, world units.
    pub displacement: f64,
}

impl Track {
    /// Returns why the object is invalid; `None` where it is valid.
    fn fault(&self) -> Option<String> {
        let mut sides = self.dimensions.iter();
        let is_box = sides.all(|&side| side.is_finite() && side > 0.0);
        let no_box = (!is_box).then(|| "has no box".to_owned());
        self.path.fault().or(no_box)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trajectory::BSpline;

    fn tracks() -> Tracks {
        let track = |id| Track {
            id,
            class: "vehicle".to_owned(),
            dimensions: [4.5, 1.8, 1.5],
            path: ObjectPath {
                centre: BSpline {
                    degree: 1,
                    knots: BSpline::uniform_knots(1, 2, 0.0, 1.0),
                    coefficients: vec![[0.0; 3], [1.0, 0.0, 0.0]],
                },
                heading_seconds: vec![0.0],
                headings: vec![0.0],
            },
            detections: 2,
            displacement: 1.0,
        };
        let detection = |frame, track| Detection {
            frame,
            box_pixels: [1.0, 2.0, 3.0, 4.0],
            confidence: 1.0,
            class: "vehicle".to_owned(),
            distance: None,
            position: None,
            track,
        };
        Tracks {
            scene: "flight".to_owned(),
            frames: vec![0, 1],
            image_size: [320, 180],
            up: [0.0, 0.0, 1.0],
            metres_per_unit: 1.0,
            stages: Vec::new(),
            detections: vec![
                detection(0, Some(1)),
                detection(0, Some(2)),
                detection(0, None),
                detection(0, None),
                detection(1, Some(1)),
            ],
            tracks: vec![track(1), track(2)],
            warnings: Vec::new(),
        }
    }

    #[test]
    fn what_is_wrong_with_tracks_is_told() {
        assert_eq!(tracks().fault(), None);
        let fault = |change: fn(&mut Tracks)| {
            let mut tracks = tracks();
            change(&mut tracks);
            tracks.fault().unwrap_or_default()
        };
        assert_eq!(
            fault(|tracks| tracks.tracks[1].id = 1),
            "track 1 is there twice"
        );
        assert_eq!(
            fault(|tracks| tracks.tracks[1].dimensions[2] = 0.0),
            "track 2 has no box"
        );
        assert!(
            fault(|tracks| tracks.tracks[0].path.headings.clear())
                .starts_with("track 1 has headings")
        );
        assert_eq!(
            fault(|tracks| tracks.detections[3].track = Some(2)),
            "frame 0 has two boxes of track 2"
        );
        assert_eq!(
            fault(|tracks| tracks.detections[4].box_pixels[0] = f64::NAN),
            "frame 1 has a box of numbers that are not finite"
        );
    }
}
