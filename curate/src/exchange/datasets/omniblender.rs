//! `OmniBlender`: rendered panoramas along small circles, of `EgoNeRF`
//! (`dataLoader/dataset_omniblender.py` and `dataLoader/ray_utils.py` of `changwoonchoi/EgoNeRF`).
//!
//! ```text
//! transform.json           per frame a file in images/ and a camera-to-world matrix
//! images/                  the panoramas
//! train.txt, test.txt      names of images without their extension
//! ```
//!
//! Axes: `get_ray_directions_360` has x right, y up and z back, -z in the middle of the image, and the centre of
//! the first pixel at (1/2, 1/2): those of nerfstudio's `transforms.json`. The world of Blender, z up, is kept.
//! The data set has no distances and no points.

use std::path::Path;

use omnilife_schemas::store::StoreError;
use serde::Deserialize;

use super::{folders_not_read, panorama_camera, plain_frame};
use crate::{
    error::CurateError,
    exchange::{ForeignScene, ForeignSplit, Format, FrameRate, image_of, nerfstudio, read_json},
};

/// The format.
pub const FORMAT: Format = Format {
    id: "omniblender",
    about: "a scene of OmniBlender (EgoNeRF): transform.json, images/, train.txt and test.txt",
    holds_cube_faces: false,
    holds_padded_panoramas: false,
    export: None,
    import,
};

const TRANSFORM_FILE: &str = "transform.json";
const IMAGES_FOLDER: &str = "images";

#[derive(Deserialize)]
struct Transform {
    frames: Vec<Frame>,
}

#[derive(Deserialize)]
struct Frame {
    file_path: String,
    transform_matrix: [[f64; 4]; 4],
}

fn import(folder: &Path) -> Result<ForeignScene, CurateError> {
    let path = folder.join(TRANSFORM_FILE);
    let transform: Transform = read_json(&path)?;
    let (mut frames, mut missing_images) = (Vec::new(), Vec::new());
    for frame in &transform.frames {
        let pose = nerfstudio::pose_of(&frame.transform_matrix).ok_or_else(|| {
            let reason = format!("{} has no rigid transform", frame.file_path);
            StoreError::malformed(&path, reason)
        })?;
        let name = format!("{IMAGES_FOLDER}/{}", frame.file_path);
        match image_of(folder, &name)? {
            Some(image) => frames.push(plain_frame(image, pose, None)),
            None => missing_images.push(name),
        }
    }
    let mut notes: Vec<String> = (folders_not_read(folder, &[IMAGES_FOLDER])?)
        .into_iter()
        .collect();
    let lists: [&Path; 2] = [&folder.join("train.txt"), &folder.join("test.txt")];
    let published_split = ForeignSplit::from_lists("OmniBlender", lists, &mut notes)?;
    let camera = panorama_camera(folder, &frames, &missing_images)?;
    Ok(ForeignScene {
        missing_images,
        published_split,
        frame_rate: Some(FrameRate::STATIC),
        notes,
        ..ForeignScene::new(camera, frames, folder)
    })
}
