//! Structure from motion by COLMAP, driven by one small Python script.
//!
//! The script (`sfm.py`, part of this binary) only calls COLMAP and leaves a text model; the rest is done here.
//! Configurations of [`FALLBACK_CONFIGURATIONS`] are tried in order until one is valid; each runs in its own process
//! and is recorded in `sfm/attempts.json`.

mod installation;
mod workspace;

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    Pose,
    camera::Camera,
    layout::{ATTEMPTS_FILE, SFM_FOLDER},
    progress::Progress,
    records::{
        PoseSource, PoseValidation, Scale, Sequence, SfmAttempt, SfmReport, ValidationStatus,
    },
    stage::StagePlan,
    store,
};
use serde::{Deserialize, Serialize};

pub use installation::{PYTHON_VARIABLE, SfmInstallation, installation};
use workspace::{Attempted, SfmWorkspace};

use super::{
    PosedSequence,
    colmap::ColmapModel,
    error::SfmError,
    frame_list::FrameList,
    given::{camera_of_frames, frame_names},
    ignored::IgnoredPixels,
    level::{self, Levelling},
    masks, parallax,
    validate::ValidationLimits,
};
use crate::error::CurateError;

/// Measure of the fit by rotations of the camera alone ([`parallax`]).
pub(super) const TURNS_MEASURE: &str = "turns_alone_pixels";
pub(super) const TURNS_FOCAL_MEASURE: &str = "turns_alone_focal_pixels";

/// Name of the program in records, before its version.
pub(super) const TOOL: &str = "pycolmap";

/// Settings of structure from motion.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SfmSettings {
    /// Folder of mask images named after the frames; white pixels give no features.
    pub masks: Option<PathBuf>,
    /// Threads; one per core if `None`.
    pub threads: Option<usize>,
    /// Seed of COLMAP's random numbers.
    pub seed: u32,
    /// Limits of valid poses.
    pub limits: ValidationLimits,
}

/// A configuration of COLMAP.
#[derive(Debug, Clone, Copy)]
pub struct Configuration {
    /// Unique id, recorded with the attempt.
    pub id: &'static str,
    /// Its effect and its use.
    pub summary: &'static str,
    mapper: &'static str,
    features: u32,
    overlap: u32,
}

/// Configurations in the order in which they are tried. On rendered scenes with known poses both
/// are accurate to a few hundredths of a degree; they fail on different footage.
pub static FALLBACK_CONFIGURATIONS: &[Configuration] = &[
    Configuration {
        id: "global",
        summary: "Global mapping: all rotations, then all positions, at once.",
        mapper: "global",
        features: 8192,
        overlap: 10,
    },
    Configuration {
        id: "incremental",
        summary: "Incremental mapping that may start on forward motion, with more features.",
        mapper: "incremental",
        features: 12288,
        overlap: 15,
    },
];

/// Adds everything that the poses depend on to a stage's inputs. Threads are left out: they affect only the speed.
pub(super) fn add_inputs(
    plan: StagePlan,
    settings: &SfmSettings,
    version: &str,
) -> Result<StagePlan, CurateError> {
    let mut plan = plan
        .with_settings("seed", &settings.seed)
        .with_settings("limits", &settings.limits)
        .with_text("configurations", &format!("{FALLBACK_CONFIGURATIONS:?}"))
        .with_text("script", workspace::SCRIPT)
        .with_text(TOOL, version);
    if let Some(folder) = &settings.masks {
        for file in masks::files(folder)? {
            // A mask belongs to the frame whose name it has.
            let name = file.file_name().unwrap_or_default().to_string_lossy();
            plan = plan.with_text("mask name", &name).with_file(&file)?;
        }
    }
    Ok(plan)
}

/// Poses a sequence by structure from motion; pixels outside the scene give no features.
pub(super) fn run(
    sequence_folder: &Path,
    sequence: &Sequence,
    settings: (&SfmSettings, &IgnoredPixels),
    progress: &dyn Progress,
) -> Result<PosedSequence, CurateError> {
    run_with(
        &installation()?,
        sequence_folder,
        sequence,
        settings,
        progress,
    )
}

/// Poses a sequence as [`run`], with a given interpreter.
fn run_with(
    installation: &SfmInstallation,
    sequence_folder: &Path,
    sequence: &Sequence,
    (settings, ignored): (&SfmSettings, &IgnoredPixels),
    progress: &dyn Progress,
) -> Result<PosedSequence, CurateError> {
    let settings_and_masks = (settings, ignored);
    let workspace = SfmWorkspace::new(sequence_folder, sequence, settings_and_masks, installation)?;
    let mut attempts = Vec::new();
    let mut best: Option<(usize, (ColmapModel, PoseValidation))> = None;
    let mut any_broken = false;
    for configuration in FALLBACK_CONFIGURATIONS {
        let label = format!("structure from motion: {}", configuration.id);
        progress.begin(&label, None);
        let outcome = workspace.attempt(configuration, progress);
        progress.end();
        let Attempted {
            attempt,
            found,
            is_broken,
        } = outcome?;
        any_broken |= is_broken;
        progress.note(&format!("{}: {}", sequence.id, describe(&attempt)));
        let index = attempts.len();
        attempts.push(attempt);
        if let Some(found) = found {
            let is_better = best
                .as_ref()
                .is_none_or(|(other, _)| rank(&attempts[index]) > rank(&attempts[*other]));
            if is_better {
                best = Some((index, found));
            }
        }
        if is_valid(&attempts[index]) {
            break;
        }
    }
    let report = SfmReport {
        attempts,
        chosen: best.as_ref().map(|(index, _)| *index),
    };
    store::write_record(&workspace.folder.join(ATTEMPTS_FILE), &report)?;
    let Some((index, found)) = best else {
        return Err(no_poses(sequence, &report, any_broken).into());
    };
    workspace.publish(&report.attempts[index].configuration, progress)?;
    posed(
        sequence_folder,
        sequence,
        settings,
        installation,
        &report,
        index,
        found,
    )
}

fn no_poses(sequence: &Sequence, report: &SfmReport, any_broken: bool) -> SfmError {
    let reasons: Vec<String> = report.attempts.iter().map(describe).collect();
    let (sequence, reason) = (sequence.id.clone(), reasons.join("; "));
    if any_broken {
        SfmError::Broken { sequence, reason }
    } else {
        SfmError::NoPoses { sequence, reason }
    }
}

/// Returns the chosen model, levelled, as poses of the sequence's frames.
fn posed(
    sequence_folder: &Path,
    sequence: &Sequence,
    settings: &SfmSettings,
    installation: &SfmInstallation,
    report: &SfmReport,
    index: usize,
    (mut model, mut validation): (ColmapModel, PoseValidation),
) -> Result<PosedSequence, CurateError> {
    let names = frame_names(&sequence.frames.entries);
    let attempt = &report.attempts[index];
    let camera = camera_of_frames(
        &sequence_folder.join(SFM_FOLDER),
        Some(model.camera.camera()),
        &FrameList::of_sequence(sequence),
    )?;
    if let Camera::Pinhole(camera) = camera {
        let shift = model
            .camera
            .lens()
            .map_or(0.0, |lens| lens.largest_shift_pixels());
        let measures = [
            ("focal_length_pixels", camera.fx),
            ("distortion_pixels", shift),
        ];
        let turns = parallax::turns_alone(&model, &names).into_iter();
        let turns = turns.flat_map(|turns| {
            [
                (TURNS_MEASURE, turns.pixels),
                (TURNS_FOCAL_MEASURE, turns.focal),
            ]
        });
        let measures = measures.into_iter().chain(turns);
        let measures = measures.filter(|(_, value)| value.is_finite());
        (validation.measures).extend(measures.map(|(name, value)| (name.to_owned(), value)));
    }
    match level::level(&mut model) {
        Levelling::ByGround { share } => {
            validation.measures.insert("ground_share".to_owned(), share);
        }
        Levelling::ByCameras { agreement } => {
            validation
                .measures
                .insert("up_agreement".to_owned(), agreement);
        }
        Levelling::None { agreement } => {
            validation
                .measures
                .insert("up_agreement".to_owned(), agreement);
            validation.status = ValidationStatus::Unstable;
            validation.problems.push(format!(
                "the cameras agree on no up (agreement {agreement:.2}); the world is not levelled"
            ));
        }
    }
    let poses: Vec<Option<Pose>> = names
        .iter()
        .map(|name| {
            let image = model.images.values().find(|image| image.name == *name)?;
            Some(image.pose())
        })
        .collect();
    let masks = match &settings.masks {
        Some(folder) => masks::find(folder, &sequence.frames.entries)?
            .into_iter()
            .map(Some)
            .collect(),
        None => vec![None; names.len()],
    };
    Ok(PosedSequence {
        camera: model.camera.resized(camera.width(), camera.height()),
        poses,
        masks,
        points: Some(model.cloud()),
        scale: Scale::Arbitrary,
        source: PoseSource::Sfm {
            tool: format!("{TOOL} {}", installation.version),
            configuration: attempt.configuration.clone(),
            wall_seconds: report
                .attempts
                .iter()
                .map(|attempt| attempt.wall_seconds)
                .sum::<f64>()
                .ceil() as u64,
        },
        validation,
    })
}

fn is_valid(attempt: &SfmAttempt) -> bool {
    attempt
        .validation
        .as_ref()
        .is_some_and(|validation| validation.status == ValidationStatus::Valid)
}

/// Ranks valid before unstable, then more frames, then fewer missed limits.
fn rank(attempt: &SfmAttempt) -> (bool, u32, std::cmp::Reverse<usize>) {
    let (frames, problems) = attempt
        .validation
        .as_ref()
        .map_or((0, usize::MAX), |validation| {
            (validation.registered_frames, validation.problems.len())
        });
    (is_valid(attempt), frames, std::cmp::Reverse(problems))
}

fn describe(attempt: &SfmAttempt) -> String {
    match (&attempt.validation, &attempt.failure) {
        (Some(validation), _) => format!(
            "{}: {} of {} frames in {:.0} s, {}",
            attempt.configuration,
            validation.registered_frames,
            validation.total_frames,
            attempt.wall_seconds,
            if is_valid(attempt) {
                "valid"
            } else {
                "unstable"
            }
        ),
        (None, failure) => format!(
            "{}: {}",
            attempt.configuration,
            failure.as_deref().unwrap_or("no model")
        ),
    }
}

#[cfg(all(test, unix))]
mod tests;
