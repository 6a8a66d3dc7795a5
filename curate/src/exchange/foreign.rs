//! Scenes as read from other tools' formats.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::Arc,
};

use omnilife_schemas::{
    Pose,
    image_file::{ImageFile, ShownImage},
    mask_file::MarkedGreys,
    points::PointCloud,
    records::{PoseSource, Scale, SceneObject},
    store::StoreError,
};
use tempfile::TempDir;

use super::{ForeignDistance, ForeignSplit, MaskMeaning, driving::Drive};
use crate::{poses::frame_camera::FrameCamera, stills::Still};

/// A scene of another program.
#[derive(Debug, Clone)]
pub struct ForeignScene {
    /// The camera of all frames, with their lens.
    pub camera: FrameCamera,
    /// Frames with existing images, in any order.
    pub frames: Vec<ForeignFrame>,
    /// Pixels of the images that poses refer to.
    pub pixels: FramePixels,
    /// Length of a unit of the world, if the format states it.
    pub scale: Scale,
    /// World points; empty where the format has none.
    pub points: PointCloud,
    /// Source of the poses, unless it is the format itself.
    pub pose_source: Option<PoseSource>,
    /// Folder of `times.csv` and `ignore/`.
    pub root: PathBuf,
    /// Further folders that may hold images which are not frames.
    pub image_folders: Vec<PathBuf>,
    /// Names of missing images that have a pose.
    pub missing_images: Vec<String>,
    /// Single objects by their names, where the format states their classes.
    pub objects: BTreeMap<String, SceneObject>,
    /// The split that the scene is published with.
    pub published_split: Option<ForeignSplit>,
    /// Times of the frames without a `times.csv` and a given frame rate; `None` if one of them is required.
    pub frame_rate: Option<FrameRate>,
    /// Stills without poses by their image, with the seconds since the first.
    pub(crate) stills: BTreeMap<PathBuf, (Still, f64)>,
    /// A line on the source of these seconds; empty without stills.
    pub(crate) stills_note: String,
    /// Names, times, boxes and distances of the frames of a drive, and paths of moving objects.
    pub(crate) drive: Option<Drive>,
    /// Folder of the images, where the format has no files of them; it is removed with the last copy of the scene.
    #[expect(dead_code, reason = "it keeps the folder")]
    pub(crate) unpacked: Option<Arc<TempDir>>,
    /// Lines on decisions and omissions of the reader.
    pub notes: Vec<String>,
}

impl ForeignScene {
    /// Returns a line on images whose registration to each other failed.
    pub(super) fn failed_registration(&self) -> Option<String> {
        match &self.pose_source {
            Some(PoseSource::Registered {
                reason,
                succeeded: false,
            }) => Some(format!("registering the frames failed: {reason}")),
            _ => None,
        }
    }

    /// Returns a scene of frames in a folder, with everything else unknown.
    pub(super) fn new(camera: FrameCamera, frames: Vec<ForeignFrame>, root: &Path) -> Self {
        Self {
            camera,
            frames,
            pixels: FramePixels::Shown,
            scale: Scale::Arbitrary,
            points: PointCloud::default(),
            pose_source: None,
            root: root.to_owned(),
            image_folders: Vec::new(),
            missing_images: Vec::new(),
            objects: BTreeMap::new(),
            published_split: None,
            frame_rate: None,
            stills: BTreeMap::new(),
            stills_note: String::new(),
            drive: None,
            unpacked: None,
            notes: Vec::new(),
        }
    }
}

/// Pixels of images with a rotation in their EXIF data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FramePixels {
    /// Those that viewers show, turned.
    Shown,
    /// Those of the file, for programs that ignore the rotation.
    Stored,
}

impl FramePixels {
    /// Returns the pixels that the pose of an image refers to: those that are shown, if the camera has the size of these
    /// alone, as of programs that turn images.
    ///
    /// # Errors
    /// When it cannot be opened, or its EXIF data cannot be read.
    pub(super) fn of(self, image: &Path, camera: [usize; 2]) -> Result<Self, StoreError> {
        let mut image = ImageFile::open(image)?;
        Ok(match self {
            Self::Stored if image.size() != camera && image.shown_size()? == camera => Self::Shown,
            own => own,
        })
    }

    /// Returns width and height of an image.
    ///
    /// # Errors
    /// When its EXIF data cannot be read.
    pub(super) fn size(self, mut image: ImageFile<'_>) -> Result<[usize; 2], StoreError> {
        match self {
            Self::Shown => image.shown_size(),
            Self::Stored => Ok(image.size()),
        }
    }

    /// Decodes an image.
    ///
    /// # Errors
    /// When it is damaged.
    pub(super) fn decoded(self, image: ImageFile<'_>) -> Result<ShownImage, StoreError> {
        match self {
            Self::Shown => image.decode_shown(),
            Self::Stored => image.decode_stored(),
        }
    }
}

/// A frame rate implied by the format.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameRate {
    /// Frames per second, positive.
    pub frames_per_second: f64,
    /// Reason, for messages.
    pub reason: &'static str,
}

impl FrameRate {
    /// Rate of static scenes: times only give an order.
    pub const STATIC: Self = Self {
        frames_per_second: 1.0,
        reason: "nothing in the scene moves, and no file says when the frames were shown",
    };
}

/// A frame found by a reader.
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
    /// Frames with the same number here were taken simultaneously.
    pub moment: Option<u32>,
}

/// A mask in another tool's convention.
#[derive(Debug, Clone)]
pub struct ForeignMask {
    /// The image.
    pub file: PathBuf,
    /// True if black (instead of white) marks moving content: a mask of pixels to use, with everything outside the
    /// scene in black, too.
    pub black_is_dynamic: bool,
}

impl ForeignMask {
    /// Returns the share of a frame that it marks as moving, from that of its marked greys. It is 0 if masks are declared
    /// to mark what is ignored.
    pub(super) fn moving_share(&self, marked: f64, meaning: MaskMeaning) -> f64 {
        match meaning {
            MaskMeaning::Ignored => 0.0,
            MaskMeaning::Moving if self.black_is_dynamic => 1.0 - marked,
            MaskMeaning::Moving => marked,
        }
    }

    /// Returns the greys that it marks, moving or not. In masks of pixels to use, black is everything excluded.
    pub(super) fn marked_greys(&self) -> MarkedGreys {
        if self.black_is_dynamic {
            MarkedGreys::NotBlack
        } else {
            MarkedGreys::AboveHalf
        }
    }
}
