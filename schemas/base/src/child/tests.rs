//! Programs that end well and badly, as shell scripts in a folder.
#![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

use std::{collections::BTreeMap, fs, os::unix::fs::PermissionsExt, path::PathBuf};

use tempfile::TempDir;

use super::*;
use crate::process::Stat;

const GRACE_HERE: Duration = Duration::from_millis(300);

/// `detached FILE`: an orphan with a session of its own, whose id is written to the file.
const DETACHED: &str = r#"detached() {
  (setsid sh -c 'echo $$ > "$0.new"; mv "$0.new" "$0"; exec sleep 300' "$1" > /dev/null 2>&1 &)
  while ! test -e "$1"; do sleep 0.01; done
  # By this name it is reported.
  until test "$(cat "/proc/$(cat "$1")/comm")" = sleep; do sleep 0.01; done
}
"#;

struct Folder(TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Starts a script in the folder.
    fn begin(&self, script: &str) -> ProcessGroup {
        let mut command = Command::new("sh");
        command.args(["-c", &format!("{DETACHED}{script}")]);
        ProcessGroup::spawn(command.current_dir(self.0.path()), None).unwrap()
    }

    /// Returns the id that a script writes to a file.
    fn id(&self, name: &str) -> u32 {
        let file = self.at(name);
        wait_for(&file);
        fs::read_to_string(file).unwrap().trim().parse().unwrap()
    }
}

fn wait_for(file: &Path) {
    let begun = Instant::now();
    while !file.exists() {
        assert!(
            begun.elapsed() < Duration::from_secs(20),
            "{}",
            file.display()
        );
        thread::sleep(Duration::from_millis(5));
    }
}

fn wait_for_end(group: &mut ProcessGroup) -> ExitStatus {
    group.wait().unwrap().status
}

/// Returns true for a process that neither runs nor is a zombie.
fn is_gone(id: u32) -> bool {
    Stat::of(id).is_none()
}

/// Waits for the end of a killed process, which takes a moment on a busy machine.
fn ends(id: u32) -> bool {
    let begun = Instant::now();
    while process::is_running(id) {
        if begun.elapsed() > Duration::from_secs(10) {
            return false;
        }
        thread::sleep(Duration::from_millis(10));
    }
    true
}

#[test]
fn children_in_any_session_end_with_their_program() {
    let folder = Folder::new();
    let script = |name: &str, rest: &str| {
        format!("detached own-{name}; sleep 300 & echo $! > plain-{name}; touch {name}; {rest}")
    };
    let mut itself = folder.begin(&script("itself", "exit 3"));
    let mut limited = folder.begin(&script("limited", "wait"));
    let dropped = folder.begin(&script("dropped", "wait"));

    assert_eq!(wait_for_end(&mut itself).code(), Some(3));
    let left = itself.end(GRACE_HERE);
    assert_eq!(left.ended.len(), 2, "{left:?}");
    for file in ["own-itself", "plain-itself"] {
        let name = format!("sleep (process {})", folder.id(file));
        assert!(left.ended.contains(&name), "{left:?}");
    }
    assert!(left.running.is_empty(), "{left:?}");

    wait_for(&folder.at("limited"));
    assert_eq!(limited.end(GRACE_HERE), Leftovers::default());
    wait_for(&folder.at("dropped"));
    drop(dropped);
    for name in ["itself", "limited", "dropped"] {
        for kind in ["own", "plain"] {
            let file = format!("{kind}-{name}");
            assert!(is_gone(folder.id(&file)), "{file}");
        }
    }
}

/// Helpers that see the end of their program are not reported, and leave nothing in the list of processes.
#[test]
fn what_ends_by_itself_soon_is_not_left() {
    let folder = Folder::new();
    let mut group = folder.begin(
        "(setsid sh -c 'echo $$ > early.new; mv early.new early' &); \
         while ! test -e early; do sleep 0.01; done; sleep 0.1; sleep 0.1 & exit 0",
    );
    assert!(wait_for_end(&mut group).success());
    assert_eq!(group.end(GRACE_HERE), Leftovers::default());
    assert!(is_gone(folder.id("early")));
}

#[test]
fn a_program_may_put_things_in_order() {
    let folder = Folder::new();
    let mut group = folder.begin(
        "trap 'sleep 0.2; echo saved > saved; exit 0' TERM; touch ready; \
         while :; do sleep 0.02; done",
    );
    wait_for(&folder.at("ready"));
    let begun = Instant::now();
    assert_eq!(group.end(Duration::from_secs(10)), Leftovers::default());
    assert!(begun.elapsed() < Duration::from_secs(5), "no longer");
    assert_eq!(
        fs::read_to_string(folder.at("saved")).unwrap().trim(),
        "saved"
    );
    assert!(group.wait().unwrap().status.success());
}

#[test]
fn one_that_will_not_end_is_killed() {
    let folder = Folder::new();
    let mut group = folder.begin(
        "trap '' TERM; detached own; echo $$ > ready.new; mv ready.new ready; \
         while :; do sleep 0.02; done",
    );
    let id = folder.id("ready");
    let begun = Instant::now();
    let left = group.end(GRACE_HERE);
    assert!(begun.elapsed() >= GRACE_HERE);
    assert!(left.ended.contains(&format!("sh (process {id})")));
    assert!(left.running.is_empty(), "{left:?}");
    assert!(!group.wait().unwrap().status.success());
    assert!(is_gone(folder.id("own")));
}

/// A process that a nested program has marked once more belongs to both programs.
#[test]
fn one_of_two_programs_ends_without_what_the_other_has_left() {
    let folder = Folder::new();
    let mut first = folder.begin(
        "OMNILIFE_JOB=$OMNILIFE_JOB:9-9; export OMNILIFE_JOB; detached one; touch first; sleep 300",
    );
    let mut second = folder.begin("detached two; touch second; exit 0");
    assert!(wait_for_end(&mut second).success());
    wait_for(&folder.at("first"));
    let (one, two) = (folder.id("one"), folder.id("two"));
    assert_eq!(first.end(GRACE_HERE), Leftovers::default());
    assert!(is_gone(one));
    assert!(process::is_running(two));
    let left = second.end(GRACE_HERE);
    assert_eq!(left.ended, [format!("sleep (process {two})")]);
    assert!(is_gone(two));
}

/// Stand-in for a runtime. Its containers are orphans without a mark, and its client does not end when it is asked
/// to. `kill` of the container `stuck` fails.
const RUNTIME: &str = r#"#!/bin/sh
cd "$(dirname "$0")" || exit 1
case $1 in
run)
  trap '' TERM
  (env -i PATH="$PATH" setsid sh -c 'echo $$ > "$0.new"; mv "$0.new" "$0"; exec sleep 300' \
    "$2" > /dev/null 2>&1 &)
  while ! test -e "$2"; do sleep 0.01; done
  test "$3" = fail && { echo broken; exit 4; }
  while :; do sleep 0.02; done ;;
kill)
  test "$2" = stuck && { echo "cannot connect to the daemon" >&2; exit 1; }
  test -e "$2" || { echo "No such container: $2" >&2; exit 1; }
  kill -KILL "$(cat "$2")" ;;
esac
"#;

fn outcome_of(folder: &Folder, name: &str, how: &str) -> Outcome {
    let runtime = folder.at("runtime");
    fs::write(&runtime, RUNTIME).unwrap();
    fs::set_permissions(&runtime, fs::Permissions::from_mode(0o755)).unwrap();
    let runtime = runtime.to_str().unwrap().to_owned();
    let container = Container {
        runtime: runtime.clone(),
        name: name.to_owned(),
    };
    run(&Job {
        command: [runtime.as_str(), "run", name, how]
            .map(str::to_owned)
            .into(),
        variables: BTreeMap::new(),
        folder: folder.0.path().to_owned(),
        log: folder.at(&format!("{name}.log")),
        time_limit: Some(Duration::from_secs(1)),
        grace: GRACE_HERE,
        container: Some(container),
    })
    .unwrap()
}

#[test]
fn containers_end_by_their_names() {
    let folder = Folder::new();
    let begun = Instant::now();
    let limited = outcome_of(&folder, "limited", "wait");
    let seconds = begun.elapsed().as_secs_f64() - limited.wall_seconds;
    assert!(
        seconds >= GRACE_HERE.as_secs_f64(),
        "its end counts as its time"
    );
    assert!(!limited.succeeded);
    assert_eq!(limited.ending, "the time limit of 1 s");
    let of_container = |what: &&String| what.contains("container");
    let containers: Vec<_> = limited.left_running.iter().filter(of_container).collect();
    assert_eq!(containers, ["container limited"]);
    assert!(ends(folder.id("limited")));

    let failed = outcome_of(&folder, "failed", "fail");
    assert_eq!(failed.failure(), "ended with exit 4: broken");
    assert_eq!(failed.left_running, ["container failed"]);
    assert!(ends(folder.id("failed")));

    // A container that cannot be ended is reported, in the ending too.
    let stuck = outcome_of(&folder, "stuck", "fail");
    assert!(stuck.ending.contains("container stuck"), "{stuck:?}");
    assert!(stuck.ending.contains("cannot connect to the daemon"));
    assert_eq!(stuck.left_running.len(), 1);
    let id = i32::try_from(folder.id("stuck")).unwrap();
    let id = nix::unistd::Pid::from_raw(id);
    nix::sys::signal::kill(id, nix::sys::signal::Signal::SIGKILL).unwrap();
}
