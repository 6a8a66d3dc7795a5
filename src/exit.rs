//! From errors to exit codes: 2 for bad input, 1 for a failure of ours, 75 for work that was
//! interrupted and goes on when it is begun again.

use std::{
    io::{self, Write},
    process::ExitCode,
};

use omnilife_bench::BenchError;
use omnilife_curate::CurateError;
use omnilife_leaderboard::LeaderboardError;
use omnilife_reconstruct::ReconstructError;
use omnilife_schemas::{Blame, Blamed, store::StoreError};
use omnilife_sweep::SweepError;

/// `EX_TEMPFAIL` of sysexits.h: begin it again.
const INTERRUPTED: u8 = 75;

/// Some work failed, and the rest went on: each failure has been reported already.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub(crate) struct PartialFailure {
    /// How much failed, and the first failure with its file and reason.
    pub(crate) message: String,
    /// Ours if any failure is ours.
    pub(crate) blame: Blame,
}

impl Blamed for PartialFailure {
    fn blame(&self) -> Blame {
        self.blame
    }
}

/// The user asked for something that does not go together.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct BadRequest(pub(crate) String);

impl Blamed for BadRequest {
    fn blame(&self) -> Blame {
        Blame::Input
    }
}

/// Reports an error in one line and gives the exit code.
pub(crate) fn code(outcome: anyhow::Result<()>) -> ExitCode {
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) if is_closed_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => {
            // When stderr is closed too there is nobody left to tell.
            drop(writeln!(io::stderr(), "omnilife: {}", one_line(&error)));
            if is_interruption(&error) {
                return ExitCode::from(INTERRUPTED);
            }
            match blame(&error) {
                Blame::Input => ExitCode::from(2),
                Blame::Ours => ExitCode::from(1),
            }
        }
    }
}

/// Whether the process was told to end, and what it did goes on when it is begun again.
pub(crate) fn is_interruption(error: &anyhow::Error) -> bool {
    matches!(
        error.downcast_ref::<ReconstructError>(),
        Some(ReconstructError::Interrupted { .. })
    ) || matches!(
        error.downcast_ref::<SweepError>(),
        Some(SweepError::Interrupted)
    )
}

/// Prints a result to standard output.
pub(crate) fn print(text: &str) -> anyhow::Result<()> {
    let mut out = io::stdout().lock();
    out.write_all(text.as_bytes())?;
    out.flush()?;
    Ok(())
}

/// Who is to blame for an error; what nobody claims is ours.
pub(crate) fn blame(error: &anyhow::Error) -> Blame {
    fn of<E: Blamed + Send + Sync + 'static>(error: &anyhow::Error) -> Option<Blame> {
        error.downcast_ref::<E>().map(Blamed::blame)
    }
    of::<CurateError>(error)
        .or_else(|| of::<ReconstructError>(error))
        .or_else(|| of::<BenchError>(error))
        .or_else(|| of::<LeaderboardError>(error))
        .or_else(|| of::<SweepError>(error))
        .or_else(|| of::<StoreError>(error))
        .or_else(|| of::<PartialFailure>(error))
        .or_else(|| of::<BadRequest>(error))
        .unwrap_or(Blame::Ours)
}

/// The message alone: errors of this workspace say themselves what caused them.
fn one_line(error: &anyhow::Error) -> String {
    error
        .to_string()
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
}

/// The reader of our output has gone away (`omnilife ... | head`).
fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error
        .downcast_ref::<io::Error>()
        .is_some_and(|error| error.kind() == io::ErrorKind::BrokenPipe)
}
