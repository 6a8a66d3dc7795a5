//! Writing commands on a faulty machine: a full disk, a read-only disk, a folder of another user, too little memory,
//! too few open files. Each ends in one line and leaves no partial files; without the fault it then does what an
//! undisturbed run does.
//!
//! An ordinary test run meets some of the commands with one of the faults each; `scripts/reliability faults` all
//! commands with all faults, and prints a table.

use std::{
    fs,
    os::unix::fs::PermissionsExt,
    path::Path,
    process::{Command, Stdio},
};

use crate::{
    outcomes::{ExpectedContent, ending_fault},
    support::{Ended, SmallDisk},
    trial::{Trial, variable},
    writing_commands::Inputs,
};

/// Step in the list of commands where not all meet all faults.
const EVERY: usize = 3;
/// Size of the disk, KiB: for every command with its initial files.
const DISK_KIBIBYTES: u32 = 128 << 10;
/// Space left on the full disk, KiB.
const LEFT_KIBIBYTES: [u64; 3] = [0, 8, 200];
/// Address space of the process, KiB. The libraries alone take the first.
const MEMORY_KIBIBYTES: [u32; 3] = [300 << 10, 320 << 10, 360 << 10];
/// Open files; the system's loader takes three, and standard input and output are three more.
const OPEN_FILES: [u32; 3] = [6, 10, 16];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fault {
    FullDisk,
    ReadOnly,
    NoPermission,
    LittleMemory,
    FewOpenFiles,
}

const FAULTS: [(Fault, &str); 5] = [
    (Fault::FullDisk, "full disk"),
    (Fault::ReadOnly, "read-only disk"),
    (Fault::NoPermission, "no permission"),
    (Fault::LittleMemory, "little memory"),
    (Fault::FewOpenFiles, "few open files"),
];

impl Fault {
    /// Runs the command with this fault in several degrees and returns how it ended.
    fn meet(self, trial: &Trial<'_>) -> Vec<Ended> {
        let limited = |limits: [u32; 3], option: &str| {
            let run = |limit: u32| {
                trial.reset();
                let script = format!("ulimit {option} {limit} && exec \"$0\" \"$@\"");
                trial.run_through(&["sh", "-c", &script])
            };
            limits.into_iter().map(run).collect()
        };
        match self {
            Self::FullDisk => LEFT_KIBIBYTES
                .iter()
                .map(|&left| on_a_full_disk(trial, left))
                .collect(),
            Self::ReadOnly => {
                trial.reset();
                assert!(remount(&trial.folder, "ro"));
                let ended = trial.run();
                assert!(remount(&trial.folder, "rw"));
                vec![ended]
            }
            Self::NoPermission => {
                trial.reset();
                vec![as_somebody_else(trial)]
            }
            Self::LittleMemory => limited(MEMORY_KIBIBYTES, "-v"),
            Self::FewOpenFiles => limited(OPEN_FILES, "-n"),
        }
    }
}

fn remount(folder: &Path, how: &str) -> bool {
    let mut command = Command::new("mount");
    command.args(["-o", &format!("remount,{how}")]).arg(folder);
    let status = command.stdout(Stdio::null()).stderr(Stdio::null()).status();
    status.is_ok_and(|status| status.success())
}

fn on_a_full_disk(trial: &Trial<'_>, left_kibibytes: u64) -> Ended {
    trial.reset();
    let (filler, block) = (trial.folder.join("filler"), vec![0; 1 << 10]);
    let mut file = fs::File::create(&filler).unwrap();
    let mut written = 0_u64;
    while std::io::Write::write_all(&mut file, &block).is_ok() {
        written += 1;
    }
    file.set_len(written.saturating_sub(left_kibibytes) << 10)
        .unwrap();
    drop(file);
    let ended = trial.run();
    fs::remove_file(filler).unwrap();
    ended
}

/// Runs the command as a user who can read the folders but not write into them.
fn as_somebody_else(trial: &Trial<'_>) -> Ended {
    let is_root =
        fs::metadata("/proc/self").is_ok_and(|own| std::os::unix::fs::MetadataExt::uid(&own) == 0);
    if is_root {
        return trial.run_through(&[
            "setpriv",
            "--reuid=65534",
            "--regid=65534",
            "--clear-groups",
        ]);
    }
    let folders = [trial.folder.join("work"), trial.out()];
    let permit = |mode: u32| {
        for folder in folders.iter().filter(|folder| folder.is_dir()) {
            fs::set_permissions(folder, fs::Permissions::from_mode(mode)).unwrap();
        }
    };
    permit(0o555);
    let ended = trial.run();
    permit(0o755);
    ended
}

#[test]
fn every_command_on_a_machine_that_fails_it() {
    let is_whole = variable::<u32>("OMNILIFE_FAULTS").is_some();
    let Some(disk) = SmallDisk::mount(DISK_KIBIBYTES) else {
        omnilife_schemas::testing::skip("a small disk cannot be mounted here");
        return;
    };
    let inputs = Inputs::prepare();
    fs::set_permissions(disk.folder(), fs::Permissions::from_mode(0o755)).unwrap();
    let mut wrong = Vec::new();
    let names: Vec<&str> = FAULTS.iter().map(|(_, name)| *name).collect();
    println!(
        "| command | {} |\n|---|{}",
        names.join(" | "),
        "---|".repeat(names.len())
    );
    let step = if is_whole { 1 } else { EVERY };
    let commands = inputs.chosen_commands();
    for (number, command) in commands.iter().step_by(step).enumerate() {
        let trial = Trial {
            command,
            inputs,
            folder: disk.folder().to_owned(),
        };
        let undisturbed = (0..2).map(|_| {
            trial.reset();
            trial.run().succeeded();
            trial.left()
        });
        let expected = ExpectedContent::of(undisturbed.collect());
        let mut cells = Vec::new();
        for (at, (fault, name)) in FAULTS.into_iter().enumerate() {
            if !is_whole && number % FAULTS.len() != at {
                cells.push(String::new());
                continue;
            }
            let ends = fault.meet(&trial);
            let mut faults: Vec<String> = ends.iter().filter_map(ending_fault).collect();
            // Without memory FFmpeg reports a damaged video, and no more is known about it.
            if fault != Fault::LittleMemory && ends.iter().any(|ended| ended.code == Some(2)) {
                faults.push("the input is blamed for the machine's fault".to_owned());
            }
            let half = trial
                .left()
                .into_keys()
                .filter(|file| file.contains(".tmp-"));
            // A read-only disk and a process without memory leave the old files.
            if matches!(fault, Fault::FullDisk | Fault::FewOpenFiles) {
                faults.extend(half.map(|file| format!("{file}: left over")));
            }
            faults.extend(trial.run_again(&expected));
            let codes: Vec<String> = ends
                .iter()
                .map(|ended| {
                    ended
                        .code
                        .map_or_else(|| "killed".to_owned(), |code| code.to_string())
                })
                .collect();
            let mark = if faults.is_empty() { "" } else { " WRONG" };
            cells.push(codes.join(" ") + mark);
            wrong.extend(
                faults
                    .into_iter()
                    .map(|fault| format!("{}: {name}: {fault}", command.shown())),
            );
        }
        println!("| `{}` | {} |", command.shown(), cells.join(" | "));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
