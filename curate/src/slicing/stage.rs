//! The stage that records what became of every second of a video and writes its slices.

use std::{path::Path, time::Instant};

use omnilife_schemas::{
    layout::{SLICES_FILE, SLICES_FOLDER, sequence_name},
    progress::Progress,
    records::{Slices, StretchFate, VideoAnalysis},
    stage::StagePlan,
    store,
};
use serde::{Deserialize, Serialize};

use super::{Shots, SliceRequest, SliceSource, slice_video, stretches};
use crate::error::CurateError;

/// How slices are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct SliceSettings {
    /// Whether sound is copied along.
    pub audio: bool,
}

/// Removes the slices of a video and their record.
pub(crate) fn remove_slices(folder: &Path) -> Result<(), CurateError> {
    store::remove(&folder.join(SLICES_FOLDER))?;
    Ok(store::remove(&folder.join(SLICES_FILE))?)
}

/// Writes `slices.json` into a video's folder, and an mp4 per kept shot where `settings` asks for
/// them; skipped, with a note, while the video, its shots and the settings have not changed.
///
/// # Errors
/// As [`slice_video`].
pub fn write_slices(
    folder: &Path,
    analysis: &VideoAnalysis,
    shots: &Shots,
    video: &SliceSource<'_>,
    settings: Option<SliceSettings>,
    progress: &dyn Progress,
) -> Result<Slices, CurateError> {
    let mut record = Slices {
        source: analysis.source.clone(),
        range: analysis.range,
        stretches: stretches(analysis.range, shots, sequence_name),
    };
    let path = folder.join(SLICES_FILE);
    let Some(settings) = settings else {
        // Slices of an earlier run would belong to no record.
        store::remove(&folder.join(SLICES_FOLDER))?;
        store::update_record(&path, &record)?;
        return Ok(record);
    };
    let plan = StagePlan::new(folder, "slices")
        .with_hash("video", analysis.source.sha256.clone())
        .with_settings("stretches", &record)
        .with_settings("settings", &settings);
    if plan.is_done() {
        progress.note(&format!(
            "{}: slices unchanged, skipped",
            video.video.display()
        ));
        return Ok(store::read_record(&path)?);
    }
    plan.begin()?;
    let started = Instant::now();
    let slices_folder = folder.join(SLICES_FOLDER);
    store::remove(&slices_folder)?;
    store::create_folder(&slices_folder)?;
    let requests: Vec<SliceRequest> = shots
        .kept
        .iter()
        .enumerate()
        .map(|(index, &range)| {
            let name = format!("{SLICES_FOLDER}/{}.mp4", sequence_name(index));
            SliceRequest {
                range,
                path: folder.join(&name),
                name,
            }
        })
        .collect();
    let mut files = slice_video(video, &requests, settings, progress)?.into_iter();
    let mut outputs = vec![SLICES_FILE.to_owned()];
    for stretch in &mut record.stretches {
        if let StretchFate::Kept { slice, .. } = &mut stretch.fate {
            *slice = files.next();
            outputs.extend(slice.iter().map(|slice| slice.file.clone()));
        }
    }
    store::write_record(&path, &record)?;
    plan.finish(outputs, started.elapsed().as_secs_f64())?;
    Ok(record)
}
