//! Panoramas of `TartanAir` V2 (`castacks/tartanairpy`: `docs/modalities.rst`, `tartanair/reader.py`,
//! `tartanair/dataset.py`, `tartanair/customizer.py`).
//!
//! ```text
//! ENV/Data_easy/P000/image_lcam_equirect/000000_lcam_equirect_image.png    the panoramas, at 10 Hz
//! ENV/Data_easy/P000/depth_lcam_equirect/000000_lcam_equirect_depth.png    distances along the rays, metres
//! ENV/Data_easy/P000/pose_lcam_front.txt      tx ty tz qx qy qz qw for every frame, camera to world
//! ```
//!
//! Axes: the poses are those of the front camera, in north, east and down, its body with x forward, y right and z down;
//! the world is kept so. A panorama has the front camera's axis at three quarters of its width, as in Unreal Engine
//! (`image_sampler/full_view_rotation.py`), so that its middle looks to the left. On the published data this was
//! measured against the images of the front camera, and distances were measured to be along the rays
//! (`data-pipeline/conectoma/vision/panorama.py` of `fsantibanezleal/CAOS_RES_Conectoma`).
//!
//! A distance is a float in the four bytes of a pixel, in the order in which `OpenCV` has them in memory. The sky is "a
//! very large value", 65504 m at most; distances from 10 km on are unknown. No split is published.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use glam::{DMat3, DQuat, DVec3};
use omnilife_schemas::{
    Pose,
    records::{DistanceConvention, Scale},
    store::{self, StoreError},
};

use super::{folders_not_read, panorama_camera, plain_frame};
use crate::{
    error::CurateError,
    exchange::{DistanceEncoding, ForeignDistance, ForeignScene, Format, FrameRate},
    frame_order,
};

/// The format.
pub const FORMAT: Format = Format {
    id: "tartanair",
    about: "a trajectory of TartanAir V2 (P000): image_lcam_equirect/, depth_lcam_equirect/, pose_lcam_front.txt",
    holds_cube_faces: false,
    holds_padded_panoramas: false,
    export: None,
    import,
};

const POSE_FILE: &str = "pose_lcam_front.txt";
const IMAGES_FOLDER: &str = "image_lcam_equirect";
const DEPTH_FOLDER: &str = "depth_lcam_equirect";
/// Distance from which on a value stands for the sky, metres.
const SKY_FROM_METRES: f64 = 1e4;
/// From `docs/modalities.rst`.
const FRAME_RATE: FrameRate = FrameRate {
    frames_per_second: 10.0,
    reason: "TartanAir is sampled at 10 Hz",
};

fn import(folder: &Path) -> Result<ForeignScene, CurateError> {
    let pose_path = folder.join(POSE_FILE);
    let poses = read_poses(&pose_path)?;
    let distances = distances_by_number(&folder.join(DEPTH_FOLDER))?;
    let (mut frames, mut seen) = (Vec::new(), BTreeSet::new());
    for image in frame_order::images_in(&folder.join(IMAGES_FOLDER))? {
        let number = frame_order::number(&image)
            .ok_or_else(|| CurateError::input(&image, "has no number in its name"))?;
        let index = usize::try_from(number).ok();
        let pose = (index.and_then(|index| poses.get(index))).ok_or_else(|| {
            let reason = format!(
                "has {} poses, and {} is image {number}, counted from 0",
                poses.len(),
                image.display()
            );
            CurateError::input(&pose_path, reason)
        })?;
        let distance = distances.get(&number).map(|file| ForeignDistance {
            file: file.clone(),
            encoding: DistanceEncoding::FloatInBgra,
            unit: 1.0,
            convention: DistanceConvention::Ray,
            sky_from: SKY_FROM_METRES,
        });
        frames.push(plain_frame(image, *pose, distance));
        seen.insert(number);
    }
    let missing = (0_u64..).take(poses.len());
    let missing = missing.filter(|number| !seen.contains(number));
    let camera = panorama_camera(folder, &frames, &[])?;
    Ok(ForeignScene {
        scale: Scale::Metres,
        missing_images: missing
            .map(|number| format!("{IMAGES_FOLDER}/{number:06}_lcam_equirect_image.png"))
            .collect(),
        frame_rate: Some(FRAME_RATE),
        notes: (folders_not_read(folder, &[IMAGES_FOLDER, DEPTH_FOLDER])?)
            .into_iter()
            .collect(),
        ..ForeignScene::new(camera, frames, folder)
    })
}

/// Returns files of distances by the numbers in their names; empty without the folder.
fn distances_by_number(folder: &Path) -> Result<BTreeMap<u64, PathBuf>, StoreError> {
    if !folder.is_dir() {
        return Ok(BTreeMap::new());
    }
    let files = frame_order::images_in(folder)?.into_iter();
    Ok(files
        .filter_map(|file| Some((frame_order::number(&file)?, file)))
        .collect())
}

/// Returns the poses of the panoramas, one for each line.
fn read_poses(path: &Path) -> Result<Vec<Pose>, StoreError> {
    let text = store::read_text(path)?;
    let lines = (1_usize..).zip(text.lines());
    lines
        .filter(|(_, line)| !line.trim().is_empty() && !line.starts_with('#'))
        .map(|(number, line)| {
            pose_of(line).ok_or_else(|| {
                let reason = format!(
                    "line {number} must be a translation with a unit quaternion: tx ty tz qx qy qz qw"
                );
                StoreError::malformed(path, reason)
            })
        })
        .collect()
}

/// Returns the pose of the panorama at the front camera of a line.
fn pose_of(line: &str) -> Option<Pose> {
    let numbers: Vec<f64> = line
        .split_whitespace()
        .map(|word| word.parse().ok())
        .collect::<Option<_>>()?;
    let [tx, ty, tz, qx, qy, qz, qw] = <[f64; 7]>::try_from(numbers).ok()?;
    let (front, centre) = (DQuat::from_xyzw(qx, qy, qz, qw), DVec3::new(tx, ty, tz));
    // NaN compares false, so it is refused too.
    let is_unit = (front.length() - 1.0).abs() < 1e-3;
    if !is_unit || !centre.is_finite() {
        return None;
    }
    // In the body of the front camera (forward, right, down): right in the panorama is forward, down is down, and
    // its middle is the left.
    let to_body = DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y);
    let to_world = front.normalize() * DQuat::from_mat3(&to_body);
    Some(Pose::new(to_world.normalize(), centre))
}
