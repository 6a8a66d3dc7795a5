//! Structure from motion: COLMAP's equirectangular camera, driven by one small Python script.
//!
//! The script (`erp_sfm.py`, part of this binary) only calls COLMAP and leaves a text model; all
//! else is done here. Configurations of [`LADDER`] are tried in order until one is valid; each runs
//! in its own process and is recorded in `sfm/attempts.json`.

use std::{
    fs,
    io::{BufRead, BufReader, Read},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    time::Instant,
};

use omnilife_schemas::{
    Blame, Blamed, Pose,
    progress::Progress,
    records::{PoseSource, Scale, Sequence, SfmAttempt, SfmReport, ValidationStatus},
    store,
};
use serde::{Deserialize, Serialize};

use super::{
    PosedSequence,
    colmap::ColmapModel,
    given::frame_names,
    level, masks,
    validate::{ValidationLimits, validate},
};
use crate::{error::CurateError, frames::FRAMES_FOLDER};

/// Names the Python interpreter that has pycolmap.
pub const PYTHON_VARIABLE: &str = "OMNILIFE_SFM_PYTHON";
/// Folder of everything structure from motion leaves, relative to the sequence.
pub const SFM_FOLDER: &str = "sfm";
/// File of the record of all attempts, relative to [`SFM_FOLDER`].
pub const ATTEMPTS_FILE: &str = "attempts.json";

const SCRIPT: &str = include_str!("erp_sfm.py");
/// First version whose EQUIRECTANGULAR camera works.
const LEAST_VERSION: (u32, u32) = (4, 1);

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
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
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

impl Default for SfmSettings {
    fn default() -> Self {
        Self {
            masks: None,
            threads: None,
            seed: 0,
            limits: ValidationLimits::default(),
        }
    }
}

/// An interpreter with pycolmap.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SfmInstallation {
    /// The interpreter.
    pub python: PathBuf,
    /// Version of pycolmap.
    pub version: String,
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

/// Looks for an interpreter with pycolmap: `$OMNILIFE_SFM_PYTHON`, else the virtual environment
/// that `scripts/setup --sfm` makes in the data folder.
///
/// # Errors
/// [`SfmError::NotInstalled`] that says what is missing.
pub fn installation() -> Result<SfmInstallation, SfmError> {
    let python = interpreter().ok_or_else(|| SfmError::NotInstalled {
        reason: "neither OMNILIFE_DATA, XDG_DATA_HOME nor HOME is set".to_owned(),
    })?;
    let not_installed = |reason: String| SfmError::NotInstalled { reason };
    let output = Command::new(&python)
        .args(["-c", "import pycolmap; print(pycolmap.__version__)"])
        .stdin(Stdio::null())
        .output()
        .map_err(|error| not_installed(format!("{}: {error}", python.display())))?;
    if !output.status.success() {
        return Err(not_installed(format!(
            "{} has no pycolmap",
            python.display()
        )));
    }
    let version = String::from_utf8_lossy(&output.stdout).trim().to_owned();
    let mut parts = version
        .split('.')
        .map_while(|part| part.parse::<u32>().ok());
    let found = (parts.next().unwrap_or(0), parts.next().unwrap_or(0));
    if found < LEAST_VERSION {
        return Err(not_installed(format!(
            "{} has pycolmap {version}, {}.{} or newer is needed",
            python.display(),
            LEAST_VERSION.0,
            LEAST_VERSION.1
        )));
    }
    Ok(SfmInstallation { python, version })
}

fn interpreter() -> Option<PathBuf> {
    let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty());
    if let Some(python) = set(PYTHON_VARIABLE) {
        return Some(PathBuf::from(python));
    }
    let data = set("OMNILIFE_DATA")
        .map(PathBuf::from)
        .or_else(|| set("XDG_DATA_HOME").map(|data| PathBuf::from(data).join("omnilife")))
        .or_else(|| set("HOME").map(|home| PathBuf::from(home).join(".local/share/omnilife")))?;
    Some(data.join("sfm/bin/python"))
}

/// Poses a sequence by structure from motion.
pub(crate) fn run(
    sequence_folder: &Path,
    sequence: &Sequence,
    settings: &SfmSettings,
    progress: &dyn Progress,
) -> Result<PosedSequence, CurateError> {
    let installation = installation()?;
    let workshop = Workshop::new(sequence_folder, sequence, settings, &installation)?;
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
    posed(sequence, settings, &installation, &report, index, model)
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

/// The folder in which attempts are made.
struct Workshop<'a> {
    frames: PathBuf,
    folder: PathBuf,
    /// Hidden; removed at the end with all databases and models in it.
    scratch: PathBuf,
    masks: Option<PathBuf>,
    script: PathBuf,
    sequence: &'a Sequence,
    settings: &'a SfmSettings,
    installation: &'a SfmInstallation,
}

impl<'a> Workshop<'a> {
    fn new(
        sequence_folder: &Path,
        sequence: &'a Sequence,
        settings: &'a SfmSettings,
        installation: &'a SfmInstallation,
    ) -> Result<Self, CurateError> {
        // COLMAP and its interpreter are run from anywhere.
        let sequence_folder = fs::canonicalize(sequence_folder)
            .map_err(|error| store::StoreError::read(sequence_folder, error))?;
        let folder = sequence_folder.join(SFM_FOLDER);
        let scratch = store::temporary_beside(&folder.join("work"));
        store::create_folder(&scratch)?;
        let mut workshop = Self {
            frames: sequence_folder.join(FRAMES_FOLDER),
            script: scratch.join("erp_sfm.py"),
            masks: None,
            folder,
            scratch,
            sequence,
            settings,
            installation,
        };
        store::write_bytes(&workshop.script, SCRIPT.as_bytes())?;
        if let Some(given) = &settings.masks {
            let found = masks::find(given, sequence)?;
            let masks = workshop.scratch.join("masks");
            masks::write_for_colmap(&masks, &found, sequence)?;
            workshop.masks = Some(masks);
        }
        Ok(workshop)
    }

    /// Runs one configuration in its own process and looks at the model it leaves.
    fn attempt(
        &self,
        configuration: &Configuration,
        progress: &dyn Progress,
    ) -> Result<(SfmAttempt, Option<ColmapModel>), CurateError> {
        let started = Instant::now();
        let out = self.scratch.join(configuration.id);
        store::create_folder(&out)?;
        let conversation = self.converse(configuration, &out, progress)?;
        let sparse = out.join("sparse");
        let (model, failure) = match conversation.failure {
            Some(failure) => (None, Some(failure)),
            None => match ColmapModel::read(&sparse) {
                Ok(model) if model.images.len() >= 2 => (Some(model), None),
                Ok(_) => (
                    None,
                    Some("fewer than two frames were registered".to_owned()),
                ),
                Err(error) => (None, Some(error.to_string())),
            },
        };
        let names = frame_names(self.sequence);
        let attempt = SfmAttempt {
            configuration: configuration.id.to_owned(),
            wall_seconds: started.elapsed().as_secs_f64(),
            models: conversation.models,
            validation: model
                .as_ref()
                .map(|model| validate(model, &names, &self.settings.limits)),
            failure,
        };
        Ok((attempt, model))
    }

    /// Runs the script and follows what it says.
    fn converse(
        &self,
        configuration: &Configuration,
        out: &Path,
        progress: &dyn Progress,
    ) -> Result<Conversation, CurateError> {
        let log_path = self.folder.join(format!("{}.log", configuration.id));
        let log = fs::File::create(&log_path)
            .map_err(|error| store::StoreError::write(&log_path, error))?;
        let python = &self.installation.python;
        let cannot_run = |source| SfmError::Run {
            python: python.clone(),
            source,
        };
        let mut running = Running(
            self.command(configuration, out)
                .stdout(Stdio::piped())
                .stderr(log)
                .spawn()
                .map_err(cannot_run)?,
        );
        let mut conversation = Conversation::default();
        if let Some(stdout) = running.0.stdout.take() {
            for line in BufReader::new(stdout).lines().map_while(Result::ok) {
                match line.split_once(' ') {
                    Some(("begin", stage)) => progress.remark(stage),
                    Some(("models", count)) => conversation.models = count.parse().unwrap_or(0),
                    Some(("failed", reason)) => conversation.failure = Some(reason.to_owned()),
                    // COLMAP's own chatter.
                    _ => {}
                }
            }
        }
        let status = running.0.wait().map_err(cannot_run)?;
        if !status.success() && conversation.failure.is_none() {
            conversation.failure = Some(format!(
                "COLMAP ended with {status}{}",
                last_line(&log_path)
            ));
        }
        Ok(conversation)
    }

    fn command(&self, configuration: &Configuration, out: &Path) -> Command {
        let threads = self.settings.threads.unwrap_or_else(|| {
            std::thread::available_parallelism().map_or(1, std::num::NonZero::get)
        });
        let mut command = Command::new(&self.installation.python);
        command
            .arg(&self.script)
            .args(["--frames".as_ref(), self.frames.as_os_str()])
            .args(["--out".as_ref(), out.as_os_str()])
            .args(["--mapper", configuration.mapper])
            .args(["--features", &configuration.features.to_string()])
            .args(["--overlap", &configuration.overlap.to_string()])
            .args(["--threads", &threads.to_string()])
            .args(["--seed", &self.settings.seed.to_string()])
            .stdin(Stdio::null());
        if let Some(masks) = &self.masks {
            command.args(["--masks".as_ref(), masks.as_os_str()]);
        }
        command
    }

    /// Keeps the text model of the chosen attempt as `sfm/sparse`.
    fn publish(&self, configuration: &str) -> Result<(), CurateError> {
        let target = self.folder.join("sparse");
        let failed = |error| store::StoreError::write(&target, error);
        if target.exists() {
            fs::remove_dir_all(&target).map_err(failed)?;
        }
        fs::rename(self.scratch.join(configuration).join("sparse"), &target).map_err(failed)?;
        Ok(())
    }
}

impl Drop for Workshop<'_> {
    fn drop(&mut self) {
        // Nothing depends on it any more; what cannot be removed is hidden and harmless.
        drop(fs::remove_dir_all(&self.scratch));
    }
}

/// What the script said.
#[derive(Default)]
struct Conversation {
    models: u32,
    failure: Option<String>,
}

/// A child process that does not outlive its handle.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        // Both fail harmlessly when it has ended already.
        drop(self.0.kill());
        drop(self.0.wait());
    }
}

/// The last line of a log that is not empty, in parentheses; nothing where there is none.
fn last_line(path: &Path) -> String {
    let mut bytes = Vec::new();
    if fs::File::open(path)
        .and_then(|mut file| file.read_to_end(&mut bytes))
        .is_err()
    {
        return String::new();
    }
    String::from_utf8_lossy(&bytes)
        .lines()
        .rev()
        .map(str::trim)
        .find(|line| !line.is_empty())
        .map_or(String::new(), |line| format!(" ({line})"))
}
