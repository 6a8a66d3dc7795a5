//! COLMAP's models, and their text form: `cameras.txt`, `images.txt`, `points3D.txt`
//! (<https://colmap.github.io/format.html#text-format>).
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    str::FromStr,
};

use glam::{DQuat, DVec2, DVec3};
use omnilife_schemas::{
    Pose,
    camera::{Camera, ErpCamera},
    points::PointCloud,
    store::StoreError,
};

use super::{
    colmap_binary,
    lens::{self, Lens},
};

/// A reconstruction with one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct ColmapModel {
    /// The camera of all images, without a lens: observations are where it would show them.
    pub camera: Camera,
    /// The lens of the images as they are; none where it does nothing.
    pub lens: Option<Lens>,
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
    /// The pose in the convention of the records.
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

/// Files of a text model.
const TEXT_FILES: [&str; 3] = ["cameras.txt", "images.txt", "points3D.txt"];

/// Where below a folder a model may lie: COLMAP numbers its models.
const MODEL_FOLDERS: [&str; 4] = ["", "sparse/0", "0", "sparse"];

/// Files of the model in a folder, or of the first one below it: the binary ones where they are there,
/// as COLMAP itself reads them, else those of a text model.
pub fn files(folder: &Path) -> [PathBuf; 3] {
    for below in MODEL_FOLDERS.map(|below| folder.join(below)) {
        for names in [colmap_binary::FILES, TEXT_FILES] {
            if below.join(names[0]).is_file() {
                return names.map(|name| below.join(name));
            }
        }
    }
    TEXT_FILES.map(|name| folder.join(name))
}

impl ColmapModel {
    /// Reads the model in a folder or below it, text or binary ([`files`]).
    ///
    /// # Errors
    /// When a file is missing or malformed, or a camera is neither `EQUIRECTANGULAR` nor perspective with
    /// a lens that [`Lens`] knows.
    pub fn read(folder: &Path) -> Result<Self, StoreError> {
        let [cameras, images, points] = files(folder);
        if cameras
            .extension()
            .is_some_and(|extension| extension == "bin")
        {
            return colmap_binary::read(cameras.parent().unwrap_or(folder));
        }
        let camera = read_camera(&cameras)?;
        Self::new(camera, read_images(&images)?, read_points(&points)?)
            .map_err(|reason| StoreError::malformed(&cameras, reason))
    }

    /// A model of images as they are: what the lens does to them is taken out.
    pub(super) fn new(
        camera: ModelCamera,
        mut images: BTreeMap<u32, ColmapImage>,
        points: BTreeMap<u64, ColmapPoint>,
    ) -> Result<Self, String> {
        let (camera, lens) = match camera {
            ModelCamera::Erp(camera) => (camera.into(), None),
            ModelCamera::Perspective(lens) if lens.is_negligible() => (lens.camera.into(), None),
            ModelCamera::Perspective(lens) => {
                let straight = lens.straight().ok_or_else(|| {
                    format!(
                        "no straight image is within a lens of {:?}",
                        lens.distortion
                    )
                })?;
                for observation in images
                    .values_mut()
                    .flat_map(|image| &mut image.observations)
                {
                    observation.0 = lens.straightened(&straight, observation.0);
                }
                (straight.into(), Some(lens))
            }
        };
        Ok(Self {
            camera,
            lens,
            images,
            points,
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

    /// The points as a coloured cloud, in order of id.
    pub fn cloud(&self) -> PointCloud {
        PointCloud {
            positions: self
                .points
                .values()
                .map(|point| point.position.to_array())
                .collect(),
            colours: self.points.values().map(|point| point.colour).collect(),
        }
    }
}

/// A line of a model file with its number, for errors.
struct Line<'a> {
    path: &'a Path,
    number: usize,
    text: &'a str,
}

impl Line<'_> {
    fn malformed(&self, what: &str) -> StoreError {
        StoreError::malformed(self.path, format!("line {}: {what}", self.number))
    }

    fn field<T: FromStr>(&self, index: usize, what: &str) -> Result<T, StoreError> {
        self.text
            .split_whitespace()
            .nth(index)
            .and_then(|word| word.parse().ok())
            .ok_or_else(|| self.malformed(&format!("no {what}")))
    }

    fn numbers<const N: usize>(&self, first: usize, what: &str) -> Result<[f64; N], StoreError> {
        let mut numbers = [0.0; N];
        let mut words = self.text.split_whitespace().skip(first);
        for number in &mut numbers {
            *number = words
                .next()
                .and_then(|word| word.parse::<f64>().ok())
                .filter(|value| value.is_finite())
                .ok_or_else(|| self.malformed(&format!("no {what}")))?;
        }
        Ok(numbers)
    }
}

/// All lines but comments. Empty lines stay: an image without features has an empty second line.
fn lines<'a>(path: &'a Path, text: &'a str) -> impl Iterator<Item = Line<'a>> {
    text.lines()
        .enumerate()
        .filter(|(_, text)| !text.starts_with('#'))
        .map(move |(index, text)| Line {
            path,
            number: index.saturating_add(1),
            text,
        })
}

fn text(path: &Path) -> Result<String, StoreError> {
    fs::read_to_string(path).map_err(|error| StoreError::read(path, error))
}

fn read_camera(path: &Path) -> Result<ModelCamera, StoreError> {
    let text = text(path)?;
    let mut camera = None;
    for line in lines(path, &text).filter(|line| !line.text.trim().is_empty()) {
        let this = camera_of(&line)?;
        if *camera.get_or_insert(this) != this {
            return Err(line.malformed("camera differs from the one before"));
        }
    }
    camera.ok_or_else(|| StoreError::malformed(path, "has no camera"))
}

fn camera_of(line: &Line<'_>) -> Result<ModelCamera, StoreError> {
    let name: String = line.field(1, "camera model")?;
    let (width, height): (u32, u32) = (
        line.field(2, "camera width")?,
        line.field(3, "camera height")?,
    );
    if width == 0 || height == 0 {
        return Err(line.malformed("camera size is empty"));
    }
    if name == "EQUIRECTANGULAR" {
        return Ok(ModelCamera::Erp(ErpCamera { width, height }));
    }
    let Some((model, count)) = lens::parameters_of_name(&name) else {
        return Err(line.malformed(&unknown_model(&name)));
    };
    let parameters: Vec<f64> = (4..count.saturating_add(4))
        .map(|index| line.field(index, "camera parameters"))
        .collect::<Result<_, _>>()?;
    Lens::of_model(model, [width, height], &parameters)
        .map(ModelCamera::Perspective)
        .ok_or_else(|| line.malformed("a focal length is not positive, or a parameter not finite"))
}

/// What is said of a camera model that is not known.
pub(super) fn unknown_model(name: &str) -> String {
    format!(
        "camera model {name}; known are EQUIRECTANGULAR, {} (COLMAP's image_undistorter takes other \
         distortions out of images)",
        lens::MODEL_NAMES
    )
}

fn read_images(path: &Path) -> Result<BTreeMap<u32, ColmapImage>, StoreError> {
    let text = text(path)?;
    let mut lines = lines(path, &text);
    let mut images = BTreeMap::new();
    while let Some(line) = lines.next() {
        if line.text.trim().is_empty() {
            continue;
        }
        let id = line.field(0, "image id")?;
        let [w, x, y, z, tx, ty, tz] = line.numbers(1, "image pose")?;
        let name: Vec<&str> = line.text.split_whitespace().skip(9).collect();
        if name.is_empty() {
            return Err(line.malformed("no image name"));
        }
        let observations = match lines.next() {
            Some(features) => read_observations(&features)?,
            None => Vec::new(),
        };
        let pose = [w, x, y, z, tx, ty, tz];
        let image =
            image_of(pose, name.join(" "), observations).map_err(|what| line.malformed(what))?;
        if images.insert(id, image).is_some() {
            return Err(line.malformed(&format!("a second image has the id {id}")));
        }
    }
    Ok(images)
}

/// An image by its pose: quaternion (w, x, y, z) and translation, world to camera.
pub(super) fn image_of(
    [w, x, y, z, tx, ty, tz]: [f64; 7],
    name: String,
    observations: Vec<(DVec2, u64)>,
) -> Result<ColmapImage, &'static str> {
    let camera_from_world = DQuat::from_xyzw(x, y, z, w);
    if (camera_from_world.length() - 1.0).abs() > 1e-3 {
        return Err("rotation is no unit quaternion");
    }
    let rotation = camera_from_world.normalize().inverse();
    Ok(ColmapImage {
        name,
        rotation,
        centre: -(rotation * DVec3::new(tx, ty, tz)),
        observations,
    })
}

/// A point, which has to fit into the f32 of clouds.
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

/// Features as `x y point` triples; features without a point (-1) are left out.
fn read_observations(line: &Line<'_>) -> Result<Vec<(DVec2, u64)>, StoreError> {
    let words: Vec<&str> = line.text.split_whitespace().collect();
    let (triples, rest) = words.as_chunks::<3>();
    if !rest.is_empty() {
        return Err(line.malformed("features are no x y point triples"));
    }
    let mut observations = Vec::new();
    for [x, y, point] in triples {
        let parsed = (x.parse(), y.parse(), point.parse::<i64>());
        let (Ok(x), Ok(y), Ok(point)) = parsed else {
            return Err(line.malformed("features are no x y point triples"));
        };
        if let Ok(point) = u64::try_from(point) {
            observations.push((DVec2::new(x, y), point));
        }
    }
    Ok(observations)
}

fn read_points(path: &Path) -> Result<BTreeMap<u64, ColmapPoint>, StoreError> {
    let text = text(path)?;
    let mut points = BTreeMap::new();
    for line in lines(path, &text).filter(|line| !line.text.trim().is_empty()) {
        let id = line.field(0, "point id")?;
        let colour = [
            line.field(4, "point colour")?,
            line.field(5, "point colour")?,
            line.field(6, "point colour")?,
        ];
        let track: Vec<u32> = line
            .text
            .split_whitespace()
            .skip(8)
            .step_by(2)
            .map(str::parse)
            .collect::<Result<_, _>>()
            .map_err(|_| line.malformed("point track is no list of image ids"))?;
        let position = DVec3::from_array(line.numbers(1, "point position")?);
        let point = point_of(position, colour, track).map_err(|what| line.malformed(what))?;
        if points.insert(id, point).is_some() {
            return Err(line.malformed(&format!("a second point has the id {id}")));
        }
    }
    Ok(points)
}
