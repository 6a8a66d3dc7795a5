//! Local pool: limits, failures, killed runners, overhead.

use std::{
    collections::BTreeMap,
    fs,
    process::{Child, Command},
    thread,
    time::{Duration, Instant},
};

use omnilife_schemas::{records::UnitOutcome, store};

use crate::support::{Shell, lines, succeeded, wait_for};

fn signal(child: &Child, name: &str) {
    let id = child.id().to_string();
    assert!(
        Command::new("kill")
            .args([name, &id])
            .status()
            .unwrap()
            .success()
    );
}

/// Returns pseudorandom numbers, the same in every run.
fn scattered(count: u32) -> impl Iterator<Item = u64> {
    (0..count).scan(0x2545_f491_4f6c_dd1d_u64, |state, _| {
        *state ^= *state << 13;
        *state ^= *state >> 7;
        *state ^= *state << 17;
        Some(*state)
    })
}

#[test]
fn failures_are_rows_with_reasons_and_can_be_retried() {
    let commands = [
        "echo fine",
        "test -e mended || { echo \"no part <b>2</b>\" >&2; exit 3; }",
        "kill -9 $$",
        "sleep 30",
    ];
    let shell = Shell::planned(&commands.map(str::to_owned), &["--unit-limit", "1"]);
    assert_eq!(shell.count("missing"), 4);

    let ended = shell.run("run", &["--cores", "4"]);
    assert_eq!(ended.status.code(), Some(1));
    let said = String::from_utf8(ended.stderr).unwrap();
    assert!(said.contains("3 of 4 units failed, the first: "), "{said}");
    let reasons: BTreeMap<String, String> = shell
        .rows()
        .into_iter()
        .map(|[unit, state, reason]| (unit, format!("{state} {reason}")))
        .collect();
    assert_eq!(reasons["line-00001"], "done ");
    assert_eq!(reasons["line-00002"], "failed sh: exit 3: no part <b>2</b>");
    assert_eq!(reasons["line-00003"], "failed sh: signal 9");
    assert_eq!(
        reasons["line-00004"],
        "failed ended at its time limit of 1 s"
    );

    // Failed units are left alone until a retry is requested.
    fs::write(shell.path("mended"), "").unwrap();
    assert_eq!(shell.run("run", &[]).status.code(), Some(1));
    succeeded(shell.run("retry", &["line-00002"]));
    assert_eq!(shell.count("missing"), 1);
    assert_eq!(shell.run("run", &[]).status.code(), Some(1));
    assert_eq!(shell.count("done"), 2);
    assert_eq!(shell.run("retry", &["line-00001"]).status.code(), Some(2));
    succeeded(shell.run("retry", &[]));
    assert_eq!(shell.count("missing"), 2);
    let attempts = shell.path("sweep/units/line-00002/attempt-2.log");
    assert!(attempts.exists(), "the logs of all attempts stay");
}

#[test]
fn no_more_run_at_once_than_cores_and_memory_allow() {
    // Every unit writes the number of running units.
    let line = "touch on-$$; ls on-* | wc -l >> at-once; sleep 0.15; rm on-$$".to_owned();
    for (options, most) in [
        (&["--cores", "3", "--memory", "64"][..], 3),
        (&["--cores", "3", "--memory", "4.5"], 2),
    ] {
        let shell = Shell::planned(&vec![line.clone(); 9], &["--unit-memory", "2"]);
        succeeded(shell.run("run", options));
        let counts: Vec<usize> = lines(&shell.path("at-once"))
            .iter()
            .map(|line| line.trim().parse().unwrap())
            .collect();
        assert_eq!(counts.len(), 9);
        // Once units were measured, more of them fit into the memory: a shell needs little.
        let early = if most == 3 { 9 } else { 2 };
        assert!(
            counts[..early].iter().all(|&count| count <= most),
            "{counts:?}"
        );
        assert!(counts.iter().all(|&count| count <= 3), "{counts:?}");
        assert!(counts.iter().any(|&count| count > 1), "{counts:?}");
    }
    let shell = Shell::planned(&[line], &["--unit-cores", "8"]);
    let ended = shell.run("run", &["--cores", "2"]);
    assert_eq!(ended.status.code(), Some(2));
    let said = String::from_utf8(ended.stdout).unwrap();
    assert!(
        said.contains("not begun: line-00001: needs 8 cores"),
        "{said}"
    );
    assert_eq!(shell.count("missing"), 1);
}

/// A runner is killed and restarted at scattered moments: no unit is lost, runs twice at a time, or is done twice.
#[test]
fn killed_runners_cost_no_more_than_their_running_units() {
    const UNITS: usize = 60;
    // A unit reports if it starts while another process of the same unit runs.
    let commands: Vec<String> = (0..UNITS)
        .map(|unit| {
            format!(
                "(flock -n 9 || echo {unit} >> clashes; sleep 0.1; echo {unit} >> finished) \
                 9> lock-{unit}"
            )
        })
        .collect();
    let shell = Shell::planned(&commands, &[]);
    let mut runner = shell.runner(&["--cores", "4"]);
    for number in scattered(14) {
        thread::sleep(Duration::from_millis(20 + number % 180));
        signal(&runner, "-KILL");
        runner.wait().unwrap();
        runner = shell.runner(&["--cores", "4"]);
    }
    runner.wait().unwrap();
    // A unit that was running at three of the kills is given up until a retry. Which ones those are, if any, depends
    // on timing.
    let rows = shell.rows();
    let failed: Vec<_> = rows.iter().filter(|row| row[1] == "failed").collect();
    assert_eq!(shell.count("done") + failed.len(), UNITS);
    for row in &failed {
        assert!(row[2].contains("given up after 3 runners"), "{row:?}");
    }
    if !failed.is_empty() {
        succeeded(shell.run("retry", &[]));
        succeeded(shell.run("run", &["--cores", "2"]));
    }
    assert_eq!(shell.count("done"), UNITS);
    assert_eq!(lines(&shell.path("clashes")), Vec::<String>::new());
    // A unit that was killed after its last command and before its record runs again: at most one per core and kill.
    let finished = lines(&shell.path("finished")).len();
    assert!((UNITS..=UNITS + 14 * 4).contains(&finished), "{finished}");
    for unit in fs::read_dir(shell.path("sweep/units")).unwrap() {
        let names = fs::read_dir(unit.unwrap().path()).unwrap();
        let names = names.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let left: Vec<String> = names
            .filter(|name| name == "running.json" || name.starts_with('.'))
            .collect();
        assert_eq!(left, Vec::<String>::new());
    }
}

#[test]
fn a_unit_that_kills_its_runners_is_given_up() {
    // The parent of a unit's process is its runner.
    let shell = Shell::planned(
        &["kill -9 $PPID; sleep 5".to_owned(), "true".to_owned()],
        &[],
    );
    let killed = (0..5)
        .filter(|_| !shell.runner(&["--cores", "1"]).wait().unwrap().success())
        .count();
    assert!((3..=5).contains(&killed), "{killed}");
    let rows = shell.rows();
    assert_eq!(rows[0][1], "failed");
    let reason = &rows[0][2];
    assert!(
        reason.starts_with("given up after 3 runners: its runner went away"),
        "{reason}"
    );
    assert_eq!(rows[1][1], "done", "and the others are done");
}

/// On SIGTERM, a runner signals its units, waits for their checkpoints, and leaves them to be done.
#[test]
fn told_to_end_a_runner_lets_units_save_their_work() {
    let unit = "if test -e saved; then cp saved result; exit; fi; \
                trap 'sleep 0.3; echo half > saved; exit 75' TERM; touch begun; \
                while :; do sleep 0.05; done";
    let shell = Shell::planned(&[unit.to_owned()], &[]);
    let mut runner = shell.runner(&[]);
    wait_for("the unit", Duration::from_secs(20), || {
        shell.path("begun").exists()
    });
    assert_eq!(shell.count("running"), 1);
    signal(&runner, "-TERM");
    assert_eq!(runner.wait().unwrap().code(), Some(75));
    assert_eq!(shell.count("missing"), 1);
    assert!(shell.path("saved").exists());
    succeeded(shell.run("run", &[]));
    assert_eq!(lines(&shell.path("result")), ["half"]);
}

/// The next attempt waits until everything that a killed runner's unit has started is gone.
#[test]
fn what_a_killed_runner_has_left_is_waited_for() {
    let unit = "if test -e begun; then test -e late && touch after; exit; fi; \
                setsid sh -c 'touch begun; sleep 1; touch late' & wait; sleep 30";
    let shell = Shell::planned(&[unit.to_owned()], &[]);
    let mut runner = shell.runner(&[]);
    wait_for("the unit", Duration::from_secs(20), || {
        shell.path("begun").exists()
    });
    signal(&runner, "-KILL");
    runner.wait().unwrap();
    assert_eq!(shell.count("running"), 1, "its grandchild is there");
    succeeded(shell.run("run", &[]));
    assert!(shell.path("after").exists());
}

/// The next unit must not share the machine with leftovers of another.
#[test]
fn what_a_unit_leaves_running_is_ended_and_told() {
    let unit = "setsid sh -c 'echo $$ > own; exec sleep 300' & \
                while ! test -s own; do sleep 0.01; done";
    let shell = Shell::planned(&[unit.to_owned()], &[]);
    let ended = shell.run("run", &[]);
    let said = String::from_utf8_lossy(&ended.stderr).into_owned() + &succeeded(ended);
    let own = lines(&shell.path("own"))[0].parse().unwrap();
    assert!(!omnilife_schemas::process::is_running(own));
    let left = format!("sleep (process {own})");
    assert!(said.contains(&left), "{said}");
    let record = shell.path("sweep/units/line-00001/done.json");
    let outcome: UnitOutcome = store::read_record(&record).unwrap();
    assert_eq!(outcome.left_running, [left]);
}

#[test]
fn a_second_runner_is_told_who_runs_the_sweep() {
    let unit = "touch begun; while ! test -e enough; do sleep 0.05; done";
    let shell = Shell::planned(&[unit.to_owned()], &[]);
    let mut runner = shell.runner(&[]);
    wait_for("the unit", Duration::from_secs(20), || {
        shell.path("begun").exists()
    });
    let second = shell.run("run", &[]);
    assert_eq!(second.status.code(), Some(2));
    let said = String::from_utf8(second.stderr).unwrap();
    let by = format!("is run by process {} on ", runner.id());
    assert!(said.contains(&by) && said.lines().count() == 1, "{said}");
    fs::write(shell.path("enough"), "").unwrap();
    assert!(runner.wait().unwrap().success());
    assert_eq!(shell.count("done"), 1);
}

/// A task of a job array leaves a unit alone that a pool runs, and finds it done afterwards.
#[test]
fn a_task_waits_for_a_unit_that_is_run() {
    let unit = "echo once >> runs; touch begun; while ! test -e enough; do sleep 0.05; done";
    let shell = Shell::planned(&[unit.to_owned()], &[]);
    let mut runner = shell.runner(&[]);
    wait_for("the unit", Duration::from_secs(20), || {
        shell.path("begun").exists()
    });
    fs::write(shell.path("list"), "line-00001\n").unwrap();
    let list = shell.path("list");
    let task = ["--list", list.to_str().unwrap(), "--line", "0"];
    let early = succeeded(shell.run("run", &[&task[..], &["--no-wait"]].concat()));
    assert!(early.contains("1 by others"), "{early}");
    let mut waiting = shell.runner(&task);
    fs::write(shell.path("enough"), "").unwrap();
    assert!(runner.wait().unwrap().success() && waiting.wait().unwrap().success());
    assert_eq!(lines(&shell.path("runs")), ["once"]);
}

#[test]
fn a_record_that_cannot_be_read_is_one_bad_unit() {
    let shell = Shell::planned(&["true".to_owned(), "true".to_owned()], &[]);
    succeeded(shell.run("run", &[]));
    let record = shell.path("sweep/units/line-00001/done.json");
    fs::write(&record, "").unwrap();
    let rows = shell.rows();
    assert_eq!(rows[0][1], "failed");
    assert!(rows[0][2].contains("done.json"), "{}", rows[0][2]);
    assert_eq!(rows[1][1], "done");
    let again = shell.run("run", &[]);
    assert_eq!(again.status.code(), Some(1), "it says so");
    succeeded(shell.run("retry", &["line-00001"]));
    succeeded(shell.run("run", &[]));
    assert_eq!(shell.count("done"), 2);
}

#[test]
fn status_writes_nothing() {
    let shell = Shell::planned(&["true".to_owned(), "false".to_owned()], &[]);
    assert_eq!(shell.run("run", &[]).status.code(), Some(1));
    assert!(shell.path("sweep/units.csv").exists(), "the run leaves it");
    fs::remove_file(shell.path("sweep/units.csv")).unwrap();
    let state = || {
        let mut all = Vec::new();
        let mut folders = vec![shell.path("sweep")];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(&folder).unwrap() {
                let entry = entry.unwrap();
                let modified = entry.metadata().unwrap().modified().unwrap();
                all.push((entry.path(), modified));
                if entry.path().is_dir() {
                    folders.push(entry.path());
                }
            }
        }
        all.sort();
        all
    };
    let before = state();
    succeeded(shell.run("status", &["--units"]));
    assert_eq!(shell.count("failed"), 1);
    let printed = succeeded(shell.run("status", &["--json"]));
    let status: serde_json::Value = serde_json::from_str(&printed).unwrap();
    assert_eq!(status["failed"], 1);
    let units = status["units"].as_array().unwrap();
    assert!(
        units.iter().any(|unit| unit["state"] == "failed"),
        "{status}"
    );
    assert_eq!(state(), before);
}

#[test]
fn times_that_no_job_has_are_refused_in_one_line() {
    let shell = Shell::planned(&["true".to_owned()], &[]);
    for option in ["--minutes", "--signal-before"] {
        let number = u64::MAX.to_string();
        let ended = shell.run("submit", &["--slurm", "--dry-run", option, &number]);
        assert_eq!(ended.status.code(), Some(2));
        let said = String::from_utf8(ended.stderr).unwrap();
        assert!(said.contains(option) && said.lines().count() == 1, "{said}");
    }
}

#[test]
fn changed_inputs_and_lost_outputs_make_a_unit_missing() {
    // Plans of commands have no inputs: the record is given one.
    let shell = Shell::planned(&["cp input output".to_owned()], &[]);
    fs::write(shell.path("input"), "one").unwrap();
    succeeded(shell.run("run", &[]));
    let again = succeeded(shell.run("run", &[]));
    assert!(again.starts_with("1 done (0 here)"), "{again}");
    let record = shell.path("sweep/units/line-00001/done.json");
    let text = fs::read_to_string(&record).unwrap();
    let hash = store::sha256_bytes(b"one");
    let path = shell.path("input");
    let input = format!(
        "\"inputs\": [{{\"file\": {path:?}, \"bytes\": 3, \"modified_nanoseconds\": 1, \
         \"sha256\": {hash:?}}}]"
    );
    fs::write(&record, text.replace("\"inputs\": []", &input)).unwrap();
    assert_eq!(shell.count("done"), 1, "another time, the same content");
    fs::write(&path, "two").unwrap();
    let rows = shell.rows();
    assert_eq!(rows[0][1], "missing");
    assert!(
        rows[0][2].contains("input: has changed since"),
        "{}",
        rows[0][2]
    );
    let reduced = shell.run("reduce", &[]);
    let told = String::from_utf8_lossy(&reduced.stderr).into_owned();
    assert!(
        told.contains("have to be done again") && told.contains("line-00001"),
        "{told}"
    );
    succeeded(shell.run("run", &[]));
    assert_eq!(fs::read_to_string(shell.path("output")).unwrap(), "two");
    let reduced = shell.run("reduce", &[]);
    assert!(!String::from_utf8_lossy(&reduced.stderr).contains("done again"));
}

/// Returns wall-clock and CPU seconds of a command and its children. CPU time is read from the shell, which prints
/// that of its children as `0m1.234s 0m0.567s`.
fn seconds_of(shell: &Shell, command: &str) -> [f64; 2] {
    let begun = Instant::now();
    let output = Command::new("bash")
        .args(["-c", &format!("{command} > /dev/null && times")])
        .current_dir(shell.path(""))
        .output()
        .unwrap();
    let wall = begun.elapsed().as_secs_f64();
    let printed = succeeded(output);
    let times = printed.lines().nth(1).unwrap().split(' ').map(|time| {
        let (minutes, seconds) = time.trim_end_matches('s').split_once('m').unwrap();
        60.0 * minutes.parse::<f64>().unwrap() + seconds.parse::<f64>().unwrap()
    });
    [wall, times.sum()]
}

/// `OMNILIFE_SWEEP_UNITS` and `OMNILIFE_SWEEP_SECONDS` measure other sizes.
#[test]
fn overhead_is_small() {
    let setting = |name: &str, default: f64| {
        std::env::var(name).map_or(default, |value| value.parse::<f64>().unwrap())
    };
    let units = setting("OMNILIFE_SWEEP_UNITS", 40.0);
    let seconds = setting("OMNILIFE_SWEEP_SECONDS", 0.1);
    let shell = Shell::planned(&vec![format!("sleep {seconds}"); units as usize], &[]);
    // Time of the same commands without a sweep: starting and ending shells takes time itself.
    let bare = seconds_of(&shell, "xargs -P 4 -I {} sh -c {} < lines.txt");
    let binary = assert_cmd::cargo::cargo_bin!("omnilife");
    let run = format!(
        "{} -q sweep run sweep --cores 4 --memory 1000",
        binary.display()
    );
    let pooled = seconds_of(&shell, &run);
    let wall = (pooled[0] - bare[0]) * 4.0 / units;
    let processor = (pooled[1] - bare[1]) / units;
    println!(
        "{units} units of {seconds} s, four at a time: {:.2} s by xargs, {:.2} s by the pool; per \
         unit {:.1} ms more, and {:.1} ms more on the CPU",
        bare[0],
        pooled[0],
        1000.0 * wall,
        1000.0 * processor
    );
    // The target is 10 ms of a unit of 1 s. Wall-clock time is meaningless while other tests run.
    assert!(processor < 0.03, "{processor}");
}
