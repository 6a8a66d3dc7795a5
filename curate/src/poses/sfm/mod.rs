//! Structure from motion: COLMAP's equirectangular camera, driven by one small Python script.
//!
//! The script (`erp_sfm.py`, part of this binary) only calls COLMAP and leaves a text model; all
//! else is done here. Configurations of [`LADDER`] are tried in order until one is valid; each runs
//! in its own process and is recorded in `sfm/attempts.json`.

mod installation;
mod workshop;

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    Blame, Blamed, Pose,
    progress::Progress,
    records::{PoseSource, Scale, Sequence, SfmAttempt, SfmReport, ValidationStatus},
    store,
};
use serde::{Deserialize, Serialize};

pub use installation::{PYTHON_VARIABLE, SfmInstallation, installation};
use workshop::Workshop;

use super::{
    PosedSequence,
    colmap::ColmapModel,
    given::frame_names,
    level, masks,
    validate::{ValidationLimits, validate},
};
use crate::error::CurateError;

/// Folder of everything structure from motion leaves, relative to the sequence.
pub const SFM_FOLDER: &str = "sfm";
/// File of the record of all attempts, relative to [`SFM_FOLDER`].
pub const ATTEMPTS_FILE: &str = "attempts.json";

/// What goes wrong with structure from motion.
#[derive(Debug, thiserror::Error)]
pub enum SfmError {
    /// There is no interpreter with pycolmap.
    #[error("structure from motion is not installed; run scripts/setup --sfm ({reason})")]
    NotInstalled {
        /// What was looked for, and what was found.
        reason: String,
    },
    /// No attempt registered two frames.
    #[error("{sequence}: structure from motion found no poses: {reason}")]
    NoPoses {
        /// Id of the sequence.
        sequence: String,
        /// The failures of all attempts.
        reason: String,
    },
    /// The interpreter could not be run.
    #[error("{}: cannot be run: {source}", python.display())]
    Run {
        /// The interpreter.
        python: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
}

impl Blamed for SfmError {
    fn blame(&self) -> Blame {
        match self {
            Self::NotInstalled { .. } | Self::Run { .. } => Blame::Ours,
            Self::NoPoses { .. } => Blame::Input,
        }
    }
}

/// How structure from motion is done. Part of the stage's inputs.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SfmSettings {
    /// Folder of mask images named after the frames; white pixels give no features.
    pub masks: Option<PathBuf>,
    /// Threads; one per core where none are given.
    pub threads: Option<usize>,
    /// Seed of COLMAP's random numbers.
    pub seed: u32,
    /// What valid poses keep to.
    pub limits: ValidationLimits,
}

/// One way of running COLMAP.
#[derive(Debug, Clone, Copy)]
pub struct Configuration {
    /// Unique id, recorded with the attempt.
    pub id: &'static str,
    /// What it does and when it helps.
    pub summary: &'static str,
    mapper: &'static str,
    features: u32,
    overlap: u32,
}

/// Configurations in the order in which they are tried. On rendered scenes with known poses both
/// are accurate to a few hundredths of a degree; they fail on different footage.
pub static LADDER: &[Configuration] = &[
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

/// Poses a sequence by structure from motion.
pub(crate) fn run(
    sequence_folder: &Path,
    sequence: &Sequence,
    settings: &SfmSettings,
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

/// The same with a given interpreter.
fn run_with(
    installation: &SfmInstallation,
    sequence_folder: &Path,
    sequence: &Sequence,
    settings: &SfmSettings,
    progress: &dyn Progress,
) -> Result<PosedSequence, CurateError> {
    let workshop = Workshop::new(sequence_folder, sequence, settings, installation)?;
    let mut attempts = Vec::new();
    let mut best: Option<(usize, ColmapModel)> = None;
    for configuration in LADDER {
        let label = format!("structure from motion: {}", configuration.id);
        progress.begin(&label, None);
        let outcome = workshop.attempt(configuration, progress);
        progress.end();
        let (attempt, model) = outcome?;
        progress.note(&format!("{}: {}", sequence.id, describe(&attempt)));
        let index = attempts.len();
        attempts.push(attempt);
        if let Some(model) = model {
            let is_better = best
                .as_ref()
                .is_none_or(|(other, _)| rank(&attempts[index]) > rank(&attempts[*other]));
            if is_better {
                best = Some((index, model));
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
    store::write_record(&workshop.folder.join(ATTEMPTS_FILE), &report)?;
    let Some((index, model)) = best else {
        return Err(no_poses(sequence, &report).into());
    };
    workshop.publish(&report.attempts[index].configuration)?;
    posed(sequence, settings, installation, &report, index, model)
}

fn no_poses(sequence: &Sequence, report: &SfmReport) -> SfmError {
    let reasons: Vec<String> = report.attempts.iter().map(describe).collect();
    SfmError::NoPoses {
        sequence: sequence.id.clone(),
        reason: reasons.join("; "),
    }
}

/// The chosen model, levelled, as poses of the sequence's frames.
fn posed(
    sequence: &Sequence,
    settings: &SfmSettings,
    installation: &SfmInstallation,
    report: &SfmReport,
    index: usize,
    mut model: ColmapModel,
) -> Result<PosedSequence, CurateError> {
    let names = frame_names(sequence);
    let mut validation = validate(&model, &names, &settings.limits);
    let levelling = level::level(&mut model);
    validation
        .measures
        .insert("up_agreement".to_owned(), levelling.agreement);
    if !levelling.levelled {
        validation.status = ValidationStatus::Unstable;
        validation.problems.push(format!(
            "the cameras agree on no up (agreement {:.2}); the world is not levelled",
            levelling.agreement
        ));
    }
    let poses: Vec<Option<Pose>> = names
        .iter()
        .map(|name| {
            let image = model.images.values().find(|image| image.name == *name)?;
            Some(image.pose())
        })
        .collect();
    let masks = match &settings.masks {
        Some(folder) => masks::find(folder, sequence)?,
        None => vec![None; names.len()],
    };
    let attempt = &report.attempts[index];
    Ok(PosedSequence {
        poses,
        masks,
        points: Some(model.cloud()),
        scale: Scale::Arbitrary,
        source: PoseSource::Sfm {
            tool: format!("pycolmap {}", installation.version),
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

/// Valid before unstable, then more frames, then fewer missed limits.
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
