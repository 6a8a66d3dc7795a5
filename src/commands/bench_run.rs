//! `omnilife bench run`: scenes x protocols x methods x seeds, run, scored and tabulated.
//!
//! ```text
//! OUT/outcomes.csv                                 every unit with its outcome
//! OUT/leaderboard/                                 tables with intervals, and the site
//! OUT/scenes/<scene>/<protocol>/split.json
//! OUT/scenes/<scene>/<protocol>/<method>/seed-<n>/run/, score/
//! OUT/sweeps/<hash>/                               the plan, and what every unit printed and cost
//! ```
//!
//! A unit that fails is a row of the outcomes and of the tables, and the others continue. A scene that is too short for
//! a default protocol is one row of the outcomes, `left out`. Units are run by the pool of `sweep run`, each in
//! processes of its own, so that the memory in a record is that of one run. Finished units are not run again.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use omnilife_leaderboard::{LeaderboardRequest, build_leaderboard};
use omnilife_reconstruct::request::MethodRequest;
use omnilife_schemas::{
    ErrorKind,
    lock::FolderLock,
    plain_text::{counted, first_of, serialize_for_spreadsheet},
    progress::Progress,
    records::{ResultRecord, SweepUnit},
    stage::StagePlan,
    store,
};
use omnilife_sweep::UnitState;
use serde::Serialize;

use super::{method_list, pooled};
use crate::{
    cli::{BackendArgument, BenchRunArguments},
    exit::{self, PartialFailure},
    plans::{
        benchmark::{self, BenchmarkRequest, Method, MethodKind},
        left_out::{self, LeftOut},
    },
    prerequisites::{self, Prerequisite},
};

/// Outcome of a scene that is too short for a protocol.
const LEFT_OUT: &str = "left out";
/// Name of the summary.
const OUTCOMES_FILE: &str = "outcomes.csv";
/// Number of rendered views that the site shows per scene and method.
const SITE_VIEWS: usize = 4;

/// Row of the summary.
#[derive(Debug, Clone, Serialize)]
struct Unit {
    /// Id in the plan; empty where the scene is left out for all methods.
    #[serde(skip)]
    id: String,
    #[serde(serialize_with = "serialize_for_spreadsheet")]
    scene: String,
    protocol: String,
    /// Empty where the scene is left out for all methods.
    #[serde(serialize_with = "serialize_for_spreadsheet")]
    method: String,
    seed: Option<u64>,
    /// `scored`, `incomplete` where some views could not be scored, `failed`, or `left out`.
    outcome: &'static str,
    /// Reason in one line of the omission, of the failure of the run, or of the first view that could not be scored.
    #[serde(serialize_with = "serialize_for_spreadsheet")]
    reason: String,
    #[serde(skip)]
    blame: Option<ErrorKind>,
}

impl Unit {
    /// Returns whether a result with scores of some views exists.
    fn has_scores(&self) -> bool {
        self.outcome != "failed" && self.outcome != LEFT_OUT
    }
}

impl From<LeftOut> for Unit {
    fn from(pair: LeftOut) -> Self {
        Self {
            id: String::new(),
            scene: pair.scene,
            protocol: pair.protocol,
            method: String::new(),
            seed: None,
            outcome: LEFT_OUT,
            reason: pair.reason,
            blame: None,
        }
    }
}

/// Runs all units and prints the tables.
///
/// # Errors
/// When the request is invalid, nothing could be scored, or something failed beside the scored units.
pub(crate) fn execute(
    arguments: &BenchRunArguments,
    progress: &dyn Progress,
) -> anyhow::Result<()> {
    let methods = methods(arguments)?;
    let (protocols, left_out) = left_out::protocols_for(&arguments.scenes, &arguments.protocols)?;
    let is_trained = methods.iter().any(Method::is_trained);
    let results = arguments.out.join("scenes");
    let units = benchmark::units(&BenchmarkRequest {
        results: &results,
        scenes: &arguments.scenes,
        methods: &methods,
        protocols: &protocols,
        left_out: &left_out,
        seeds: &arguments.seeds,
        train: &if is_trained {
            training_options(arguments)
        } else {
            Vec::new()
        },
        tensorboard: arguments.tensorboard.as_deref(),
        needs: pooled::needs(arguments.unit_cores)?,
    })?;
    if is_trained && !arguments.out.join(OUTCOMES_FILE).is_file() {
        // Finished units need none.
        prerequisites::require([Prerequisite::Backend(arguments.backend.into())])?;
    }
    for pair in &left_out {
        progress.note(&pair.to_string());
    }
    let _lock = FolderLock::take(&arguments.out, progress)?;
    let summary = StagePlan::new(&arguments.out, "summary");
    let units = summary.run([OUTCOMES_FILE], progress, |made| -> anyhow::Result<_> {
        let mut units: Vec<Unit> = pooled::run_units(&arguments.out, units, progress)?
            .iter()
            .map(|(unit, state)| outcome(unit, state))
            .collect::<Result<_, _>>()?;
        for line in reasons(&units) {
            progress.note(&line);
        }
        units.extend(left_out.into_iter().map(Unit::from));
        store::write_csv_rows(&made.path(OUTCOMES_FILE), &units)?;
        made.add(OUTCOMES_FILE);
        Ok(units)
    })?;
    if units.iter().any(Unit::has_scores) {
        let collected = omnilife_leaderboard::collect(&results)?;
        let found = collected.iter().map(|(_, result)| result);
        if let Some(line) = of_other_requests(found, &units, &results) {
            progress.note(&line);
        }
        let leaderboard = build_leaderboard(&LeaderboardRequest {
            results,
            out: arguments.out.join("leaderboard"),
            dataset: None,
            page: None,
            site: true,
            views: SITE_VIEWS,
            project: None,
            descriptions: method_list::descriptions(),
        })?;
        let page = leaderboard.site.unwrap_or_default();
        exit::print(&format!(
            "{}\nTables with intervals: {}\nSite, for a browser: {}\n",
            exit::for_reader(&leaderboard.short, &leaderboard.markdown),
            arguments.out.join("leaderboard/tables").display(),
            page.display()
        ))?;
    }
    as_result(&units)
}

/// Returns a line on results in the folder that this request did not ask for, which tables have too.
fn of_other_requests<'a>(
    found: impl Iterator<Item = &'a ResultRecord>,
    units: &[Unit],
    folder: &Path,
) -> Option<String> {
    let is_of = |unit: &Unit, result: &ResultRecord| {
        let has_seed = result.seed.is_none() || unit.seed.is_none() || result.seed == unit.seed;
        unit.scene == result.scene && unit.method == result.method && has_seed
    };
    let others = found.filter(|result| !units.iter().any(|unit| is_of(unit, result)));
    let names: Vec<String> = others
        .map(|result| match result.seed {
            Some(seed) => format!("{}, {}, seed {seed}", result.scene, result.method),
            None => format!("{}, {}", result.scene, result.method),
        })
        .collect();
    (!names.is_empty()).then(|| {
        format!(
            "{}: {} of other requests are in the tables too: {}",
            folder.display(),
            counted(names.len(), "result"),
            first_of(&names)
        )
    })
}

/// Returns the methods, all of which must support the request before the first of them runs.
fn methods(arguments: &BenchRunArguments) -> anyhow::Result<Vec<Method>> {
    let methods = benchmark::with_aids(benchmark::methods(&arguments.methods)?, arguments.aids)?;
    for method in &methods {
        if let MethodKind::Ours(method, variant) = &method.kind {
            let request = MethodRequest {
                budget_seconds: arguments.budget,
                ..variant.request(arguments.iterations, 0)
            };
            // Methods without training run on the CPU, whatever the others train on.
            let backend = if method.is_trained() {
                arguments.backend
            } else {
                BackendArgument::Cpu
            };
            method.check(&request, backend.into())?;
        }
    }
    Ok(methods)
}

/// Returns the options of `reconstruct train` for the methods that are trained.
fn training_options(arguments: &BenchRunArguments) -> Vec<String> {
    let mut options = vec!["--iterations".to_owned(), arguments.iterations.to_string()];
    if let Some(budget) = arguments.budget {
        options.extend(["--budget".to_owned(), budget.to_string()]);
    }
    options.extend(["--backend", arguments.backend.name()].map(str::to_owned));
    options
}

/// Returns the row of a unit: its outcome, and that of the views in its result.
fn outcome(unit: &SweepUnit, state: &UnitState) -> anyhow::Result<Unit> {
    let label = |name: &str| unit.labels.get(name).cloned().unwrap_or_default();
    let result = result_of(unit)?;
    // The result has the reason in the method's own words; the pool has the end of its command.
    let incomplete = result.as_ref().and_then(ResultRecord::why_incomplete);
    let (outcome, reason, blame) = match (pooled::failure(state), incomplete) {
        (Some((reason, blame)), incomplete) => {
            ("failed", incomplete.unwrap_or(reason), Some(blame))
        }
        (None, Some(reason)) => ("incomplete", reason, Some(ErrorKind::User)),
        (None, None) => ("scored", String::new(), None),
    };
    Ok(Unit {
        id: unit.id.clone(),
        scene: label("scene"),
        protocol: label("protocol"),
        method: label("method"),
        seed: label("seed").parse().ok(),
        outcome,
        reason,
        blame,
    })
}

/// Returns a line for every reason on a scene. A reason that several runs share, such as a fault of the scene, is one
/// line with their number.
fn reasons(units: &[Unit]) -> Vec<String> {
    let mut groups: BTreeMap<(&str, &str), Vec<&Unit>> = BTreeMap::new();
    for unit in units.iter().filter(|unit| !unit.reason.is_empty()) {
        let reason = (unit.scene.as_str(), unit.reason.as_str());
        groups.entry(reason).or_default().push(unit);
    }
    let line = |((scene, reason), runs): ((&str, &str), Vec<&Unit>)| {
        if let [run] = runs[..] {
            return format!("{}: {reason}", run.id);
        }
        let methods: BTreeSet<&str> = runs.iter().map(|run| run.method.as_str()).collect();
        let methods = match methods.first() {
            Some(&method) if methods.len() == 1 => method.to_owned(),
            _ => counted(methods.len(), "method"),
        };
        format!("{scene}: {reason} ({} runs of {methods})", runs.len())
    };
    groups.into_iter().map(line).collect()
}

/// Returns the result of a unit, where it left one.
fn result_of(unit: &SweepUnit) -> anyhow::Result<Option<ResultRecord>> {
    let Some(file) = unit.outputs.first().map(Path::new) else {
        return Ok(None);
    };
    match file.is_file() {
        true => Ok(Some(store::read_record(file)?)),
        false => Ok(None),
    }
}

/// Returns an error where anything failed, including views that could not be scored.
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
            units.iter().filter(|unit| unit.outcome != LEFT_OUT).count(),
            first.method,
            first.scene,
            first.protocol,
            first.reason
        ),
        blame,
    }
    .into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reason_that_methods_share_is_one_line_with_their_number() {
        let run = |method: &str, protocol: &str, reason: &str| Unit {
            id: format!("{protocol}.{method}"),
            scene: "hall".to_owned(),
            protocol: protocol.to_owned(),
            method: method.to_owned(),
            seed: Some(0),
            outcome: "failed",
            reason: reason.to_owned(),
            blame: Some(ErrorKind::User),
        };
        let lines = reasons(&[
            run("a", "sparse", "no frame 3"),
            run("b", "dense", "no frame 3"),
            run("b", "sparse", "no frame 3"),
            run("a", "dense", "no memory"),
            run("c", "dense", "no weights"),
            run("c", "sparse", "no weights"),
            run("d", "dense", ""),
        ]);
        assert_eq!(
            lines,
            [
                "hall: no frame 3 (3 runs of 2 methods)",
                "dense.a: no memory",
                "hall: no weights (2 runs of c)",
            ]
        );
    }

    #[test]
    fn results_of_other_scenes_methods_and_seeds_are_named() {
        let unit = |method: &str, seed: Option<u64>| Unit {
            id: String::new(),
            scene: "park".to_owned(),
            protocol: "per-scene".to_owned(),
            method: method.to_owned(),
            seed,
            outcome: "scored",
            reason: String::new(),
            blame: None,
        };
        let of = |scene: &str, method: &str, seed: u64| ResultRecord {
            seed: Some(seed),
            ..ResultRecord::new(method, scene)
        };
        let units = [unit("odgs", Some(0)), unit("cross-fade", None)];
        let own = of("park", "odgs", 0);
        let line = |other: ResultRecord| {
            let found = [own.clone(), other];
            of_other_requests(found.iter(), &units, Path::new("scenes"))
        };
        assert_eq!(line(of("park", "cross-fade", 7)), None);
        let others = [
            of("hall", "odgs", 0),
            of("park", "panogs", 0),
            of("park", "odgs", 1),
        ];
        for other in others {
            let told = line(other).unwrap_or_default();
            assert!(told.contains("1 result of other requests"), "{told}");
        }
    }
}
