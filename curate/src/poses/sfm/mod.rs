//! Structure from motion by COLMAP, driven by one small Python script.
//!
//! The script (`program/sfm.py`, part of this binary) only calls COLMAP and leaves a text model; the rest is done here.
//! Configurations of [`FALLBACK_CONFIGURATIONS`] are tried in order until one is valid, or one of every [`Road`] for a
//! comparison; each runs in its own process and is recorded in `sfm/attempts.json`.

mod advice;
mod configurations;
mod held_out;
mod installation;
mod workspace;

use std::{
    cmp::{Ordering, Reverse},
    path::{Path, PathBuf},
};

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

use advice::{Circumstances, advice};
use configurations::configurations;
pub use configurations::{Configuration, FALLBACK_CONFIGURATIONS, Road};
use held_out::HeldOutTracks;
pub use installation::{PYTHON_VARIABLE, SfmInstallation, installation};
use workspace::{AttemptResult, SfmWorkspace};

use super::{
    PosedSequence,
    colmap::ColmapModel,
    frame_list::FrameList,
    given::{camera_of_frames, frame_names},
    ignored::IgnoredPixels,
    level::{self, Levelling},
    masks, parallax,
    validate::ValidationLimits,
};
use crate::error::{CurateError, SfmError};

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
    /// Road from panoramas to poses.
    #[serde(default)]
    pub road: Road,
    /// Runs one configuration of every road and takes the best poses.
    #[serde(default)]
    pub compare: bool,
}

/// Adds everything that the poses depend on to a stage's inputs. Threads are left out: they affect only the speed.
pub(super) fn add_inputs(
    plan: StagePlan,
    settings: &SfmSettings,
    version: &str,
) -> Result<StagePlan, CurateError> {
    let mut plan = plan
        .with_settings("seed", &settings.seed)
        .with_settings("limits", &settings.limits)
        .with_settings("road", &settings.road)
        .with_settings("comparison", &settings.compare)
        .with_text("configurations", &format!("{FALLBACK_CONFIGURATIONS:?}"))
        .with_text(TOOL, version);
    for (name, text) in workspace::PROGRAM {
        plan = plan.with_text(name, text);
    }
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
    let (mut attempts, mut models) = (Vec::new(), Vec::new());
    let mut tracks = HeldOutTracks::default();
    let mut any_broken = false;
    for configuration in configurations(sequence_folder, sequence, settings)? {
        let label = format!("structure from motion: {}", configuration.id);
        progress.begin(&label, None);
        let outcome = workspace.attempt(configuration, progress);
        progress.end();
        let AttemptResult {
            attempt,
            found,
            held_out,
            is_broken,
        } = outcome?;
        any_broken |= is_broken;
        tracks.extend(&held_out);
        progress.note(&format!("{}: {}", sequence.id, describe(&attempt)));
        let ends = is_valid(&attempt) && !settings.compare;
        attempts.push(attempt);
        models.push(found);
        if ends {
            break;
        }
    }
    // All roads are judged by the matches of all.
    for (attempt, found) in attempts.iter_mut().zip(&models) {
        attempt.held_out = found.as_ref().and_then(|(model, _)| tracks.score(model));
    }
    let chosen = best_of(&attempts, &models);
    let width = f64::from(sequence.frames.width);
    let circumstances = Circumstances {
        parallax_degrees: tracks.parallax_degrees(),
        pixel_degrees: (!sequence.is_pinhole()).then(|| 360.0 / width),
        is_broken: any_broken,
        has_masks: settings.masks.is_some(),
        has_ignored: !ignored.is_empty(),
    };
    let report = SfmReport {
        advice: advice(&attempts, chosen, &settings.limits, circumstances),
        attempts,
        chosen,
    };
    store::write_record(&workspace.folder.join(ATTEMPTS_FILE), &report)?;
    for sentence in &report.advice {
        progress.note(&format!("{}: poses: {sentence}", sequence.id));
    }
    let found = chosen.and_then(|index| Some((index, models.get_mut(index)?.take()?)));
    let Some((index, found)) = found else {
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

/// Returns the index of the attempt with the best poses; the earlier one of equals.
fn best_of<T>(attempts: &[SfmAttempt], models: &[Option<T>]) -> Option<usize> {
    let usable = (0..attempts.len()).filter(|&index| models[index].is_some());
    // The last of equal maxima is taken, so the search begins at the end.
    usable
        .rev()
        .max_by(|&a, &b| compare(&attempts[a], &attempts[b]))
}

fn no_poses(sequence: &Sequence, report: &SfmReport, any_broken: bool) -> SfmError {
    let reasons: Vec<String> = (report.attempts.iter().map(describe))
        .chain(report.advice.iter().cloned())
        .collect();
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
    if let Some(held_out) = attempt.held_out {
        let measures = &mut validation.measures;
        measures.insert("held_out_score".to_owned(), held_out.score);
        if let Some(degrees) = held_out.median_degrees {
            measures.insert("held_out_median_degrees".to_owned(), degrees);
        }
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

/// Ranks valid before unstable, then by held-out tracks, then more frames, then fewer missed limits.
fn compare(a: &SfmAttempt, b: &SfmAttempt) -> Ordering {
    let score = |attempt: &SfmAttempt| attempt.held_out.map_or(0.0, |held_out| held_out.score);
    let counts = |attempt: &SfmAttempt| {
        let validation = attempt.validation.as_ref();
        validation.map_or((0, Reverse(usize::MAX)), |validation| {
            let problems = validation.problems.len();
            (validation.registered_frames, Reverse(problems))
        })
    };
    (is_valid(a).cmp(&is_valid(b)))
        .then(score(a).total_cmp(&score(b)))
        .then(counts(a).cmp(&counts(b)))
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
