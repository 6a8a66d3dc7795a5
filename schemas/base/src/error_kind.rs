//! Kinds of errors, from which the exit code of the binary follows.

use std::{
    cell::RefCell,
    path::{Path, PathBuf},
};

thread_local! {
    static LAST_FILE: RefCell<Option<PathBuf>> = const { RefCell::new(None) };
}

/// Remembers the file that this thread reads, in case that reading it reveals a mistake of ours.
pub fn reading(file: &Path) {
    LAST_FILE.with_borrow_mut(|last| *last = Some(file.to_owned()));
}

/// Returns the last file that this thread was [`reading`].
pub fn last_file() -> Option<PathBuf> {
    // A thread that is ending has no such file any more.
    LAST_FILE
        .try_with(|last| last.try_borrow().ok()?.clone())
        .ok()
        .flatten()
}

/// Kinds of errors, by the party that has to act.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorKind {
    /// Bad or missing input, which the user has to change. Exit code 2.
    User,
    /// Failure of the program or the machine (a bug, a full disk). Exit code 1.
    Internal,
}

/// Errors with a kind; every error type of the workspace implements it.
///
/// Messages are one line that names the file and the reason.
pub trait Classified: std::error::Error {
    /// Returns the party that has to act.
    fn error_kind(&self) -> ErrorKind;
}
