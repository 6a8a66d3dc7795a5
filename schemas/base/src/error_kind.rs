//! Whose fault an error is: the exit code of the binary follows from it.

use std::{
    cell::RefCell,
    path::{Path, PathBuf},
};

thread_local! {
    static LAST_FILE: RefCell<Option<PathBuf>> = const { RefCell::new(None) };
}

/// Remembers what this thread reads, in case that reading it shows a mistake of ours.
pub fn reading(file: &Path) {
    LAST_FILE.with_borrow_mut(|last| *last = Some(file.to_owned()));
}

/// The file that this thread was [`reading`] last.
pub fn last_file() -> Option<PathBuf> {
    // A thread that is ending has nothing to tell any more.
    LAST_FILE
        .try_with(|last| last.try_borrow().ok()?.clone())
        .ok()
        .flatten()
}

/// Kinds of errors, by the party that has to act.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorKind {
    /// The input is bad or missing; the user has to change it. Exit code 2.
    User,
    /// Our failure or the machine's (a full disk, a bug). Exit code 1.
    Internal,
}

/// Implemented by every error type of the workspace.
///
/// Messages are one line that names the file and the reason.
pub trait Classified: std::error::Error {
    /// Returns the party that has to act.
    fn error_kind(&self) -> ErrorKind;
}
