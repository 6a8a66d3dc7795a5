//! Every reader of files that others make, on files that were changed at random: whatever they hold, a
//! reader returns, and does not panic.
//!
//! An ordinary test run makes a few hundred changes per target, always the same ones. `scripts/fuzz`
//! makes as many as fit into a time, from another seed each time. A file that makes a reader panic is
//! written to `target/fuzz/crashes/<target>/`; once mended, it is kept in `tests/fuzz/kept/<target>/`,
//! which every run reads first. What ends the whole process, such as an allocation that fails, leaves
//! the file at `target/fuzz/<target>.current`.
#![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

mod mutation;
mod targets;

use std::{
    env, fs,
    panic::{self, AssertUnwindSafe},
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use mutation::Mutator;
use omnilife_schemas::{process, store};
use targets::{Input, TARGETS, Target};

/// Changed files per target where no time is given.
const FILES: u64 = 300;
/// Memory of the whole process: files are small, so nothing needs more.
const MEMORY_BYTES: u64 = 4 << 30;
/// The seed where none is given.
const SEED: u64 = 1;

fn variable<T: std::str::FromStr>(name: &str) -> Option<T> {
    env::var(name).ok()?.parse().ok()
}

#[test]
fn no_file_makes_a_reader_panic() {
    process::limit_memory(MEMORY_BYTES).unwrap();
    let seconds: Option<f64> = variable("OMNILIFE_FUZZ_SECONDS");
    let seed = variable("OMNILIFE_FUZZ_SEED").unwrap_or(SEED);
    let only: Option<String> = variable("OMNILIFE_FUZZ_TARGET");
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let scratch = tempfile::tempdir().unwrap();
    let chosen: Vec<&Target> = TARGETS
        .iter()
        .filter(|target| only.as_ref().is_none_or(|only| *only == target.id))
        .collect();
    assert!(!chosen.is_empty(), "there is no target {only:?}");
    let each = seconds.map(|seconds| Duration::from_secs_f64(seconds / chosen.len() as f64));
    // Panics are what is looked for: they are told at the end.
    let told = panic::take_hook();
    panic::set_hook(Box::new(|_| {}));
    let mut crashes = Vec::new();
    for target in chosen {
        let folder = scratch.path().join(target.id);
        fs::create_dir(&folder).unwrap();
        let mut run = Run {
            target,
            input: Input::new(&folder, (target.seeds)(&folder)),
            current: root.join(format!("target/fuzz/{}.current", target.id)),
            crashes: root.join("target/fuzz/crashes").join(target.id),
        };
        store::create_folder(&run.crashes).unwrap();
        for file in kept(&root.join("tests/fuzz/kept").join(target.id)) {
            let bytes = fs::read(&file).unwrap();
            crashes.extend((0..run.input.seeds.len()).find_map(|at| run.read(at, &bytes)));
        }
        let files = run.change(each, seed, &mut crashes);
        println!("{}: {files} files", target.id);
    }
    panic::set_hook(told);
    assert!(crashes.is_empty(), "{}", crashes.join("\n"));
}

/// Files of a folder, which need not be there, in order of their names.
fn kept(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = fs::read_dir(folder)
        .into_iter()
        .flatten()
        .map(|entry| entry.unwrap().path())
        .collect();
    files.sort();
    files
}

/// One target's files.
struct Run<'a> {
    target: &'a Target,
    input: Input,
    current: PathBuf,
    crashes: PathBuf,
}

impl Run<'_> {
    /// Reads changed files until the time is over, or so many; returns how many.
    fn change(&mut self, time: Option<Duration>, seed: u64, crashes: &mut Vec<String>) -> u64 {
        let begun = Instant::now();
        let mut mutator = Mutator::new(seed, self.target.words);
        let mut found = 0;
        let most = FILES / self.target.cost.max(1);
        for number in 0.. {
            let is_over = match time {
                Some(time) => begun.elapsed() >= time,
                None => number >= most,
            };
            // One place gives as many crashes as there is time for; three are enough to mend it.
            if is_over || found >= 3 {
                return number;
            }
            let (at, bytes) = {
                let seeds: Vec<&[u8]> = self.input.seeds.iter().map(|seed| &*seed.bytes).collect();
                mutator.changed(&seeds)
            };
            if let Some(crash) = self.read(at, &bytes) {
                found += 1;
                crashes.push(crash);
            }
        }
        0
    }

    /// Reads a file in the place of one of the seeds; what is wrong where the reader panics.
    fn read(&self, seed: usize, bytes: &[u8]) -> Option<String> {
        fs::write(&self.current, bytes).unwrap();
        let seed = &self.input.seeds[seed];
        fs::write(self.input.folder.join(&seed.name), bytes).unwrap();
        let outcome =
            panic::catch_unwind(AssertUnwindSafe(|| (self.target.read)(&self.input, seed)));
        fs::write(self.input.folder.join(&seed.name), &seed.bytes).unwrap();
        fs::remove_file(&self.current).unwrap();
        let payload = outcome.err()?;
        let reason = payload
            .downcast_ref::<String>()
            .cloned()
            .or_else(|| {
                payload
                    .downcast_ref::<&str>()
                    .map(|&reason| reason.to_owned())
            })
            .unwrap_or_default();
        let name = format!(
            "{:.12}-{}",
            store::sha256_bytes(bytes),
            seed.name.replace('/', "-")
        );
        let file = self.crashes.join(name);
        fs::write(&file, bytes).unwrap();
        Some(format!("{}: {}: {reason}", self.target.id, file.display()))
    }
}
