//! Job arrays on a real Slurm: two nodes on this machine, `scripts/slurm-test-cluster`.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::{Command, Output},
    thread,
    time::{Duration, Instant},
};

use omnilife_schemas::{
    records::{Direction, ResultRecord, Summary},
    store,
};
use tempfile::TempDir;

use crate::support::{Shell, lines, succeeded, wait_for};

/// Cluster that ends with the test.
struct Cluster(TempDir);

fn cluster_script(command: &str, folder: &Path) -> Output {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/slurm-test-cluster");
    Command::new(script)
        .arg(command)
        .arg(folder)
        .output()
        .unwrap()
}

impl Cluster {
    /// Starts a cluster; returns `None`, with the reason printed, where that is impossible.
    fn up() -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let check = cluster_script("check", folder.path());
        if !check.status.success() {
            omnilife_schemas::testing::skip(String::from_utf8_lossy(&check.stderr).trim());
            return None;
        }
        let cluster = Self(folder);
        succeeded(cluster_script("up", cluster.0.path()));
        Some(cluster)
    }

    fn configuration(&self) -> PathBuf {
        self.0.path().join("slurm.conf")
    }

    /// Returns the output of a program of Slurm.
    fn says(&self, program: &str, arguments: &[&str]) -> String {
        let mut command = Command::new(program);
        command
            .args(arguments)
            .env("SLURM_CONF", self.configuration());
        succeeded(command.output().unwrap())
    }

    /// Runs `omnilife sweep submit SWEEP --slurm <options>`.
    fn submit(&self, shell: &Shell, options: &[&str]) -> String {
        let sweep = shell.sweep();
        let mut arguments = vec!["sweep", "submit", sweep.as_str(), "--slurm"];
        arguments.extend(options);
        let mut command = shell.command(&arguments);
        command.env("SLURM_CONF", self.configuration());
        succeeded(command.output().unwrap())
    }

    /// Waits until the queue is empty. Requeued jobs start soon instead of in two minutes, but not at once, because
    /// their node refuses jobs that it has ended a second ago.
    fn drain(&self) {
        const PAUSE: Duration = Duration::from_secs(3);
        let mut seen: BTreeMap<String, Instant> = BTreeMap::new();
        wait_for("an empty queue", Duration::from_secs(120), || {
            let jobs = self.says("squeue", &["--noheader", "--array", "--format=%i %r"]);
            for line in jobs.lines().filter(|line| line.ends_with(" BeginTime")) {
                let job = line.split(' ').next().unwrap().to_owned();
                if seen
                    .entry(job.clone())
                    .or_insert_with(Instant::now)
                    .elapsed()
                    > PAUSE
                {
                    // It may have started since.
                    let mut release = Command::new("scontrol");
                    release.args(["update", &format!("JobId={job}"), "StartTime=now"]);
                    release.env("SLURM_CONF", self.configuration());
                    drop(release.output().unwrap());
                }
            }
            jobs.trim().is_empty()
        });
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        let ended = cluster_script("down", self.0.path());
        if thread::panicking() || !ended.status.success() {
            for log in ["slurmctld.log", "slurmd-n1.log"] {
                let last = lines(&self.0.path().join(log));
                println!("{log}: {:#?}", &last[last.len().saturating_sub(20)..]);
            }
        }
    }
}

fn result(scene: usize) -> ResultRecord {
    let score = Summary {
        mean: 20.0 + scene as f64 / 7.0,
        views: 12,
        direction: Some(Direction::HigherIsBetter),
        standard_deviation: None,
        undefined_views: 0,
    };
    ResultRecord {
        scene_sha256: store::sha256_bytes(&[scene as u8]),
        protocol: "per-scene/1".to_owned(),
        protocol_hash: "a34df006b285".repeat(5) + "a34d",
        scored_size: [512, 256],
        novel_views: [("psnr".to_owned(), score)].into(),
        training_seconds: Some(61.25),
        primitives: Some(1000),
        iterations: Some(3000),
        seed: Some(0),
        ..ResultRecord::new("odgs", &format!("place-{scene}/seq-000"))
    }
}

const SCENES: usize = 19;
/// Scene whose result is missing at first.
const BROKEN: usize = 7;

/// Scene whose node goes down.
const SLOW: usize = 3;

/// Plans units that each copy one result slowly, and record how many run meanwhile.
fn study() -> Shell {
    let folder = tempfile::tempdir().unwrap();
    for scene in (0..SCENES).filter(|&scene| scene != BROKEN) {
        let file = folder.path().join(format!("made-{scene}.json"));
        store::write_record(&file, &result(scene)).unwrap();
    }
    let commands: Vec<String> = (0..SCENES)
        .map(|scene| {
            format!(
                "touch on-{scene}; ls on-* | wc -l >> at-once; \
                 if test {scene} = {SLOW} && ! test -e slow; then touch slow; sleep 30; fi; \
                 sleep 0.3; rm on-{scene}; \
                 mkdir -p results/{scene} && cp made-{scene}.json results/{scene}/result.json"
            )
        })
        .collect();
    let binary = assert_cmd::cargo::cargo_bin!("omnilife");
    let reduce = format!(
        "{} leaderboard build results --out board --no-site",
        binary.display()
    );
    let options = ["--unit-memory", "0.25", "--reduce", &reduce];
    Shell::planned_in(folder, &commands, &options)
}

fn table(shell: &Shell) -> String {
    fs::read_to_string(shell.path("board/table.md")).unwrap()
}

fn mend(shell: &Shell) {
    let file = shell.path(&format!("made-{BROKEN}.json"));
    store::write_record(&file, &result(BROKEN)).unwrap();
}

#[test]
fn job_arrays_do_what_a_local_run_does() {
    let Some(cluster) = Cluster::up() else {
        return;
    };
    let shell = study();

    // Planned submission: chunks below MaxArraySize, which is 9.
    let planned = cluster.submit(&shell, &["--dry-run"]);
    let sizes: Vec<&str> = planned.lines().map(|line| &line[..14]).collect();
    assert_eq!(
        sizes,
        ["array: 9 units", "array: 9 units", "array: 1 unit,"]
    );
    assert!(planned.contains("each 1 core, 256 MiB"), "{planned}");

    // A throttle of three, and a node that goes down in the middle: its units run again.
    let submitted = cluster.submit(&shell, &["--throttle", "3"]);
    assert!(
        submitted.contains("reduces when all is over"),
        "{submitted}"
    );
    let again = cluster.submit(&shell, &[]);
    assert!(
        again.contains("in the queue already: ") && again.contains("nothing to submit"),
        "{again}"
    );
    wait_for("the slow unit", Duration::from_secs(60), || {
        shell.path("slow").exists()
    });
    let running = cluster.says("squeue", &["--noheader", "--array", "--format=%K %N"]);
    let node = running
        .lines()
        .find_map(|line| line.strip_prefix(&format!("{SLOW} n")))
        .unwrap();
    let node = format!("NodeName=n{node}");
    cluster.says("scontrol", &["update", &node, "State=DOWN", "Reason=test"]);
    cluster.drain();
    let rows = shell.rows();
    for (scene, [unit, state, reason]) in rows.iter().enumerate() {
        let expected = if scene == BROKEN { "failed" } else { "done" };
        assert_eq!(state, expected, "{unit}: {reason}");
    }
    assert!(
        rows[BROKEN][2].contains("made-7.json"),
        "{}",
        rows[BROKEN][2]
    );
    let most = lines(&shell.path("at-once"))
        .iter()
        .map(|line| line.trim().parse::<usize>().unwrap())
        .max();
    // Units that were ended with their node left their marks for a while.
    assert!(most <= Some(5), "{most:?}");
    let again = format!("sweep/units/line-{:05}/attempt-2.log", SLOW + 1);
    assert!(shell.path(&again).exists(), "it ran again");

    // Resubmission has the missing units alone.
    assert!(cluster.submit(&shell, &[]).contains("nothing to submit"));
    mend(&shell);
    succeeded(shell.run("retry", &[]));
    let resubmitted = cluster.submit(&shell, &[]);
    assert!(resubmitted.contains(": 1 unit,"), "{resubmitted}");
    cluster.drain();
    assert_eq!(shell.count("done"), SCENES);

    // The reduction gives the table of a run on one machine.
    let local = study();
    mend(&local);
    fs::write(local.path("slow"), "").unwrap();
    succeeded(local.run("run", &["--cores", "4"]));
    succeeded(local.run("reduce", &[]));
    assert_eq!(table(&shell), table(&local));

    told_to_end_a_task_goes_on_later(&cluster);
}

/// Slurm's own signal before a job's time is up: here 90 s before the end of 2 minutes.
fn told_to_end_a_task_goes_on_later(cluster: &Cluster) {
    let unit = "if test -e saved; then cp saved result; exit; fi; \
                trap 'echo half > saved; exit 75' TERM; touch begun; \
                while :; do sleep 0.05; done";
    let shell = Shell::planned(&[unit.to_owned()], &["--unit-memory", "0.25"]);
    let limit = ["--sbatch=--time=2", "--sbatch=--signal=B:USR1@90"];
    cluster.submit(&shell, &["--no-reduce", limit[0], limit[1]]);
    wait_for("the unit", Duration::from_secs(60), || {
        shell.path("begun").exists()
    });
    // Slurm looks at time limits every half minute.
    wait_for("its checkpoint", Duration::from_secs(120), || {
        shell.path("saved").exists()
    });
    cluster.drain();
    assert_eq!(shell.count("done"), 1);
    assert_eq!(lines(&shell.path("result")), ["half"]);
}
