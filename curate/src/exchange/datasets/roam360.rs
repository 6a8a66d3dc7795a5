//! Scenes of 360Roam: panoramas of rooms with poses, points and the split of their authors.
//!
//! ```text
//! images/            the panoramas, 6080x3040 as published
//! pose_c2w.json      "train" and "test": per image `rgb_file` and `transform_matrix`, camera to world, 4x4
//! scene.ply          world points; `<folder>.ply` in some scenes
//! ```
//!
//! Axes: OmniGS, which has an author of 360Roam, hands the matrices on as OpenMVG's `rotation` (inverted) and
//! `center` without a turn (`scripts/360roam_to_openmvg_train.py` of OmniGS, stored as `raikuma/OmniGS-fork`).
//! It projects by `lon = atan2(x, z)`, `lat = asin(y / r)`, `u = (lon / pi + 1) W / 2`,
//! `v = (2 lat / pi + 1) H / 2` (`point3ToLonlatPixel` in `cuda_rasterizer/auxiliary.h`): x right, y down,
//! z forward, and the image is ours. Nothing is turned. The second name of the points is from
//! `tools/convert_360roam_to_colmap.py` of `Insta360-Research-Team/GGPS`, which reads the same axes.
//!
//! Split: the lists `train` and `test`. Times are not published, and the scenes count as static.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use glam::{DMat3, DMat4, DVec4};
use omnilife_schemas::{Pose, points::PointCloud, store::StoreError};
use serde::Deserialize;

use super::{panorama_camera, text_file};
use crate::{
    error::CurateError,
    exchange::{ForeignFrame, ForeignScene, ForeignSplit, Format, FrameRate, image_of},
};

/// The format.
pub const FORMAT: Format = Format {
    id: "360roam",
    about: "scenes of 360Roam with pose_c2w.json and their published split",
    holds_cube_faces: false,
    holds_padded_panoramas: false,
    export: None,
    import,
};

const POSES_FILE: &str = "pose_c2w.json";
const POINTS_FILE: &str = "scene.ply";

/// `pose_c2w.json`.
#[derive(Deserialize)]
struct Poses {
    train: Vec<PosedImage>,
    test: Vec<PosedImage>,
}

#[derive(Deserialize)]
struct PosedImage {
    /// Name in `images`.
    rgb_file: String,
    /// Rows of camera-to-world.
    transform_matrix: [[f64; 4]; 4],
}

impl PosedImage {
    fn pose(&self) -> Option<Pose> {
        let matrix = DMat4::from_cols_array_2d(&self.transform_matrix).transpose();
        if matrix.row(3) != DVec4::W {
            return None;
        }
        Pose::from_matrix(DMat3::from_mat4(matrix), matrix.w_axis.truncate())
    }
}

fn import(folder: &Path) -> Result<ForeignScene, CurateError> {
    let path = folder.join(POSES_FILE);
    let malformed = |reason: String| StoreError::malformed(&path, reason);
    let poses: Poses = text_file::read_json(&path)?;
    let images = folder.join("images");
    let (mut frames, mut missing_images) = (Vec::new(), Vec::new());
    let mut names = BTreeSet::new();
    for posed in poses.train.iter().chain(&poses.test) {
        if !names.insert(posed.rgb_file.as_str()) {
            return Err(malformed(format!("has two poses of {}", posed.rgb_file)).into());
        }
        let pose = posed
            .pose()
            .ok_or_else(|| malformed(format!("{} has no rigid transform", posed.rgb_file)))?;
        let Some(image) = image_of(&images, &posed.rgb_file)? else {
            missing_images.push(posed.rgb_file.clone());
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
    let listed = |images: &[PosedImage]| -> Vec<String> {
        let names = images.iter().map(|posed| posed.rgb_file.clone());
        names.collect()
    };
    let published_split = Some(ForeignSplit {
        source: format!("360Roam, {POSES_FILE}"),
        input: listed(&poses.train),
        novel: listed(&poses.test),
    });
    let points = points_file(folder);
    let notes = points.is_none().then(|| {
        format!("no points: the folder has neither {POINTS_FILE} nor a file of its own name")
    });
    let camera = panorama_camera(folder, &frames, &missing_images)?;
    Ok(ForeignScene {
        image_folders: vec![images],
        missing_images,
        published_split,
        frame_rate: Some(FrameRate::STATIC),
        notes: notes.into_iter().collect(),
        points: match points {
            Some(file) => PointCloud::read_ply(&file)?,
            None => PointCloud::default(),
        },
        ..ForeignScene::new(camera, frames, folder)
    })
}

/// Returns the file of the points: `scene.ply`, or that which has the name of its folder.
fn points_file(folder: &Path) -> Option<PathBuf> {
    let own_name = folder.file_name().map(|name| {
        let mut name = name.to_owned();
        name.push(".ply");
        folder.join(name)
    });
    [Some(folder.join(POINTS_FILE)), own_name]
        .into_iter()
        .flatten()
        .find(|file| file.is_file())
}
