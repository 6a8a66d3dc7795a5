//! Folders of panoramas in the layout in which Splatter-360 and its successors keep HM3D and Replica
//! (`preprocess/dataset_generation`, `src/dataset/dataset_hm3d.py` of Splatter-360).
//!
//! ```text
//! pano/00000.png ...       the frames, numbered
//! mask/00000.png ...       white where something moves (ours; their readers have no masks)
//! rotation.npy             (frames, 3, 3) f32, camera to world
//! translation.npy          (frames, 3) f32, camera centres
//! origin.json              {"origin": [x, y, z]}, where f32 does not hold the centres (ours): they lie around it
//! train.txt, test.txt      numbers of the frames for training and for testing, where a split is given
//! ```
//!
//! Axes: their panorama has `theta = (1/2 - u / W) 2 pi`, `phi = (1/2 - v / H) pi` and
//! `p = (cos phi sin theta, sin phi, cos phi cos theta)`: x left, y up, z forward at the image
//! centre. So the x and y columns of camera-to-world change their signs. (A Habitat agent looks
//! along -z of this frame, out of the panorama's edge.) Numbers are f32, as their loaders expect:
//! poses keep 7 digits, of the extent of the cameras where they lie far from the world's origin. Row i of the arrays
//! is that of image number i, counted from 0 or from 1. The format has no points; depth maps (`pano_depth`) are not
//! ours to write.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{collections::BTreeMap, path::Path};

use glam::{DMat3, DVec3};
use omnilife_schemas::{
    Pose, RgbImage, Similarity,
    camera::{Camera, ErpCamera},
    image_file::ImageFile,
    npy,
    store::{self, StoreError},
};
use serde::{Deserialize, Serialize};

use super::{
    ExportScene, ForeignFrame, ForeignMask, ForeignScene, Format, Writer, left_out,
    parts::numbered_name,
};
use crate::{error::CurateError, frame_order, poses::frame_camera::FrameCamera};

/// The format.
pub const FORMAT: Format = Format {
    id: "hm3d",
    about: "panoramas with rotation.npy and translation.npy, as Splatter-360 keeps HM3D; no points",
    holds_cube_faces: false,
    holds_padded_panoramas: false,
    export: Some(Writer {
        write: export,
        holds: &[],
    }),
    import,
};

const ROTATION_FILE: &str = "rotation.npy";
const TRANSLATION_FILE: &str = "translation.npy";
const ORIGIN_FILE: &str = "origin.json";

/// `origin.json`.
#[derive(Serialize, Deserialize)]
struct Origin {
    /// World units.
    origin: [f64; 3],
}

/// Returns the place around which f32 holds the cameras; `None` if that is the world's origin.
fn origin(scene: &ExportScene) -> Option<DVec3> {
    let frames = scene.frames.iter();
    let centres: Vec<DVec3> = frames.map(|frame| frame.pose.centre()).collect();
    Similarity::from_most_cameras(&centres)
        .filter(|around| !around.fits_f32())
        .map(|around| DVec3::from_array(around.offset))
}

/// Converts our camera axes to the format's, and back.
fn turned(rotation: DMat3) -> DMat3 {
    rotation * DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0))
}

fn export(scene: &ExportScene, out: &Path) -> Result<(), CurateError> {
    match scene.camera {
        Camera::Erp(_) => {}
        Camera::Pinhole(_) => {
            return Err(CurateError::input(
                out,
                "hm3d holds panoramas, and the camera of the scene is a pinhole",
            ));
        }
    }
    let (panoramas, masks) = (out.join("pano"), out.join("mask"));
    store::create_folder(&panoramas)?;
    write_split_lists(scene, out)?;
    let origin = origin(scene);
    if let Some(origin) = origin {
        let origin = Origin {
            origin: origin.to_array(),
        };
        super::write_json(&out.join(ORIGIN_FILE), &origin)?;
    }
    let (mut rotations, mut translations) = (Vec::new(), Vec::new());
    for (index, frame) in scene.frames.iter().enumerate() {
        let name = numbered_name(index);
        let is_png = frame.name.to_ascii_lowercase().ends_with(".png");
        if is_png {
            store::copy_atomically(&frame.image, &panoramas.join(&name))?;
        } else {
            RgbImage::read(&frame.image)?.write_png(&panoramas.join(&name))?;
        }
        if let Some(mask) = &frame.mask {
            store::create_folder(&masks)?;
            store::copy_atomically(mask, &masks.join(&name))?;
        }
        super::masks::copy_ignore_mask(frame, &name, out)?;
        // Valid poses have a rotation: frames were selected by that.
        let rotation = turned(DMat3::from_quat(frame.pose.rotation().unwrap_or_default()));
        rotations.extend(rotation.transpose().to_cols_array().map(|v| v as f32));
        let centre = frame.pose.centre() - origin.unwrap_or_default();
        translations.extend(centre.to_array().map(|v| v as f32));
    }
    let count = scene.frames.len();
    npy::write_f32(&out.join(ROTATION_FILE), &[count, 3, 3], &rotations)?;
    npy::write_f32(&out.join(TRANSLATION_FILE), &[count, 3], &translations)?;
    Ok(())
}

fn write_split_lists(scene: &ExportScene, out: &Path) -> Result<(), StoreError> {
    if !scene.has_split {
        return Ok(());
    }
    for (file, is_input) in [("train.txt", true), ("test.txt", false)] {
        let frames = scene.frames.iter().enumerate();
        let lines: String = frames
            .filter(|(_, frame)| frame.is_input == is_input)
            .map(|(index, _)| format!("{index:05}\n"))
            .collect();
        store::write_bytes(&out.join(file), lines.as_bytes())?;
    }
    Ok(())
}

fn import(folder: &Path) -> Result<ForeignScene, CurateError> {
    let (rotation_path, translation_path) =
        (folder.join(ROTATION_FILE), folder.join(TRANSLATION_FILE));
    let rotations = npy::read(&rotation_path)?;
    let translations = npy::read(&translation_path)?;
    let count = translations.shape.first().copied().unwrap_or(0);
    if rotations.shape != [count, 3, 3] || translations.shape != [count, 3] || count == 0 {
        return Err(StoreError::malformed(
            &rotation_path,
            format!(
                "must have rotations N x 3 x 3 and translations N x 3, got arrays of shape {:?} and {:?}",
                rotations.shape, translations.shape
            ),
        )
        .into());
    }
    let panoramas = frame_order::images_in(&folder.join("pano"))?;
    if panoramas.len() != count {
        return Err(CurateError::input(
            &folder.join("pano"),
            format!("has {} panoramas for {count} poses", panoramas.len()),
        ));
    }
    if !frame_order::are_counted(&panoramas) {
        return Err(CurateError::input(
            &folder.join("pano"),
            "has panoramas that are not numbered from 0 or 1 on without gaps, so rows of rotation.npy belong to \
             none of them",
        ));
    }
    let origin_path = folder.join(ORIGIN_FILE);
    let origin = if origin_path.is_file() {
        let Origin { origin } = super::read_json(&origin_path)?;
        DVec3::from_array(origin)
    } else {
        DVec3::ZERO
    };
    let mut frames = Vec::new();
    let (rotations, _) = rotations.values.as_chunks::<9>();
    let (translations, _) = translations.values.as_chunks::<3>();
    let poses = rotations.iter().zip(translations);
    for (index, (image, (rows, centre))) in panoramas.into_iter().zip(poses).enumerate() {
        let rotation = turned(DMat3::from_cols_array(rows).transpose());
        let centre = origin + DVec3::from_array(*centre);
        let pose = Pose::from_matrix(rotation, centre).ok_or_else(|| {
            StoreError::malformed(&rotation_path, format!("pose {index} must be a rotation"))
        })?;
        let mask = image
            .file_name()
            .map(|name| folder.join("mask").join(name))
            .filter(|file| file.is_file());
        frames.push(ForeignFrame {
            image,
            mask: mask.map(|file| ForeignMask {
                file,
                black_is_dynamic: false,
            }),
            objects: BTreeMap::new(),
            pose: Some(pose),
            moment: None,
            distance: None,
        });
    }
    let first = frames
        .first()
        .ok_or_else(|| CurateError::input(folder, "has no panoramas"))?;
    let [width, height] = ImageFile::open(&first.image)?.shown_size()?;
    let camera = ErpCamera {
        width: width as u32,
        height: height as u32,
    };
    Ok(ForeignScene {
        notes: left_out::unread_images(folder, &frames)?,
        ..ForeignScene::new(FrameCamera::Straight(camera.into()), frames, folder)
    })
}
