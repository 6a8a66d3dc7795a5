//! `OB3D`: rendered panoramas on a small spiral (`Egocentric`) or a long path (`Non-Egocentric`)
//! (`README.md`, `blender_script/generate_trajectory-data.py`, `demo_files/dataset_omniphoto.py` and
//! `utils/eval_depth.py` of `gsisaoki/Omnidirectional_Blender_3D_Dataset`).
//!
//! ```text
//! SCENE/Egocentric/cameras/00000_cam.json      a list of one camera: size, rotation and translation, world to camera
//! SCENE/Egocentric/images/00000_rgb.png        the panoramas
//! SCENE/Egocentric/depths/00000_depth.exr      distances along the rays (not read)
//! SCENE/Egocentric/normals/00000_normal.exr    (not read)
//! SCENE/Egocentric/sparse/sparse.ply           world points
//! SCENE/Egocentric/train.txt, test.txt         images by their numbers or names
//! ```
//!
//! Axes: `convert_blender_to_opencv` has turned the cameras to x right, y down, z forward, which is the middle of
//! Blender's panorama: ours. The world of Blender, z up, is kept. `intrinsics` mean nothing for a panorama.
//! Distances are `OpenEXR` files, which this program does not read; the loaders do not agree on their unit (1 in
//! `dataset_omniphoto.py`, 100 in `eval_depth.py`).

use std::{collections::BTreeMap, path::Path};

use glam::{DMat3, DVec3};
use omnilife_schemas::{
    Pose,
    points::PointCloud,
    store::{self, StoreError},
};
use serde::Deserialize;

use super::{folders_not_read, panorama_camera, plain_frame};
use crate::{
    error::CurateError,
    exchange::{
        ForeignFrame, ForeignScene, ForeignSplit, Format, FrameRate, image_of, left_out, read_json,
    },
    frame_order,
};

/// The format.
pub const FORMAT: Format = Format {
    id: "ob3d",
    about: "a capture of OB3D (SCENE/Egocentric): cameras/, images/, sparse/, train.txt and test.txt; its EXR \
            distances are left out",
    holds_cube_faces: false,
    holds_padded_panoramas: false,
    export: None,
    import,
};

const CAMERAS_FOLDER: &str = "cameras";
const IMAGES_FOLDER: &str = "images";
const DEPTH_FOLDER: &str = "depths";
const POINTS_FOLDER: &str = "sparse";
/// End of a camera's file name, and of its image's.
const CAMERA_END: &str = "_cam.json";
const IMAGE_END: &str = "_rgb.png";

#[derive(Deserialize)]
struct Camera {
    width: u32,
    height: u32,
    extrinsics: Extrinsics,
}

#[derive(Deserialize)]
struct Extrinsics {
    /// Rows, world to camera.
    rotation: [[f64; 3]; 3],
    translation: [f64; 3],
}

/// Cameras by the names of their images, in the folder of the capture.
struct NamedCameras {
    frames: Vec<ForeignFrame>,
    missing_images: Vec<String>,
    /// Names of images by their numbers.
    numbers: BTreeMap<u64, String>,
}

fn import(folder: &Path) -> Result<ForeignScene, CurateError> {
    let found = frames_of(folder)?;
    let mut notes = Vec::new();
    let depth = folder.join(DEPTH_FOLDER);
    if depth.is_dir() {
        let files = left_out::line(
            &store::names_in(&depth)?,
            "distances left out, which are OpenEXR files",
        );
        notes.extend(files);
    }
    let read = [CAMERAS_FOLDER, IMAGES_FOLDER, DEPTH_FOLDER, POINTS_FOLDER];
    notes.extend(folders_not_read(folder, &read)?);
    let lists: [&Path; 2] = [&folder.join("train.txt"), &folder.join("test.txt")];
    let mut split = ForeignSplit::from_lists("OB3D", lists, &mut notes)?;
    if let Some(split) = &mut split {
        for name in split.input.iter_mut().chain(&mut split.novel) {
            let number = name.parse::<u64>().ok();
            if let Some(image) = number.and_then(|number| found.numbers.get(&number)) {
                name.clone_from(image);
            }
        }
    }
    let points = folder.join(POINTS_FOLDER).join("sparse.ply");
    let camera = panorama_camera(folder, &found.frames, &found.missing_images)?;
    Ok(ForeignScene {
        points: if points.is_file() {
            PointCloud::read_ply(&points)?
        } else {
            PointCloud::default()
        },
        image_folders: vec![folder.join(IMAGES_FOLDER)],
        missing_images: found.missing_images,
        published_split: split,
        frame_rate: Some(FrameRate::STATIC),
        notes,
        ..ForeignScene::new(camera, found.frames, folder)
    })
}

/// Returns the frames of all cameras with existing images.
fn frames_of(folder: &Path) -> Result<NamedCameras, CurateError> {
    let cameras = folder.join(CAMERAS_FOLDER);
    if !cameras.is_dir() {
        let reason = "has no cameras/; a scene of OB3D has two captures, Egocentric and Non-Egocentric: give one of \
                      them";
        return Err(CurateError::input(folder, reason));
    }
    let mut found = NamedCameras {
        frames: Vec::new(),
        missing_images: Vec::new(),
        numbers: BTreeMap::new(),
    };
    let mut size = None;
    let mut files = store::paths_in(&cameras)?;
    files.retain(|file| !store::is_hidden(file));
    for file in files {
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        let Some(stem) = name.strip_suffix(CAMERA_END) else {
            continue;
        };
        let camera = camera_of(&file)?;
        let [width, height] = *size.get_or_insert([camera.width, camera.height]);
        if [width, height] != [camera.width, camera.height] {
            let reason = format!(
                "is of {}x{} pixels, other cameras of {width}x{height}",
                camera.width, camera.height
            );
            return Err(CurateError::input(&file, reason));
        }
        let pose = pose_of(&camera.extrinsics).ok_or_else(|| {
            StoreError::malformed(
                &file,
                "its extrinsics must be a rotation with a translation",
            )
        })?;
        let name = format!("{stem}{IMAGE_END}");
        let place = format!("{IMAGES_FOLDER}/{name}");
        match image_of(folder, &place)? {
            Some(image) => found.frames.push(plain_frame(image, pose, None)),
            None => found.missing_images.push(place),
        }
        if let Some(number) = frame_order::number(&file) {
            found.numbers.insert(number, name);
        }
    }
    Ok(found)
}

/// Returns the one camera of a file.
fn camera_of(file: &Path) -> Result<Camera, StoreError> {
    let cameras: Vec<Camera> = read_json(file)?;
    let one = <[Camera; 1]>::try_from(cameras).map_err(|cameras| {
        let reason = format!("has {} cameras, expected one", cameras.len());
        StoreError::malformed(file, reason)
    });
    one.map(|[camera]| camera)
}

/// Returns the pose of `X_camera = R X_world + t`.
fn pose_of(extrinsics: &Extrinsics) -> Option<Pose> {
    // Its rows are the columns of the inverse.
    let to_world = DMat3::from_cols_array_2d(&extrinsics.rotation);
    let centre = -(to_world * DVec3::from_array(extrinsics.translation));
    Pose::from_matrix(to_world, centre)
}
