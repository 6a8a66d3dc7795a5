//! COLMAP's text model: `cameras.txt`, `images.txt`, `points3D.txt`
//! (<https://colmap.github.io/format.html#text-format>).
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    str::FromStr,
};

use glam::{DVec2, DVec3};
use omnilife_schemas::{
    camera::ErpCamera,
    store::{self, StoreError},
};

use super::{
    colmap::{
        ColmapPoint, ImagesByCamera, ModelCamera, ModelParts, image_of, impossible_parameters,
        point_of, unknown_model,
    },
    lens::LensModel,
};

/// Names of the files.
pub(super) const FILES: [&str; 3] = ["cameras.txt", "images.txt", "points3D.txt"];
/// Fault of a line of features. Files of other programs often lack these lines.
const FEATURES_FAULT: &str = "features must be triples of x, y and point; an image without features is followed by an empty line";
/// Panoramas in COLMAP, and in its earlier forks.
const SPHERES: [&str; 3] = ["EQUIRECTANGULAR", "SPHERICAL", "SPHERE"];

/// Reads a text model.
pub(super) fn read([cameras, images, points]: &[PathBuf; 3]) -> Result<ModelParts, StoreError> {
    Ok(ModelParts {
        cameras: read_cameras(cameras)?,
        images: read_images(images)?,
        points: read_points(points)?,
    })
}

/// A line of a model file with its number, for errors.
pub(super) struct Line<'a> {
    path: &'a Path,
    number: usize,
    text: &'a str,
}

impl Line<'_> {
    pub(super) fn malformed(&self, what: &str) -> StoreError {
        StoreError::malformed(self.path, format!("line {}: {what}", self.number))
    }

    pub(super) fn field<T: FromStr>(&self, index: usize, what: &str) -> Result<T, StoreError> {
        self.text
            .split_whitespace()
            .nth(index)
            .and_then(|word| word.parse().ok())
            .ok_or_else(|| self.malformed(&format!("no {what}")))
    }

    /// Returns the words from a field on.
    pub(super) fn words_from(&self, first: usize) -> Vec<&str> {
        self.text.split_whitespace().skip(first).collect()
    }

    /// Returns the rest of the line from a field on, with the spaces within it.
    fn rest_from(&self, first: usize) -> &str {
        (0..first).fold(self.text.trim(), |rest, _| {
            rest.split_once(char::is_whitespace)
                .map_or("", |(_, rest)| rest.trim_start())
        })
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

/// Returns all lines except comments. Empty lines stay: an image without features has an empty second line.
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

/// Returns the lines that are not empty.
pub(super) fn filled_lines<'a>(path: &'a Path, text: &'a str) -> impl Iterator<Item = Line<'a>> {
    lines(path, text).filter(|line| !line.text.trim().is_empty())
}

fn read_cameras(path: &Path) -> Result<BTreeMap<u32, Result<ModelCamera, String>>, StoreError> {
    let text = store::read_text(path)?;
    let mut cameras = BTreeMap::new();
    for line in filled_lines(path, &text) {
        let id = line.field(0, "camera id")?;
        if cameras.insert(id, camera_of(&line)?).is_some() {
            return Err(line.malformed(&format!("a second camera has the id {id}")));
        }
    }
    Ok(cameras)
}

/// Returns the camera of a line, or the reason why it cannot be used if an image refers to it.
fn camera_of(line: &Line<'_>) -> Result<Result<ModelCamera, String>, StoreError> {
    let name: String = line.field(1, "camera model")?;
    let size: [u32; 2] = [
        line.field(2, "camera width")?,
        line.field(3, "camera height")?,
    ];
    if size.contains(&0) {
        return Err(line.malformed("camera size is empty"));
    }
    let usable = if SPHERES.contains(&name.as_str()) {
        let parameters: Option<Vec<f64>> = line
            .words_from(4)
            .iter()
            .map(|word| word.parse().ok())
            .collect();
        parameters
            .and_then(|parameters| whole_sphere(size, &parameters))
            .map(ModelCamera::Erp)
            .ok_or_else(|| {
                let [width, height] = size;
                format!(
                    "the parameters of {name} are not those of a whole sphere of {width}x{height}"
                )
            })
    } else if let Some(model) = LensModel::of_name(&name) {
        let parameters: Vec<f64> = (4..model.parameters.saturating_add(4))
            .map(|index| line.field(index, "camera parameters"))
            .collect::<Result<_, _>>()?;
        let surplus = line.words_from(model.parameters.saturating_add(4));
        if let Some(word) = surplus.first() {
            let count = model.parameters;
            return Err(line.malformed(&format!(
                "{name} has {count} parameters, and {word} is one more"
            )));
        }
        model
            .lens(size, &parameters)
            .map(ModelCamera::Perspective)
            .ok_or_else(|| impossible_parameters(&name))
    } else {
        Err(unknown_model(&name))
    };
    Ok(usable.map_err(|reason| format!("line {}: {reason}", line.number)))
}

/// Returns a panorama by its parameters: width and height, or, in a fork, a focal length without effect and the centre.
/// It must have as many pixels for a degree in height as in width.
fn whole_sphere([width, height]: [u32; 2], parameters: &[f64]) -> Option<ErpCamera> {
    let (w, h) = (f64::from(width), f64::from(height));
    let is_whole = match parameters {
        [a, b] => [*a, *b] == [w, h],
        [_, x, y] => [2.0 * x, 2.0 * y] == [w, h] && w == 2.0 * h,
        _ => false,
    };
    is_whole.then_some(ErpCamera { width, height })
}

/// Returns the number of images of a model.
pub(super) fn image_count(path: &Path) -> Result<usize, StoreError> {
    Ok(read_images(path)?.len())
}

pub(super) fn read_images(path: &Path) -> Result<ImagesByCamera, StoreError> {
    let text = store::read_text(path)?;
    let mut lines = lines(path, &text);
    let mut images = BTreeMap::new();
    while let Some(line) = lines.next() {
        if line.text.trim().is_empty() {
            continue;
        }
        let id = line.field(0, "image id")?;
        let pose: [f64; 7] = line.numbers(1, "image pose")?;
        let camera: u32 = line.field(8, "camera of the image")?;
        let name = line.rest_from(9);
        if name.is_empty() {
            return Err(line.malformed("no image name"));
        }
        let observations = match lines.next() {
            Some(features) => read_observations(&features)?,
            None => Vec::new(),
        };
        let image =
            image_of(pose, name.to_owned(), observations).map_err(|what| line.malformed(what))?;
        if images.insert(id, (camera, image)).is_some() {
            return Err(line.malformed(&format!("a second image has the id {id}")));
        }
    }
    Ok(images)
}

/// Features as `x y point` triples; features without a point (-1) are left out.
fn read_observations(line: &Line<'_>) -> Result<Vec<(DVec2, u64)>, StoreError> {
    let words = line.words_from(0);
    let (triples, rest) = words.as_chunks::<3>();
    if !rest.is_empty() {
        return Err(line.malformed(FEATURES_FAULT));
    }
    let mut observations = Vec::new();
    for [x, y, point] in triples {
        let parsed = (x.parse(), y.parse(), point.parse::<i64>());
        let (Ok(x), Ok(y), Ok(point)) = parsed else {
            return Err(line.malformed(FEATURES_FAULT));
        };
        if let Ok(point) = u64::try_from(point) {
            observations.push((DVec2::new(x, y), point));
        }
    }
    Ok(observations)
}

pub(super) fn read_points(path: &Path) -> Result<BTreeMap<u64, ColmapPoint>, StoreError> {
    let text = store::read_text(path)?;
    let mut points = BTreeMap::new();
    for line in filled_lines(path, &text) {
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
            .map_err(|_| line.malformed("the track of a point must be a list of image ids"))?;
        let position = DVec3::from_array(line.numbers(1, "point position")?);
        let point = point_of(position, colour, track).map_err(|what| line.malformed(what))?;
        if points.insert(id, point).is_some() {
            return Err(line.malformed(&format!("a second point has the id {id}")));
        }
    }
    Ok(points)
}
