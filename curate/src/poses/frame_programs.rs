//! External programs that make masks, distances or poses of the frames of a scene or a sequence: mostly networks.
//!
//! A command is words between blanks, with these placeholders, all absolute paths:
//!
//! - `{frames}`: a folder with exactly the frames, each named by its number in the scene (`000012.png`), so that the
//!   order of names is that of frames;
//! - `{out}`: a folder for masks and distances named like the frames, or for poses as `poses.json` or
//!   `all_poses.npy`. It is empty, except for masks that a failed or killed run of the same command on the same frames
//!   has left;
//! - `{times}`: a CSV with the columns `image` and `time_seconds`, which a `poses.json` needs; optional.
//!
//! It starts in this process's directory, and has failed if its exit code is not 0. At its time limit it is ended with
//! all its child processes.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    str::FromStr,
    time::Duration,
};

use omnilife_schemas::{
    child::{self, GRACE, Job},
    placeholders, plain_text,
    progress::Progress,
    records::{DistanceConvention, DistanceGrid, FrameEntry, PoseSource, Scene, Sequence},
    staging::Staging,
    store::{self, StoreError},
};

use super::{frame_list::FrameList, masks, prior::GivenPrior, unfinished::UnfinishedMasks};
use crate::error::CurateError;

/// Placeholders of a command, each with true if it is a number.
const PLACEHOLDERS: [(&str, bool); 3] = [("frames", false), ("out", false), ("times", false)];
/// Names that poses may have in the folder of a program.
const POSE_FILES: [&str; 2] = ["poses.json", "all_poses.npy"];

/// A command with its placeholders.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FrameCommand(String);

impl FromStr for FrameCommand {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        for word in text.split_whitespace() {
            placeholders::check(word, &PLACEHOLDERS)?;
        }
        match ["{frames}", "{out}"]
            .iter()
            .find(|needed| !text.contains(**needed))
        {
            Some(needed) => Err(format!("the command does not say {needed}")),
            None => Ok(Self(text.to_owned())),
        }
    }
}

/// Program that masks the dynamic regions in the frames of a sequence.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MaskProgram {
    /// The program.
    pub command: FrameCommand,
    /// Its time limit; no limit if `None`.
    pub time_limit: Option<Duration>,
}

impl MaskProgram {
    /// Returns the command as it was given.
    pub(crate) fn text(&self) -> &str {
        &self.command.0
    }

    /// Runs it on copies of the frames of a sequence, in a folder that must outlive the files. Returns the mask of each
    /// frame, in their order.
    ///
    /// # Errors
    /// When a frame cannot be copied, the program fails, or it leaves no mask of some frame.
    pub(crate) fn run(
        &self,
        sequence_folder: &Path,
        sequence: &Sequence,
        folder: &Path,
        progress: &dyn Progress,
    ) -> Result<Vec<PathBuf>, CurateError> {
        let frames = numbered(&FrameList::of_sequence(sequence));
        let images = sequence.frames.entries.iter().map(|entry| &*entry.file);
        let room = Room::prepare((sequence_folder, images), &frames, folder)?;
        let made = room.mask(sequence_folder, &frames, self, progress)?;
        masks::find(&made, &frames.entries)
    }
}

/// A program that estimates distances, and the format of its files.
#[derive(Debug, Clone, PartialEq)]
pub struct PriorProgram {
    /// The program.
    pub command: FrameCommand,
    /// Length of a step of 1 in its files, in units of the world frame.
    pub unit: f64,
    /// Grid of their pixels.
    pub grid: DistanceGrid,
    /// Line that their distances are measured along.
    pub convention: DistanceConvention,
}

/// Programs that are run on the frames of a scene, whose files are attached to it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FramePrograms {
    /// Masks moving content.
    pub masks: Option<FrameCommand>,
    /// Estimates distances.
    pub prior: Option<PriorProgram>,
    /// Finds the poses.
    pub poses: Option<FrameCommand>,
    /// Time limit of each; no limit if `None`.
    pub time_limit: Option<Duration>,
}

/// Output of programs, for the frames by their numbers.
pub(super) struct ProgramOutputs {
    pub(super) frames: FrameList,
    /// Folder of masks, and the command.
    pub(super) masks: Option<(PathBuf, String)>,
    pub(super) prior: Option<GivenPrior>,
    /// File of poses, and the command.
    pub(super) poses: Option<(PathBuf, String)>,
}

impl FramePrograms {
    /// Runs the programs on copies of a scene's frames, in a folder that is removed afterwards.
    ///
    /// # Errors
    /// When a frame cannot be copied, a program fails, or a program for poses leaves none or two files of them.
    pub(super) fn run(
        &self,
        (scene_folder, scene): (&Path, &Scene),
        frames: &FrameList,
        staging: &Staging,
        progress: &dyn Progress,
    ) -> Result<ProgramOutputs, CurateError> {
        let mut made = ProgramOutputs {
            frames: numbered(frames),
            masks: None,
            prior: None,
            poses: None,
        };
        let prior = self.prior.as_ref();
        let prior_command = prior.map(|prior| &prior.command);
        let commands = [self.masks.as_ref(), prior_command, self.poses.as_ref()];
        if commands.iter().all(Option::is_none) {
            return Ok(made);
        }
        let images = scene.frames.iter().map(|frame| &*frame.image);
        let room = Room::prepare((scene_folder, images), &made.frames, &staging.folder)?;
        let run = |command: &FrameCommand, kind: &str| {
            let out = room.folder.join(format!("program-{kind}"));
            store::create_folder(&out)?;
            room.run(command, kind, &out, self.time_limit, progress)?;
            Ok::<_, CurateError>(out)
        };
        if let Some(command) = &self.masks {
            let program = MaskProgram {
                command: command.clone(),
                time_limit: self.time_limit,
            };
            let folder = room.mask(scene_folder, &made.frames, &program, progress)?;
            made.masks = Some((folder, command.0.clone()));
        }
        if let Some(prior) = prior {
            made.prior = Some(GivenPrior {
                folder: run(&prior.command, "distances")?,
                unit: prior.unit,
                grid: prior.grid,
                convention: prior.convention,
                source: plain_text::without_folders(&prior.command.0),
            });
        }
        if let Some(command) = &self.poses {
            let file = pose_file(&run(command, "poses")?, command)?;
            made.poses = Some((file, command.0.clone()));
        }
        Ok(made)
    }
}

/// Returns the frames as programs see them, each named by its number.
fn numbered(frames: &FrameList) -> FrameList {
    let entries = frames.entries.iter().enumerate().map(|(number, entry)| {
        let kind = Path::new(&entry.file).extension().unwrap_or_default();
        FrameEntry {
            file: format!("{number:06}.{}", kind.to_string_lossy()),
            time_seconds: entry.time_seconds,
            capture: entry.capture.clone(),
        }
    });
    FrameList {
        entries: entries.collect(),
        ..frames.clone()
    }
}

/// Returns the one file of poses that a program has left.
fn pose_file(out: &Path, command: &FrameCommand) -> Result<PathBuf, CurateError> {
    let files = POSE_FILES.map(|name| out.join(name));
    let mut found = files.into_iter().filter(|file| file.is_file());
    match (found.next(), found.next()) {
        (Some(file), None) => Ok(file),
        (first, _) => {
            let what = if first.is_some() { "both" } else { "neither" };
            let [record, array] = POSE_FILES;
            let reason = format!("left {what} of {record} and {array}, expected one of them");
            Err(CurateError::input(Path::new(&command.0), reason))
        }
    }
}

pub(super) fn source_of_program(source: PoseSource, command: String) -> PoseSource {
    match source {
        PoseSource::Given { file } => PoseSource::Program {
            command,
            file,
            convention: None,
        },
        PoseSource::Matrices { file, convention } => PoseSource::Program {
            command,
            file,
            convention: Some(convention),
        },
        other => other,
    }
}

fn absolute(folder: &Path) -> Result<PathBuf, StoreError> {
    std::path::absolute(folder).map_err(|source| StoreError::read(folder, source))
}

/// Working folder of programs.
struct Room {
    folder: PathBuf,
    frames: PathBuf,
    times: PathBuf,
}

impl Room {
    /// Copies the images of frames, which lie below a folder, and writes their times.
    fn prepare<'a>(
        (images_folder, images): (&Path, impl Iterator<Item = &'a str>),
        numbered: &FrameList,
        folder: &Path,
    ) -> Result<Self, CurateError> {
        let folder = absolute(folder)?;
        let room = Self {
            frames: folder.join("frames-by-number"),
            times: folder.join("times.csv"),
            folder,
        };
        store::create_folder(&room.frames)?;
        let mut times = "image,time_seconds\n".to_owned();
        for (image, entry) in images.zip(&numbered.entries) {
            let copy = room.frames.join(&entry.file);
            store::copy(&images_folder.join(image), &copy)?;
            times += &format!("{},{}\n", entry.file, entry.time_seconds);
        }
        store::write_bytes(&room.times, times.as_bytes())?;
        Ok(room)
    }

    /// Runs a program that masks the frames; returns the folder with a mask of each. What it leaves when it fails is
    /// kept in `record_folder`.
    fn mask(
        &self,
        record_folder: &Path,
        frames: &FrameList,
        program: &MaskProgram,
        progress: &dyn Progress,
    ) -> Result<PathBuf, CurateError> {
        let record_folder = absolute(record_folder)?;
        let request = self.request(frames, program)?;
        let unfinished = UnfinishedMasks::open(&record_folder, &request, frames, progress)?;
        let out = unfinished.out();
        let ran = self.run(
            &program.command,
            "masks",
            &out,
            program.time_limit,
            progress,
        );
        if let Err(error) = ran.and_then(|()| masks::find(&out, &frames.entries)) {
            unfinished.keep(frames, progress)?;
            return Err(error);
        }
        let made = self.folder.join("program-masks");
        unfinished.finish(&made)?;
        Ok(made)
    }

    /// Returns the command and the hashes of the times and frames that it sees, a line each.
    fn request(&self, frames: &FrameList, program: &MaskProgram) -> Result<String, StoreError> {
        let images = frames
            .entries
            .iter()
            .map(|entry| self.frames.join(&entry.file));
        let mut request = format!("{}\n", program.text());
        for file in [self.times.clone()].into_iter().chain(images) {
            request += &store::sha256_file(&file)?;
            request.push('\n');
        }
        Ok(request)
    }

    /// Runs a command with a folder for its output.
    fn run(
        &self,
        command: &FrameCommand,
        kind: &str,
        out: &Path,
        time_limit: Option<Duration>,
        progress: &dyn Progress,
    ) -> Result<(), CurateError> {
        let places = BTreeMap::from([
            ("frames", &*self.frames),
            ("out", out),
            ("times", &*self.times),
        ]);
        let fill = |word: &str| {
            placeholders::replace(word, |name, _| {
                Some(places.get(name)?.display().to_string())
            })
        };
        progress.begin(&command.0, None);
        let outcome = child::run(&Job {
            command: command.0.split_whitespace().map(fill).collect(),
            variables: BTreeMap::new(),
            folder: PathBuf::from("."),
            log: self.folder.join(format!("{kind}.log")),
            time_limit,
            grace: GRACE,
            container: None,
        });
        progress.end();
        let outcome = outcome?;
        for what in &outcome.left_running {
            progress.note(&format!("{} left running: {what}", command.0));
        }
        if outcome.succeeded {
            return Ok(());
        }
        Err(CurateError::input(Path::new(&command.0), outcome.failure()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_say_where_frames_are_and_files_go() {
        let parsed = |text: &str| text.parse::<FrameCommand>().is_ok();
        assert!(parsed("sh net.sh {frames} {out} --times={times}"));
        for wrong in [
            "",
            "sh net.sh {frames}",
            "{out}",
            "net {frames} {out} {what}",
        ] {
            assert!(!parsed(wrong), "{wrong}");
        }
    }
}
