//! Times of imported frames: by a table, by a frame rate, or by order alone.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use super::{
    ForeignFrame, ForeignScene, ImportRequest,
    scene_folder::{file_name, name_with_folder},
    times,
};
use crate::{error::CurateError, frame_order};

/// Times of frames.
pub(super) struct FrameTimes {
    /// Seconds, one for each frame.
    pub(super) seconds: Vec<f64>,
    /// Notes on assumptions.
    pub(super) notes: Vec<String>,
}

/// Reads times from `times.csv`, else counts them by the given frame rate, or that of the format. `beside` are images
/// that are not frames.
///
/// # Errors
/// When the table does not fit, there is neither a table nor a frame rate, or simultaneous frames have different times.
pub(super) fn frame_times(
    request: &ImportRequest<'_>,
    scene: &ForeignScene,
    beside: &[PathBuf],
) -> Result<FrameTimes, CurateError> {
    if let Some(seconds) = of_drive(request, scene)? {
        let notes = Vec::new();
        return Ok(FrameTimes { seconds, notes });
    }
    if let Some(table) = times::TimeTable::read(&scene.root)? {
        let both = |image: &Path| [file_name(image), name_with_folder(image)];
        let frames: Vec<[String; 2]> = (scene.frames.iter())
            .map(|frame| both(frame.image.as_path()))
            .collect();
        let missing = scene.missing_images.iter().map(Path::new);
        let others: Vec<[String; 2]> = (beside.iter().map(PathBuf::as_path))
            .chain(missing)
            .map(both)
            .collect();
        let times = table.of(&frames, &others)?;
        return Ok(FrameTimes {
            seconds: times.seconds,
            notes: times.note.into_iter().collect(),
        });
    }
    if let (None, Some(seconds)) = (request.frames_per_second, of_stills(scene)) {
        return Ok(FrameTimes {
            seconds,
            notes: vec![scene.stills_note.clone()],
        });
    }
    if let Some(rate) = request.frames_per_second
        && !(rate.is_finite() && rate > 0.0)
    {
        let reason = format!("--fps must be positive, got {rate}");
        return Err(CurateError::input(request.folder, reason));
    }
    let assumed = (scene.frame_rate).filter(|_| request.frames_per_second.is_none());
    let rate = (request.frames_per_second)
        .or(assumed.map(|rate| rate.frames_per_second))
        .filter(|rate| rate.is_finite() && *rate > 0.0);
    let rate = rate.ok_or_else(|| {
        CurateError::input(
            request.folder,
            format!(
                "has no {}, so nothing says when its frames were shown; give --fps",
                times::TIMES_FILE
            ),
        )
    })?;
    let images: Vec<&Path> = (scene.frames.iter())
        .map(|frame| frame.image.as_path())
        .collect();
    let times = frame_order::times_at(rate, &images, beside);
    if times.seconds.iter().any(|seconds| !seconds.is_finite()) {
        let reason = format!("--fps {rate} gives times beyond all numbers");
        return Err(CurateError::input(request.folder, reason));
    }
    expect_shared_times(request.folder, &scene.frames, &times.seconds)?;
    let shared = shared_by_folders(&scene.frames, &times.seconds);
    Ok(FrameTimes {
        seconds: times.seconds,
        notes: (times.note.into_iter().chain(shared))
            .chain(assumed.map(|rate| {
                format!(
                    "times count {} frames per second: {}; --fps gives another rate",
                    rate.frames_per_second, rate.reason
                )
            }))
            .collect(),
    })
}

/// Returns a line on frames of several folders that share times by their numbers but are not views of a rig.
fn shared_by_folders(frames: &[ForeignFrame], times: &[f64]) -> Option<String> {
    let alone = frames
        .iter()
        .zip(times)
        .filter(|(frame, _)| frame.moment.is_none());
    let mut seen: Vec<u64> = alone.map(|(_, time)| time.to_bits()).collect();
    let all = seen.len();
    seen.sort_unstable();
    seen.dedup();
    let shared = all.saturating_sub(seen.len());
    (shared > 0).then(|| {
        format!(
            "{shared} images have the number of one in another folder, and its time: give {} where they were not \
             taken at once",
            times::TIMES_FILE
        )
    })
}

/// Returns the times of the images of a drive, which its layout states; `None` for other scenes.
fn of_drive(
    request: &ImportRequest<'_>,
    scene: &ForeignScene,
) -> Result<Option<Vec<f64>>, CurateError> {
    let Some(drive) = &scene.drive else {
        return Ok(None);
    };
    if let Some(rate) = request.frames_per_second {
        let reason = format!(
            "--fps must be left out of the format {}, which states times, got {rate}",
            request.format
        );
        return Err(CurateError::input(request.folder, reason));
    }
    let views = (scene.frames.iter()).map(|frame| Some(drive.view(&frame.image)?.seconds));
    Ok(views.collect())
}

/// Returns the times of stills; `None` for frames of a video.
fn of_stills(scene: &ForeignScene) -> Option<Vec<f64>> {
    let times: Option<Vec<f64>> = (scene.frames.iter())
        .map(|frame| Some(scene.stills.get(&frame.image)?.1))
        .collect();
    times
}

/// Refuses simultaneous frames with different times by their names.
fn expect_shared_times(
    folder: &Path,
    frames: &[ForeignFrame],
    times: &[f64],
) -> Result<(), CurateError> {
    let mut moments = BTreeMap::new();
    for (frame, time) in frames.iter().zip(times) {
        let Some(moment) = frame.moment else {
            continue;
        };
        let (first, shown) = *moments.entry(moment).or_insert((frame, time));
        if shown != time {
            let reason = format!(
                "has {} and {} in one frame of a rig, and their numbers differ; give {} with their times",
                name_with_folder(&first.image),
                name_with_folder(&frame.image),
                times::TIMES_FILE
            );
            return Err(CurateError::input(folder, reason));
        }
    }
    Ok(())
}
