//! COLMAP's text model with its `EQUIRECTANGULAR` or `PINHOLE` camera
//! (<https://colmap.github.io/format.html#text-format>).
//!
//! ```text
//! images/                  the frames
//! masks/<image>.png        black where features are not to be taken (COLMAP's convention)
//! ignore/<image>           white outside of the scene; black in masks/ as well
//! sparse/0/cameras.txt     one camera
//! sparse/0/images.txt      per frame: quaternion (w, x, y, z) and translation, world to camera
//! sparse/0/points3D.txt    world points, without their tracks
//! train.txt, test.txt      images for training and for testing, where a split is given
//! ```
//!
//! Axes: COLMAP's cameras have x right, y down and z forward, and its equirectangular image is
//! ours: nothing is turned. `x_c = R x_w + t`. Its pinhole has the centre of the first pixel at
//! (1/2, 1/2), as ours.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    collections::BTreeMap,
    io::Write,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    camera::{Camera, ErpCamera, PinholeCamera},
    store::{self, StoreError},
};

use super::{
    ExportScene, ForeignFrame, ForeignScene, Format, FramePixels, Part, Writer, left_out,
    masks::black_mask,
};
use crate::{
    error::CurateError,
    poses::{
        colmap::{self, ColmapModel},
        colmap_binary, colmap_frames,
    },
};

/// The format.
pub const FORMAT: Format = Format {
    id: "colmap",
    about: "COLMAP text model with an EQUIRECTANGULAR (COLMAP 4.1 and later) or PINHOLE camera",
    holds_cube_faces: true,
    holds_padded_panoramas: false,
    export: Some(Writer {
        write: export,
        holds: &[Part::Points, Part::Names],
    }),
    import,
};

/// The format with the binary model, which some trainers read alone.
pub const BINARY_FORMAT: Format = Format {
    id: "colmap-binary",
    about: "the same with a binary model: cameras.bin, images.bin, points3D.bin",
    holds_cube_faces: true,
    holds_padded_panoramas: false,
    export: Some(Writer {
        write: export_binary,
        holds: &[Part::Points, Part::Names],
    }),
    import,
};

const MODEL_FOLDER: &str = "sparse/0";

fn export_binary(scene: &ExportScene, out: &Path) -> Result<(), CurateError> {
    let model = export_images(scene, out)?;
    let images: Vec<_> = scene
        .frames
        .iter()
        .map(|frame| (frame.name.as_str(), frame.pose))
        .collect();
    Ok(colmap_binary::write(
        &model,
        &scene.camera,
        &images,
        &scene.points,
    )?)
}

/// Writes images, masks and the lists of the split; returns the folder of the model.
fn export_images(scene: &ExportScene, out: &Path) -> Result<PathBuf, CurateError> {
    super::copy_images(scene, out)?;
    super::masks::write_black_masks(scene, &out.join("masks"), mask_name)?;
    super::write_split_lists(scene, out)?;
    let model = out.join(MODEL_FOLDER);
    store::create_folder(&model)?;
    Ok(model)
}

fn export(scene: &ExportScene, out: &Path) -> Result<(), CurateError> {
    let mut names = scene.frames.iter().map(|frame| &frame.name);
    if let Some(name) = names.find(|name| name.contains(char::is_whitespace)) {
        let reason = format!(
            "{name:?} has a space, at which COLMAP ends the name of an image in a text model; {} holds it",
            BINARY_FORMAT.id
        );
        return Err(CurateError::input(out, reason));
    }
    let model = export_images(scene, out)?;
    let camera = match scene.camera {
        Camera::Erp(ErpCamera { width, height }) => {
            format!("1 EQUIRECTANGULAR {width} {height} {width} {height}\n")
        }
        Camera::Pinhole(camera) => {
            let PinholeCamera { width, height, .. } = camera;
            let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy];
            format!("1 PINHOLE {width} {height} {fx} {fy} {cx} {cy}\n")
        }
    };
    store::write_bytes(&model.join("cameras.txt"), camera.as_bytes())?;
    store::write_with(&model.join("images.txt"), |writer| {
        for (id, frame) in (1..).zip(&scene.frames) {
            // Valid poses have a rotation: frames were selected by that.
            let q = frame.pose.rotation().unwrap_or_default().inverse();
            let t = -(q * frame.pose.centre());
            writeln!(
                writer,
                "{id} {} {} {} {} {} {} {} 1 {}\n",
                q.w, q.x, q.y, q.z, t.x, t.y, t.z, frame.name
            )?;
        }
        Ok(())
    })?;
    Ok(store::write_with(&model.join("points3D.txt"), |writer| {
        let points = scene.points.positions.iter().zip(&scene.points.colours);
        for (id, ([x, y, z], [r, g, b])) in (1..).zip(points) {
            // An error of 0 and no track: nothing is known about observations.
            writeln!(writer, "{id} {x} {y} {z} {r} {g} {b} 0")?;
        }
        Ok(())
    })?)
}

fn mask_name(image: &str) -> String {
    format!("{image}.png")
}

fn import(folder: &Path) -> Result<ForeignScene, CurateError> {
    let files = colmap::files(folder)?;
    let model = ColmapModel::read_files(&files.paths)?;
    let [_, images_file, _] = &files.paths;
    if model.images.is_empty() {
        return Err(StoreError::malformed(images_file, "has no images").into());
    }
    let together = colmap_frames::together(&files.paths)?;
    let root = root_of(folder, &files.paths);
    let (images, masks) = (root.join("images"), root.join("masks"));
    let (mut frames, mut missing_images) = (Vec::new(), Vec::new());
    for (id, image) in &model.images {
        let Some(path) = super::image_of(&images, &image.name)? else {
            missing_images.push(image.name.clone());
            continue;
        };
        frames.push(ForeignFrame {
            image: path,
            mask: black_mask(&masks, &mask_name(&image.name)),
            objects: BTreeMap::new(),
            pose: Some(image.pose()),
            moment: together.get(id).copied(),
            distance: None,
        });
    }
    let mut notes = left_out::unread_images(&root, &frames)?;
    notes.extend(files.note);
    Ok(ForeignScene {
        // COLMAP does not turn images (`Bitmap::Read` in `src/colmap/sensor/bitmap.cc`).
        pixels: FramePixels::Stored,
        image_folders: left_out::folders_below(&images)?,
        missing_images,
        notes,
        points: model.cloud(),
        ..ForeignScene::new(model.camera, frames, &root)
    })
}

/// Returns the folder with the images of a model: the given one or, if that is the model itself (`sparse/0`), one of
/// the two above it.
fn root_of(folder: &Path, [cameras, ..]: &[PathBuf; 3]) -> PathBuf {
    let is_model = cameras.parent() == Some(folder);
    folder
        .ancestors()
        .take(if is_model { 3 } else { 1 })
        .find(|place| place.join("images").is_dir())
        .unwrap_or(folder)
        .to_owned()
}
