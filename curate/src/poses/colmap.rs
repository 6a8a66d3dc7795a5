//! COLMAP's models, text or binary: places and content of their files.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    cmp::Reverse,
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use glam::{DQuat, DVec2, DVec3};
use omnilife_schemas::{
    Pose,
    camera::{Camera, ErpCamera},
    points::PointCloud,
    store::{self, StoreError},
};

use super::{
    colmap_binary, colmap_text,
    frame_camera::FrameCamera,
    lens::{Lens, LensModel},
};

/// A reconstruction with one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct ColmapModel {
    /// The camera of all images. Observations are at their places in its undistorted images.
    pub camera: FrameCamera,
    /// Registered images by their id.
    pub images: BTreeMap<u32, ColmapImage>,
    /// Points by their id.
    pub points: BTreeMap<u64, ColmapPoint>,
}

/// A camera as a model's files have it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum ModelCamera {
    Erp(ErpCamera),
    Perspective(Lens),
}

impl ModelCamera {
    /// Returns true if two cameras agree up to rounding: to a millionth of the width, and 1e-9 of the distortion.
    fn agrees(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Erp(a), Self::Erp(b)) => a == b,
            (Self::Perspective(a), Self::Perspective(b)) => {
                let numbers = |lens: Lens| {
                    let camera = lens.camera;
                    [camera.fx, camera.fy, camera.cx, camera.cy]
                        .map(|pixels| 1e-3 * pixels / f64::from(camera.width))
                        .into_iter()
                        .chain(lens.distortion.numbers())
                };
                let size = |lens: &Lens| [lens.camera.width, lens.camera.height];
                size(a) == size(b)
                    && numbers(*a)
                        .zip(numbers(*b))
                        .all(|(a, b)| (a - b).abs() <= 1e-9)
            }
            _ => false,
        }
    }
}

/// Images by their id, each with the id of its camera.
pub(super) type ImagesByCamera = BTreeMap<u32, (u32, ColmapImage)>;

/// The content of a model's files.
pub(super) struct ModelParts {
    /// By their id; an unreadable one with the reason, which matters only if an image uses it.
    pub(super) cameras: BTreeMap<u32, Result<ModelCamera, String>>,
    pub(super) images: ImagesByCamera,
    pub(super) points: BTreeMap<u64, ColmapPoint>,
}

impl ModelParts {
    /// Returns the camera of all images. COLMAP keeps the cameras of unregistered images: those do not count.
    fn camera(&self) -> Result<ModelCamera, String> {
        let mut common: Option<(ModelCamera, u32, &str)> = None;
        for (id, image) in self.images.values() {
            let camera = (self.cameras.get(id))
                .ok_or_else(|| format!("has no camera {id}, which {} has", image.name))?
                .clone()?;
            let (first, first_id, name) = common.get_or_insert((camera, *id, image.name.as_str()));
            if !first.agrees(&camera) {
                return Err(format!(
                    "camera {first_id} of {name} and camera {id} of {} differ; a scene has one camera",
                    image.name
                ));
            }
        }
        match common {
            Some((camera, ..)) => Ok(camera),
            None => (self.cameras.values().next())
                .ok_or("has no camera")?
                .clone(),
        }
    }
}

/// A registered image.
#[derive(Debug, Clone, PartialEq)]
pub struct ColmapImage {
    /// File name.
    pub name: String,
    /// Camera to world.
    pub rotation: DQuat,
    /// Camera centre.
    pub centre: DVec3,
    /// Features that see a point: image coordinates in pixels and the point's id.
    pub observations: Vec<(DVec2, u64)>,
}

impl ColmapImage {
    /// Returns the pose in the convention of the records.
    pub fn pose(&self) -> Pose {
        Pose::new(self.rotation, self.centre)
    }
}

/// A world point.
#[derive(Debug, Clone, PartialEq)]
pub struct ColmapPoint {
    /// World coordinates.
    pub position: DVec3,
    /// 8-bit sRGB.
    pub colour: [u8; 3],
    /// Ids of the images that see it, one entry per observation.
    pub track: Vec<u32>,
}

/// The files of a model.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ModelFiles {
    /// Cameras, images and points.
    pub paths: [PathBuf; 3],
    /// A line on the other models of the folder, if there are several.
    pub note: Option<String>,
}

/// Returns the files of the model in a folder, or below it in `sparse/N`, `N` (COLMAP numbers its models) or `sparse`.
/// The binary ones are preferred, as in COLMAP itself, to those of a text model. Of several numbered models it is the
/// one with most images.
///
/// # Errors
/// When the folder cannot be listed, or the images of several models cannot be counted.
pub fn files(folder: &Path) -> Result<ModelFiles, StoreError> {
    let sparse = folder.join("sparse");
    let places = [
        vec![folder.to_owned()],
        numbered_folders(&sparse)?,
        numbered_folders(folder)?,
        vec![sparse],
    ];
    for group in places {
        let found: Vec<[PathBuf; 3]> = group.iter().filter_map(|place| model_in(place)).collect();
        if !found.is_empty() {
            return largest(folder, found);
        }
    }
    Ok(ModelFiles {
        paths: colmap_text::FILES.map(|name| folder.join(name)),
        note: None,
    })
}

/// Folders named by a number, in their order.
fn numbered_folders(folder: &Path) -> Result<Vec<PathBuf>, StoreError> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let mut numbered: Vec<(u32, PathBuf)> = store::names_in(folder)?
        .into_iter()
        .filter_map(|name| Some((name.parse().ok()?, folder.join(name))))
        .collect();
    numbered.sort();
    Ok(numbered.into_iter().map(|(_, path)| path).collect())
}

fn model_in(folder: &Path) -> Option<[PathBuf; 3]> {
    [colmap_binary::FILES, colmap_text::FILES]
        .map(|names| names.map(|name| folder.join(name)))
        .into_iter()
        .find(|[cameras, ..]| cameras.is_file())
}

/// Returns the model with most images, the first of equals.
fn largest(folder: &Path, models: Vec<[PathBuf; 3]>) -> Result<ModelFiles, StoreError> {
    if let [only] = models.as_slice() {
        return Ok(ModelFiles {
            paths: only.clone(),
            note: None,
        });
    }
    let mut counted = Vec::new();
    for paths in models {
        counted.push((image_count(&paths)?, paths));
    }
    counted.sort_by_key(|(count, _)| Reverse(*count));
    let lines: Vec<String> = counted
        .iter()
        .map(|(count, [cameras, ..])| {
            let place = cameras.parent().unwrap_or(cameras);
            let place = place.strip_prefix(folder).unwrap_or(place);
            format!("{} ({count} images)", place.display())
        })
        .collect();
    let mut paths = counted.into_iter().map(|(_, paths)| paths);
    Ok(ModelFiles {
        paths: paths.next().unwrap_or_default(),
        note: lines.split_first().map(|(taken, left)| {
            format!(
                "of several models {taken} is taken, and not {}",
                left.join(", ")
            )
        }),
    })
}

fn is_binary(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "bin")
}

fn image_count([_, images, _]: &[PathBuf; 3]) -> Result<usize, StoreError> {
    if is_binary(images) {
        colmap_binary::image_count(images)
    } else {
        colmap_text::image_count(images)
    }
}

/// Reads the images of a text model, with any cameras, in order of id.
///
/// # Errors
/// When the file is missing or malformed.
pub(crate) fn text_images(path: &Path) -> Result<Vec<ColmapImage>, StoreError> {
    let images = colmap_text::read_images(path)?.into_values();
    Ok(images.map(|(_, image)| image).collect())
}

/// Reads the points of a text model.
///
/// # Errors
/// When the file is missing or malformed.
pub(crate) fn text_points(path: &Path) -> Result<PointCloud, StoreError> {
    Ok(cloud_of(&colmap_text::read_points(path)?))
}

/// Returns a coloured cloud, in order of id.
fn cloud_of(points: &BTreeMap<u64, ColmapPoint>) -> PointCloud {
    let positions = points.values().map(|point| point.position.to_array());
    PointCloud {
        positions: positions.collect(),
        colours: points.values().map(|point| point.colour).collect(),
    }
}

impl ColmapModel {
    /// Reads the model in a folder or below it, text or binary ([`files`]).
    ///
    /// # Errors
    /// When a file is missing or malformed, or the images have different cameras. Also when their camera is neither
    /// `EQUIRECTANGULAR` nor perspective with a lens that [`Lens`] knows.
    pub fn read(folder: &Path) -> Result<Self, StoreError> {
        Self::read_files(&files(folder)?.paths)
    }

    /// Reads the model in these files.
    ///
    /// # Errors
    /// Those of [`ColmapModel::read`].
    pub fn read_files(paths: &[PathBuf; 3]) -> Result<Self, StoreError> {
        let [cameras, ..] = paths;
        let parts = if is_binary(cameras) {
            colmap_binary::read(paths)?
        } else {
            colmap_text::read(paths)?
        };
        Self::new(parts).map_err(|reason| StoreError::malformed(cameras, reason))
    }

    /// Creates a model of undistorted images.
    fn new(parts: ModelParts) -> Result<Self, String> {
        let camera = match parts.camera()? {
            ModelCamera::Erp(camera) => FrameCamera::Straight(camera.into()),
            ModelCamera::Perspective(lens) => FrameCamera::behind(lens)?,
        };
        let images = parts.images.into_iter().map(|(id, (_, image))| (id, image));
        let mut images: BTreeMap<u32, ColmapImage> = images.collect();
        if let (Some(lens), Camera::Pinhole(straight)) = (camera.lens(), camera.camera()) {
            let images = images.values_mut();
            for (pixel, _) in images.flat_map(|image| &mut image.observations) {
                *pixel = lens.straightened(&straight, *pixel);
            }
        }
        Ok(Self {
            camera,
            images,
            points: parts.points,
        })
    }

    /// Turns the world by a rotation.
    pub fn rotate_world(&mut self, rotation: DQuat) {
        for image in self.images.values_mut() {
            image.rotation = (rotation * image.rotation).normalize();
            image.centre = rotation * image.centre;
        }
        for point in self.points.values_mut() {
            point.position = rotation * point.position;
        }
    }

    /// Returns the points as a coloured cloud, in order of id.
    pub fn cloud(&self) -> PointCloud {
        cloud_of(&self.points)
    }
}

/// Returns the reason to refuse invalid parameters of a model.
pub(super) fn impossible_parameters(model: &str) -> String {
    format!(
        "the parameters of {model}: focal lengths must be positive, all finite, and in the model's range"
    )
}

/// Returns the reason to refuse an unknown camera model.
pub(super) fn unknown_model(name: &str) -> String {
    let known = LensModel::names();
    format!("camera model {name}; known are EQUIRECTANGULAR, {known}")
}

/// Returns an image by its pose: quaternion (w, x, y, z) and translation, world to camera.
pub(super) fn image_of(
    [w, x, y, z, tx, ty, tz]: [f64; 7],
    name: String,
    observations: Vec<(DVec2, u64)>,
) -> Result<ColmapImage, &'static str> {
    let camera_from_world = DQuat::from_xyzw(x, y, z, w);
    if (camera_from_world.length() - 1.0).abs() > 1e-3 {
        return Err("the rotation must be a unit quaternion");
    }
    let rotation = camera_from_world.normalize().inverse();
    Ok(ColmapImage {
        name,
        rotation,
        centre: -(rotation * DVec3::new(tx, ty, tz)),
        observations,
    })
}

/// Returns a point, which must fit into the f32 of clouds.
pub(super) fn point_of(
    position: DVec3,
    colour: [u8; 3],
    track: Vec<u32>,
) -> Result<ColmapPoint, &'static str> {
    if !position.as_vec3().is_finite() {
        return Err("the point is too far away for single precision");
    }
    Ok(ColmapPoint {
        position,
        colour,
        track,
    })
}
