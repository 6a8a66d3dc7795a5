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
    camera::{Camera, ErpCamera, PinholeCamera},
    points::PointCloud,
    store::StoreError,
};

use super::colmap_binary;

/// A reconstruction with one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct ColmapModel {
    /// The camera of all images.
    pub camera: Camera,
    /// Registered images by their id.
    pub images: BTreeMap<u32, ColmapImage>,
    /// Points by their id.
    pub points: BTreeMap<u64, ColmapPoint>,
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
    /// When a file is missing or malformed, or a camera is neither `EQUIRECTANGULAR` nor a pinhole without
    /// distortion.
    pub fn read(folder: &Path) -> Result<Self, StoreError> {
        let [cameras, images, points] = files(folder);
        if cameras
            .extension()
            .is_some_and(|extension| extension == "bin")
        {
            return colmap_binary::read(cameras.parent().unwrap_or(folder));
        }
        Ok(Self {
            camera: read_camera(&cameras)?,
            images: read_images(&images)?,
            points: read_points(&points)?,
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
                .map(|point| point.position.as_vec3().to_array())
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

fn read_camera(path: &Path) -> Result<Camera, StoreError> {
    let text = text(path)?;
    let mut camera = None;
    for line in lines(path, &text).filter(|line| !line.text.trim().is_empty()) {
        let this = camera_of(&line)?;
        if this.width() == 0 || this.height() == 0 || *camera.get_or_insert(this) != this {
            return Err(line.malformed("camera size is empty or differs from the one before"));
        }
    }
    camera.ok_or_else(|| StoreError::malformed(path, "has no camera"))
}

/// Lens distortion has to be taken out of the images first: no camera of ours has any.
fn camera_of(line: &Line<'_>) -> Result<Camera, StoreError> {
    let model: String = line.field(1, "camera model")?;
    let (width, height) = (
        line.field(2, "camera width")?,
        line.field(3, "camera height")?,
    );
    let [fx, fy, cx, cy] = match model.as_str() {
        "EQUIRECTANGULAR" => return Ok(ErpCamera { width, height }.into()),
        "PINHOLE" => line.numbers(4, "fx, fy, cx, cy")?,
        "SIMPLE_PINHOLE" => {
            let [f, cx, cy] = line.numbers(4, "f, cx, cy")?;
            [f, f, cx, cy]
        }
        _ => {
            return Err(line.malformed(&format!(
                "camera model {model}; known are EQUIRECTANGULAR, PINHOLE and SIMPLE_PINHOLE (COLMAP's \
                 image_undistorter takes distortion out of images)"
            )));
        }
    };
    if !(fx > 0.0 && fy > 0.0) {
        return Err(line.malformed("a focal length is not positive"));
    }
    Ok(PinholeCamera {
        width,
        height,
        fx,
        fy,
        cx,
        cy,
    }
    .into())
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
