//! `files`: boxes that another program found, as MOT text or COCO JSON.
//!
//! MOT text (<https://motchallenge.net/instructions/>): `frame,id,left,top,width,height,confidence,class`
//! per line, frames from 1 on in the order of the scene's frames; the id may be -1, and what follows the
//! height may be missing. COCO JSON: `images`, `annotations` with `bbox` and perhaps `score`,
//! `categories`; images are matched by the name of their file.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use omnilife_schemas::{
    posed_view::PosedView,
    progress::Progress,
    records::{Detection, Scene},
    store::{self, StoreError},
};
use serde::Deserialize;

use super::{Detector, DetectorInput};
use crate::error::TracksError;

/// The detector.
pub const DETECTOR: Detector = Detector {
    id: "files",
    about: "boxes that any other program found, as MOT text or COCO JSON (--detections FILE)",
    keeps_files: false,
    detect: |input, progress| {
        let file = input.file.ok_or_else(|| {
            TracksError::input(
                input.folder,
                "the detector files reads a file: --detections FILE",
            )
        })?;
        let is_json = file
            .extension()
            .is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
        let format = if is_json {
            BoxFormat::Coco
        } else {
            BoxFormat::Mot
        };
        let frames = NamedFrames::of_scene(input.scene);
        let mut found = read(file, format, &frames, input, progress)?;
        // Boxes of unused frames are read all the same: a broken file is an error.
        let looked_at: BTreeSet<u32> = input.views.iter().map(|view| view.frame).collect();
        found.retain(|one| looked_at.contains(&one.frame));
        for one in &mut found {
            if format == BoxFormat::Mot || one.class.is_empty() {
                "vehicle".clone_into(&mut one.class);
            }
        }
        Ok(found.into())
    },
};

/// Format of boxes in files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum BoxFormat {
    Mot,
    Coco,
}

/// The frames to which a file of boxes may refer.
pub(super) struct NamedFrames {
    /// Their numbers in the scene, in the order in which MOT text counts them from 1 on.
    in_order: Vec<u32>,
    /// Their numbers in the scene by the names of their files without the extension.
    by_stem: BTreeMap<String, u32>,
}

impl NamedFrames {
    /// Collects all frames of a scene, by the names of its images.
    fn of_scene(scene: &Scene) -> Self {
        let numbered = (0..).zip(&scene.frames);
        let by_stem = numbered.map(|(number, frame)| (stem(&frame.image), number));
        Self {
            by_stem: by_stem.collect(),
            in_order: (0..scene.frames.len() as u32).collect(),
        }
    }

    /// Collects some frames of a scene whose files are named by their numbers.
    pub(super) fn called_by_number(views: &[PosedView]) -> Self {
        let mut in_order: Vec<u32> = views.iter().map(|view| view.frame).collect();
        in_order.sort_unstable();
        let by_stem = in_order.iter().map(|&frame| (format!("{frame:06}"), frame));
        Self {
            by_stem: by_stem.collect(),
            in_order,
        }
    }
}

/// Reads a file of boxes; classes are as in the file, empty if it has none. A line reports confidences that are
/// neither in [0, 1] nor -1.
///
/// # Errors
/// When it cannot be read, or has an invalid box in one of the frames.
pub(super) fn read(
    file: &Path,
    format: BoxFormat,
    frames: &NamedFrames,
    input: &DetectorInput<'_>,
    progress: &dyn Progress,
) -> Result<Vec<Detection>, TracksError> {
    let text = store::read_text(file)?;
    let mut found = match format {
        BoxFormat::Mot => read_mot(file, &text, frames, input),
        BoxFormat::Coco => read_coco(file, &text, frames, input),
    }?;
    let mut odd = 0_usize;
    for one in &mut found {
        // MOT's ground truth has 1, or -1 for an unknown confidence.
        let is_unknown = (one.confidence + 1.0).abs() < 1e-9;
        if is_unknown || !(0.0..=1.0).contains(&one.confidence) {
            one.confidence = 1.0;
            odd = odd.saturating_add(usize::from(!is_unknown));
        }
    }
    if odd > 0 {
        progress.note(&format!(
            "{}: {odd} of {} confidences are neither in [0, 1] nor -1 (unknown), and count as 1",
            file.display(),
            found.len()
        ));
    }
    Ok(found)
}

/// Largest number of boxes that a file may hold.
const MOST_BOXES: usize = 2_000_000;

/// Checks a box against its image.
fn check(sides: [f64; 4], confidence: f64, input: &DetectorInput<'_>) -> Result<(), String> {
    if sides
        .iter()
        .chain(&[confidence])
        .any(|number| !number.is_finite())
    {
        return Err("has a number that is not finite".to_owned());
    }
    let [left, top, width, height] = sides;
    if width <= 0.0 || height <= 0.0 {
        return Err(format!("has a box of {width}x{height} pixels"));
    }
    let [columns, rows] = input.scene.camera.size().map(|side| side as f64);
    if left >= columns || top >= rows || left + width <= 0.0 || top + height <= 0.0 {
        return Err(format!(
            "has a box at {left},{top} of {width}x{height} pixels, outside of its image of \
             {columns}x{rows}"
        ));
    }
    Ok(())
}

fn detection(frame: u32, sides: [f64; 4], confidence: f64, class: &str) -> Detection {
    Detection {
        frame,
        box_pixels: sides,
        confidence,
        class: class.to_owned(),
        distance: None,
        position: None,
        track: None,
    }
}

fn read_mot(
    path: &Path,
    text: &str,
    names: &NamedFrames,
    input: &DetectorInput<'_>,
) -> Result<Vec<Detection>, TracksError> {
    let frames = names.in_order.len();
    let (mut found, mut ids) = (Vec::new(), BTreeSet::new());
    for (row, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let malformed = |reason: String| {
            StoreError::malformed(path, format!("line {}: {reason}", row.saturating_add(1)))
        };
        let words: Vec<&str> = line.split(',').map(str::trim).collect();
        if words.len() < 6 {
            return Err(malformed("expected frame,id,left,top,width,height".to_owned()).into());
        }
        let value = |index: usize| -> Result<f64, StoreError> {
            let word = words.get(index).copied().unwrap_or_default();
            word.parse()
                .map_err(|_| malformed(format!("must be a number, got {word:?}")))
        };
        let frame = value(0)?;
        let place = (frame >= 1.0 && frame.fract() == 0.0).then_some(frame as usize);
        let place = place.and_then(|place| place.checked_sub(1));
        let Some(&number) = place.and_then(|place| names.in_order.get(place)) else {
            let reason = format!("is of frame {frame}, and there are the frames 1 to {frames}");
            return Err(malformed(reason).into());
        };
        let id = value(1)?;
        if id >= 0.0 && !ids.insert((number, id.to_bits())) {
            return Err(malformed(format!("frame {frame} has two boxes of id {id}")).into());
        }
        let sides = [value(2)?, value(3)?, value(4)?, value(5)?];
        let confidence = if words.len() > 6 { value(6)? } else { 1.0 };
        check(sides, confidence, input).map_err(malformed)?;
        if found.len() == MOST_BOXES {
            return Err(malformed(format!("holds more than {MOST_BOXES} boxes")).into());
        }
        let class = words.get(7).copied().unwrap_or_default();
        found.push(detection(number, sides, confidence, class));
    }
    Ok(found)
}

#[derive(Deserialize)]
struct Coco {
    images: Vec<CocoImage>,
    annotations: Vec<CocoAnnotation>,
    #[serde(default)]
    categories: Vec<CocoCategory>,
}

#[derive(Deserialize)]
struct CocoImage {
    id: i64,
    file_name: String,
    width: Option<u32>,
    height: Option<u32>,
}

#[derive(Deserialize)]
struct CocoAnnotation {
    image_id: i64,
    bbox: [f64; 4],
    category_id: Option<i64>,
    score: Option<f64>,
}

#[derive(Deserialize)]
struct CocoCategory {
    id: i64,
    name: String,
}

fn stem(file: &str) -> String {
    let stem = Path::new(file).file_stem().unwrap_or_default();
    stem.to_string_lossy().into_owned()
}

fn read_coco(
    path: &Path,
    text: &str,
    names: &NamedFrames,
    input: &DetectorInput<'_>,
) -> Result<Vec<Detection>, TracksError> {
    let malformed = |reason: String| StoreError::malformed(path, reason);
    let coco: Coco = serde_json::from_str(text)
        .map_err(|error| malformed(format!("must be a COCO JSON of boxes: {error}")))?;
    let scene = input.scene;
    let [width, height] = [scene.camera.width(), scene.camera.height()];
    let mut frames = BTreeMap::new();
    for image in &coco.images {
        let name = &image.file_name;
        let &number = names
            .by_stem
            .get(&stem(name))
            .ok_or_else(|| malformed(format!("{name} is not a frame of {}", scene.id)))?;
        let size = [image.width.unwrap_or(width), image.height.unwrap_or(height)];
        if size != [width, height] {
            let reason = format!(
                "{name} is {}x{} pixels, the frames of {} are {width}x{height}",
                size[0], size[1], scene.id
            );
            return Err(malformed(reason).into());
        }
        if frames.insert(image.id, number).is_some() {
            return Err(malformed(format!("has two images with the id {}", image.id)).into());
        }
    }
    if coco.annotations.len() > MOST_BOXES {
        return Err(malformed(format!("holds more than {MOST_BOXES} boxes")).into());
    }
    let classes: BTreeMap<i64, &str> = coco
        .categories
        .iter()
        .map(|category| (category.id, category.name.as_str()))
        .collect();
    let mut found = Vec::new();
    for (index, one) in coco.annotations.iter().enumerate() {
        let of_one = |reason: String| malformed(format!("annotation {index} {reason}"));
        let &frame = frames
            .get(&one.image_id)
            .ok_or_else(|| of_one(format!("is of image {}, which is not listed", one.image_id)))?;
        let confidence = one.score.unwrap_or(1.0);
        check(one.bbox, confidence, input).map_err(of_one)?;
        let class = one.category_id.and_then(|id| classes.get(&id).copied());
        found.push(detection(
            frame,
            one.bbox,
            confidence,
            class.unwrap_or_default(),
        ));
    }
    Ok(found)
}
