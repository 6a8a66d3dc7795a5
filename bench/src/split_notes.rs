//! Oddities of the frames of a split, checked before training.

use std::{collections::BTreeMap, path::Path};

use omnilife_schemas::{
    image_file::ImageFile,
    records::{Scene, Split},
    rgb,
    store::{self, StoreError},
};
use rayon::prelude::*;

use crate::{
    diagnosis::{Look, repeated_frames},
    error::BenchError,
    split::without_content,
};

struct Seen {
    is_single_colour: bool,
    look: Look,
}

/// Returns the lines of [`Split::notes`]. Examines the images of the frames too, for a line on those of a single
/// colour, which show nothing, and one on those that are unusable for training or scoring.
///
/// # Errors
/// When the `scene.json` cannot be read.
pub fn notes_on_split(scene: &Path, split: &Split) -> Result<Vec<String>, BenchError> {
    let record: Scene = store::read_record(scene)?;
    let frames = [split.input_views.as_slice(), &split.novel_views].concat();
    let seen: Vec<(u32, Result<Seen, StoreError>)> = frames
        .par_iter()
        .filter_map(|&frame| {
            let file = scene.with_file_name(&record.frames.get(frame as usize)?.image);
            let seen = ImageFile::open(&file).and_then(|image| {
                let size = image.size();
                let rgb = image.decode_plain()?;
                Ok(Seen {
                    is_single_colour: rgb::is_single_colour(&rgb),
                    look: Look::of(&rgb, size),
                })
            });
            Some((frame, seen))
        })
        .collect();
    let single = seen
        .iter()
        .filter(|(_, seen)| seen.as_ref().is_ok_and(|seen| seen.is_single_colour));
    let unusable: Vec<&StoreError> = seen
        .iter()
        .filter_map(|(_, seen)| seen.as_ref().err())
        .collect();
    let looks = seen.iter().filter_map(|(frame, seen)| {
        let seen = seen.as_ref().ok()?;
        (!seen.is_single_colour).then_some((*frame, &seen.look))
    });
    let looks: BTreeMap<u32, &Look> = looks.collect();
    let repeated = repeated_frames(&split.novel_views, &split.input_views, |frame| {
        looks.get(&frame).copied()
    });
    let mut lines = split.notes(&record);
    lines.extend(repeated.map(|kind| kind.to_string()));
    lines.extend(without_content(single.map(|(frame, _)| *frame)));
    lines.extend(unusable.first().map(|first| {
        format!(
            "{} of {} images are not usable; the first: {first}",
            unusable.len(),
            frames.len()
        )
    }));
    Ok(lines)
}
