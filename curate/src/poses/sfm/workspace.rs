//! One attempt at structure from motion: a process of its own, and its results.

use std::{
    fs,
    io::{BufRead, BufReader},
    path::{Path, PathBuf},
    process::{Command, Stdio},
    time::Instant,
};

use omnilife_schemas::{
    child::{self, GRACE, ProcessGroup},
    layout::{FRAMES_FOLDER, SFM_FOLDER},
    plain_text::without_folders,
    process,
    progress::Progress,
    records::{PoseValidation, Sequence, SfmAttempt},
    stage::StagePlan,
    store::{self, Unfinished},
};

use super::{Configuration, HeldOutTracks, SfmInstallation, SfmSettings};
use crate::{
    error::{CurateError, SfmError},
    poses::{
        colmap::ColmapModel, given::frame_names, ignored::IgnoredPixels, masks, validate::validate,
    },
};

/// The script and its modules, by the names of their files.
pub(super) const PROGRAM: [(&str, &str); 4] = [
    (SCRIPT, include_str!("program/sfm.py")),
    ("faces.py", include_str!("program/faces.py")),
    ("held_out.py", include_str!("program/held_out.py")),
    ("loops.py", include_str!("program/loops.py")),
];
const SCRIPT: &str = "sfm.py";

/// Tracks that the mapper of their own road did not see.
const HELD_OUT_FILE: &str = "held_out.txt";

/// Folder of a text model.
const MODEL_FOLDER: &str = "sparse";

/// Exit code of the script for frames without a model.
const FAILED_EXIT_CODE: i32 = 4;

/// Working folder of attempts.
pub(super) struct SfmWorkspace<'a> {
    frames: PathBuf,
    pub(super) folder: PathBuf,
    /// Hidden; removed at the end with all databases and models in it.
    scratch: Unfinished,
    masks: Option<PathBuf>,
    script: PathBuf,
    sequence: &'a Sequence,
    settings: &'a SfmSettings,
    installation: &'a SfmInstallation,
}

impl<'a> SfmWorkspace<'a> {
    pub(super) fn new(
        sequence_folder: &Path,
        sequence: &'a Sequence,
        (settings, ignored): (&'a SfmSettings, &IgnoredPixels),
        installation: &'a SfmInstallation,
    ) -> Result<Self, CurateError> {
        // COLMAP and its interpreter may run in another directory.
        let sequence_folder = fs::canonicalize(sequence_folder)
            .map_err(|error| store::StoreError::read(sequence_folder, error))?;
        let folder = sequence_folder.join(SFM_FOLDER);
        store::remove_abandoned(&folder)?;
        let scratch = Unfinished::folder_beside(&folder.join("work"))?;
        let mut workspace = Self {
            frames: sequence_folder.join(FRAMES_FOLDER),
            script: scratch.path().join(SCRIPT),
            masks: None,
            folder,
            scratch,
            sequence,
            settings,
            installation,
        };
        for (name, text) in PROGRAM {
            store::write_bytes(&workspace.scratch.path().join(name), text.as_bytes())?;
        }
        let moving = settings.masks.as_ref();
        let moving = moving
            .map(|folder| masks::find(folder, &sequence.frames.entries))
            .transpose()?;
        let masks = workspace.scratch.path().join("masks");
        let has_masks = masks::write_for_colmap(&masks, moving.as_deref(), ignored, sequence)?;
        workspace.masks = has_masks.then_some(masks);
        Ok(workspace)
    }

    /// Runs one configuration in its own process and evaluates its model.
    pub(super) fn attempt(
        &self,
        configuration: &Configuration,
        progress: &dyn Progress,
    ) -> Result<AttemptResult, CurateError> {
        let started = Instant::now();
        let out = self.scratch.path().join(configuration.id);
        store::create_folder(&out)?;
        let Conversation {
            models,
            loops,
            cpu_seconds,
            ending,
        } = self.converse(configuration, &out, progress)?;
        let held_out = HeldOutTracks::read(&out.join(HELD_OUT_FILE))?;
        let model = match ending {
            AttemptEnd::Success => match ColmapModel::read(&out.join(MODEL_FOLDER)) {
                Ok(model) if model.images.len() >= 2 => Ok(model),
                Ok(_) => Err(AttemptEnd::Failed(
                    "fewer than two frames were registered".to_owned(),
                )),
                Err(error) => Err(AttemptEnd::Broken(error.without_folders())),
            },
            failure => Err(failure),
        };
        let is_broken = matches!(model, Err(AttemptEnd::Broken(_)));
        let failure = match &model {
            Err(AttemptEnd::Failed(reason) | AttemptEnd::Broken(reason)) => {
                Some(without_folders(reason))
            }
            _ => None,
        };
        let names = frame_names(&self.sequence.frames.entries);
        let found = model.ok().map(|model| {
            let validation = validate(&model, &names, &self.settings.limits);
            (model, validation)
        });
        let attempt = SfmAttempt {
            configuration: configuration.id.to_owned(),
            wall_seconds: started.elapsed().as_secs_f64(),
            cpu_seconds: Some(cpu_seconds),
            loops,
            models,
            held_out: None,
            validation: found.as_ref().map(|(_, validation)| validation.clone()),
            failure,
        };
        Ok(AttemptResult {
            attempt,
            found,
            held_out,
            is_broken,
        })
    }

    /// Runs the script and parses its output.
    fn converse(
        &self,
        configuration: &Configuration,
        out: &Path,
        progress: &dyn Progress,
    ) -> Result<Conversation, CurateError> {
        let log_path = self.folder.join(format!("{}.log", configuration.id));
        let log = child::new_log(&log_path)?;
        let python = &self.installation.python;
        let cannot_run = |source| SfmError::Run {
            python: python.clone(),
            source,
        };
        let mut command = self.command(configuration, out);
        command.stdout(Stdio::piped()).stderr(log);
        let mut group = ProcessGroup::spawn(&mut command, None).map_err(cannot_run)?;
        let mut models = 0;
        let mut loops = None;
        let mut failed = None;
        let mut misspoken = None;
        if let Some(stdout) = group.leader().stdout.take() {
            // COLMAP prints file names, which need not be UTF-8.
            for line in BufReader::new(stdout).split(b'\n') {
                let line = line.map_err(cannot_run)?;
                let line = String::from_utf8_lossy(&line);
                match line.trim_end().split_once(' ') {
                    Some(("begin", stage)) => progress.status(stage),
                    Some(("models", count)) => match count.parse() {
                        Ok(count) => models = count,
                        Err(_) => misspoken = Some(format!("the script said {line:?}")),
                    },
                    Some(("loops", count)) => match count.parse() {
                        Ok(count) => loops = Some(count),
                        Err(_) => misspoken = Some(format!("the script said {line:?}")),
                    },
                    Some(("failed", reason)) => failed = Some(reason.to_owned()),
                    // COLMAP's own chatter.
                    _ => {}
                }
            }
        }
        let ended = group.wait().map_err(cannot_run)?;
        let status = ended.status;
        for what in group.end(GRACE).lines() {
            progress.note(&format!("COLMAP left running: {what}"));
        }
        let ending = match (failed, misspoken) {
            (Some(reason), _) if status.code() == Some(FAILED_EXIT_CODE) => {
                AttemptEnd::Failed(reason)
            }
            (_, Some(line)) => AttemptEnd::Broken(line),
            _ if status.success() => AttemptEnd::Success,
            _ => {
                let said = process::last_line(&log_path);
                let said = said.map_or_else(String::new, |line| format!(" ({line})"));
                AttemptEnd::Broken(format!("COLMAP ended with {status}{said}"))
            }
        };
        Ok(Conversation {
            models,
            loops,
            cpu_seconds: ended.cpu_time.as_secs_f64(),
            ending,
        })
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
            .args(["--camera-model", camera_model(self.sequence)])
            .args(["--road", configuration.road.name()])
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
    pub(super) fn publish(
        &self,
        configuration: &str,
        progress: &dyn Progress,
    ) -> Result<(), CurateError> {
        let made = self.scratch.path().join(configuration);
        let names = store::names_in(&made.join(MODEL_FOLDER))?;
        let files: Vec<String> = names
            .iter()
            .map(|name| format!("{MODEL_FOLDER}/{name}"))
            .collect();
        let stage = StagePlan::new(&self.folder, MODEL_FOLDER);
        Ok(stage.run([""; 0], progress, |out| out.replace(&made, &files))?)
    }
}

/// Returns COLMAP's model of a sequence's camera. Perspective videos come without intrinsics: the focal length and one
/// term of distortion are found with the poses.
fn camera_model(sequence: &Sequence) -> &'static str {
    if sequence.is_pinhole() {
        "SIMPLE_RADIAL"
    } else {
        "EQUIRECTANGULAR"
    }
}

/// One attempt, recorded, with what it found.
pub(super) struct AttemptResult {
    pub(super) attempt: SfmAttempt,
    pub(super) found: Option<(ColmapModel, PoseValidation)>,
    /// Its tracks that the mapper did not see.
    pub(super) held_out: HeldOutTracks,
    /// True if it was killed, crashed, or left invalid files.
    pub(super) is_broken: bool,
}

/// Output of the script.
struct Conversation {
    models: u32,
    loops: Option<u32>,
    cpu_seconds: f64,
    ending: AttemptEnd,
}

enum AttemptEnd {
    /// There is a model.
    Success,
    /// The frames gave no model.
    Failed(String),
    /// The program broke, independently of the frames.
    Broken(String),
}
