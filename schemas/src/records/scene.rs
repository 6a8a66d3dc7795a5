//! `scene`: sequence with cameras, ready for reconstruction and scoring.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::capture::Capture;
use crate::{
    camera::Camera,
    pose::{self, Pose},
    store::{self, Record, StoreError},
};

/// `scene.json`. All files are relative to its folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Scene {
    /// Id of the sequence.
    pub id: String,
    /// The camera of all frames.
    pub camera: Camera,
    /// Unit of the world: metres or arbitrary.
    pub scale: Scale,
    /// Frames in order of time.
    pub frames: Vec<SceneFrame>,
    /// PLY file of world points.
    pub points: Option<String>,
    /// Source of the poses.
    pub pose_source: PoseSource,
    /// Validation of the poses.
    pub validation: PoseValidation,
    /// The split that the publisher of its data set asks for, where there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub published_split: Option<PublishedSplit>,
    /// Single objects by their names. Objects that frames have and that are not listed are of class other.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub objects: BTreeMap<String, SceneObject>,
}

impl Scene {
    /// Returns all files of the scene beside its record, without repetition.
    pub fn files(&self) -> BTreeSet<&str> {
        let of_frames = self.frames.iter().flat_map(SceneFrame::files);
        of_frames.chain(&self.points).map(String::as_str).collect()
    }

    /// Makes a scene of given poses, which are not checked, of arbitrary scale and without points and objects.
    pub fn given(id: &str, camera: impl Into<Camera>, frames: Vec<SceneFrame>) -> Self {
        let registered = frames.iter().filter(|frame| frame.pose.is_some()).count();
        Self {
            id: id.to_owned(),
            camera: camera.into(),
            scale: Scale::Arbitrary,
            points: None,
            pose_source: PoseSource::Given {
                file: "poses.json".to_owned(),
            },
            validation: PoseValidation::unchecked(registered, frames.len()),
            frames,
            published_split: None,
            objects: BTreeMap::new(),
        }
    }

    /// Returns a line that names the frames whose cameras are far from all others; `None` without any.
    pub fn far_frames(&self) -> Option<String> {
        let poses: Vec<_> = self.frames.iter().map(|frame| frame.pose).collect();
        pose::far_frames(&poses)
    }

    /// Returns a line on the ground of a hovering camera, which is assumed; `None` for scenes of other poses, and where
    /// no ground is assumed. Registered images tell rotations alone, so that points beside them are of such a ground.
    pub fn planar_ground(&self) -> Option<String> {
        let is_registered = matches!(
            self.pose_source,
            PoseSource::Registered {
                succeeded: true,
                ..
            }
        );
        if !is_registered || self.points.is_none() || !matches!(self.camera, Camera::Pinhole(_)) {
            return None;
        }
        let unit = match self.scale {
            Scale::Metres => "lengths are metres by its stated height",
            Scale::Arbitrary => "lengths are relative to its height",
        };
        Some(format!(
            "the camera of {} hovers: its ground is assumed to be a plane, on which what stands has no height; {unit}",
            self.id
        ))
    }

    /// Returns the SHA-256 of its camera and poses. Measurements in its world are invalid with other ones.
    pub fn geometry_sha256(&self) -> String {
        let poses: Vec<_> = self.frames.iter().map(|frame| &frame.pose).collect();
        let text = serde_json::json!([self.camera, poses]).to_string();
        store::sha256_bytes(text.as_bytes())
    }

    /// Returns the class of an object.
    pub fn class_of(&self, object: &str) -> ObjectClass {
        let listed = self.objects.get(object);
        listed.map_or(ObjectClass::Other, |object| object.class)
    }

    /// Returns the names of all objects, listed or in a frame.
    pub fn object_names(&self) -> BTreeSet<&str> {
        let of_frames = self.frames.iter().flat_map(SceneFrame::object_names);
        let listed = self.objects.keys().map(String::as_str);
        listed.chain(of_frames).collect()
    }

    /// Returns the SHA-256 of the ignored regions of its frames; `None` where they have none.
    ///
    /// # Errors
    /// When a mask cannot be read.
    pub fn ignored_sha256(&self, folder: &Path) -> Result<Option<String>, StoreError> {
        let files: BTreeSet<&String> = (self.frames.iter())
            .filter_map(|frame| frame.ignore_mask.as_ref())
            .collect();
        if files.is_empty() {
            return Ok(None);
        }
        let of_files: BTreeMap<&String, String> = (files.into_iter())
            .map(|file| Ok((file, store::sha256_file(&folder.join(file))?)))
            .collect::<Result<_, StoreError>>()?;
        let of_frames: Vec<_> = (self.frames.iter())
            .map(|frame| Some(&of_files[frame.ignore_mask.as_ref()?]))
            .collect();
        let text = serde_json::json!(of_frames).to_string();
        Ok(Some(store::sha256_bytes(text.as_bytes())))
    }
}

impl Record for Scene {
    const SCHEMA: &'static str = "omnilife/scene/2";
    /// The older version has a camera without model: all were ERP.
    const OLDER: &'static [&'static str] = &["omnilife/scene/1"];
}

/// A single object of a scene. Its masks and boxes are in the frames, by its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct SceneObject {
    /// Its class.
    pub class: ObjectClass,
}

/// Class of an object. Scores of vehicles and of people stand apart.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum ObjectClass {
    /// Cars, trucks, buses, trailers, bicycles and other vehicles.
    Vehicle,
    /// People, on foot or riding.
    Person,
    /// Anything else.
    #[default]
    Other,
}

impl ObjectClass {
    /// All classes, in the order of the tables.
    pub const ALL: [Self; 3] = [Self::Vehicle, Self::Person, Self::Other];

    /// Returns its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Vehicle => "vehicle",
            Self::Person => "person",
            Self::Other => "other",
        }
    }

    /// Returns the name of its region, by which frames have masks of classes; `None` for other objects.
    pub fn region(self) -> Option<&'static str> {
        match self {
            Self::Vehicle => Some("vehicle"),
            Self::Person => Some("human"),
            Self::Other => None,
        }
    }
}

/// The split of a data set's publisher. Frame numbers count the scene's frames from 0, and rise; frames that
/// are in neither list have no part in it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct PublishedSplit {
    /// Publisher and address.
    pub source: String,
    /// Frames a method may use.
    pub input_views: Vec<u32>,
    /// Frames a method must predict.
    pub novel_views: Vec<u32>,
}

/// One frame of a scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SceneFrame {
    /// Image file.
    pub image: String,
    /// Presentation timestamp in the source, seconds.
    pub time_seconds: f64,
    /// Facts that the file of a still states.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub capture: Option<Capture>,
    /// The camera, where it is known. Frames without one are neither trained on nor scored.
    pub pose: Option<Pose>,
    /// Mask image of dynamic objects (white).
    pub mask: Option<String>,
    /// Mask image of ignored regions (white): the operator, a tripod, directions that were not recorded.
    /// Nothing is learned from these pixels, and no score counts them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ignore_mask: Option<String>,
    /// Mask images of the objects of a class (white), by its name, such as `human` and `vehicle`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub classes: BTreeMap<String, String>,
    /// Mask images of single objects (white), by the object's name; none where it is not seen.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub objects: BTreeMap<String, String>,
    /// Boxes of single objects, by the object's name: left, top, width and height, pixels. In panoramas a box that
    /// reaches over the right edge goes on at the left one. A box stands for its object where that has no mask.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub boxes: BTreeMap<String, [f64; 4]>,
    /// True distances, where they are known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth: Option<DepthImage>,
    /// Distances that somebody estimated, where there are any. A method may use them, no score does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth_prior: Option<DepthPrior>,
}

impl SceneFrame {
    /// Makes a frame with an image, a time in seconds and a pose alone.
    pub fn new(image: String, time_seconds: f64, pose: Option<Pose>) -> Self {
        Self {
            image,
            time_seconds,
            capture: None,
            pose,
            mask: None,
            ignore_mask: None,
            classes: BTreeMap::new(),
            objects: BTreeMap::new(),
            boxes: BTreeMap::new(),
            depth: None,
            depth_prior: None,
        }
    }

    /// Returns the names of the objects with a mask or a box, in order and without repetition.
    pub fn object_names(&self) -> impl Iterator<Item = &str> {
        let names: BTreeSet<&String> = self.objects.keys().chain(self.boxes.keys()).collect();
        names.into_iter().map(String::as_str)
    }

    /// Returns all files of the frame, its image first.
    pub fn files(&self) -> impl Iterator<Item = &String> {
        std::iter::once(&self.image)
            .chain(&self.mask)
            .chain(&self.ignore_mask)
            .chain(self.classes.values())
            .chain(self.objects.values())
            .chain(self.depth.iter().map(|depth| &depth.file))
            .chain(self.depth_prior.iter().map(|prior| &prior.file))
    }
}

/// Estimated distances of what the pixels of a frame show.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DepthPrior {
    /// 16-bit grey PNG, or a `.npy` of f32 (rows, columns); 0 where the distance is not known. Pixel
    /// (i, j) has its centre at (i + 1/2, j + 1/2).
    pub file: String,
    /// Size of a step of 1 in the file, in units of the world frame.
    pub unit: f64,
    /// Columns of the file. They may be fewer than the image's, in the same proportion to its rows.
    pub width: u32,
    /// Rows of the file.
    pub height: u32,
    /// Direction that distances are measured along.
    pub convention: DistanceConvention,
    /// Origin of the distances: a network, a sensor; `given` if it was not stated.
    pub source: String,
}

/// Direction that distances are measured along.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum DistanceConvention {
    /// The ray of the pixel.
    #[default]
    Ray,
    /// The viewing direction of the camera; in a panorama, of the face of a cube that the pixel is on.
    Z,
}

/// Arrangement of a panorama's pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum DistanceGrid {
    /// Pixel (i, j) of W x H has its centre at (i + 1/2, j + 1/2); W columns are a turn.
    #[default]
    HalfPixel,
    /// The first column and the last are one direction, the first row and the last the poles (PanoGS,
    /// Eq. 4).
    Endpoint,
}

/// Distances from the camera along the rays of the pixels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DepthImage {
    /// 16-bit grey PNG of the camera's size, or a `.npy` of f32 (rows, columns); 0 where the distance is not
    /// known.
    pub file: String,
    /// Size of a step of 1 in the file, in units of the world frame.
    pub unit: f64,
}

/// Unit of the world frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Scale {
    /// Metres.
    Metres,
    /// Unknown, as structure from motion leaves it.
    Arbitrary,
}

/// Source of poses.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum PoseSource {
    /// Given by the user.
    Given {
        /// Name of the file or folder.
        file: String,
    },
    /// Matrices that the user gave.
    Matrices {
        /// Name of the file.
        file: String,
        /// Convention of the matrices, as the user stated it.
        convention: PoseConvention,
    },
    /// A program that was run on the frames.
    Program {
        /// The program and its arguments.
        command: String,
        /// Name of the file that it left.
        file: String,
        /// Convention of the matrices; `None` for other files of poses.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        convention: Option<PoseConvention>,
    },
    /// Images registered to their neighbours: turns of a camera whose place is not known.
    Registered {
        /// Finding and quality of the fit.
        reason: String,
        /// `true` if enough of the images fits everywhere; if `false`, the poses are the best that
        /// were found.
        succeeded: bool,
    },
    /// Structure from motion.
    Sfm {
        /// Program and version.
        tool: String,
        /// Named configuration.
        configuration: String,
        /// Wall-clock time, seconds, rounded up.
        wall_seconds: u64,
    },
}

/// Mapping of a pose's matrix; axes of the camera are x right, y down, z forward.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PoseConvention {
    /// Points of the camera to the world.
    CameraToWorld,
    /// Points of the world to the camera.
    WorldToCamera,
}

/// Report of the pose validation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PoseValidation {
    /// The projection.
    pub status: ValidationStatus,
    /// Frames with a pose.
    pub registered_frames: u32,
    /// All frames.
    pub total_frames: u32,
    /// Measured values; the name carries the unit.
    pub measures: BTreeMap<String, f64>,
    /// Every limit that was missed, in words.
    pub problems: Vec<String>,
}

impl PoseValidation {
    /// Makes the report of poses that cannot be checked.
    pub fn unchecked(registered_frames: usize, total_frames: usize) -> Self {
        Self {
            status: ValidationStatus::Unchecked,
            registered_frames: registered_frames as u32,
            total_frames: total_frames as u32,
            measures: BTreeMap::new(),
            problems: Vec::new(),
        }
    }
}

/// Outcome of the pose validation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ValidationStatus {
    /// All limits kept.
    Valid,
    /// Some limit missed; scores on this scene are to be read with care.
    Unstable,
    /// Poses were given without observations to check them by.
    Unchecked,
}
