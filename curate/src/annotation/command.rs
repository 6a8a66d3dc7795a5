//! Captions by any program: frames in, JSON out.
//!
//! The program is started once per sequence. It reads one JSON object from standard input:
//!
//! ```json
//! {
//!   "schema": "omnilife/caption-request/1",
//!   "sequence": "video/seq-000",
//!   "projection": "equirectangular",
//!   "frames": [{ "file": "/absolute/path/000000.png", "time_seconds": 0.0 }],
//!   "scenes": ["beach", "canyon"],
//!   "actions": ["walking", "cycling"]
//! }
//! ```
//!
//! and writes one to standard output, of which any entry may be left out or null:
//!
//! ```json
//! { "caption": "A walk through a market at night.", "scene": "night-market", "action": "walking" }
//! ```
//!
//! `scene` and `action` must be among those listed. Exit code 0 means success; the standard error of a failed program
//! is shown. It is ended after the timeout (SIGTERM, and SIGKILL after five seconds), together with its child
//! processes.

use std::{
    io::{self, Read, Write},
    path::Path,
    process::{Command, Stdio},
    sync::mpsc::{self, Receiver},
    thread,
    time::{Duration, Instant},
};

use omnilife_schemas::{
    child::{GRACE, ProcessGroup},
    process,
    progress::Progress,
    records::{NameGroup, Sequence, Taxonomy},
};
use serde::{Deserialize, Serialize};

use super::TagRow;
use crate::error::CurateError;

/// Frames that are shown at most, spread evenly over the sequence.
const SHOWN_FRAMES: usize = 8;
/// Maximum size of an answer; a longer one is refused.
const MOST_ANSWER_BYTES: usize = 1 << 20;
/// Maximum size of the error output that is read.
const SHOWN_ERROR_BYTES: usize = 64 << 10;
/// Time for which the pipes of an ended program are still read.
const PIPE_GRACE: Duration = Duration::from_secs(1);

/// A captioning program.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CaptionCommand {
    /// The program.
    pub program: String,
    /// Its arguments.
    pub arguments: Vec<String>,
    /// Time limit per sequence.
    pub timeout: Duration,
}

#[derive(Serialize)]
struct Request<'a> {
    schema: &'static str,
    sequence: &'a str,
    projection: &'static str,
    frames: Vec<RequestFrame>,
    scenes: Vec<&'a str>,
    actions: Vec<&'a str>,
}

#[derive(Serialize)]
struct RequestFrame {
    file: String,
    time_seconds: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Answer {
    caption: Option<String>,
    scene: Option<String>,
    action: Option<String>,
}

impl CaptionCommand {
    /// Captions a sequence. The author is the program's file name: its folder differs from machine to machine.
    ///
    /// # Errors
    /// [`CurateError::Input`] when the program cannot be run, fails, takes too long or gives a malformed answer.
    pub fn run(
        &self,
        folder: &Path,
        sequence: &Sequence,
        taxonomy: &Taxonomy,
        progress: &dyn Progress,
    ) -> Result<TagRow, CurateError> {
        let failed = |reason: String| {
            CurateError::input(
                Path::new(&self.program),
                format!("captioning {}: {reason}", sequence.id),
            )
        };
        let request = request(folder, sequence, taxonomy).map_err(|e| failed(e.to_string()))?;
        progress.begin(&format!("captioning {}", sequence.id), None);
        let answered = self.exchange(request, progress);
        progress.end();
        let answer = answered.map_err(failed)?;
        let answer: Answer = serde_json::from_slice(&answer)
            .map_err(|error| failed(format!("its answer is not the JSON asked for: {error}")))?;
        let program = Path::new(&self.program).file_name().unwrap_or_default();
        Ok(TagRow {
            sequence: sequence.id.clone(),
            author: program.to_string_lossy().into_owned(),
            scene: answer.scene,
            action: answer.action,
            traversal: None,
            caption: answer.caption,
        })
    }

    /// Runs the program on a request and returns its output.
    fn exchange(&self, request: Vec<u8>, progress: &dyn Progress) -> Result<Vec<u8>, String> {
        let mut command = Command::new(&self.program);
        command
            .args(&self.arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let mut group = ProcessGroup::spawn(&mut command, None)
            .map_err(|error| format!("cannot be run: {error}"))?;
        let child = group.leader();
        let (input, output, errors) =
            (child.stdin.take(), child.stdout.take(), child.stderr.take());
        // All three pipes at once: a program that fills one waits for its reader.
        thread::spawn(move || {
            // A program need not read its input; its answer counts all the same.
            let _ = input.map(|mut pipe| pipe.write_all(&request));
        });
        let output = in_background(move || read_at_most(output, MOST_ANSWER_BYTES + 1));
        let errors = in_background(move || process::read_tail(errors, SHOWN_ERROR_BYTES));
        let begun = Instant::now();
        let ended = group.wait_unless(|_| (begun.elapsed() >= self.timeout).then_some(()));
        for what in group.end(GRACE).lines() {
            progress.note(&format!("{} left running: {what}", self.program));
        }
        // Child processes end with the program, and so do the other ends of the pipes. Pipes held by a process that
        // could not be found are not waited for.
        let output = output.recv_timeout(PIPE_GRACE).unwrap_or_default();
        let errors = errors.recv_timeout(PIPE_GRACE).unwrap_or_default();
        if output.len() > MOST_ANSWER_BYTES {
            return Err(format!("answers more than {MOST_ANSWER_BYTES} bytes"));
        }
        match ended {
            Ok(Ok(ended)) if ended.status.success() => Ok(output),
            Ok(Ok(ended)) => {
                let said = process::last_line_of(&errors);
                let said = said.unwrap_or_else(|| "it says nothing".to_owned());
                Err(format!("failed ({}): {said}", ended.status))
            }
            Ok(Err(())) => Err(format!(
                "took longer than {} s and was stopped",
                self.timeout.as_secs_f64()
            )),
            Err(error) => Err(error.to_string()),
        }
    }
}

/// Runs work in a thread of its own; its result arrives by the receiver.
fn in_background<T: Send + 'static>(work: impl FnOnce() -> T + Send + 'static) -> Receiver<T> {
    let (sender, receiver) = mpsc::channel();
    thread::spawn(move || {
        // Its parent may have stopped waiting for it.
        drop(sender.send(work()));
    });
    receiver
}

/// Returns the first bytes of a pipe and closes it.
fn read_at_most(pipe: Option<impl Read>, most: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    // Bytes before a broken pipe are judged like any answer.
    let _ = pipe.map(|pipe| pipe.take(most as u64).read_to_end(&mut bytes));
    bytes
}

fn request(folder: &Path, sequence: &Sequence, taxonomy: &Taxonomy) -> io::Result<Vec<u8>> {
    let folder = std::path::absolute(folder)?;
    let entries = &sequence.frames.entries;
    let shown = entries.len().min(SHOWN_FRAMES);
    let frames = (0..shown)
        .map(|index| {
            let entry = &entries[index * entries.len() / shown];
            RequestFrame {
                file: folder.join(&entry.file).display().to_string(),
                time_seconds: entry.time_seconds,
            }
        })
        .collect();
    serde_json::to_vec(&Request {
        schema: "omnilife/caption-request/1",
        sequence: &sequence.id,
        projection: "equirectangular",
        frames,
        scenes: names(&taxonomy.scenes),
        actions: names(&taxonomy.actions),
    })
    .map_err(io::Error::other)
}

fn names(groups: &[NameGroup]) -> Vec<&str> {
    groups
        .iter()
        .flat_map(|group| group.members.iter().map(String::as_str))
        .collect()
}
