//! `omnilife bench run`: scenes x protocols x methods x seeds, run, scored and tabulated.
//!
//! ```text
//! OUT/outcomes.csv                                 every unit with its outcome
//! OUT/leaderboard/                                 tables with intervals, and the site
//! OUT/scenes/<scene>/<protocol>/split.json
//! OUT/scenes/<scene>/<protocol>/<method>/seed-<n>/run/, score/
//! ```
//!
//! A unit that fails is a row of the outcomes, and the others go on. Methods of ours are trained by
//! a process of their own, so that the memory in a record is that of one run.

use std::{
    path::{Path, PathBuf},
    process::Command,
    time::Instant,
};

use omnilife_bench::{
    ExternalRequest, ScoreRequest, external::EXTERNAL_RUN_FILE, protocols, run_external, score,
    split_scene,
};
use omnilife_leaderboard::{LeaderboardRequest, build_leaderboard};
use omnilife_reconstruct::{
    jobs::reconstruct::RUN_FILE, methods::Method as OurMethod, request::MethodRequest,
};
use omnilife_schemas::{
    ErrorKind, layout::SPLIT_FILE, lock::FolderLock, plain_text::serialize_for_spreadsheet,
    progress::Progress, records::ExternalRun, stage::StagePlan, store,
};
use serde::Serialize;

use crate::{
    cli::{BackendArgument, BenchRunArguments},
    exit::{self, BadRequest, PartialFailure},
    plans::benchmark::{self, Method, MethodKind},
    termination,
};

/// File of the summary.
const OUTCOMES_FILE: &str = "outcomes.csv";
/// Rendered views that the site shows per scene and method.
const SITE_VIEWS: usize = 4;

/// One row of the summary.
#[derive(Debug, Clone, Serialize)]
struct Unit {
    #[serde(serialize_with = "serialize_for_spreadsheet")]
    scene: String,
    protocol: String,
    #[serde(serialize_with = "serialize_for_spreadsheet")]
    method: String,
    seed: u64,
    /// `scored` or `failed`.
    outcome: &'static str,
    /// One line for what failed, or for the views that could not be scored.
    #[serde(serialize_with = "serialize_for_spreadsheet")]
    reason: String,
    #[serde(skip)]
    blame: Option<ErrorKind>,
}

/// Runs everything and prints the tables.
///
/// # Errors
/// When the request makes no sense, nothing could be scored, or something failed beside what was
/// scored.
pub(crate) fn execute(
    arguments: &BenchRunArguments,
    progress: &dyn Progress,
) -> anyhow::Result<()> {
    termination::take_programs_along()?;
    let scenes = benchmark::scenes(&arguments.scenes)?;
    let candidates = candidates(arguments)?;
    for protocol in &arguments.protocols {
        protocols::protocol(protocol)?;
    }
    let _lock = FolderLock::take(&arguments.out, progress)?;
    let begun = Instant::now();
    let summary = StagePlan::new(&arguments.out, "summary");
    summary.claim([OUTCOMES_FILE])?;
    let mut units = Vec::new();
    for (id, scene) in &scenes {
        for protocol in &arguments.protocols {
            let folder = arguments
                .out
                .join("scenes")
                .join(benchmark::scene_folder(id))
                .join(protocol);
            let split = folder.join(SPLIT_FILE);
            let has_split = split_scene(scene, protocol, &split).map_err(anyhow::Error::from);
            for candidate in &candidates {
                let seeds = if candidate.has_no_seed() {
                    &arguments.seeds[..1]
                } else {
                    &arguments.seeds
                };
                for &seed in seeds {
                    let job = Job {
                        arguments,
                        candidate,
                        seed,
                        scene,
                        split: &split,
                        folder: folder.join(&candidate.id).join(format!("seed-{seed}")),
                        progress,
                    };
                    let outcome = match &has_split {
                        Ok(_) => job.run(),
                        Err(error) => Err(Failure {
                            reason: error.to_string(),
                            blame: exit::error_kind(error),
                        }),
                    };
                    units.push(unit(id, protocol, &candidate.id, seed, outcome, progress));
                }
            }
        }
    }
    store::write_csv_rows(&arguments.out.join(OUTCOMES_FILE), &units)?;
    summary.finish([OUTCOMES_FILE], begun.elapsed().as_secs_f64())?;
    if units.iter().any(|unit| unit.outcome == "scored") {
        let leaderboard = build_leaderboard(&LeaderboardRequest {
            results: arguments.out.join("scenes"),
            out: arguments.out.join("leaderboard"),
            dataset: None,
            page: None,
            site: true,
            views: SITE_VIEWS,
        })?;
        exit::print(&format!(
            "{}\nTables with intervals: {}\n",
            leaderboard.markdown,
            arguments.out.join("leaderboard/tables").display()
        ))?;
    }
    as_result(&units)
}

fn candidates(arguments: &BenchRunArguments) -> anyhow::Result<Vec<Method>> {
    let mut candidates: Vec<Method> = Vec::new();
    for text in &arguments.methods {
        let candidate = Method::find(text)?;
        if let MethodKind::Ours(method) = candidate.kind {
            let backend = backend_of(method, arguments.backend);
            method.check(&request(arguments, 0), backend.into())?;
        }
        if candidates.iter().any(|other| other.id == candidate.id) {
            return Err(BadRequest(format!("method {} is given twice", candidate.id)).into());
        }
        candidates.push(candidate);
    }
    Ok(candidates)
}

fn request(arguments: &BenchRunArguments, seed: u64) -> MethodRequest {
    MethodRequest {
        budget_seconds: arguments.budget,
        ..MethodRequest::new(arguments.iterations, seed)
    }
}

/// Methods that learn nothing run on the CPU whatever trains the others.
fn backend_of(method: &OurMethod, asked: BackendArgument) -> BackendArgument {
    if method.is_trained() {
        asked
    } else {
        BackendArgument::Cpu
    }
}

/// Why a unit failed.
struct Failure {
    reason: String,
    blame: ErrorKind,
}

impl<E: std::error::Error + Send + Sync + 'static> From<E> for Failure {
    fn from(error: E) -> Self {
        let error = anyhow::Error::new(error);
        Self {
            reason: error.to_string(),
            blame: exit::error_kind(&error),
        }
    }
}

/// One unit of work.
struct Job<'a> {
    arguments: &'a BenchRunArguments,
    candidate: &'a Method,
    seed: u64,
    scene: &'a Path,
    split: &'a Path,
    folder: PathBuf,
    progress: &'a dyn Progress,
}

impl Job<'_> {
    /// Runs and scores; tells how many views could not be scored.
    fn run(&self) -> Result<usize, Failure> {
        let run = self.folder.join("run");
        let record = match &self.candidate.kind {
            MethodKind::Ours(method) => {
                self.train(method, &run)?;
                run.join(RUN_FILE)
            }
            MethodKind::External(manifest) => {
                let record: ExternalRun = run_external(
                    &ExternalRequest {
                        manifest: manifest.clone(),
                        scene: self.scene.to_owned(),
                        split: self.split.to_owned(),
                        seed: self.seed,
                        out: run.clone(),
                    },
                    self.progress,
                )?;
                if let Some(failure) = &record.failure {
                    self.progress.note(&format!("{}: {failure}", record.method));
                }
                run.join(EXTERNAL_RUN_FILE)
            }
        };
        let score_folder = self.folder.join("score");
        let request = ScoreRequest::of_run(self.scene, self.split, &record, &score_folder)?;
        Ok(score(&request, self.progress)?.failures.len())
    }

    /// Trains in a process of its own.
    fn train(&self, method: &OurMethod, run: &Path) -> Result<(), Failure> {
        let label = format!("{} on {}", method.id, self.scene.display());
        self.progress.begin(&label, None);
        let mut command = Command::new(std::env::current_exe()?);
        command
            .args(["--quiet", "reconstruct", "train"])
            .arg(self.scene)
            .arg("--split")
            .arg(self.split)
            .arg("--out")
            .arg(run)
            .args(["--method", method.id])
            .args(["--seed", &self.seed.to_string()])
            .args(["--iterations", &self.arguments.iterations.to_string()]);
        if let Some(budget) = self.arguments.budget {
            command.args(["--budget", &budget.to_string()]);
        }
        let backend = backend_of(method, self.arguments.backend);
        command.args([
            "--backend",
            match backend {
                BackendArgument::Cpu => "cpu",
                BackendArgument::Gpu => "gpu",
            },
        ]);
        let output = command.output();
        self.progress.end();
        let output = output?;
        if output.status.success() {
            return Ok(());
        }
        let text = String::from_utf8_lossy(&output.stderr);
        let last = text.lines().last().unwrap_or_default();
        let reason = match last.strip_prefix("omnilife: ") {
            Some(reason) => reason.to_owned(),
            None => format!("the training ended with {}: {last}", output.status),
        };
        Err(Failure {
            reason,
            blame: match output.status.code() {
                Some(2) => ErrorKind::User,
                _ => ErrorKind::Internal,
            },
        })
    }
}

fn unit(
    scene: &str,
    protocol: &str,
    method: &str,
    seed: u64,
    outcome: Result<usize, Failure>,
    progress: &dyn Progress,
) -> Unit {
    let name = format!("{scene}, {protocol}, {method}, seed {seed}");
    let (outcome, reason, blame) = match outcome {
        Ok(0) => ("scored", String::new(), None),
        Ok(views) => {
            let reason = format!("{views} views could not be scored");
            ("scored", reason, Some(ErrorKind::User))
        }
        Err(failure) => ("failed", failure.reason, Some(failure.blame)),
    };
    if !reason.is_empty() {
        progress.note(&format!("{name}: {reason}"));
    }
    Unit {
        scene: scene.to_owned(),
        protocol: protocol.to_owned(),
        method: method.to_owned(),
        seed,
        outcome,
        reason,
        blame,
    }
}

/// An error where anything failed, views that could not be scored included.
fn as_result(units: &[Unit]) -> anyhow::Result<()> {
    let faulty: Vec<&Unit> = units.iter().filter(|unit| unit.blame.is_some()).collect();
    let Some(first) = faulty.first() else {
        return Ok(());
    };
    let blame = if faulty
        .iter()
        .any(|unit| unit.blame == Some(ErrorKind::Internal))
    {
        ErrorKind::Internal
    } else {
        ErrorKind::User
    };
    Err(PartialFailure {
        message: format!(
            "{} of {} runs failed or left views out, the first: {} on {} under {}: {}",
            faulty.len(),
            units.len(),
            first.method,
            first.scene,
            first.protocol,
            first.reason
        ),
        blame,
    }
    .into())
}
