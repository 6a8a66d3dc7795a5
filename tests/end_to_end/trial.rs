//! Trials of one command in a folder of its own, repeated from the same state.

use std::{
    ffi::OsStr,
    fs,
    path::PathBuf,
    process::{Child, Command, Stdio},
};

use assert_cmd::cargo::cargo_bin;

use crate::{
    outcomes::{ExpectedContent, Files, left_in},
    support::{Ended, omnilife},
    writing_commands::{Inputs, WritingCommand, copy},
};

pub(crate) fn variable<T: std::str::FromStr>(name: &str) -> Option<T> {
    std::env::var(name).ok()?.parse().ok()
}

/// Returns the binary as run through another program.
fn through<S: AsRef<OsStr>>(wrapper: &[&str], words: impl IntoIterator<Item = S>) -> Command {
    let program = cargo_bin!("omnilife");
    let mut command = match wrapper {
        [] => Command::new(program),
        [first, rest @ ..] => {
            let mut command = Command::new(first);
            command.args(rest).arg(program);
            command
        }
    };
    command
        .args(words)
        .env_remove("OMNILIFE_SFM_PYTHON")
        .env("OMNILIFE_DATA", "/nonexistent")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

fn ended(mut command: Command) -> Ended {
    let output = command.output().unwrap();
    Ended {
        code: output.status.code(),
        stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
        stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
    }
}

/// Runs the binary quietly by another program, such as one that limits it.
pub(crate) fn omnilife_through(wrapper: &[&str], words: &[&str]) -> Ended {
    ended(through(wrapper, ["--quiet"].iter().chain(words)))
}

/// Command with the folder that it writes into, always the same, since records hold paths.
pub(crate) struct Trial<'a> {
    pub(crate) command: &'a WritingCommand,
    pub(crate) inputs: &'a Inputs,
    pub(crate) folder: PathBuf,
}

impl Trial<'_> {
    pub(crate) fn out(&self) -> PathBuf {
        self.folder.join("work/out")
    }

    /// Restores the state from which the command starts.
    pub(crate) fn reset(&self) {
        let work = self.folder.join("work");
        if work.exists() {
            fs::remove_dir_all(&work).unwrap();
        }
        fs::create_dir(&work).unwrap();
        match &self.command.copy_of {
            Some(from) => copy(from, &self.out()),
            // Some commands write a file into an existing folder.
            None if self
                .command
                .words
                .iter()
                .any(|word| word.starts_with("OUT/")) =>
            {
                fs::create_dir(self.out()).unwrap();
            }
            None => {}
        }
    }

    /// Returns the command as run through another program.
    fn through(&self, wrapper: &[&str]) -> Command {
        let words = self.command.arguments(self.inputs, &self.out());
        through(wrapper, words)
    }

    pub(crate) fn start(&self) -> Child {
        self.through(&[]).spawn().unwrap()
    }

    pub(crate) fn run(&self) -> Ended {
        self.run_through(&[])
    }

    /// Runs the command to its end, by another program.
    pub(crate) fn run_through(&self, wrapper: &[&str]) -> Ended {
        ended(self.through(wrapper))
    }

    /// Returns everything below and beside the output folder.
    pub(crate) fn left(&self) -> Files {
        left_in(&self.folder.join("work"))
    }

    /// Runs the command to its end on the existing files; returns the faults.
    pub(crate) fn run_again(&self, expected: &ExpectedContent) -> Vec<String> {
        if self.command.words[..2] == ["sweep", "run"] {
            // Failed units stay failed until a retry is requested.
            omnilife(["--quiet", "sweep", "retry", self.out().to_str().unwrap()]).succeeded();
        }
        let Ended { code, stderr, .. } = self.run();
        // Some commands refuse finished work instead of repeating it.
        let is_finished = code == Some(2) && stderr.lines().count() == 1;
        let faults = expected.faults(&self.left());
        if code == Some(0) || is_finished && faults.is_empty() {
            return faults;
        }
        vec![format!(
            "run again it ended with {code:?}: {}; {}",
            stderr.trim_end(),
            faults.join(", ")
        )]
    }
}
