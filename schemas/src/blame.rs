//! Whose fault an error is: the exit code of the binary follows from it.

/// Who has to act for the error to go away.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Blame {
    /// The input is bad or missing; the user has to change it. Exit code 2.
    Input,
    /// Our failure or the machine's (a full disk, a bug). Exit code 1.
    Ours,
}

/// Implemented by every error type of the workspace.
///
/// Messages are one line that names the file and the reason.
pub trait Blamed: std::error::Error {
    /// Who has to act.
    fn blame(&self) -> Blame;
}
