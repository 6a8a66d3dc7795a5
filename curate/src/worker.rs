//! Curation of each video in a process of its own. If one crashes its decoder, or exceeds the memory, it is one failed
//! video, and the others go on.
//!
//! The process is this program again, started to call [`serve`]. It reads a request from standard input, one line of
//! JSON, and writes its reports and its result to standard output, one line each. It ends when its standard input is
//! closed, so that it does not outlive its parent.

use std::{
    io::{self, BufRead, BufReader, Read, Write},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::{Mutex, PoisonError},
    thread,
};

use omnilife_schemas::{
    Classified, ErrorKind,
    child::ProcessGroup,
    process,
    progress::Progress,
    records::{CheckOutcome, SourceVideo},
};
use serde::{Deserialize, Serialize};

use crate::{dataset::duration_seconds, error::CurateError, pipeline, settings::CurateSettings};

/// Maximum length of a line of [`serve`].
const MOST_LINE_BYTES: u64 = 16 << 20;
/// Maximum size of the kept standard error of a process.
const STANDARD_ERROR_BYTES: usize = 64 << 10;

/// The program that curates one video, and its limits.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Worker {
    /// The program; it must call [`serve`] when it is started with `arguments`.
    pub program: PathBuf,
    /// Its arguments.
    pub arguments: Vec<String>,
    /// Memory that it may use, bytes.
    pub memory_bytes: Option<u64>,
}

/// Outcome of one video.
pub(crate) struct Curated {
    /// Names of its sequences' folders.
    pub(crate) sequences: Result<Vec<String>, CurateError>,
    /// Its duration, seconds, if known.
    pub(crate) duration_seconds: Option<f64>,
}

#[derive(Serialize, Deserialize)]
struct Request {
    video: PathBuf,
    source: SourceVideo,
    folder: PathBuf,
    settings: CurateSettings,
    memory_bytes: Option<u64>,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Message {
    Begin {
        label: String,
        total: Option<u64>,
    },
    Advance(u64),
    Status(String),
    End,
    Note(String),
    Curated {
        sequences: Vec<String>,
        duration_seconds: Option<f64>,
    },
    Failed {
        message: String,
        for_records: String,
        is_fault_of_input: bool,
        failed_checks: Option<Vec<CheckOutcome>>,
        duration_seconds: Option<f64>,
    },
}

impl Worker {
    /// Curates one video in a process, see [`pipeline::curate_video`].
    pub(crate) fn curate(
        &self,
        video: &Path,
        source: &SourceVideo,
        folder: &Path,
        settings: &CurateSettings,
        progress: &dyn Progress,
    ) -> Curated {
        let request = Request {
            video: video.to_owned(),
            source: source.clone(),
            folder: folder.to_owned(),
            settings: settings.clone(),
            memory_bytes: self.memory_bytes,
        };
        let failed = |error| Curated {
            sequences: Err(error),
            duration_seconds: None,
        };
        let Ok(request) = serde_json::to_string(&request) else {
            return failed(CurateError::video(video, "its path is not valid UTF-8"));
        };
        let run = || -> io::Result<(Option<Curated>, [String; 2])> {
            let mut command = Command::new(&self.program);
            command
                .args(&self.arguments)
                .stdin(Stdio::piped())
                .stdout(Stdio::piped())
                .stderr(Stdio::piped());
            // Dropping it ends a process that still runs.
            let mut group = ProcessGroup::spawn(&mut command, None)?;
            let child = group.leader();
            let errors = child.stderr.take();
            let errors = thread::spawn(move || process::read_tail(errors, STANDARD_ERROR_BYTES));
            let curated = converse(child, &request, progress)?;
            // One that still runs ends when its input is closed.
            drop(child.stdin.take());
            let ending = process::ending(group.wait()?.status);
            let said = process::last_line_of(&errors.join().unwrap_or_default());
            let said = said.map_or_else(String::new, |line| format!(": {line}"));
            Ok((curated, [ending, said]))
        };
        match run() {
            Ok((Some(curated), _)) => curated,
            Ok((None, [ending, said])) => failed(self.crashed(video, &ending, &said)),
            Err(error) => failed(CurateError::internal(
                video,
                format!("the process that curates it failed: {error}"),
            )),
        }
    }

    /// Returns the error of a process that ended in this way, with its last error output `said`.
    fn crashed(&self, video: &Path, ending: &str, said: &str) -> CurateError {
        let limit = self.memory_bytes.filter(|_| said.contains("memory"));
        let hint = limit.map_or_else(String::new, |bytes| {
            let gibibytes = bytes as f64 / f64::from(1 << 30);
            format!(" (it may use {gibibytes:.1} GiB, see --memory)")
        });
        let reason = format!("the process that read it ended with {ending}");
        CurateError::Elsewhere {
            message: format!("{}: {reason}{said}{hint}", video.display()),
            for_records: reason,
            kind: ErrorKind::Internal,
            failed_checks: None,
        }
    }
}

/// Sends the request and passes on the reports of the process, until its result; `None` without one.
fn converse(
    child: &mut Child,
    request: &str,
    progress: &dyn Progress,
) -> io::Result<Option<Curated>> {
    if let Some(input) = &mut child.stdin {
        // A process that has ended already is judged by its output.
        let _ = input.write_all(format!("{request}\n").as_bytes());
    }
    let Some(output) = child.stdout.take() else {
        return Ok(None);
    };
    let mut output = BufReader::new(output);
    let mut open = 0_u64;
    let mut curated = None;
    while let Some(message) = next_message(&mut output)? {
        match message {
            Message::Begin { label, total } => {
                open += 1;
                progress.begin(&label, total);
            }
            Message::Advance(steps) => progress.advance(steps),
            Message::Status(text) => progress.status(&text),
            Message::End => {
                open = open.saturating_sub(1);
                progress.end();
            }
            Message::Note(line) => progress.note(&line),
            Message::Curated {
                sequences,
                duration_seconds,
            } => {
                curated = Some(Curated {
                    sequences: Ok(sequences),
                    duration_seconds,
                });
            }
            Message::Failed {
                message,
                for_records,
                is_fault_of_input,
                failed_checks,
                duration_seconds,
            } => {
                let kind = if is_fault_of_input {
                    ErrorKind::User
                } else {
                    ErrorKind::Internal
                };
                curated = Some(Curated {
                    sequences: Err(CurateError::Elsewhere {
                        message,
                        for_records,
                        kind,
                        failed_checks,
                    }),
                    duration_seconds,
                });
            }
        }
    }
    // Activities that a crash has left open.
    for _ in 0..open {
        progress.end();
    }
    Ok(curated)
}

/// Returns the next message; `None` at the end, and at a truncated one.
fn next_message(output: &mut impl BufRead) -> io::Result<Option<Message>> {
    let mut line = Vec::new();
    output.take(MOST_LINE_BYTES).read_until(b'\n', &mut line)?;
    if line.last() != Some(&b'\n') {
        return Ok(None);
    }
    serde_json::from_slice(&line)
        .map(Some)
        .map_err(io::Error::other)
}

/// Curates the video of the request on standard input, and ends the process when that is closed.
///
/// # Errors
/// When there is no request, or the reader of the reports has gone. Errors of the video are reported.
pub fn serve() -> io::Result<()> {
    let mut line = String::new();
    io::stdin().lock().read_line(&mut line)?;
    let request: Request = serde_json::from_str(&line)?;
    if let Some(bytes) = request.memory_bytes {
        process::limit_memory(bytes)?;
    }
    thread::spawn(|| {
        // Nothing more is sent: this returns when the parent closes the pipe or ends.
        let _ = io::stdin().lock().read(&mut [0]);
        std::process::exit(1);
    });
    let relay = Relay {
        output: Mutex::new(io::stdout()),
    };
    let Request {
        video,
        source,
        folder,
        settings,
        ..
    } = request;
    let sequences = pipeline::curate_source(&video, &source, &folder, &settings, &relay);
    let duration_seconds = duration_seconds(&video, &folder);
    relay.send(&match sequences {
        Ok(sequences) => Message::Curated {
            sequences,
            duration_seconds,
        },
        Err(error) => Message::Failed {
            message: error.to_string(),
            for_records: error.for_records(),
            is_fault_of_input: error.error_kind() == ErrorKind::User,
            failed_checks: error.failed_checks().map(<[_]>::to_vec),
            duration_seconds,
        },
    })
}

/// Passes progress on to the parent process.
struct Relay {
    output: Mutex<io::Stdout>,
}

impl Relay {
    fn send(&self, message: &Message) -> io::Result<()> {
        let mut line = serde_json::to_string(message)?;
        line.push('\n');
        let mut output = self.output.lock().unwrap_or_else(PoisonError::into_inner);
        output.write_all(line.as_bytes())?;
        output.flush()
    }

    fn report(&self, message: &Message) {
        // The parent is gone; the closed input ends this process.
        drop(self.send(message));
    }
}

impl Progress for Relay {
    fn begin(&self, label: &str, total: Option<u64>) {
        let label = label.to_owned();
        self.report(&Message::Begin { label, total });
    }

    fn advance(&self, steps: u64) {
        self.report(&Message::Advance(steps));
    }

    fn status(&self, text: &str) {
        self.report(&Message::Status(text.to_owned()));
    }

    fn end(&self) {
        self.report(&Message::End);
    }

    fn note(&self, line: &str) {
        self.report(&Message::Note(line.to_owned()));
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

    use omnilife_schemas::progress::Silent;

    use super::*;

    /// Returns the result of a worker shell script for a video.
    fn curated_by(script: &str, memory_bytes: Option<u64>) -> Curated {
        let worker = Worker {
            program: "sh".into(),
            arguments: vec!["-c".to_owned(), script.to_owned()],
            memory_bytes,
        };
        let source = SourceVideo {
            file_name: "a.mp4".to_owned(),
            sha256: String::new(),
            bytes: 0,
        };
        let settings = CurateSettings::default();
        let (video, folder) = (Path::new("a.mp4"), Path::new("out"));
        worker.curate(video, &source, folder, &settings, &Silent)
    }

    #[test]
    fn however_a_process_ends_there_is_one_error_that_names_the_video() {
        for (script, reason) in [
            ("kill -SEGV $$", "signal 11"),
            (
                "echo 'panicked somewhere' >&2; exit 1",
                "exit 1: panicked somewhere",
            ),
            ("exit 0", "exit 0"),
            ("printf '{\"end\"'", "exit 0"),
            ("echo hello; exec sleep 60", "expected"),
        ] {
            let curated = curated_by(script, None);
            let error = curated.sequences.unwrap_err();
            let message = error.to_string();
            assert!(message.starts_with("a.mp4: "), "{script}: {message}");
            assert!(message.contains(reason), "{script}: {message}");
            assert_eq!(error.error_kind(), ErrorKind::Internal, "{script}");
        }
        let script = "echo 'memory allocation of 9 bytes failed' >&2; kill -ABRT $$";
        let message = curated_by(script, Some(1 << 30))
            .sequences
            .unwrap_err()
            .to_string();
        assert!(
            message.contains("may use 1.0 GiB, see --memory"),
            "{message}"
        );
    }

    #[test]
    fn what_a_process_says_of_its_end_is_passed_on() {
        let script =
            r#"echo '"end"'; echo '{"curated":{"sequences":["seq-000"],"duration_seconds":2.5}}'"#;
        let curated = curated_by(script, None);
        assert_eq!(curated.sequences.unwrap(), ["seq-000"]);
        assert_eq!(curated.duration_seconds, Some(2.5));
        let script = r#"echo '{"failed":{"message":"/films/a.mp4: is empty","for_records":"is empty","is_fault_of_input":true,"failed_checks":null,"duration_seconds":null}}'"#;
        let error = curated_by(script, None).sequences.unwrap_err();
        assert_eq!(
            (error.to_string().as_str(), error.error_kind()),
            ("/films/a.mp4: is empty", ErrorKind::User)
        );
        assert_eq!(error.for_records(), "is empty");
        assert_eq!(error.failed_checks(), None);
    }
}
