//! Methods in containers, with a stand-in for the runtime. Its containers are orphans, and its client passes no
//! signal on.

use std::{
    fs,
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use assert_cmd::cargo::cargo_bin;
use omnilife_schemas::{process, records::ExternalRun, store};
use tempfile::TempDir;

use crate::support::{SEQUENCE, scratch, small_run};

const RUNTIME: &str = r#"#!/bin/sh
here=$(cd "$(dirname "$0")" && pwd)
case $1 in
run)
  while test "$1" != --name; do shift; done
  (env -i PATH="$PATH" setsid sh -c 'echo $$ > "$0.new"; mv "$0.new" "$0"; exec sleep 300' \
    "$here/$2.container" > /dev/null 2>&1 &)
  while :; do sleep 0.05; done ;;
kill)
  kill -KILL "$(cat "$here/$2.container")" ;;
esac
"#;

struct Method(TempDir);

impl Method {
    fn new(options: &str, limit: &str) -> Self {
        let method = Self(scratch());
        let runtime = method.at("runtime");
        fs::write(&runtime, RUNTIME).unwrap();
        fs::set_permissions(&runtime, fs::Permissions::from_mode(0o755)).unwrap();
        let manifest = format!(
            "id = \"contained\"\n{limit}\n[environment]\nkind = \"container\"\nimage = \"image\"\n\
             runtime = {:?}\noptions = {options}\n[render]\ncommand = [\"render\"]\n\
             [predictions]\nnovel = \"{{work}}/{{frame}}.png\"\n",
            runtime.display().to_string()
        );
        fs::write(method.at("method.toml"), manifest).unwrap();
        method
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Returns `bench external` on the sample.
    fn command(&self) -> Command {
        let sequence = small_run().out.join(SEQUENCE);
        let mut command = Command::new(cargo_bin!("omnilife"));
        command
            .args(["--quiet", "bench", "external"])
            .arg(self.at("method.toml"))
            .arg("--scene")
            .arg(sequence.join("scene.json"))
            .arg("--split")
            .arg(sequence.join("per-scene/split.json"))
            .arg("--out")
            .arg(self.at("run"))
            .stdout(Stdio::null());
        command
    }

    /// Returns the file of the only container that was started, once there is one.
    fn container(&self) -> Option<PathBuf> {
        let entries = fs::read_dir(self.0.path()).unwrap();
        let mut paths = entries.map(|entry| entry.unwrap().path());
        paths.find(|path| {
            path.extension()
                .is_some_and(|extension| extension == "container")
        })
    }
}

fn is_running(container: &Path) -> bool {
    let id = fs::read_to_string(container).unwrap();
    process::is_running(id.trim().parse().unwrap())
}

#[test]
fn a_container_ends_at_the_time_limit() {
    for (options, name) in [
        ("[\"--gpus\", \"all\"]", None),
        ("[\"--name=of-mine\", \"--name\", \"mine\"]", Some("mine")),
    ] {
        let method = Method::new(options, "time_limit_seconds = 1");
        method.command().status().unwrap();
        let run: ExternalRun = store::read_record(&method.at("run/external-run.json")).unwrap();
        let failure = run.failure.unwrap();
        assert!(failure.contains("the time limit of 1 s"), "{failure}");
        let phase = &run.phases[0];
        assert!(phase.command.iter().any(|word| word == "--init"));
        let is_name = |word: &&String| word.starts_with("--name");
        assert_eq!(
            phase.command.iter().filter(is_name).count(),
            name.map_or(1, |_| 2),
            "{:?}",
            phase.command
        );
        let place = phase.command.iter().rposition(|word| word == "--name");
        let given = &phase.command[place.unwrap() + 1];
        assert!(name.map_or(given.starts_with("omnilife-"), |name| given == name));
        assert_eq!(phase.left_running, [format!("container {given}")]);
        assert_eq!(run.warnings.len(), 1, "{:?}", run.warnings);
        assert!(!is_running(&method.container().unwrap()));
    }
}

#[test]
fn a_container_ends_when_the_process_is_told_to() {
    let method = Method::new("[]", "");
    let mut child = method.command().spawn().unwrap();
    let deadline = Instant::now() + Duration::from_secs(60);
    let container = loop {
        if let Some(container) = method.container() {
            break container;
        }
        assert!(Instant::now() < deadline, "it has not begun in a minute");
        thread::sleep(Duration::from_millis(10));
    };
    assert!(is_running(&container));
    let id = child.id().to_string();
    let sent = Command::new("kill").args(["-TERM", &id]).status().unwrap();
    assert!(sent.success());
    assert!(!child.wait().unwrap().success());
    assert!(!is_running(&container));
}
