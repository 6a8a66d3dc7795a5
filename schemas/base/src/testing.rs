//! Support for the tests of all crates: skipped tests, and a [`Progress`] that keeps its notes.

use std::{
    fmt::Display,
    fs::File,
    io::Write,
    mem,
    sync::{Mutex, PoisonError},
};

use crate::progress::Progress;

/// Name of the variable with the file in which skipped tests are counted; `scripts/test` sets it and prints the file.
const LIST_VARIABLE: &str = "OMNILIFE_SKIPPED_TESTS";

/// Reports in one line that the running test, or a part of it, is skipped, with the reason. The line goes to standard
/// output and, where the variable `OMNILIFE_SKIPPED_TESTS` names a file, to its end.
pub fn skip(reason: impl Display) {
    println!("skipped: {reason}");
    let Some(list) = std::env::var_os(LIST_VARIABLE) else {
        return;
    };
    let package = std::env::var("CARGO_PKG_NAME").unwrap_or_default();
    let thread = std::thread::current();
    let test = thread.name().unwrap_or("a thread");
    // One write, so that lines of parallel tests do not mix.
    let line = format!("{package} {test}: {reason}\n");
    let written = File::options()
        .append(true)
        .create(true)
        .open(&list)
        .and_then(|mut file| file.write_all(line.as_bytes()));
    if let Err(error) = written {
        println!("{}: {error}", list.display());
    }
}

/// Progress that keeps every note and reports nothing.
#[derive(Debug, Default)]
pub struct Notes(Mutex<Vec<String>>);

impl Notes {
    /// Returns the notes since the last call, in their order.
    pub fn take(&self) -> Vec<String> {
        mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Progress for Notes {
    fn begin(&self, _: &str, _: Option<u64>) {}
    fn advance(&self, _: u64) {}
    fn status(&self, _: &str) {}
    fn end(&self) {}
    fn note(&self, line: &str) {
        let mut notes = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        notes.push(line.to_owned());
    }
}
