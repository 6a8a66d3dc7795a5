//! Exit codes of errors: 2 for bad input, 1 for a failure of the program or the machine, 75 for interrupted work that
//! resumes when it is started again.

use std::{
    borrow::Cow,
    io::{self, IsTerminal, Write},
    panic::{self, AssertUnwindSafe},
    path::Path,
    process::ExitCode,
    sync::atomic::{AtomicBool, Ordering},
};

use omnilife_bench::BenchError;
use omnilife_curate::CurateError;
use omnilife_leaderboard::LeaderboardError;
use omnilife_reconstruct::ReconstructError;
use omnilife_schemas::{
    Classified, ErrorKind, error_kind::last_file, foreign_code::is_guarded,
    plain_text::for_terminal, store::StoreError,
};
use omnilife_sweep::SweepError;
use omnilife_tracks::TracksError;
use omnilife_video::VideoError;

use crate::{colour, width};

/// `EX_TEMPFAIL` of sysexits.h: start it again.
const INTERRUPTED: u8 = 75;

/// Partial failure: the rest of the work continued, and each failure has been reported already.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub(crate) struct PartialFailure {
    /// Number of failures, and the first one with its file and reason.
    pub(crate) message: String,
    /// Internal if any failure is internal.
    pub(crate) blame: ErrorKind,
}

impl Classified for PartialFailure {
    fn error_kind(&self) -> ErrorKind {
        self.blame
    }
}

/// Request that the user has to change, such as options that contradict each other.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct BadRequest(pub(crate) String);

impl Classified for BadRequest {
    fn error_kind(&self) -> ErrorKind {
        ErrorKind::User
    }
}

/// Reports an error in one line and returns the exit code.
fn code(outcome: anyhow::Result<()>) -> ExitCode {
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if is_closed_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            // With stderr closed too, the error cannot be reported.
            let line = format!("omnilife: {}", one_line(&error));
            drop(writeln!(io::stderr(), "{}", colour::for_stderr(&line)));
            if is_interruption(&error) {
                return ExitCode::from(INTERRUPTED);
            }
            match error_kind(&error) {
                ErrorKind::User => ExitCode::from(2),
                ErrorKind::Internal => ExitCode::from(1),
            }
        }
    }
}

/// Returns whether the process was terminated and its work resumes when it is started again.
pub(crate) fn is_interruption(error: &anyhow::Error) -> bool {
    matches!(
        error.downcast_ref::<ReconstructError>(),
        Some(ReconstructError::Interrupted { .. })
    ) || matches!(
        error.downcast_ref::<SweepError>(),
        Some(SweepError::Interrupted)
    )
}

/// True once some thread has panicked, which has been reported.
static PANICKED: AtomicBool = AtomicBool::new(false);

/// Runs the program and returns its exit code. A panic on any thread, which is a bug of the program, is reported in
/// one line and gives 1; unfinished files are removed while unwinding.
pub(crate) fn code_of(program: impl FnOnce() -> anyhow::Result<()>) -> ExitCode {
    panic::set_hook(Box::new(|panicked| {
        if is_guarded() {
            return;
        }
        // Later panics follow from the first one.
        if PANICKED.swap(true, Ordering::SeqCst) {
            return;
        }
        let reason = panicked
            .payload_as_str()
            .unwrap_or("the reason is not told");
        let place = panicked.location().map(ToString::to_string);
        let line = panic_line(last_file().as_deref(), reason, place.as_deref());
        // With stderr closed the panic cannot be reported.
        drop(writeln!(io::stderr(), "{}", colour::for_stderr(&line)));
    }));
    let outcome = panic::catch_unwind(AssertUnwindSafe(program));
    match outcome {
        Ok(outcome) if !PANICKED.load(Ordering::SeqCst) => code(outcome),
        _ => ExitCode::from(1),
    }
}

/// Returns the line for a panic; `file` is the last that the thread read, `place` a line of the source.
fn panic_line(file: Option<&Path>, reason: &str, place: Option<&str>) -> String {
    let file = file.map_or_else(String::new, |file| format!("{}: ", file.display()));
    let place = place.map_or_else(String::new, |place| format!(" ({place})"));
    // Messages of rayon and the standard library when the system refuses resources.
    let is_of_machine = ["ThreadPoolBuildError", "failed to spawn thread"]
        .iter()
        .any(|words| reason.contains(words));
    let line = if is_of_machine {
        format!("omnilife: the system starts no more threads: {reason}")
    } else {
        format!("omnilife: {file}failed by a mistake of this program: {reason}{place}")
    };
    let words: Vec<&str> = line.split_whitespace().collect();
    for_terminal(&words.join(" ")).into_owned()
}

/// Returns the short table where stdout is a terminal, folded to its width, else the whole.
pub(crate) fn for_reader<'a>(short: &str, whole: &'a str) -> Cow<'a, str> {
    if io::stdout().is_terminal() {
        Cow::Owned(width::folded(short, width::of_stdout()))
    } else {
        Cow::Borrowed(whole)
    }
}

/// Prints a result to standard output.
pub(crate) fn print(text: &str) -> anyhow::Result<()> {
    let mut out = io::stdout().lock();
    let text = for_terminal(text);
    out.write_all(colour::for_stdout(&text).as_bytes())?;
    out.flush()?;
    Ok(())
}

/// Writes data to standard output unchanged, for other programs.
pub(crate) fn print_data(bytes: &[u8]) -> anyhow::Result<()> {
    let mut out = io::stdout().lock();
    out.write_all(bytes)?;
    out.flush()?;
    Ok(())
}

/// Returns the kind of an error; an error of no known type is internal.
pub(crate) fn error_kind(error: &anyhow::Error) -> ErrorKind {
    fn of<E: Classified + Send + Sync + 'static>(error: &anyhow::Error) -> Option<ErrorKind> {
        error.downcast_ref::<E>().map(Classified::error_kind)
    }
    of::<CurateError>(error)
        .or_else(|| of::<VideoError>(error))
        .or_else(|| of::<TracksError>(error))
        .or_else(|| of::<ReconstructError>(error))
        .or_else(|| of::<BenchError>(error))
        .or_else(|| of::<LeaderboardError>(error))
        .or_else(|| of::<SweepError>(error))
        .or_else(|| of::<StoreError>(error))
        .or_else(|| of::<PartialFailure>(error))
        .or_else(|| of::<BadRequest>(error))
        .unwrap_or(ErrorKind::Internal)
}

/// Returns the message alone: errors of this workspace state their causes themselves.
fn one_line(error: &anyhow::Error) -> String {
    let words = error.to_string();
    let line: Vec<&str> = words.split_whitespace().collect();
    for_terminal(&line.join(" ")).into_owned()
}

/// Returns whether the reader of our output has gone away (`omnilife ... | head`).
fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error
        .downcast_ref::<io::Error>()
        .is_some_and(|error| error.kind() == io::ErrorKind::BrokenPipe)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_one_line_and_the_exit_code_1() {
        let line = panic_line(
            Some(Path::new("a\u{1b}.png")),
            "index out\nof bounds",
            Some("src/x.rs:1:2"),
        );
        assert_eq!(
            line,
            "omnilife: a\\u{1b}.png: failed by a mistake of this program: index out of bounds \
             (src/x.rs:1:2)"
        );
        let default = panic::take_hook();
        let by_panic = code_of(|| panic!("on purpose"));
        panic::set_hook(default);
        assert_eq!(format!("{by_panic:?}"), format!("{:?}", ExitCode::from(1)));
    }
}
