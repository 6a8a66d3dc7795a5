//! Copies of a method's views at the places where scoring expects them.

use std::path::Path;

use omnilife_schemas::{
    records::{Scene, Split},
    store::{self, StoreError},
};

use super::{
    INPUT_FOLDER, NOVEL_FOLDER,
    manifest::Manifest,
    placeholders::{Places, ViewName},
};
use crate::prediction;

/// The gathered views.
pub(super) struct Gathered {
    /// Relative to the run's folder.
    pub(super) files: Vec<String>,
    pub(super) warnings: Vec<String>,
}

impl Gathered {
    /// Returns no views, with the manifest's notes for readers of scores.
    pub(super) fn notes_of(manifest: &Manifest) -> Self {
        Self {
            files: Vec::new(),
            warnings: manifest.notes.iter().cloned().collect(),
        }
    }
}

/// Copies every view of the method, byte for byte, to `predictions/<kind>/<frame>.png`, or `.npy` for an array. Scoring
/// decides whether a file is a usable image; missing ones are not replaced.
pub(super) fn gather(
    manifest: &Manifest,
    places: &Places,
    scene: &Scene,
    split: &Split,
    out: &Path,
) -> Result<Gathered, StoreError> {
    let mut gathered = Gathered::notes_of(manifest);
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
                stem: &image.file_stem().unwrap_or_default().to_string_lossy(),
            };
            let source = places.fill_pattern(pattern, &view);
            if !source.is_file() {
                continue;
            }
            let file = format!("{folder}/{}", prediction::name_for(frame, &source));
            let bytes = std::fs::read(&source).map_err(|error| StoreError::read(&source, error))?;
            store::write_bytes(&out.join(&file), &bytes)?;
            gathered.files.push(file);
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
