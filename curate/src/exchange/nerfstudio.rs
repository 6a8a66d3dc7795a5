//! Nerfstudio's `transforms.json`
//! (<https://docs.nerf.studio/quickstart/data_conventions.html>).
//!
//! ```text
//! transforms.json          camera, per frame a camera-to-world matrix, and the files of the split
//! images/                  the frames
//! masks/<stem>.png         black where pixels are not used (nerfstudio's convention); of all frames or of none, as
//!                          its data parser asks (nerfstudio/data/dataparsers/nerfstudio_dataparser.py)
//! points.ply               world points
//! ```
//!
//! Axes: nerfstudio's cameras have x right, y up and z back (OpenGL). Its equirectangular image has -z in the centre,
//! which is our +z (`nerfstudio/cameras/cameras.py`, `EQUIRECTANGULAR`, with `fl_x = w / 2` and `fl_y = h`). For a
//! padded panorama w and h are its own, and `cx` and `cy` its middle. So the y and z columns of camera-to-world change
//! their signs. The world is not turned: nerfstudio levels it by default. A pinhole's principal point is taken as it
//! stands; the centre of the first pixel is at (1/2, 1/2) there too. `ns-process-data` has turned its cameras by
//! `applied_transform`, and the points of `ply_file_path` alike: their world is kept.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

mod camera;

use std::{borrow::Cow, collections::BTreeMap, path::Path};

use camera::{Entries, camera};
use glam::{DMat3, DMat4, DVec3, DVec4};
use omnilife_schemas::{
    Pose,
    camera::{Camera, ErpCamera, PinholeCamera},
    points::PointCloud,
    store::{self, StoreError},
};
use serde::{Deserialize, Serialize};

use super::{
    ExportScene, ForeignFrame, ForeignMask, ForeignScene, Format, FramePixels, Part, Writer,
    file_of, left_out, stem,
};
use crate::{error::CurateError, frame_order};

/// The format.
pub const FORMAT: Format = Format {
    id: "nerfstudio",
    about: "nerfstudio's transforms.json with an EQUIRECTANGULAR, PINHOLE or OPENCV camera",
    holds_cube_faces: true,
    holds_padded_panoramas: true,
    export: Some(Writer {
        write: export,
        holds: &[Part::Points, Part::Names],
    }),
    import,
};

const TRANSFORMS_FILE: &str = "transforms.json";
const POINTS_FILE: &str = "points.ply";
const ERP_MODEL: &str = "EQUIRECTANGULAR";
const PINHOLE_MODEL: &str = "PINHOLE";

/// `transforms.json` as it is written.
#[derive(Serialize)]
struct Transforms {
    camera_model: String,
    w: u32,
    h: u32,
    fl_x: f64,
    fl_y: f64,
    cx: f64,
    cy: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    ply_file_path: Option<String>,
    /// Files of the split, in the form of nerfstudio's data parser.
    #[serde(skip_serializing_if = "Option::is_none")]
    train_filenames: Option<Vec<String>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    val_filenames: Option<Vec<String>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    test_filenames: Option<Vec<String>>,
    frames: Vec<Frame>,
}

/// `transforms.json` as it is read.
#[derive(Deserialize)]
struct ForeignTransforms {
    #[serde(default)]
    ply_file_path: Option<String>,
    frames: Vec<Frame>,
    #[serde(flatten)]
    others: Entries,
}

#[derive(Serialize, Deserialize)]
struct Frame {
    file_path: String,
    transform_matrix: [[f64; 4]; 4],
    #[serde(default, skip_serializing_if = "Option::is_none")]
    mask_path: Option<String>,
    /// Entries of its camera among them.
    #[serde(flatten)]
    others: Entries,
}

/// Converts our camera axes to OpenGL's, and back.
fn opengl(rotation: DMat3) -> DMat3 {
    rotation * DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0))
}

/// Returns the pose of a camera-to-world matrix, by rows; `None` unless it is a rigid transform.
pub(super) fn pose_of(transform_matrix: &[[f64; 4]; 4]) -> Option<Pose> {
    let matrix = DMat4::from_cols_array_2d(transform_matrix).transpose();
    let rotation = opengl(DMat3::from_mat4(matrix));
    Pose::from_matrix(rotation, matrix.w_axis.truncate()).filter(|_| matrix.row(3) == DVec4::W)
}

/// Reads the poses of a `transforms.json` with the files of their images, which need not exist.
///
/// # Errors
/// When the file is missing or malformed, or a matrix is not a rigid transform.
pub(super) fn poses(path: &Path) -> Result<Vec<(String, Pose)>, CurateError> {
    let transforms: ForeignTransforms = super::read_json(path)?;
    let frames = transforms.frames.into_iter();
    let posed = frames.map(|frame| {
        let pose = pose_of(&frame.transform_matrix).ok_or_else(|| {
            StoreError::malformed(path, format!("{} has no rigid transform", frame.file_path))
        })?;
        Ok((frame.file_path, pose))
    });
    posed.collect()
}

fn export(scene: &ExportScene, out: &Path) -> Result<(), CurateError> {
    super::copy_images(scene, out)?;
    let masks = out.join("masks");
    super::masks::write_black_masks(scene, &masks, mask_name)?;
    let has_masks = super::masks::write_white_masks(scene, &masks, mask_name)?;
    let intrinsics = match scene.camera {
        Camera::Erp(ErpCamera { width, height }) => {
            let whole = ([0, 0], [width, height]);
            let padded = scene.panorama.map(|frame| (frame.offset(), frame.image()));
            let ([left, top], size) = padded.unwrap_or(whole);
            let [across, down] = size.map(f64::from);
            PinholeCamera {
                width,
                height,
                fx: across / 2.0,
                fy: down,
                cx: f64::from(left) + across / 2.0,
                cy: f64::from(top) + down / 2.0,
            }
        }
        Camera::Pinhole(camera) => camera,
    };
    let has_points = !scene.points.is_empty();
    if has_points {
        scene.points.write_ply(&out.join(POINTS_FILE))?;
    }
    let frames = scene.frames.iter().map(|frame| {
        // Valid poses have a rotation: frames were selected by that.
        let rotation = DMat3::from_quat(frame.pose.rotation().unwrap_or_default());
        let mut matrix = DMat4::from_mat3(opengl(rotation));
        matrix.w_axis = frame.pose.centre().extend(1.0);
        Frame {
            file_path: format!("images/{}", frame.name),
            // Rows of the matrix are columns of its transpose.
            transform_matrix: matrix.transpose().to_cols_array_2d(),
            mask_path: has_masks.then(|| format!("masks/{}", mask_name(&frame.name))),
            others: Entries::new(),
        }
    });
    let files = |is_input: bool| -> Option<Vec<String>> {
        let frames = scene
            .frames
            .iter()
            .filter(|frame| frame.is_input == is_input);
        let files = frames.map(|frame| format!("images/{}", frame.name));
        scene.has_split.then(|| files.collect())
    };
    let transforms = Transforms {
        camera_model: match scene.camera {
            Camera::Erp(_) => ERP_MODEL,
            Camera::Pinhole(_) => PINHOLE_MODEL,
        }
        .to_owned(),
        w: intrinsics.width,
        h: intrinsics.height,
        fl_x: intrinsics.fx,
        fl_y: intrinsics.fy,
        cx: intrinsics.cx,
        cy: intrinsics.cy,
        ply_file_path: has_points.then(|| POINTS_FILE.to_owned()),
        train_filenames: files(true),
        val_filenames: files(false),
        test_filenames: files(false),
        frames: frames.collect(),
    };
    Ok(super::write_json(&out.join(TRANSFORMS_FILE), &transforms)?)
}

fn mask_name(image: &str) -> String {
    format!("{}.png", stem(image))
}

/// Returns the file that a name stands for: the one of that name, or else the one with `/` for the `\` of Windows, or
/// else the only image of that name with an ending, as in synthetic scenes of the first radiance fields. Returns the name
/// itself where no file is found.
fn file_for<'a>(folder: &Path, name: &'a str) -> Cow<'a, str> {
    const ENDINGS: [&str; 3] = ["png", "jpg", "jpeg"];
    if folder.join(name).exists() {
        return Cow::Borrowed(name);
    }
    let slashed = name.replace('\\', "/");
    if folder.join(&slashed).is_file() {
        return Cow::Owned(slashed);
    }
    let ended = ENDINGS.map(|ending| format!("{slashed}.{ending}"));
    let mut found = (ended.into_iter()).filter(|file| folder.join(file).is_file());
    match (found.next(), found.next()) {
        (Some(file), None) => Cow::Owned(file),
        _ => Cow::Borrowed(name),
    }
}

/// Returns a line on files of points beside a `transforms.json` that names none: nerfstudio reads the named one alone.
fn unnamed_points(folder: &Path) -> Result<Option<String>, StoreError> {
    let mut names = store::names_in(folder)?;
    names.retain(|name| frame_order::has_extension(Path::new(name), &["ply"]));
    let what = "files of points that are not read, as transforms.json has no ply_file_path";
    Ok(left_out::line(&names, what))
}

fn import(folder: &Path) -> Result<ForeignScene, CurateError> {
    let path = folder.join(TRANSFORMS_FILE);
    let malformed = |reason: String| StoreError::malformed(&path, reason);
    let transforms: ForeignTransforms = super::read_json(&path)?;
    let (camera, unread) = camera(&transforms.others, &transforms.frames).map_err(malformed)?;
    let (mut frames, mut missing_images) = (Vec::new(), Vec::new());
    let mut renamed = Vec::new();
    for frame in &transforms.frames {
        let name = file_for(folder, &frame.file_path);
        if name != frame.file_path {
            renamed.push(format!("{} as {name}", frame.file_path));
        }
        let Some(image) = super::image_of(folder, &name)? else {
            missing_images.push(frame.file_path.clone());
            continue;
        };
        let pose = pose_of(&frame.transform_matrix)
            .ok_or_else(|| malformed(format!("{} has no rigid transform", frame.file_path)))?;
        let mask = match &frame.mask_path {
            Some(mask) => Some(ForeignMask {
                file: file_of(folder, &file_for(folder, mask))?,
                black_is_dynamic: true,
            }),
            None => None,
        };
        frames.push(ForeignFrame {
            image,
            mask,
            objects: BTreeMap::new(),
            pose: Some(pose),
            moment: None,
            distance: None,
        });
    }
    let mut beside = left_out::unread_images(folder, &frames)?;
    if transforms.ply_file_path.is_none() {
        beside.extend(unnamed_points(folder)?);
    }
    Ok(ForeignScene {
        // Its data set does not turn images (`get_numpy_image` in `nerfstudio/data/datasets/base_dataset.py`).
        pixels: FramePixels::Stored,
        missing_images,
        notes: left_out::line(&unread, "entries of transforms.json that are not read")
            .into_iter()
            .chain(left_out::line(
                &renamed,
                "images that have other names than in transforms.json",
            ))
            .chain(beside)
            .collect(),
        points: match &transforms.ply_file_path {
            Some(file) => PointCloud::read_ply(&file_of(folder, &file_for(folder, file))?)?,
            None => PointCloud::default(),
        },
        ..ForeignScene::new(camera, frames, folder)
    })
}
