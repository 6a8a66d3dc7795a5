//! Scenes of OmniPhotos: panoramas on a circle with the trajectory and the map of OpenVSLAM.
//!
//! ```text
//! Input/                       the panoramas
//! Config/modelFiles.openvslam  three lines: the files below, relative to Config
//! Capture/openvslam/cameras.txt
//! Capture/openvslam/frame_trajectory_with_filename.txt
//! Capture/openvslam/map.msg    the map in MessagePack, of which the landmarks are read
//! ```
//!
//! (`Python/preprocessing/readme.md`, section 4.1.2, and `src/Core/Loaders/OpenVSLAMLoader.cpp` of `cr333/OmniPhotos`.)
//! A line of the trajectory has index, file name, place (x, y, z) and quaternion (x, y, z, w), camera to world. As in
//! the loader, lines with `#` or a negative index are skipped, and the file name ends at its first `/`.
//!
//! Axes: OpenVSLAM's panorama has `lon = (u / W - 1/2) 2 pi`, `lat = -(v / H - 1/2) pi` and
//! `p = (cos lat sin lon, -sin lat, cos lat cos lon)` (`src/openvslam/camera/equirectangular.cc` of
//! `xdspacelab/openvslam`): x right, y down, z forward, and the image is ours. Nothing is turned. (The loader of
//! OmniPhotos turns the world, cameras and points alike, by `diag(1, -1, -1)`; ours stays that of OpenVSLAM.)
//! The camera has the size of the images: `cameras.txt` has that of the video, which `Input` may be scaled from.
//!
//! Numbers in the names of images count the frames of a video, whose rate the import is to be given.
//!
//! Split: the authors publish none. Their viewer's clip and sampling of cameras (`Config/*.yaml`) are not a split and not
//! applied. The data of ODGS, with OpenMVG's poses and a split, are the format `openmvg`.

mod landmarks;

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use glam::{DQuat, DVec3};
use omnilife_schemas::{
    Pose,
    points::PointCloud,
    store::{self, StoreError},
};

use super::{panorama_camera, text_file};
use crate::{
    error::CurateError,
    exchange::{ForeignFrame, ForeignScene, Format, file_of, image_of},
};

/// The format.
pub const FORMAT: Format = Format {
    id: "omniphotos",
    about: "scenes of OmniPhotos with the trajectory and map of OpenVSLAM",
    holds_cube_faces: false,
    holds_padded_panoramas: false,
    export: None,
    import,
};

const MODEL_FILE: &str = "Config/modelFiles.openvslam";
const INPUT_FOLDER: &str = "Input";
/// Maps have some tens of megabytes, most of them features of key frames.
const MOST_MAP_BYTES: u64 = 1 << 30;
/// The largest deviation of a quaternion's length from 1; they are written with nine digits.
const LENGTH_TOLERANCE: f64 = 1e-3;

/// The files that `modelFiles.openvslam` names.
struct ModelFiles {
    cameras: PathBuf,
    trajectory: PathBuf,
    /// The file that the third line names, unless that is empty.
    map: Option<PathBuf>,
}

impl ModelFiles {
    fn read(folder: &Path) -> Result<Self, CurateError> {
        let path = folder.join(MODEL_FILE);
        let text = text_file::read(&path)?;
        let mut lines = text.lines().map(str::trim);
        // Relative to the folder of the list, and within that of the scene.
        let file = |line: &str| file_of(folder, &format!("Config/{line}"));
        let mut named = |what: &str| match lines.next() {
            Some(line) if !line.is_empty() => file(line),
            _ => {
                let reason = format!("has no line with the file of its {what}");
                Err(StoreError::malformed(&path, reason).into())
            }
        };
        Ok(Self {
            cameras: named("cameras")?,
            trajectory: named("trajectory")?,
            map: match lines.next() {
                Some(line) if !line.is_empty() => Some(file(line)?),
                _ => None,
            },
        })
    }
}

/// Refuses scenes of other cameras than one panorama.
fn expect_panoramas(path: &Path) -> Result<(), StoreError> {
    let text = text_file::read(path)?;
    let cameras: Vec<&str> = text
        .lines()
        .filter(|line| !line.starts_with('#') && !line.trim().is_empty())
        .collect();
    let model = match cameras.as_slice() {
        [camera] => camera.split_ascii_whitespace().nth(1),
        _ => {
            let reason = format!("has {} cameras, expected 1", cameras.len());
            return Err(StoreError::malformed(path, reason));
        }
    };
    if model == Some("EQUIRECTANGULAR") {
        return Ok(());
    }
    let reason = format!(
        "its camera is {}, expected EQUIRECTANGULAR",
        model.unwrap_or("without a model")
    );
    Err(StoreError::malformed(path, reason))
}

/// An image of the trajectory.
struct TrajectoryImage<'a> {
    /// Name in `Input`.
    name: &'a str,
    pose: Pose,
}

/// Parses a line of the trajectory; `None` for those that the loader skips.
///
/// # Errors
/// Names the malformed part of the line.
fn posed(line: &str) -> Result<Option<TrajectoryImage<'_>>, String> {
    if line.starts_with('#') || line.trim().is_empty() {
        return Ok(None);
    }
    let words: Vec<&str> = line.split_ascii_whitespace().collect();
    let [index, name, numbers @ ..] = words.as_slice() else {
        return Err("has no index and file name".to_owned());
    };
    let index: i64 = index
        .parse()
        .map_err(|_error| format!("begins with {index:?}, expected an index"))?;
    if index < 0 {
        return Ok(None);
    }
    let numbers: Vec<f64> = numbers
        .iter()
        .map(|word| word.parse::<f64>().ok().filter(|value| value.is_finite()))
        .collect::<Option<_>>()
        .ok_or("has a value that is not a finite number")?;
    let &[x, y, z, qx, qy, qz, qw] = numbers.as_slice() else {
        return Err(format!(
            "has {} numbers after the file name, expected place and quaternion, 7",
            numbers.len()
        ));
    };
    let turn = DQuat::from_xyzw(qx, qy, qz, qw);
    let length = turn.length();
    if (length - 1.0).abs() > LENGTH_TOLERANCE {
        return Err(format!(
            "has a quaternion of length {length}, expected one of length 1"
        ));
    }
    Ok(Some(TrajectoryImage {
        name: name.split_once('/').map_or(*name, |(_, below)| below),
        pose: Pose::new(turn.normalize(), DVec3::new(x, y, z)),
    }))
}

fn import(folder: &Path) -> Result<ForeignScene, CurateError> {
    let files = ModelFiles::read(folder)?;
    expect_panoramas(&files.cameras)?;
    let images = folder.join(INPUT_FOLDER);
    let (mut frames, mut missing_images) = (Vec::new(), Vec::new());
    let mut names = BTreeSet::new();
    let text = text_file::read(&files.trajectory)?;
    for (number, line) in (1..).zip(text.lines()) {
        let malformed = |reason: String| {
            StoreError::malformed(&files.trajectory, format!("line {number} {reason}"))
        };
        let Some(TrajectoryImage { name, pose }) = posed(line).map_err(malformed)? else {
            continue;
        };
        if !names.insert(name) {
            return Err(malformed(format!("has a second pose of {name}")).into());
        }
        let Some(image) = image_of(&images, name)? else {
            missing_images.push(name.to_owned());
            continue;
        };
        frames.push(ForeignFrame {
            image,
            mask: None,
            objects: BTreeMap::new(),
            pose: Some(pose),
            distance: None,
            moment: None,
        });
    }
    let points = match &files.map {
        Some(map) => read_landmarks(map)?,
        None => PointCloud::default(),
    };
    let camera = panorama_camera(folder, &frames, &missing_images)?;
    Ok(ForeignScene {
        image_folders: vec![images],
        missing_images,
        notes: vec![if points.is_empty() {
            "no points: no map is named, or it has no landmarks".to_owned()
        } else {
            "the landmarks have no colours: points are grey".to_owned()
        }],
        points,
        ..ForeignScene::new(camera, frames, folder)
    })
}

/// Reads the landmarks of a map, grey.
fn read_landmarks(path: &Path) -> Result<PointCloud, StoreError> {
    let bytes = store::read_limited(path, MOST_MAP_BYTES)?;
    let positions =
        landmarks::positions(&bytes).map_err(|reason| StoreError::malformed(path, reason))?;
    Ok(PointCloud {
        colours: vec![[128; 3]; positions.len()],
        positions,
    })
}
