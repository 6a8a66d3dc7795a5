//! Killed training that resumes from its last checkpoint.

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    thread,
    time::{Duration, Instant, SystemTime},
};

use assert_cmd::cargo::cargo_bin;
use omnilife_schemas::{records::RunRecord, store};

use crate::support::{SEQUENCE, omnilife, scratch, small_run};

const ITERATIONS: &str = "150";

fn arguments(out: &Path) -> Vec<PathBuf> {
    let sequence = small_run().out.join(SEQUENCE);
    let mut arguments: Vec<PathBuf> = ["reconstruct", "train"].map(PathBuf::from).into();
    arguments.extend([sequence.join("scene.json"), "--split".into()]);
    arguments.extend([sequence.join("per-scene/split.json"), "--out".into()]);
    arguments.push(out.to_owned());
    arguments.extend(["--iterations", ITERATIONS].map(PathBuf::from));
    arguments.extend(["--checkpoint-every", "10"].map(PathBuf::from));
    arguments
}

fn start(out: &Path) -> Child {
    Command::new(cargo_bin!("omnilife"))
        .args(arguments(out))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// Returns the time at which the checkpoint was written; `None` without a checkpoint.
fn written(out: &Path) -> Option<SystemTime> {
    fs::metadata(out.join("checkpoint.bin"))
        .ok()?
        .modified()
        .ok()
}

/// Waits for a checkpoint later than `before`, and some time more.
fn wait_for_checkpoint(
    out: &Path,
    child: &mut Child,
    before: Option<SystemTime>,
    longer: Duration,
) {
    let deadline = Instant::now() + Duration::from_secs(120);
    while written(out) == before {
        assert!(Instant::now() < deadline, "no checkpoint in two minutes");
        assert!(child.try_wait().unwrap().is_none(), "it ended early");
        thread::sleep(Duration::from_millis(2));
    }
    thread::sleep(longer);
}

#[test]
#[cfg(unix)]
fn killed_twice_it_gives_the_gaussians_of_a_run_that_was_not() {
    let folder = scratch();
    let whole = folder.path().join("whole");
    omnilife(arguments(&whole)).succeeded();

    let killed = folder.path().join("killed");
    // On SIGTERM it writes a checkpoint of its present state and reports so; killed, it falls back to the last one.
    for (signal, longer, code) in [("-KILL", 13, None), ("-TERM", 31, Some(75))] {
        let before = written(&killed);
        let mut child = start(&killed);
        wait_for_checkpoint(&killed, &mut child, before, Duration::from_millis(longer));
        let id = child.id().to_string();
        let sent = Command::new("kill").args([signal, &id]).status().unwrap();
        assert!(sent.success());
        let ended = child.wait().unwrap();
        assert!(!ended.success(), "it was over before {signal}");
        assert_eq!(ended.code(), code, "{signal}");
        assert!(!killed.join("run.json").exists(), "no record of half a run");
    }
    let ended = omnilife(arguments(&killed)).succeeded();
    assert!(
        ended.stderr.contains("continued from the checkpoint"),
        "{}",
        ended.stderr
    );

    assert_eq!(
        fs::read(killed.join("gaussians.ply")).unwrap(),
        fs::read(whole.join("gaussians.ply")).unwrap()
    );
    assert!(!killed.join("checkpoint.bin").exists());
    let record: RunRecord = store::read_record(&killed.join("run.json")).unwrap();
    assert!(record.warnings[0].contains("continued from the checkpoint"));
}

/// On SIGTERM, a run of an external method ends everything that the method has started.
#[test]
#[cfg(unix)]
fn programs_of_others_end_with_the_process() {
    let folder = scratch();
    let at = |name: &str| folder.path().join(name);
    let manifest = "id = \"parent\"\n[render]\ncommand = [\"sh\", \"-c\", \
                    \"(sleep 3; touch {work}/late) & touch {work}/begun; wait\"]\n\
                    [predictions]\nnovel = \"{work}/{frame}.png\"\n";
    fs::write(at("method.toml"), manifest).unwrap();
    let sequence = small_run().out.join(SEQUENCE);
    let child = Command::new(cargo_bin!("omnilife"))
        .args(["--quiet", "bench", "external"])
        .arg(at("method.toml"))
        .arg("--scene")
        .arg(sequence.join("scene.json"))
        .arg("--split")
        .arg(sequence.join("per-scene/split.json"))
        .arg("--out")
        .arg(at("run"))
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let deadline = Instant::now() + Duration::from_secs(60);
    while !at("run/work/begun").exists() {
        assert!(Instant::now() < deadline, "it has not begun in a minute");
        thread::sleep(Duration::from_millis(10));
    }
    let id = child.id().to_string();
    let sent = Command::new("kill").args(["-TERM", &id]).status().unwrap();
    assert!(sent.success());
    let ended = child.wait_with_output().unwrap();
    assert!(!ended.status.success());
    let stderr = String::from_utf8(ended.stderr).unwrap();
    assert!(stderr.contains("run the same command again"), "{stderr}");
    thread::sleep(Duration::from_secs(4));
    assert!(!at("run/work/late").exists());
}
