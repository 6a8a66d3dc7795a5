//! Identity of a scene beyond its name: scores compete only on the same frames and cameras.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use omnilife_schemas::{
    Pose,
    camera::{Camera, ErpCamera},
    object_regions::{self, ObjectShape, Region, RegionSource},
    records::{Scene, SceneFrame, Split},
    store::{self, StoreError},
};
use serde::Serialize;

use crate::metrics::Need;

/// The hash of a result's scene.
pub(crate) struct SceneIdentity {
    /// SHA-256 in lower-case hexadecimal.
    pub(crate) sha256: String,
}

#[derive(Serialize)]
struct Content<'a> {
    camera: CameraContent<'a>,
    frames: Vec<FrameContent<'a>>,
}

/// ERP cameras are hashed without a model: scenes once had no other, and their hashes stay the same.
#[derive(Serialize)]
#[serde(untagged)]
enum CameraContent<'a> {
    Erp(&'a ErpCamera),
    WithModel(&'a Camera),
}

#[derive(Serialize)]
struct FrameContent<'a> {
    image_sha256: String,
    time_seconds: f64,
    pose: &'a Option<Pose>,
    /// Names and hashes of masks and depth, if scores depend on them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    annotations: Vec<(String, String)>,
}

impl SceneIdentity {
    /// Hashes camera, times, poses and ground truth of all frames of a split, and the masks and depth for metrics with
    /// these needs. Names of files, the place of the scene and the time of posing do not count.
    ///
    /// # Errors
    /// When a ground truth image cannot be read.
    pub(crate) fn of_split(
        scene_file: &Path,
        scene: &Scene,
        split: &Split,
        needs: &[Need],
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
                    annotations: annotations(scene_file, scene, frame, needs)?,
                })
            })
            .collect::<Result<_, StoreError>>()?;
        let content = Content {
            camera: match &scene.camera {
                Camera::Erp(camera) => CameraContent::Erp(camera),
                camera @ Camera::Pinhole(_) => CameraContent::WithModel(camera),
            },
            frames,
        };
        let bytes = serde_json::to_vec(&content)
            .map_err(|error| StoreError::malformed(scene_file, error.to_string()))?;
        Ok(Self {
            sha256: store::sha256_bytes(&bytes),
        })
    }
}

/// Returns names and hashes of the files that metrics with these needs read beside a frame's image.
fn annotations(
    scene_file: &Path,
    scene: &Scene,
    frame: &SceneFrame,
    needs: &[Need],
) -> Result<Vec<(String, String)>, StoreError> {
    let mut files: Vec<(String, &str)> = Vec::new();
    files.extend(
        frame
            .ignore_mask
            .iter()
            .map(|file| ("ignore mask".to_owned(), file.as_str())),
    );
    let mut objects = BTreeMap::new();
    if needs.contains(&Need::ObjectMasks) {
        objects = object_regions::shapes(frame);
    }
    for (name, region) in regions(needs) {
        match region.source(scene, frame) {
            Some(RegionSource::Mask(file)) => files.push((name, file)),
            Some(RegionSource::Objects(of_region)) => objects.extend(of_region),
            None => {}
        }
    }
    let mut boxes = Vec::new();
    for (object, shape) in objects {
        let name = format!("{} {object}", scene.class_of(object).name());
        match shape {
            ObjectShape::Mask(file) => files.push((name, file)),
            ObjectShape::Box(sides) => boxes.push((name, format!("{sides:?}"))),
        }
    }
    if let Some(depth) = &frame.depth
        && needs.contains(&Need::Depth)
    {
        files.push((format!("depth in {}", depth.unit), &depth.file));
    }
    let files = files
        .into_iter()
        .map(|(name, file)| Ok((name, store::sha256_file(&scene_file.with_file_name(file))?)));
    files.chain(boxes.into_iter().map(Ok)).collect()
}

/// Returns the regions that metrics with these needs read, with the names of their masks.
fn regions(needs: &[Need]) -> Vec<(String, Region<'static>)> {
    let moving = needs
        .contains(&Need::DynamicMask)
        .then(|| ("mask".to_owned(), Region::Moving));
    let classes = needs.iter().filter_map(|need| match need {
        Need::ClassMask(class) => Some(*class),
        _ => None,
    });
    let classes: BTreeSet<&'static str> = classes.collect();
    let classes = classes.into_iter();
    let classes = classes.map(|class| (format!("class {class}"), Region::Class(class)));
    moving.into_iter().chain(classes).collect()
}
