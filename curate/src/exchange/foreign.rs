//! Scenes as readers of other tools' formats find them.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    Pose,
    mask_file::MarkedGreys,
    points::PointCloud,
    records::{PoseSource, Scale},
};

use super::{ForeignDistance, ForeignSplit};
use crate::{poses::frame_camera::FrameCamera, stills::Still};

/// A scene of another program, as a reader found it.
#[derive(Debug, Clone)]
pub struct ForeignScene {
    /// The camera of all frames, with their lens.
    pub camera: FrameCamera,
    /// Frames whose images are there, in whatever order.
    pub frames: Vec<ForeignFrame>,
    /// Length of a unit of the world, as far as the format says.
    pub scale: Scale,
    /// World points; empty where the format has none.
    pub points: PointCloud,
    /// Source of the poses, where it is not the format itself.
    pub pose_source: Option<PoseSource>,
    /// The folder that `times.csv` and `ignore/` lie in.
    pub root: PathBuf,
    /// Folders that may hold images which are no frames, beside those of the frames.
    pub image_folders: Vec<PathBuf>,
    /// Names of images that have a pose and are not there.
    pub missing_images: Vec<String>,
    /// The split that the scene is published with.
    pub published_split: Option<ForeignSplit>,
    /// Times of the frames where there is neither a `times.csv` nor a frame rate given; `None` where one of them
    /// is needed.
    pub frame_rate: Option<FrameRate>,
    /// Stills without poses by their image, with the seconds since the first.
    pub(crate) stills: BTreeMap<PathBuf, (Still, f64)>,
    /// A line on where these seconds come from; empty without stills.
    pub(crate) stills_note: String,
    /// Lines on what the reader decided and left out.
    pub notes: Vec<String>,
}

impl ForeignScene {
    /// Returns a scene of frames in a folder, of which nothing else is known.
    pub(super) fn new(camera: FrameCamera, frames: Vec<ForeignFrame>, root: &Path) -> Self {
        Self {
            camera,
            frames,
            scale: Scale::Arbitrary,
            points: PointCloud::default(),
            pose_source: None,
            root: root.to_owned(),
            image_folders: Vec::new(),
            missing_images: Vec::new(),
            published_split: None,
            frame_rate: None,
            stills: BTreeMap::new(),
            stills_note: String::new(),
            notes: Vec::new(),
        }
    }
}

/// A frame rate that follows from the format.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameRate {
    /// Frames per second, positive.
    pub frames_per_second: f64,
    /// Reason in the line that says so.
    pub reason: &'static str,
}

impl FrameRate {
    /// That of scenes in which nothing moves: times are but an order.
    pub const STATIC: Self = Self {
        frames_per_second: 1.0,
        reason: "nothing in the scene moves, and no file says when the frames were shown",
    };
}

/// A frame that a reader found.
#[derive(Debug, Clone)]
pub struct ForeignFrame {
    /// The image.
    pub image: PathBuf,
    /// The mask, where there is one.
    pub mask: Option<ForeignMask>,
    /// Masks of single objects (white), by the object's name.
    pub objects: BTreeMap<String, PathBuf>,
    /// The camera, where it is known.
    pub pose: Option<Pose>,
    /// True distances, where they are known.
    pub distance: Option<ForeignDistance>,
    /// Frames with the same number here were taken at once.
    pub moment: Option<u32>,
}

/// A mask in another tool's convention.
#[derive(Debug, Clone)]
pub struct ForeignMask {
    /// The image.
    pub file: PathBuf,
    /// True where black (instead of white) is what moves: a mask of what to look at, with all outside the scene
    /// in black, too.
    pub black_is_dynamic: bool,
}

impl ForeignMask {
    /// Greys that it marks, moving or not. Black is all that tools leave out by masks of what to look at.
    pub(super) fn marked_greys(&self) -> MarkedGreys {
        if self.black_is_dynamic {
            MarkedGreys::NotBlack
        } else {
            MarkedGreys::AboveHalf
        }
    }
}
