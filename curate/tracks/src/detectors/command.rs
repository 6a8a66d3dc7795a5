//! `command`: boxes of another program that is run for this, such as any YOLO. A TOML describes it:
//!
//! ```toml
//! id = "yolov8-visdrone"              # its name in the record
//! command = ["python3", "{folder}/detect.py", "--images", "{frames}", "--out", "{boxes}"]
//! format = "coco"                     # what it writes: coco (COCO JSON) or mot (MOT text)
//! minimum_confidence = 0.25           # optional; boxes below it are left out
//! time_limit_seconds = 3600           # optional; then SIGTERM, and SIGKILL 5 s later
//!
//! [classes]                           # optional: classes that count, and what they are called in tracks
//! car = "vehicle"
//! van = "vehicle"
//! ```
//!
//! Placeholders of the command, all absolute: `{frames}` (a folder with exactly the usable frames, each named by its
//! number in the scene, as `000012.png`), `{boxes}` (the program's output file), `{work}` (its working directory,
//! removed afterwards) and `{folder}` (that of the TOML). COCO JSON names frames by their files. MOT text numbers them
//! from 1 on in the order of their names, and its classes are the numbers of its eighth column. Without `[classes]`
//! every box counts, as a vehicle.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    time::Duration,
};

use omnilife_schemas::{
    child::{self, GRACE, Job},
    placeholders,
    progress::Progress,
    records::Detection,
    stage::StagePlan,
    staging::Staging,
    store::{self, StoreError},
    toml_file,
};
use serde::Deserialize;

use super::{
    Detector, DetectorInput, DetectorOutput,
    files::{self, BoxFormat, NamedFrames},
};
use crate::error::TracksError;

/// Name on the command line.
pub const ID: &str = "command";

/// The detector.
pub const DETECTOR: Detector = Detector {
    id: ID,
    about: "boxes that another program finds when it is run, any YOLO for one, as a TOML says (--program FILE)",
    keeps_files: true,
    detect,
};

/// Name of the stage whose output are the boxes.
const STAGE: &str = "detector-command";
const FRAMES_FOLDER: &str = "frames";
const WORK_FOLDER: &str = "work";
const LOG_FILE: &str = "log.txt";
/// Placeholders of a command, each with true if it is a number.
const PLACEHOLDERS: [(&str, bool); 4] = [
    ("frames", false),
    ("boxes", false),
    (WORK_FOLDER, false),
    ("folder", false),
];

/// Content of the TOML.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Program {
    id: String,
    command: Vec<String>,
    format: BoxFormat,
    minimum_confidence: Option<f64>,
    time_limit_seconds: Option<f64>,
    classes: Option<BTreeMap<String, String>>,
}

impl Program {
    fn read(path: &Path) -> Result<Self, TracksError> {
        let program: Self = toml_file::read(path)?;
        let checked = program.check();
        checked.map_err(|reason| TracksError::input(path, reason))?;
        Ok(program)
    }

    fn check(&self) -> Result<(), String> {
        if self.id.trim().is_empty() {
            return Err("id is empty".to_owned());
        }
        if self.command.first().is_none_or(String::is_empty) {
            return Err("command is empty".to_owned());
        }
        for word in &self.command {
            placeholders::check(word, &PLACEHOLDERS)?;
        }
        for needed in ["{frames}", "{boxes}"] {
            if !self.command.iter().any(|word| word.contains(needed)) {
                return Err(format!("the command does not say {needed}"));
            }
        }
        let confidence = self.minimum_confidence.unwrap_or(0.0);
        if !(0.0..=1.0).contains(&confidence) {
            return Err(format!(
                "minimum_confidence is from 0 to 1, not {confidence}"
            ));
        }
        if let Some(limit) = self.time_limit_seconds
            && Duration::try_from_secs_f64(limit).map_or(true, |limit| limit.is_zero())
        {
            return Err(format!("the time limit must be positive, got {limit} s"));
        }
        if self.classes.as_ref().is_some_and(BTreeMap::is_empty) {
            return Err("[classes] names none: without it every box counts".to_owned());
        }
        Ok(())
    }

    /// Returns the class that a box counts as; `None` if it does not count.
    fn class_of(&self, class: &str) -> Option<String> {
        match &self.classes {
            None => Some("vehicle".to_owned()),
            Some(classes) => classes.get(class).cloned(),
        }
    }
}

fn detect(
    input: &DetectorInput<'_>,
    progress: &dyn Progress,
) -> Result<DetectorOutput, TracksError> {
    let toml = input.program.ok_or_else(|| {
        let reason = "the detector command runs a program: --program FILE.toml";
        TracksError::input(input.folder, reason)
    })?;
    let program = Program::read(toml)?;
    let boxes = boxes_file(&program, toml, input, progress)?;
    let frames = NamedFrames::called_by_number(input.views);
    let all = files::read(&boxes, program.format, &frames, input, progress)?;
    let found = all.len();
    let least = program.minimum_confidence.unwrap_or(0.0);
    let (sure, unsure): (Vec<Detection>, Vec<Detection>) =
        all.into_iter().partition(|one| one.confidence >= least);
    let of_class = |one: Detection| {
        let class = program.class_of(&one.class)?;
        Some(Detection { class, ..one })
    };
    let of_classes = sure.len();
    let kept: Vec<Detection> = sure.into_iter().filter_map(of_class).collect();
    let toml_name = toml.file_name().unwrap_or_default().to_string_lossy();
    let said = format!(
        "{} by {toml_name} (SHA-256 {}): of {found} boxes {} are below its confidence, {} of other classes",
        program.id,
        store::sha256_file(toml)?,
        unsure.len(),
        of_classes.saturating_sub(kept.len()),
    );
    Ok(DetectorOutput { boxes: kept, said })
}

/// Returns the files beside the TOML that a command names: scripts and weights of the program's own.
fn own_files(program: &Program, folder: &Path) -> impl Iterator<Item = PathBuf> {
    let words = program
        .command
        .iter()
        .filter(|word| word.contains("{folder}"));
    words
        .map(move |word| {
            let fill = |name: &str, _| (name == "folder").then(|| folder.display().to_string());
            PathBuf::from(placeholders::replace(word, fill))
        })
        .filter(|path| path.is_file())
}

/// Adds the dependencies of detections by a TOML beside the frames: itself, and the files that it names.
///
/// # Errors
/// When one cannot be read.
pub(crate) fn with_inputs(mut plan: StagePlan, toml: &Path) -> Result<StagePlan, TracksError> {
    let program = Program::read(toml)?;
    plan = plan.with_file(toml)?;
    for file in own_files(&program, &folder_of(toml)?) {
        plan = plan.with_file(&file)?;
    }
    Ok(plan)
}

/// Checks that a TOML describes a program.
///
/// # Errors
/// When it cannot be read, or describes none.
pub(crate) fn check(toml: &Path) -> Result<(), TracksError> {
    Program::read(toml).map(drop)
}

fn absolute(path: &Path) -> Result<PathBuf, StoreError> {
    std::path::absolute(path).map_err(|source| StoreError::read(path, source))
}

fn folder_of(toml: &Path) -> Result<PathBuf, StoreError> {
    Ok(absolute(toml)?
        .parent()
        .unwrap_or(Path::new("/"))
        .to_owned())
}

/// Returns the boxes of the program, which is run unless it has run on the same inputs.
fn boxes_file(
    program: &Program,
    toml: &Path,
    input: &DetectorInput<'_>,
    progress: &dyn Progress,
) -> Result<PathBuf, TracksError> {
    let name = match program.format {
        BoxFormat::Mot => "boxes.txt",
        BoxFormat::Coco => "boxes.json",
    };
    let mut plan = with_inputs(StagePlan::new(input.out, STAGE), toml)?;
    let mut images = Vec::new();
    for view in input.views {
        let Some(entry) = input.scene.frames.get(view.frame as usize) else {
            continue;
        };
        let image = input.folder.join(&entry.image);
        plan = plan.with_settings("frame", &view.frame).with_file(&image)?;
        images.push((view.frame, image));
    }
    let boxes = input.out.join(name);
    if plan.is_done() {
        let note = format!("{}: {}: unchanged, skipped", input.scene.id, program.id);
        progress.note(&note);
        return Ok(boxes);
    }
    plan.run([name], progress, |out| {
        let mut staging = Staging::new(input.out, STAGE)?;
        let written = staging.begin(name)?;
        let frames = staging.folder.join(FRAMES_FOLDER);
        store::create_folder(&frames)?;
        for (frame, image) in images {
            let kind = image.extension().unwrap_or_default().to_string_lossy();
            let copy = frames.join(format!("{frame:06}.{kind}"));
            store::copy(&image, &copy)?;
        }
        let work = staging.folder.join(WORK_FOLDER);
        store::create_folder(&work)?;
        progress.begin(&program.id, None);
        let ended = run(program, toml, &staging.folder, &written, progress);
        progress.end();
        ended?;
        let files = std::mem::take(&mut staging.files);
        out.place(&staging.folder, &files)?;
        Ok(boxes)
    })
}

fn run(
    program: &Program,
    toml: &Path,
    folder: &Path,
    boxes: &Path,
    progress: &dyn Progress,
) -> Result<(), TracksError> {
    let [frames, work, boxes] = [
        &folder.join(FRAMES_FOLDER),
        &folder.join(WORK_FOLDER),
        boxes,
    ]
    .map(absolute);
    let (work, boxes) = (work?, boxes?);
    let places = BTreeMap::from([
        ("frames", frames?),
        ("boxes", boxes.clone()),
        (WORK_FOLDER, work.clone()),
        ("folder", folder_of(toml)?),
    ]);
    let fill = |word: &String| {
        placeholders::replace(word, |name, _| {
            Some(places.get(name)?.display().to_string())
        })
    };
    let outcome = child::run(&Job {
        command: program.command.iter().map(fill).collect(),
        variables: BTreeMap::new(),
        folder: work,
        log: folder.join(LOG_FILE),
        time_limit: program.time_limit_seconds.map(Duration::from_secs_f64),
        grace: GRACE,
        container: None,
    })?;
    for what in &outcome.left_running {
        progress.note(&format!("{} left running: {what}", program.id));
    }
    let failed = |reason: String| TracksError::input(toml, format!("{} {reason}", program.id));
    if !outcome.succeeded {
        return Err(failed(outcome.failure()));
    }
    if !boxes.is_file() {
        let said = outcome.last_line.iter().map(|line| format!(": {line}"));
        let said: String = said.collect();
        return Err(failed(format!("ended without writing {{boxes}}{said}")));
    }
    Ok(())
}
