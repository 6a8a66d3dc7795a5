//! Splits that data sets are published with: lists of images for training and for testing.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use omnilife_schemas::{records::PublishedSplit, store};

use super::{ForeignScene, left_out};
use crate::error::CurateError;

/// The split of a data set's publisher. An image is named by its file, with or without its extension, or by its
/// place in the folder of the scene.
#[derive(Debug, Clone)]
pub struct ForeignSplit {
    /// Publisher and files, such as `OB3D, train.txt and test.txt`.
    pub source: String,
    /// Images for training.
    pub input: Vec<String>,
    /// Images for testing.
    pub novel: Vec<String>,
}

impl ForeignSplit {
    /// Reads two lists of images, one name a line; `None`, with a line in `notes`, if neither exists.
    ///
    /// # Errors
    /// When only one of them exists, or one cannot be read.
    pub(super) fn from_lists(
        publisher: &str,
        [input, novel]: [&Path; 2],
        notes: &mut Vec<String>,
    ) -> Result<Option<Self>, CurateError> {
        let [input_name, novel_name] = [input, novel].map(|path| {
            let name = path.file_name().unwrap_or_default();
            name.to_string_lossy().into_owned()
        });
        if !input.is_file() && !novel.is_file() {
            notes.push(format!(
                "{input_name} and {novel_name}, the split that {publisher} is published with, are not there"
            ));
            return Ok(None);
        }
        let names = |path: &Path| -> Result<Vec<String>, CurateError> {
            let text = store::read_text(path)?;
            let lines = text.lines().map(str::trim);
            let named = lines.filter(|line| !line.is_empty());
            Ok(named.map(str::to_owned).collect())
        };
        Ok(Some(Self {
            source: format!("{publisher}, {input_name} and {novel_name}"),
            input: names(input)?,
            novel: names(novel)?,
        }))
    }
}

/// The frames of an import on either side of its published split, by their numbers in natural order.
pub(super) struct SplitFrames {
    source: String,
    input: BTreeSet<usize>,
    novel: BTreeSet<usize>,
}

impl SplitFrames {
    /// Returns the split of the scene, whose frames are in order of `times`, one for each frame in natural order.
    pub(super) fn record(&self, times: &[f64]) -> PublishedSplit {
        let mut order: Vec<(usize, &f64)> = times.iter().enumerate().collect();
        order.sort_by(|a, b| a.1.total_cmp(b.1));
        let views = |chosen: &BTreeSet<usize>| -> Vec<u32> {
            let places = order.iter().enumerate();
            places
                .filter(|(_, (number, _))| chosen.contains(number))
                .map(|(place, _)| place as u32)
                .collect()
        };
        PublishedSplit {
            source: self.source.clone(),
            input_views: views(&self.input),
            novel_views: views(&self.novel),
        }
    }
}

/// A published split whose images were looked up.
#[derive(Default)]
pub(super) struct FoundSplit {
    /// Its frames; `None` if one of its images is missing, or no split was published.
    pub(super) frames: Option<SplitFrames>,
    /// A note on omissions.
    pub(super) note: Option<String>,
}

/// Finds the frames of a scene's published split. A split with missing images would be another one, and is omitted.
///
/// # Errors
/// When a list is empty, or names an image twice or one that is not a frame, or both name the same image.
pub(super) fn find(scene: &ForeignScene) -> Result<FoundSplit, CurateError> {
    let Some(split) = &scene.published_split else {
        return Ok(FoundSplit::default());
    };
    let refused = |reason: String| {
        let reason = format!("has a published split ({}) that {reason}", split.source);
        CurateError::input(&scene.root, reason)
    };
    let numbers = numbers_by_name(scene);
    let missing: BTreeSet<String> = (scene.missing_images.iter())
        .flat_map(|image| names_of(&scene.root, Path::new(image)))
        .collect();
    let mut absent = Vec::new();
    let mut frames_of = |list: &[String], side: &str| -> Result<BTreeSet<usize>, CurateError> {
        let mut frames = BTreeSet::new();
        for name in list {
            match numbers.get(name) {
                Some(Some(number)) if frames.insert(*number) => {}
                Some(Some(_)) => return Err(refused(format!("has {name} twice for {side}"))),
                Some(None) => {
                    return Err(refused(format!("names {name}, which is several frames")));
                }
                None if missing.contains(name) => absent.push(name.clone()),
                None => return Err(refused(format!("names {name}, which is not a frame"))),
            }
        }
        if list.is_empty() {
            return Err(refused(format!("has no image for {side}")));
        }
        Ok(frames)
    };
    let input = frames_of(&split.input, "training")?;
    let novel = frames_of(&split.novel, "testing")?;
    let mut frames = scene.frames.iter().enumerate();
    if let Some((_, frame)) =
        frames.find(|(number, _)| input.contains(number) && novel.contains(number))
    {
        let name = super::file_name(&frame.image.to_string_lossy());
        return Err(refused(format!("has {name} for training and for testing")));
    }
    if !absent.is_empty() {
        let what = format!(
            "images of the published split ({}) that are not there, so that it is left out",
            split.source
        );
        return Ok(FoundSplit {
            frames: None,
            note: left_out::line(&absent, &what),
        });
    }
    let others: Vec<String> = (scene.frames.iter().enumerate())
        .filter(|(number, _)| !input.contains(number) && !novel.contains(number))
        .map(|(_, frame)| super::file_name(&frame.image.to_string_lossy()))
        .collect();
    let what = format!(
        "frames without a part in the published split ({})",
        split.source
    );
    Ok(FoundSplit {
        note: left_out::line(&others, &what),
        frames: Some(SplitFrames {
            source: split.source.clone(),
            input,
            novel,
        }),
    })
}

/// Returns the numbers of frames by all their names; `None` for ambiguous names.
fn numbers_by_name(scene: &ForeignScene) -> BTreeMap<String, Option<usize>> {
    let mut numbers = BTreeMap::new();
    for (number, frame) in scene.frames.iter().enumerate() {
        for name in names_of(&scene.root, &frame.image) {
            numbers
                .entry(name)
                .and_modify(|found| *found = None)
                .or_insert(Some(number));
        }
    }
    numbers
}

/// Names of an image: its file, that without its extension, and its place in the folder of the scene.
fn names_of(root: &Path, image: &Path) -> BTreeSet<String> {
    let file = super::file_name(&image.to_string_lossy());
    let place = image.strip_prefix(root).unwrap_or(image);
    [
        super::stem(&file).to_owned(),
        place.to_string_lossy().into_owned(),
        file,
    ]
    .into()
}
