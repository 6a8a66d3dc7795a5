//! Fixed defects: inputs that made a command crash, hang, lose files or mislead silently. Each must end in one line
//! with the right exit code, and nothing is lost. `scripts/reliability defects` prints the table.

mod hostile_files;
mod readers;
mod writers;

use std::{
    path::Path,
    process::{Command, Stdio},
    time::{Duration, Instant},
};

use assert_cmd::cargo::cargo_bin;

use crate::support::{METHOD, SEQUENCE, sample, small_run};
use hostile_files::Hostile;

/// Longest time of these commands.
const LONGEST: Duration = Duration::from_secs(60);

/// Defect with the commands that showed it.
struct Defect {
    id: &'static str,
    about: &'static str,
    /// Runs the commands and checks their leftovers.
    try_again: fn(&mut Attempt<'_>),
}

/// Current attempt and its findings.
struct Attempt<'a> {
    hostile: &'a Hostile,
    codes: Vec<String>,
    faults: Vec<String>,
}

impl Attempt<'_> {
    /// Runs a command, in whose words `SCENE`, `SPLIT` and so on are filled in. It has to end with one of these exit
    /// codes, in one line where it fails. Returns its output, errors last.
    fn ends(&mut self, words: &str, codes: &[i32]) -> String {
        self.ends_under("", words, codes)
    }

    /// Runs [`Attempt::ends`] under a limit of the shell, such as `ulimit -v 3000000`.
    fn ends_under(&mut self, limit: &str, words: &str, codes: &[i32]) -> String {
        let script = if limit.is_empty() {
            "exec \"$0\" \"$@\"".to_owned()
        } else {
            format!("{limit} && exec \"$0\" \"$@\"")
        };
        let begun = Instant::now();
        let seconds = LONGEST.as_secs().to_string();
        let output = Command::new("timeout")
            .args(["--signal=KILL", &seconds, "sh", "-c", &script])
            .arg(cargo_bin!("omnilife"))
            .arg("--quiet")
            .args(words.split(' ').map(|word| self.filled(word)))
            .current_dir(self.hostile.path(""))
            .env_remove("OMNILIFE_SFM_PYTHON")
            .env("OMNILIFE_DATA", "/nonexistent")
            .stdin(Stdio::null())
            .output()
            .unwrap();
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        let code = output.status.code();
        self.codes
            .push(code.map_or_else(|| "killed".to_owned(), |code| code.to_string()));
        self.expect(
            code.is_some_and(|code| codes.contains(&code)),
            &format!(
                "{words}: {code:?} after {:.1} s: {errors}",
                begun.elapsed().as_secs_f64()
            ),
        );
        let lines = errors.lines().count();
        self.expect(
            lines == usize::from(code != Some(0)),
            &format!("{words}: {lines} lines: {errors}"),
        );
        self.expect(!errors.contains("mistake of this program"), &errors);
        self.expect(
            !errors.contains('\u{1b}'),
            &format!("{words}: shows control characters"),
        );
        format!("{}{errors}", String::from_utf8_lossy(&output.stdout))
    }

    fn filled(&self, word: &str) -> String {
        let run = &small_run().out;
        let text = |path: &Path| path.to_str().unwrap().to_owned();
        match word {
            "DATASET" => text(run),
            "SEQUENCE" => text(&run.join(SEQUENCE)),
            "SCENE" => text(&run.join(SEQUENCE).join("scene.json")),
            "SPLIT" => text(&run.join(SEQUENCE).join("per-scene/split.json")),
            "RUN" => text(&run.join(METHOD).join("run")),
            "VIDEO" => text(&sample("street.mp4")),
            "POSES" => text(&sample("poses.json")),
            other => other.to_owned(),
        }
    }

    fn expect(&mut self, is_right: bool, fault: &str) {
        if !is_right {
            self.faults.push(fault.trim_end().to_owned());
        }
    }

    /// Expects that a file of the user still has its content.
    fn expect_kept(&mut self, name: &str, content: &[u8]) {
        let kept = self.hostile.read(name) == content;
        self.expect(kept, &format!("{name} is lost or changed"));
    }
}

#[test]
fn every_defect_that_was_found_stays_mended() {
    let Some(hostile) = Hostile::make() else {
        omnilife_schemas::testing::skip("there is no ffmpeg command that makes hostile videos");
        return;
    };
    let only = std::env::var("OMNILIFE_ONLY").ok();
    let mut wrong = Vec::new();
    println!("| defect | what | exit codes | wrong |\n|---|---|---|--:|");
    for defect in readers::DEFECTS.iter().chain(writers::DEFECTS) {
        if only.as_ref().is_some_and(|only| only != defect.id) {
            continue;
        }
        let mut attempt = Attempt {
            hostile: &hostile,
            codes: Vec::new(),
            faults: Vec::new(),
        };
        (defect.try_again)(&mut attempt);
        let Attempt { codes, faults, .. } = attempt;
        println!(
            "| {} | {} | {} | {} |",
            defect.id,
            defect.about,
            codes.join(" "),
            faults.len()
        );
        wrong.extend(
            faults
                .into_iter()
                .map(|fault| format!("{}: {fault}", defect.id)),
        );
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
