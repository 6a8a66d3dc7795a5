//! Fuzzing of every reader of external files: on randomly changed files a reader returns and does not panic.
//!
//! An ordinary test run makes a few hundred changes per target, always the same ones. `scripts/fuzz` makes as many as
//! fit into a time, from another seed each time. A file that makes a reader panic is written to
//! `target/fuzz/crashes/<target>/`. Once the defect is fixed, the file is kept in `tests/fuzz/kept/<target>/`, which
//! every run reads first. A file that ends the whole process, such as by a failed allocation, stays at
//! `target/fuzz/<target>.<process>.current`.
#![cfg(unix)]
#![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

mod curated;
mod datasets;
mod drives;
mod folders;
mod mutation;
mod paths;
mod samples;
mod splats;
mod targets;

use std::{
    any::Any,
    env,
    fs::{self, File},
    os::unix::fs::FileExt,
    panic::{self, AssertUnwindSafe},
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

use curated::CURATED;
use drives::DRIVES;
use folders::FOLDERS;
use mutation::Mutator;
use omnilife_schemas::{process, store};
use paths::PATHS;
use splats::SPLATS;
use targets::{FILES, Input, Reader, Seed, Target};
use tempfile::TempDir;

/// True while a reader is at work.
static READS: AtomicBool = AtomicBool::new(false);

/// Default number of changed files per target, without a time or a number.
const NUMBER: u64 = 300;
/// Memory of the whole process, bytes; enough, because files are small.
const MEMORY_BYTES: u64 = 4 << 30;
/// Default seed.
const SEED: u64 = 1;

fn variable<T: std::str::FromStr>(name: &str) -> Option<T> {
    env::var(name).ok()?.parse().ok()
}

#[test]
fn no_file_makes_a_reader_panic() {
    process::limit_memory(MEMORY_BYTES).unwrap();
    let seconds: Option<f64> = variable("OMNILIFE_FUZZ_SECONDS");
    let number: Option<u64> = variable("OMNILIFE_FUZZ_FILES");
    let seed = variable("OMNILIFE_FUZZ_SEED").unwrap_or(SEED);
    let only: Option<String> = variable("OMNILIFE_FUZZ_TARGET");
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let scratch = scratch();
    let all = [FILES, CURATED, FOLDERS, DRIVES, PATHS, SPLATS]
        .into_iter()
        .flatten();
    let is_chosen = |target: &&Target| only.as_ref().is_none_or(|only| *only == target.id);
    let chosen: Vec<&Target> = all.filter(is_chosen).collect();
    assert!(!chosen.is_empty(), "there is no target {only:?}");
    let each = seconds.map(|seconds| Duration::from_secs_f64(seconds / chosen.len() as f64));
    // Panics of readers are the findings: they are reported at the end.
    let told = panic::take_hook();
    panic::set_hook(Box::new(move |panicked| {
        if !READS.load(Ordering::Relaxed) {
            told(panicked);
        }
    }));
    let mut crashes = Vec::new();
    println!("| target | files | a second | kept | crashes |\n|---|--:|--:|--:|--:|");
    for target in chosen {
        let folder = scratch.path().join(target.id);
        fs::create_dir(&folder).unwrap();
        let found = root.join("target/fuzz/crashes").join(target.id);
        store::create_folder(&found).unwrap();
        let current = root.join(format!(
            "target/fuzz/{}.{}.current",
            target.id,
            std::process::id()
        ));
        let input = Input::new(&folder, (target.seeds)(&folder));
        let kept = kept(&root.join("tests/fuzz/kept").join(target.id));
        let mut run = Run {
            target,
            bases: bases(&input, &kept),
            input,
            current: File::create(&current).unwrap(),
            changed: None,
            crashes: found,
        };
        let before = crashes.len();
        for file in &kept {
            let bytes = fs::read(file).unwrap();
            crashes.extend((0..run.input.seeds.len()).find_map(|at| run.read(at, &bytes)));
        }
        let most = match (each, number) {
            (Some(time), _) => Most::Time(time),
            (None, Some(number)) => Most::Files(number),
            (None, None) => Most::Files(NUMBER / target.cost.max(1)),
        };
        let begun = Instant::now();
        let files = run.change(most, seed, &mut crashes);
        fs::remove_file(&current).unwrap();
        println!(
            "| {} | {files} | {:.0} | {} | {} |",
            target.id,
            files as f64 / begun.elapsed().as_secs_f64(),
            kept.len(),
            crashes.len() - before
        );
    }
    assert!(crashes.is_empty(), "{}", crashes.join("\n"));
}

/// Makes a folder in memory where the system supports it.
fn scratch() -> TempDir {
    tempfile::tempdir_in("/dev/shm")
        .or_else(|_| tempfile::tempdir())
        .unwrap()
}

/// Returns the files of a folder, which may be missing, in order of their names.
fn kept(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = fs::read_dir(folder)
        .into_iter()
        .flatten()
        .map(|entry| entry.unwrap().path())
        .collect();
    files.sort();
    files
}

/// Returns the seeds, and kept files in the place of the first seed with their extension.
fn bases(input: &Input, kept: &[PathBuf]) -> Vec<(usize, Vec<u8>)> {
    let seeds = input.seeds.iter().enumerate();
    let mut bases: Vec<(usize, Vec<u8>)> =
        seeds.map(|(at, seed)| (at, seed.bytes.clone())).collect();
    for file in kept {
        let has_ending = |seed: &Seed| Path::new(&seed.name).extension() == file.extension();
        let at = input.seeds.iter().position(has_ending).unwrap_or(0);
        bases.push((at, fs::read(file).unwrap()));
    }
    bases
}

/// Limit of the files to read.
#[derive(Clone, Copy)]
enum Most {
    Time(Duration),
    Files(u64),
}

/// Run of one target.
struct Run<'a> {
    target: &'a Target,
    input: Input,
    /// Holds the file that is being read, in case that it ends the process.
    current: File,
    /// Files that changes start from, with the index of the seed for which each stands: the seeds and the kept files.
    bases: Vec<(usize, Vec<u8>)>,
    /// Index of the seed whose file in the folder has other content.
    changed: Option<usize>,
    crashes: PathBuf,
}

impl Run<'_> {
    /// Reads changed files up to the limit; returns their number.
    fn change(&mut self, most: Most, seed: u64, crashes: &mut Vec<String>) -> u64 {
        let begun = Instant::now();
        let mut mutator = Mutator::new(seed, self.target.words);
        let mut found = 0;
        let bases = self.bases.clone();
        let bases: Vec<&[u8]> = bases.iter().map(|(_, bytes)| bytes.as_slice()).collect();
        for number in 0.. {
            let is_over = match most {
                Most::Time(time) => begun.elapsed() >= time,
                Most::Files(most) => number >= most,
            };
            // One defect gives as many crashes as there is time for; three are enough to fix it.
            if is_over || found >= 3 {
                return number;
            }
            let (at, bytes) = mutator.changed(&bases);
            let at = self.bases[at].0;
            if let Some(crash) = self.read(at, &bytes) {
                found += 1;
                crashes.push(crash);
            }
        }
        0
    }

    /// Puts bytes in the place of a seed, and every other seed in its own.
    fn place(&mut self, at: usize, bytes: &[u8]) {
        let path = |seed: &Seed| self.input.folder.join(&seed.name);
        if let Some(before) = self.changed.replace(at).filter(|before| *before != at) {
            let seed = &self.input.seeds[before];
            fs::write(path(seed), &seed.bytes).unwrap();
        }
        fs::write(path(&self.input.seeds[at]), bytes).unwrap();
        self.input.files_read += 1;
    }

    /// Reads a file in the place of one of the seeds; returns the fault where the reader panics.
    fn read(&mut self, at: usize, bytes: &[u8]) -> Option<String> {
        self.current.set_len(0).unwrap();
        self.current.write_all_at(bytes, 0).unwrap();
        READS.store(true, Ordering::Relaxed);
        let outcome = match self.target.reader {
            Reader::Bytes(read) => {
                let seed = &self.input.seeds[at];
                panic::catch_unwind(AssertUnwindSafe(|| read(seed, bytes)))
            }
            Reader::Folder(read) => {
                self.place(at, bytes);
                let seed = &self.input.seeds[at];
                panic::catch_unwind(AssertUnwindSafe(|| read(&self.input, seed)))
            }
        };
        READS.store(false, Ordering::Relaxed);
        let reason = reason(&*outcome.err()?);
        let name = format!(
            "{:.12}-{}",
            store::sha256_bytes(bytes),
            self.input.seeds[at].name.replace('/', "-")
        );
        let file = self.crashes.join(name);
        fs::write(&file, bytes).unwrap();
        Some(format!("{}: {}: {reason}", self.target.id, file.display()))
    }
}

/// Returns the message of a panic.
fn reason(payload: &(dyn Any + Send)) -> String {
    let owned = payload.downcast_ref::<String>().cloned();
    owned
        .or_else(|| {
            payload
                .downcast_ref::<&str>()
                .map(|&reason| reason.to_owned())
        })
        .unwrap_or_default()
}
