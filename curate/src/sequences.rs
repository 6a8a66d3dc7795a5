//! The stage that cuts a video into sequences and extracts their frames.
//!
//! Every sequence folder has its own done-record. It covers the inputs of the frames (the video, the chosen timestamps,
//! the size) and nothing else: other criteria or another name of the file only rewrite `sequence.json`. Folders are
//! created beside and renamed, so that a killed process leaves complete sequences only.

mod planned;

use std::path::Path;

use omnilife_schemas::{
    elapsed::Stopwatch,
    layout::{BOUNDARIES_FILE, FRAMES_FOLDER, MOTION_FOLDER, SEQUENCE_FILE, sequence_name},
    ownership::NameState,
    plain_text::counted,
    progress::Progress,
    records::{
        Admission, BoundaryLedger, CheckOutcome, DetectedProjection, FrameEntry, FrameSet,
        Sequence, SphereLayout, TimeRange, VideoAnalysis,
    },
    stage::StagePlan,
    staging::Staging,
    store::{self, StoreError},
};
use omnilife_video::Orientation;

use self::planned::PlannedSequence;
pub(crate) use crate::edited_frames::STAGE;
use crate::{
    boundaries::{Detector, Signals},
    criteria,
    error::CurateError,
    frames::{self, Selection},
    settings::CurateSettings,
    shots::{self, ShotList},
    slicing::{self, SliceSource},
};

/// Folder for superseded sequences with poses or scores of frames that are no longer chosen, relative to the video's
/// folder.
const SUPERSEDED_FOLDER: &str = ".superseded";

/// The stage of one video.
pub(crate) struct Sequencing<'a> {
    pub(crate) video: &'a Path,
    pub(crate) folder: &'a Path,
    pub(crate) settings: &'a CurateSettings,
    pub(crate) detector: &'a Detector,
    pub(crate) analysis: &'a VideoAnalysis,
    pub(crate) signals: &'a Signals,
    pub(crate) list: &'a ShotList,
    /// The video's sphere layout, if its frames are converted to equirectangular ones.
    pub(crate) layout: Option<SphereLayout>,
    pub(crate) projection: DetectedProjection,
    pub(crate) admission: Admission,
    /// Width and height of the frames in pixels.
    pub(crate) size: (u32, u32),
}

impl Sequencing<'_> {
    /// Creates the sequence folders and returns their names in order of time.
    pub(crate) fn run(&self, progress: &dyn Progress) -> Result<Vec<String>, CurateError> {
        self.write_boundaries(progress)?;
        self.refuse_none_left()?;
        let planned = self.planned()?;
        let (done, missing): (Vec<&PlannedSequence>, Vec<&PlannedSequence>) =
            planned.iter().partition(|sequence| {
                self.plan(sequence, &self.folder.join(&sequence.name))
                    .is_done()
            });
        if !done.is_empty() {
            progress.note(&format!(
                "{}: frames of {} unchanged, skipped",
                self.video.display(),
                counted(done.len(), "sequence")
            ));
        }
        for folder in sequence_folders(self.folder)? {
            if !planned.iter().any(|sequence| sequence.name == folder) {
                clear(self.folder, &folder, progress)?;
            }
        }
        if !missing.is_empty() {
            self.extract(&missing, progress)?;
        }
        for sequence in &planned {
            let folder = self.folder.join(&sequence.name);
            store::update_record(&folder.join(SEQUENCE_FILE), &self.record(sequence, &folder))?;
        }
        self.slice(progress)?;
        progress.note(&format!(
            "{}: {}, {}",
            self.video.display(),
            self.projection.projection.name(),
            counted(planned.len(), "sequence")
        ));
        Ok(planned.into_iter().map(|sequence| sequence.name).collect())
    }

    /// Writes the boundaries with the outcome of the shots between them, and reports rejected ones.
    fn write_boundaries(&self, progress: &dyn Progress) -> Result<(), CurateError> {
        let shots = &self.list.shots;
        for shot in &shots.rejected {
            progress.note(&format!(
                "{}: {:.3} to {:.3} s makes no sequence: it {} ({}, {})",
                self.video.display(),
                shot.range.begin_seconds,
                shot.range.end_seconds,
                shots::described(shot),
                shot.check,
                shots::limit(shot)
            ));
        }
        let ledger = BoundaryLedger {
            source: self.analysis.source.clone(),
            range: self.analysis.range,
            detector: self.detector.description(),
            ledger_sha256: self.list.ledger_sha256.clone(),
            boundaries: self.list.boundaries.clone(),
            dropped: shots.dropped.clone(),
            left_out: shots.left_out.clone(),
            rejected: shots.rejected.clone(),
        };
        Ok(store::update_record(
            &self.folder.join(BOUNDARIES_FILE),
            &ledger,
        )?)
    }

    /// Refuses a video without kept shots.
    fn refuse_none_left(&self) -> Result<(), CurateError> {
        let shots = &self.list.shots;
        if !shots.kept.is_empty() {
            return Ok(());
        }
        let least = self.settings.minimum_shot_seconds;
        let (reason, failed) = match (&shots.rejected[..], &shots.left_out[..]) {
            ([_, ..], _) => {
                let failed = shots::outcomes(&shots.rejected);
                let checks: Vec<&str> = failed.iter().map(|outcome| &*outcome.check).collect();
                let reason = format!(
                    "none of its shots that are long enough is kept: {} rejected ({}), {} left out",
                    shots.rejected.len(),
                    checks.join(", "),
                    shots.left_out.len()
                );
                (reason, failed)
            }
            ([], [_, ..]) => {
                let outcome = CheckOutcome {
                    check: criteria::LEFT_OUT.to_owned(),
                    passed: false,
                    value: format!("{} shots left out", shots.left_out.len()),
                    threshold: criteria::LEFT_OUT_THRESHOLD.to_owned(),
                };
                let reason = "its ledger leaves all shots out that are long enough";
                (reason.to_owned(), vec![outcome])
            }
            ([], []) => {
                let longest = shots
                    .dropped
                    .iter()
                    .map(TimeRange::duration_seconds)
                    .fold(0.0, f64::max);
                let outcome = CheckOutcome {
                    check: criteria::SHOT_LENGTH.to_owned(),
                    passed: false,
                    value: format!("{longest:.3} s"),
                    threshold: format!("at least {least} s"),
                };
                let reason =
                    format!("none of its shots lasts {least} s, the longest {longest:.3} s");
                (reason, vec![outcome])
            }
        };
        Err(CurateError::rejected(self.video, reason, failed))
    }

    /// Accounts for every second of the video, and writes the slices if requested and possible.
    fn slice(&self, progress: &dyn Progress) -> Result<(), CurateError> {
        let source = SliceSource {
            video: self.video,
            times: &self.signals.times,
            orientation: Orientation::of(&self.analysis.probe),
        };
        let mut settings = self.settings.slices;
        let mut no_slices = None;
        if let (Some(_), Some(layout)) = (settings, self.layout) {
            let reason = format!(
                "slices are cut from equirectangular video, and this one is {layout}, converted frame by frame"
            );
            let video = self.video.display();
            progress.note(&format!("{video}: has no slices: {reason}"));
            settings = None;
            no_slices = Some(reason);
        }
        slicing::write_slices(
            self.folder,
            self.analysis,
            &self.list.shots,
            &source,
            settings,
            no_slices,
            progress,
        )
        .map(drop)
    }

    /// Lists everything that the frames of a sequence depend on, for its folder or for one that becomes it. Frames for
    /// the measurement of motion are not part of it: sequences from before there were any stay as they are.
    fn plan(&self, sequence: &PlannedSequence, folder: &Path) -> StagePlan {
        let plan = StagePlan::new(folder, STAGE)
            .with_hash("video", self.analysis.source.sha256.clone())
            .with_settings("timestamps in seconds", &sequence.times)
            .with_settings("size in pixels", &self.size)
            .with_settings("rotation in degrees", &self.analysis.probe.rotation_degrees);
        match self.layout {
            Some(layout) => plan.with_settings("layout", &layout),
            None => plan,
        }
    }

    /// Extracts the frames of some sequences in one decode and puts them in place.
    fn extract(
        &self,
        missing: &[&PlannedSequence],
        progress: &dyn Progress,
    ) -> Result<(), CurateError> {
        let started = Stopwatch::with_children();
        let staging = Staging::new(self.folder, "sequences")?;
        let selections: Vec<Selection> = missing
            .iter()
            .map(|sequence| Selection {
                times: sequence.times.clone(),
                motion_times: sequence.motion_times.clone(),
                folder: staging.folder.join(&sequence.name),
            })
            .collect();
        frames::extract(
            self.video,
            &self.analysis.probe,
            &selections,
            self.layout,
            self.size,
            progress,
        )?;
        let took = started.elapsed();
        for (sequence, selection) in missing.iter().zip(&selections) {
            store::write_record(
                &selection.folder.join(SEQUENCE_FILE),
                &self.record(sequence, &selection.folder),
            )?;
            let motion = (0..sequence.motion_times.len()).map(frames::motion_file_name);
            let files = (0..sequence.times.len())
                .map(frames::file_name)
                .chain(motion);
            self.plan(sequence, &selection.folder).finish(files, took)?;
            clear(self.folder, &sequence.name, progress)?;
            let target = self.folder.join(&sequence.name);
            store::rename(&selection.folder, &target)
                .map_err(|error| StoreError::write(&target, error))?;
        }
        Ok(())
    }

    /// Returns the record of a sequence whose files are in `folder`.
    fn record(&self, sequence: &PlannedSequence, folder: &Path) -> Sequence {
        let probe = &self.analysis.probe;
        let entries = |times: &[f64], name: fn(usize) -> String| -> Vec<FrameEntry> {
            let entry = |(index, &time_seconds): (usize, &f64)| FrameEntry {
                file: name(index),
                time_seconds,
                capture: None,
            };
            times.iter().enumerate().map(entry).collect()
        };
        let mut motion_frames = entries(&sequence.motion_times, frames::motion_file_name);
        // Earlier versions wrote none.
        if !motion_frames
            .iter()
            .all(|entry| folder.join(&entry.file).is_file())
        {
            motion_frames.clear();
        }
        Sequence {
            id: format!("{}/{}", self.folder_name(), sequence.name),
            source: self.analysis.source.clone(),
            range: sequence.range,
            probe: probe.clone(),
            projection: self.projection.clone(),
            admission: self.admission.clone(),
            frames: FrameSet {
                width: self.size.0,
                height: self.size.1,
                sampling: self.settings.sampling,
                resampling: frames::resampling(probe, self.layout, self.size),
                converted_from: self.layout,
                entries: entries(&sequence.times, frames::file_name),
                sharpest: sequence.sharpest.clone(),
            },
            motion_frames,
        }
    }

    /// Returns the name of the video in its dataset.
    fn folder_name(&self) -> String {
        let name = self.folder.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    }
}

/// Removes the results of earlier runs of a video that is now excluded, so that its folder is as if it had always been
/// excluded. Results of others from its sequences are set aside.
///
/// # Errors
/// When something cannot be moved or removed.
pub(crate) fn withdraw(
    video_folder: &Path,
    failed: &[CheckOutcome],
    progress: &dyn Progress,
) -> Result<(), CurateError> {
    for name in sequence_folders(video_folder)? {
        clear(video_folder, &name, progress)?;
    }
    slicing::remove_slices(video_folder)?;
    // If no shot is long enough, or all are excluded or rejected, its boundaries are why.
    let of_shots = shots::CHECKS.iter().map(|check| check.id);
    let mut by_boundaries = [criteria::SHOT_LENGTH, criteria::LEFT_OUT]
        .into_iter()
        .chain(of_shots);
    if !by_boundaries.any(|id| failed.iter().any(|check| check.check == id)) {
        store::remove(&video_folder.join(BOUNDARIES_FILE))?;
    }
    Ok(())
}

/// Makes way for a sequence folder of this name. Existing content is removed if only this stage has written into it,
/// and set aside otherwise.
pub(crate) fn clear(
    video_folder: &Path,
    name: &str,
    progress: &dyn Progress,
) -> Result<(), CurateError> {
    let folder = video_folder.join(name);
    if !folder.exists() {
        return Ok(());
    }
    let Some(foreign) = foreign_entry(&folder)? else {
        return Ok(store::remove(&folder)?);
    };
    let aside = video_folder.join(SUPERSEDED_FOLDER);
    store::create_folder(&aside)?;
    let target = (1_u32..)
        .map(|number| aside.join(format!("{name}-{number}")))
        .find(|target| !target.exists())
        .unwrap_or_else(|| aside.join(name));
    store::rename(&folder, &target).map_err(|error| StoreError::write(&target, error))?;
    progress.note(&format!(
        "{}: its frames are no longer these; set aside with what was made from them ({foreign}) \
         as {}",
        folder.display(),
        target.display()
    ));
    Ok(())
}

/// Returns the first entry of a sequence folder that another stage or the user has created.
fn foreign_entry(folder: &Path) -> Result<Option<String>, CurateError> {
    for name in store::names_in(folder)? {
        let is_ours = match name.as_str() {
            SEQUENCE_FILE => true,
            FRAMES_FOLDER | MOTION_FOLDER => all_are_ours(folder, &name)?,
            ".done" => store::names_in(&folder.join(".done"))?
                .iter()
                .all(|record| *record == format!("{STAGE}.json")),
            _ => name.starts_with(".tmp-"),
        };
        if !is_ours {
            return Ok(Some(name));
        }
    }
    Ok(None)
}

/// Returns true if the frames in a sequence's folder of this name are as this stage wrote them, and nothing lies beside
/// them.
fn all_are_ours(folder: &Path, frames_folder: &str) -> Result<bool, CurateError> {
    let own = StagePlan::new(folder, STAGE).own_files();
    for name in store::names_in(&folder.join(frames_folder))? {
        if !matches!(
            own.standing(&format!("{frames_folder}/{name}")),
            Ok(NameState::Ours)
        ) {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Names of the sequence folders in a video's folder, in order.
pub(crate) fn sequence_folders(folder: &Path) -> Result<Vec<String>, CurateError> {
    let mut numbered: Vec<(usize, String)> = store::names_in(folder)?
        .into_iter()
        .filter_map(|name| {
            let number = name.strip_prefix("seq-")?.parse().ok()?;
            (sequence_name(number) == name).then_some((number, name))
        })
        .collect();
    numbered.sort();
    Ok(numbered.into_iter().map(|(_, name)| name).collect())
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

    use std::fs;

    use super::*;

    #[test]
    fn folders_are_in_order_beyond_a_thousand() {
        let temp = tempfile::tempdir().unwrap();
        for name in [
            "seq-1000", "seq-999", "seq-000", "seq-0001", "seq-x", "frames",
        ] {
            fs::create_dir(temp.path().join(name)).unwrap();
        }
        assert_eq!(
            sequence_folders(temp.path()).unwrap(),
            ["seq-000", "seq-999", "seq-1000"]
        );
    }

    #[test]
    fn what_others_made_is_foreign() {
        let temp = tempfile::tempdir().unwrap();
        let path = |name: &str| temp.path().join(name);
        fs::create_dir_all(path(".done")).unwrap();
        fs::create_dir_all(path(FRAMES_FOLDER)).unwrap();
        for file in [SEQUENCE_FILE, ".done/frames.json", ".tmp-1-scene.json"] {
            fs::write(path(file), "").unwrap();
        }
        assert_eq!(foreign_entry(temp.path()).unwrap(), None);
        fs::write(path(".done/poses.json"), "").unwrap();
        assert_eq!(
            foreign_entry(temp.path()).unwrap().as_deref(),
            Some(".done")
        );
        fs::remove_file(path(".done/poses.json")).unwrap();
        fs::write(path("frames/notes.txt"), "").unwrap();
        assert_eq!(
            foreign_entry(temp.path()).unwrap().as_deref(),
            Some("frames")
        );
        fs::remove_file(path("frames/notes.txt")).unwrap();
        fs::write(path("notes.txt"), "").unwrap();
        assert_eq!(
            foreign_entry(temp.path()).unwrap().as_deref(),
            Some("notes.txt")
        );
    }
}
