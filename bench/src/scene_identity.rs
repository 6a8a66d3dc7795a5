//! What a scene is, beyond its name: two scores may only compete on the same frames and cameras.

use std::path::Path;

use omnilife_schemas::{
    Pose,
    camera::ErpCamera,
    records::{Scene, Split},
    store::{self, StoreError},
};
use serde::Serialize;

/// The hash that a result carries for its scene.
pub(crate) struct SceneIdentity {
    /// SHA-256 in lower-case hexadecimal.
    pub(crate) sha256: String,
}

#[derive(Serialize)]
struct Content<'a> {
    camera: &'a ErpCamera,
    frames: Vec<FrameContent<'a>>,
}

#[derive(Serialize)]
struct FrameContent<'a> {
    image_sha256: String,
    time_seconds: f64,
    pose: &'a Option<Pose>,
}

impl SceneIdentity {
    /// Hashes camera, times, poses and ground truth of all frames of a split. Names of files, the
    /// place of the scene and how long posing took do not count.
    ///
    /// # Errors
    /// When a ground truth image cannot be read.
    pub(crate) fn of_split(
        scene_file: &Path,
        scene: &Scene,
        split: &Split,
    ) -> Result<Self, StoreError> {
        let frames = split
            .input_views
            .iter()
            .chain(&split.novel_views)
            .map(|&index| {
                let frame = &scene.frames[index as usize];
                Ok(FrameContent {
                    image_sha256: store::sha256_file(&scene_file.with_file_name(&frame.image))?,
                    time_seconds: frame.time_seconds,
                    pose: &frame.pose,
                })
            })
            .collect::<Result<_, StoreError>>()?;
        let content = Content {
            camera: &scene.camera,
            frames,
        };
        let bytes = serde_json::to_vec(&content)
            .map_err(|error| StoreError::malformed(scene_file, error.to_string()))?;
        Ok(Self {
            sha256: store::sha256_bytes(&bytes),
        })
    }
}
