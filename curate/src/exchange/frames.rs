//! A clip as a folder of frames: ours, which hold all of a scene, and those of others, with masks of objects.
//!
//! ```text
//! rgb/00000.jpg ...             the frames, in the order of their names and numbers (or images/)
//! mask/00000.png ...            white where the object is, by the frames' names (DAVIS), or
//! objects/swan/00000.png ...    the same for each object, by its name; no file for frames without it
//! classes.json                  {"swan": "other", ...}, classes of the objects: vehicle, person or other
//! camera.json                   {"focal": F}, the focal length in pixels, where it is known
//! poses.json                    poses, one for each frame, where they are known, and the camera
//! train.txt, test.txt           names of the frames for training and for testing, where a split is given
//! ```
//!
//! Exports add the rest of the scene, so that an import restores all of it:
//!
//! ```text
//! scene.json                    the record of the scene, which names the files below by frames
//! unposed/                      frames without a pose
//! mask/                         white for moving content
//! ignore/                       white outside of the scene
//! classes/human/                white for objects of a class
//! depth/, depth-prior/          true distances and depth priors
//! ```
//!
//! If `scene.json` exists, it alone assigns files to frames; different poses or times beside it, and files that it does
//! not name, are refused.
//!
//! Without poses the camera is assumed to rotate in place ([`crate::motion::pinhole_turns`]): each frame is registered
//! to the one before it. If that finds less than two pixels of motion, the camera stands still. If it fails, the best
//! rotations found are kept, and the scene says so.

mod export;
mod recorded;

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    Pose, RgbImage,
    camera::Camera,
    image_file::ImageFile,
    layout::SCENE_FILE,
    ownership::is_inside,
    points::PointCloud,
    records::{ObjectClass, PoseSource, Poses, Scale, Scene, SceneObject},
    rgb::Mask,
    store::{self, StoreError},
};
use rayon::prelude::*;
use serde::Deserialize;

use super::{ForeignFrame, ForeignMask, ForeignScene, Format, Part, Writer, left_out};
use crate::{
    error::CurateError, frame_order, motion::pinhole_turns::GreyFrame, poses::turns, stills,
};

/// The format.
pub const FORMAT: Format = Format {
    id: "frames",
    about: "ours, which holds all of a scene; of others a perspective clip: rgb/ with mask/ (DAVIS) or \
            objects/NAME/, and without poses the camera is registered as one that turns",
    holds_cube_faces: false,
    holds_padded_panoramas: false,
    export: Some(Writer {
        write: export::export,
        holds: Part::ALL,
    }),
    import,
};

/// Poses file of a clip.
const POSES_FILE: &str = "poses.json";
/// Folder of the frames.
const IMAGES_FOLDER: &str = "rgb";
/// Folder of frames without a pose: poses belong to the others by their order.
const UNPOSED_FOLDER: &str = "unposed";
/// Folder of the masks of moving content.
const MASK_FOLDER: &str = "mask";
/// Classes of single objects, by their names.
const CLASSES_FILE: &str = "classes.json";
/// Folder of the folders of masks of single objects.
const OBJECTS_FOLDER: &str = "objects";
/// Approximate number of images examined to tell a perspective clip from panoramas.
const FEW_IMAGES: usize = 4;

#[derive(Deserialize)]
struct CameraFile {
    /// Pixels.
    focal: f64,
}

/// Returns the record of a scene in a folder of frames; `None` where it has none.
///
/// # Errors
/// When it is malformed.
pub(super) fn record(folder: &Path) -> Result<Option<Scene>, StoreError> {
    let path = folder.join(SCENE_FILE);
    if path.is_file() {
        store::read_record(&path).map(Some)
    } else {
        Ok(None)
    }
}

/// Refuses a name of an object or a class that is not a folder name.
///
/// # Errors
/// Names `folder`, that of the scene.
fn expect_folder_name(folder: &Path, name: &str) -> Result<(), CurateError> {
    if is_inside(name) && !name.contains(['/', '\\']) {
        return Ok(());
    }
    let reason =
        format!("{name:?} is the name of an object or a class, and cannot be that of a folder");
    Err(CurateError::input(&folder.join(SCENE_FILE), reason))
}

fn import(folder: &Path) -> Result<ForeignScene, CurateError> {
    if let Some(record) = record(folder)? {
        return recorded::import(folder, &record);
    }
    let images = image_files(folder)?;
    let first = images.first().ok_or_else(|| {
        CurateError::input(folder, "has no frames: expected images in rgb/ or images/")
    })?;
    let size = ImageFile::open(first)?.shown_size()?;
    let stems: Vec<String> = images.iter().map(|image| stem(image)).collect();
    let objects = object_masks(folder, &stems)?;
    let given = folder.join(POSES_FILE);
    let posed = if given.is_file() {
        given_poses(folder, &given, &images, size)?
    } else {
        refuse_panoramas(folder, &images, size)?;
        registered(&images, &objects, size, focal_of(folder)?)?
    };
    let mask_of = |stem: &String| {
        // With a single object, moving content is that object.
        let (1, Some(masks)) = (objects.len(), objects.values().next()) else {
            return None;
        };
        masks.get(stem).map(|file| ForeignMask {
            file: file.clone(),
            black_is_dynamic: false,
        })
    };
    let frames = images.iter().zip(&stems).zip(posed.poses);
    let frames = frames.map(|((image, stem), pose)| ForeignFrame {
        image: image.clone(),
        mask: mask_of(stem),
        objects: objects
            .iter()
            .filter_map(|(name, masks)| Some((name.clone(), masks.get(stem)?.clone())))
            .collect(),
        pose,
        moment: None,
        distance: None,
    });
    let frames: Vec<ForeignFrame> = frames.collect();
    Ok(ForeignScene {
        objects: listed_objects(folder, &objects)?,
        scale: posed.scale,
        points: posed.points,
        pose_source: Some(posed.source),
        notes: left_out::unread_images(folder, &frames)?,
        ..ForeignScene::new(posed.camera.into(), frames, folder)
    })
}

/// A camera with a pose for each frame.
struct PosedCamera {
    camera: Camera,
    poses: Vec<Option<Pose>>,
    points: PointCloud,
    scale: Scale,
    source: PoseSource,
}

fn stem(path: &Path) -> String {
    path.file_stem()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

fn image_files(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    for name in [IMAGES_FOLDER, "images"] {
        let images = folder.join(name);
        if images.is_dir() {
            return frame_order::images_in(&images);
        }
    }
    Ok(Vec::new())
}

/// Masks by object and by the frame's name.
fn object_masks(
    folder: &Path,
    stems: &[String],
) -> Result<BTreeMap<String, BTreeMap<String, PathBuf>>, CurateError> {
    let known: BTreeSet<&String> = stems.iter().collect();
    let read = |folder: &Path| -> Result<BTreeMap<String, PathBuf>, CurateError> {
        let mut masks = BTreeMap::new();
        for file in frame_order::images_in(folder)? {
            let name = stem(&file);
            if !known.contains(&name) {
                return Err(CurateError::input(&file, "is the mask of no frame"));
            }
            masks.insert(name, file);
        }
        Ok(masks)
    };
    let mut objects = BTreeMap::new();
    let folders = folder.join(OBJECTS_FOLDER);
    if folders.is_dir() {
        for path in store::paths_in(&folders)?
            .into_iter()
            .filter(|path| path.is_dir() && !store::is_hidden(path))
        {
            let name = path
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned();
            objects.insert(name, read(&path)?);
        }
    } else if folder.join(MASK_FOLDER).is_dir() {
        objects.insert("object".to_owned(), read(&folder.join(MASK_FOLDER))?);
    }
    Ok(objects)
}

/// Returns the objects with their classes; those that `classes.json` does not name are of class other.
fn listed_objects(
    folder: &Path,
    masks: &BTreeMap<String, BTreeMap<String, PathBuf>>,
) -> Result<BTreeMap<String, SceneObject>, CurateError> {
    let path = folder.join(CLASSES_FILE);
    let mut classes: BTreeMap<String, ObjectClass> = match path.is_file() {
        true => super::read_json(&path)?,
        false => BTreeMap::new(),
    };
    let objects = masks.keys().map(|name| {
        let class = classes.remove(name).unwrap_or_default();
        (name.clone(), SceneObject { class })
    });
    let objects = objects.collect();
    match classes.into_keys().next() {
        Some(name) => {
            let reason = format!("has a class {name:?} without masks");
            Err(CurateError::input(&path, reason))
        }
        None => Ok(objects),
    }
}

fn focal_of(folder: &Path) -> Result<Option<f64>, CurateError> {
    let path = folder.join("camera.json");
    if !path.is_file() {
        return Ok(None);
    }
    let camera: CameraFile = super::read_json(&path)?;
    let is_possible = camera.focal > 0.0 && camera.focal.is_finite();
    if !is_possible {
        let reason = format!("has a focal length of {} pixels", camera.focal);
        return Err(CurateError::input(&path, reason));
    }
    Ok(Some(camera.focal))
}

/// Returns the poses of a `poses.json`, one for each frame; its camera, or that of a `camera.json`.
fn given_poses(
    folder: &Path,
    path: &Path,
    images: &[PathBuf],
    size: [usize; 2],
) -> Result<PosedCamera, CurateError> {
    let record: Poses = store::read_record(path)?;
    if record.frames.len() != images.len() {
        let reason = format!(
            "has {} poses for {} frames",
            record.frames.len(),
            images.len()
        );
        return Err(CurateError::input(path, reason));
    }
    // Poses without names belong to frames by number, or if names have only one order.
    if !images.is_sorted() && !frame_order::are_counted(images) {
        let reason = "has poses in an order that frames do not tell: number their names from 0 or 1 on, with as \
                      many digits each";
        return Err(CurateError::input(path, reason));
    }
    if let Some(number) = record
        .frames
        .iter()
        .position(|frame| !frame.pose.is_valid())
    {
        let reason = format!("pose {number} is not a rotation with a place");
        return Err(CurateError::input(path, reason));
    }
    let camera = match (record.camera, focal_of(folder)?) {
        (Some(camera), _) => camera,
        (None, Some(focal)) => turns::pinhole(size, focal),
        (None, None) => {
            let reason = "must have a camera, or a camera.json with the focal length beside it";
            return Err(CurateError::input(path, reason));
        }
    };
    let points = match &record.points {
        Some(file) => PointCloud::read_ply(&folder.join(file))?,
        None => PointCloud::default(),
    };
    Ok(PosedCamera {
        camera,
        poses: record.frames.iter().map(|frame| Some(frame.pose)).collect(),
        points,
        scale: record.scale,
        source: PoseSource::Given {
            file: path
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned(),
        },
    })
}

/// Refuses panoramas, which only their poses would tell from a perspective clip.
fn refuse_panoramas(
    folder: &Path,
    images: &[PathBuf],
    [width, height]: [usize; 2],
) -> Result<(), CurateError> {
    let paths: Vec<&Path> = images.iter().map(PathBuf::as_path).collect();
    let opaque = |path: &&Path| -> Result<bool, StoreError> {
        Ok(ImageFile::open(path)?.decode_shown()?.transparent.is_none())
    };
    // A few suffice; images that are transparent in places are checked by their import.
    let mut few = Vec::new();
    for path in paths
        .iter()
        .step_by(paths.len().div_ceil(FEW_IMAGES).max(1))
    {
        if opaque(path)? {
            few.push(*path);
        }
    }
    if few.is_empty() || !stills::are_panoramas(&few, [width as u32, height as u32])? {
        return Ok(());
    }
    let reason = format!(
        "has {} images of {width}x{height} that are panoramas, without poses; --format panoramas takes them",
        images.len()
    );
    Err(CurateError::input(folder, reason))
}

/// Estimates the rotations of a camera in place, from the images.
fn registered(
    images: &[PathBuf],
    objects: &BTreeMap<String, BTreeMap<String, PathBuf>>,
    [width, height]: [usize; 2],
    focal: Option<f64>,
) -> Result<PosedCamera, CurateError> {
    let frames: Vec<GreyFrame> = images
        .par_iter()
        .map(|image| grey_frame(image, objects, [width, height]))
        .collect::<Result<_, CurateError>>()?;
    let found = turns::registered(&frames, [width, height], focal);
    Ok(PosedCamera {
        camera: found.camera,
        poses: found.poses,
        points: PointCloud::default(),
        scale: Scale::Arbitrary,
        source: PoseSource::Registered {
            reason: found.reason,
            succeeded: found.succeeded,
        },
    })
}

fn grey_frame(
    image: &Path,
    objects: &BTreeMap<String, BTreeMap<String, PathBuf>>,
    size: [usize; 2],
) -> Result<GreyFrame, CurateError> {
    let [width, height] = size;
    // In the form that the import writes.
    let shown = ImageFile::open(image)?.decode_shown()?;
    if shown.size != size {
        let [found_width, found_height] = shown.size;
        let reason = format!("is {found_width}x{found_height}, others are {width}x{height}");
        return Err(CurateError::input(image, reason));
    }
    let rgb = RgbImage::from_rgb8(width, height, &shown.rgb);
    let mut open: Vec<bool> = match &shown.transparent {
        Some(mask) => mask.data.iter().map(|&mark| mark == 0).collect(),
        None => vec![true; width * height],
    };
    for masks in objects.values() {
        let Some(file) = masks.get(&stem(image)) else {
            continue;
        };
        let mask = Mask::decode(ImageFile::open(file)?.expect_size(size)?)?;
        // A mask's edge is not exact.
        let reach = (width / 100).max(1);
        for pixel in (0..mask.data.len()).filter(|&pixel| mask.data[pixel] >= 128) {
            let (column, row) = (pixel % width, pixel / width);
            for near in row.saturating_sub(reach)..=(row + reach).min(height - 1) {
                let first = near * width + column.saturating_sub(reach);
                let last = near * width + (column + reach).min(width - 1);
                open[first..=last].fill(false);
            }
        }
    }
    Ok(turns::grey_frame(&rgb, open))
}
