//! The stage that records the fate of every second of a video and writes its slices.

use std::path::Path;

use omnilife_schemas::{
    layout::{SLICES_FILE, SLICES_FOLDER, sequence_name},
    progress::Progress,
    records::{SegmentOutcome, Slices, VideoAnalysis},
    stage::StagePlan,
    staging::Staging,
    store::{self, StoreError},
};
use serde::{Deserialize, Serialize};

use super::{Shots, SliceRequest, SliceSource, segments, slice_video};
use crate::error::CurateError;

/// Name of the stage.
const STAGE: &str = "slices";

/// Settings of slices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct SliceSettings {
    /// True if sound is copied along.
    pub audio: bool,
}

/// Removes the slices of a video and their record.
pub(crate) fn remove_slices(folder: &Path) -> Result<(), CurateError> {
    remove_files(folder)?;
    Ok(store::remove(&folder.join(SLICES_FILE))?)
}

/// Removes the slices that this stage has written, if they are unchanged.
fn remove_files(folder: &Path) -> Result<(), StoreError> {
    let own = StagePlan::new(folder, STAGE).own_files();
    own.remove(|file| file != SLICES_FILE)
}

/// Writes `slices.json` into a video's folder, and an mp4 per kept shot if `settings` requests them. Skipped, with a
/// note, while the video, its shots and the settings are unchanged. `no_slices` is the reason why requested slices are
/// impossible, for the record; `settings` then requests none.
///
/// # Errors
/// Those of [`slice_video`].
pub fn write_slices(
    folder: &Path,
    analysis: &VideoAnalysis,
    shots: &Shots,
    video: &SliceSource<'_>,
    settings: Option<SliceSettings>,
    no_slices: Option<String>,
    progress: &dyn Progress,
) -> Result<Slices, CurateError> {
    let mut record = Slices {
        source: analysis.source.clone(),
        range: analysis.range,
        segments: segments(analysis.range, shots, sequence_name),
        no_slices,
    };
    let path = folder.join(SLICES_FILE);
    if path.exists() {
        store::read_record::<Slices>(&path)?;
    }
    let Some(settings) = settings else {
        // Slices of an earlier run would belong to no record.
        remove_files(folder)?;
        store::update_record(&path, &record)?;
        return Ok(record);
    };
    let plan = StagePlan::new(folder, STAGE)
        .with_hash("video", analysis.source.sha256.clone())
        .with_settings("segments", &record)
        .with_settings("settings", &settings);
    let skipped = format!("{}: slices unchanged, skipped", video.video.display());
    // The record is written without slices too, and is not a mark of theirs.
    let claimed = [""; 0];
    plan.make((SLICES_FILE, &skipped), claimed, progress, |out| {
        let mut staging = Staging::new(folder, SLICES_FOLDER)?;
        let mut requests = Vec::new();
        for (index, &range) in shots.kept.iter().enumerate() {
            let name = format!("{SLICES_FOLDER}/{}.mp4", sequence_name(index));
            requests.push(SliceRequest {
                range,
                path: staging.begin(&name)?,
                name,
            });
        }
        let mut files = slice_video(video, &requests, settings, progress)?.into_iter();
        for segment in &mut record.segments {
            if let SegmentOutcome::Kept { slice, .. } = &mut segment.outcome {
                *slice = files.next();
            }
        }
        out.replace(&staging.folder, &staging.files)?;
        Ok(record)
    })
}
