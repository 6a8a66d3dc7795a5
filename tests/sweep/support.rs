//! Sweeps of shell commands, and runs of the binary on them.

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Child, Command, Output, Stdio},
    thread,
    time::{Duration, Instant},
};

use assert_cmd::cargo::cargo_bin;
use tempfile::TempDir;

pub(crate) fn omnilife(arguments: &[&str]) -> Command {
    let mut command = Command::new(cargo_bin!("omnilife"));
    command.args(arguments);
    command
}

/// Sweep of shell commands in a folder of its own.
pub(crate) struct Shell {
    folder: TempDir,
}

impl Shell {
    /// Plans one unit per line.
    pub(crate) fn planned(lines: &[String], options: &[&str]) -> Self {
        Self::planned_in(tempfile::tempdir().unwrap(), lines, options)
    }

    /// Plans one unit per line in an existing folder.
    pub(crate) fn planned_in(folder: TempDir, lines: &[String], options: &[&str]) -> Self {
        let shell = Self { folder };
        let file = shell.path("lines.txt");
        fs::write(&file, lines.join("\n") + "\n").unwrap();
        let mut arguments = vec!["sweep", "plan", "commands", file.to_str().unwrap()];
        let sweep = shell.sweep();
        arguments.extend(["--out", &sweep]);
        arguments.extend(options);
        succeeded(shell.command(&arguments).output().unwrap());
        shell
    }

    /// Returns the binary, run in the folder.
    pub(crate) fn command(&self, arguments: &[&str]) -> Command {
        let mut command = omnilife(arguments);
        command.current_dir(self.folder.path());
        command
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Returns the sweep's folder.
    pub(crate) fn sweep(&self) -> String {
        self.path("sweep").to_str().unwrap().to_owned()
    }

    /// Runs `omnilife sweep <command> SWEEP <options>` to its end.
    pub(crate) fn run(&self, command: &str, options: &[&str]) -> Output {
        let sweep = self.sweep();
        let mut arguments = vec!["sweep", command, sweep.as_str()];
        arguments.extend(options);
        self.command(&arguments).output().unwrap()
    }

    /// Starts a runner in the background.
    pub(crate) fn runner(&self, options: &[&str]) -> Child {
        let sweep = self.sweep();
        let mut arguments = vec!["--quiet", "sweep", "run", sweep.as_str()];
        arguments.extend(options);
        self.command(&arguments)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap()
    }

    /// Returns the rows of the table of units as unit, state, reason.
    pub(crate) fn rows(&self) -> Vec<[String; 3]> {
        let printed = succeeded(self.run("status", &["--csv"]));
        let mut table = csv::Reader::from_reader(printed.as_bytes());
        let rows = table.records().map(|row| {
            let row = row.unwrap();
            [0, 2, 3].map(|column| row[column].to_owned())
        });
        rows.collect()
    }

    /// Returns the number of units in a state.
    pub(crate) fn count(&self, state: &str) -> usize {
        self.rows().iter().filter(|row| row[1] == state).count()
    }
}

#[track_caller]
pub(crate) fn succeeded(output: Output) -> String {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (stdout, stderr) = (text(&output.stdout), text(&output.stderr));
    assert!(output.status.success(), "{stdout}\n{stderr}");
    stdout
}

/// Waits for something to become true.
#[track_caller]
pub(crate) fn wait_for(what: &str, limit: Duration, mut is_true: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !is_true() {
        assert!(begun.elapsed() < limit, "{what}: not in {limit:?}");
        thread::sleep(Duration::from_millis(20));
    }
}

/// Returns the lines of a file; empty where it is missing.
pub(crate) fn lines(path: &Path) -> Vec<String> {
    let text = fs::read_to_string(path).unwrap_or_default();
    text.lines().map(str::to_owned).collect()
}
