//! Copies of a method's views at the places where scoring expects them.

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    camera::cube::CUBE_FACES,
    records::{Scene, Split},
    store::{self, StoreError},
};

use super::{
    INPUT_FOLDER, NOVEL_FOLDER, compose,
    manifest::Manifest,
    placeholders::{self, Places, ViewName},
};
use crate::{error::BenchError, prediction, split};

pub(super) struct GatheredViews {
    /// Relative to the run's folder.
    pub(super) files: Vec<String>,
    pub(super) warnings: Vec<String>,
}

impl GatheredViews {
    /// Returns no views, with the manifest's notes for readers of scores.
    pub(super) fn notes_of(manifest: &Manifest) -> Self {
        Self {
            files: Vec::new(),
            warnings: manifest.notes.iter().cloned().collect(),
        }
    }
}

/// Brings every view of the method to `predictions/<kind>/<frame>.png`, or `.npy` for an array. PNG and NPY files are
/// copied byte for byte, so that scoring decides whether they are usable; others are put together. Missing views are not
/// replaced, and one that cannot be put together is missing, with a warning.
pub(super) fn gather(
    manifest: &Manifest,
    places: &Places,
    scene: &Scene,
    split: &Split,
    out: &Path,
) -> Result<GatheredViews, BenchError> {
    let (size, _) = split::sizes(scene, split)?;
    let cell = manifest.predictions.cell;
    let mut gathered = GatheredViews::notes_of(manifest);
    let kinds = [
        (
            INPUT_FOLDER,
            &split.input_views,
            manifest.predictions.input.as_ref(),
        ),
        (
            NOVEL_FOLDER,
            &split.novel_views,
            Some(&manifest.predictions.novel),
        ),
    ];
    for (folder, frames, pattern) in kinds {
        let Some(pattern) = pattern else {
            continue;
        };
        for (index, &frame) in frames.iter().enumerate() {
            let image = Path::new(&scene.frames[frame as usize].image);
            let view = ViewName {
                frame,
                index,
                group: group_of(split, frame),
                target: target_of(split, frame),
                stem: &image.file_stem().unwrap_or_default().to_string_lossy(),
                face: 0,
            };
            let sources = sources(places, pattern, view);
            if !sources.iter().all(|source| source.is_file()) {
                continue;
            }
            if let ([source], None) = (sources.as_slice(), cell)
                && is_prediction(source)
            {
                let file = format!("{folder}/{}", prediction::name_for(frame, source));
                let bytes =
                    std::fs::read(source).map_err(|error| StoreError::read(source, error))?;
                store::write_bytes(&out.join(&file), &bytes)?;
                gathered.files.push(file);
                continue;
            }
            match compose::view(&sources, cell, size) {
                Ok(image) => {
                    let file = format!("{folder}/{frame:06}.png");
                    image.write_png(&out.join(&file))?;
                    gathered.files.push(file);
                }
                Err(reason) => gathered.warnings.push(format!("view {frame}: {reason}")),
            }
        }
    }
    Ok(gathered)
}

/// Returns the number of the first group that has a frame; 0 if none has.
fn group_of(split: &Split, frame: u32) -> usize {
    let mut groups = split.groups.iter();
    groups
        .position(|group| group.context.contains(&frame) || group.novel_views.contains(&frame))
        .unwrap_or(0)
}

/// Returns the index of a frame among the novel views of its group; 0 if no group has it.
fn target_of(split: &Split, frame: u32) -> usize {
    let mut places = split.groups.iter().map(|group| {
        let mut views = group.novel_views.iter();
        views.position(|&view| view == frame)
    });
    places.find_map(|place| place).unwrap_or(0)
}

/// Returns the files of a view: one, or those of the faces of its cube.
fn sources(places: &Places, pattern: &str, view: ViewName<'_>) -> Vec<PathBuf> {
    let faces = if placeholders::has_faces(pattern) {
        CUBE_FACES.len()
    } else {
        1
    };
    (0..faces)
        .map(|face| places.fill_pattern(pattern, &ViewName { face, ..view }))
        .collect()
}

/// Returns true for files that scoring reads as they are.
fn is_prediction(source: &Path) -> bool {
    let ending = source.extension();
    ending.is_some_and(|ending| ending == "png" || ending == "npy")
}
