//! `omnilife bench validate` and `omnilife bench compare`.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use omnilife_bench::{Difference, PairedComparison, Predictions, WinsAndLosses};
use omnilife_schemas::{
    ErrorKind, bootstrap,
    plain_text::counted,
    progress::Progress,
    records::{Direction, ResultRecord},
};

use crate::exit::{self, PartialFailure};

/// Prints the faults of predictions, and fails when there are any.
pub(super) fn validate(
    scene: &Path,
    split: &Path,
    predictions: &Predictions,
    progress: &dyn Progress,
) -> anyhow::Result<()> {
    let report = omnilife_bench::validate(scene, split, predictions, progress)?;
    let mut text = String::new();
    for finding in &report.findings {
        let view = finding.view.as_deref().map_or("stray", |view| view);
        text += &format!("{view:<6} {}\n", finding.reason);
    }
    for note in &report.notes {
        text += &format!("note   {note}\n");
    }
    if report.findings.is_empty() {
        text += &format!("{}, nothing wrong\n", counted(report.views, "view"));
    }
    exit::print(&text)?;
    match report.findings.len() {
        0 => Ok(()),
        count => Err(PartialFailure {
            message: format!(
                "{} in the predictions of {}",
                counted(count, "fault"),
                counted(report.views, "view")
            ),
            blame: ErrorKind::User,
        }
        .into()),
    }
}

/// Prints a result: first warnings for the reader, then the scores, then missing metrics. An incomplete result is an
/// error, after it was printed, unless failures are accepted.
pub(super) fn report(result: &ResultRecord, accept_failures: bool) -> anyhow::Result<()> {
    exit::print(&result_text(result))?;
    match result.why_incomplete() {
        Some(reason) if !accept_failures => Err(PartialFailure {
            message: format!("{} on {}: {reason}", result.method, result.scene),
            blame: ErrorKind::User,
        }
        .into()),
        _ => Ok(()),
    }
}

/// Number of failed views that are printed one by one.
const LISTED_FAILURES: usize = 5;

fn result_text(result: &ResultRecord) -> String {
    let mut text = String::new();
    for warning in &result.warnings {
        text += &format!("warning: {warning}\n");
    }
    if result.run_failure.is_none() {
        for failure in result.failures.iter().take(LISTED_FAILURES) {
            let (view, frame, reason) = (&failure.view, failure.frame, &failure.reason);
            text += &format!("failed: {view} view {frame}: {reason}\n");
        }
        let further = result.failures.len().saturating_sub(LISTED_FAILURES);
        if further > 0 {
            text += &format!("failed: {further} further views, listed in the result\n");
        }
    }
    text += &format!(
        "{} on {}, protocol {} ({:.12})\n",
        result.method, result.scene, result.protocol, result.protocol_hash
    );
    for (view, scores) in [
        ("input", &result.input_views),
        ("novel", &result.novel_views),
    ] {
        for (metric, summary) in scores {
            let (mean, views) = (summary.mean, counted(summary.views as usize, "view"));
            text += &format!("{view} {metric} {mean:.4} over {views}");
            if summary.undefined_views > 0 {
                text += &format!(", undefined for {}", summary.undefined_views);
            }
            text.push('\n');
        }
    }
    text += &unavailable_text(result);
    if result.training.is_none() && result.run_failure.is_none() {
        text += "note: the class of the method is not stated, so it is ranked among methods without one; state it with \
                 --class per-scene, --class without-training or the --about card\n";
    }
    text
}

/// Returns one line for each reason, with the metrics that have no value for it.
fn unavailable_text(result: &ResultRecord) -> String {
    let mut by_reason: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for unavailable in &result.unavailable {
        let metrics = by_reason.entry(&unavailable.reason).or_default();
        metrics.insert(&unavailable.metric);
    }
    let lines = by_reason.into_iter().map(|(reason, metrics)| {
        let metrics: Vec<&str> = metrics.into_iter().collect();
        format!("unavailable: {} ({reason})\n", metrics.join(", "))
    });
    lines.collect()
}

/// Prints a comparison of the results below two folders.
pub(super) fn compare(a: &Path, b: &Path) -> anyhow::Result<()> {
    let [left, right] = [
        omnilife_leaderboard::collect(a)?,
        omnilife_leaderboard::collect(b)?,
    ];
    exit::print(&comparison_text(&omnilife_bench::compare(&left, &right)?))
}

fn comparison_text(comparison: &PairedComparison) -> String {
    let [a, b] = &comparison.methods;
    let scenes = comparison.scenes.len();
    let mut text = format!(
        "A: {a}\nB: {b}\nprotocol {}, {scenes} scenes: {}\n",
        comparison.protocol,
        comparison.scenes.join(", ")
    );
    for reason in &comparison.left_out {
        text += &format!("left out: {reason}\n");
    }
    for aids in &comparison.differing_aids {
        text += &format!("warning: one side used these aids and the other did not: {aids}\n");
    }
    text += &format!(
        "{:<28} {:>10} {:>10} {:>10}  {:<24} {:>14} {:>16}\n",
        "", "A", "B", "A - B", "95 % interval", "scenes A:B:=", "views A:B:="
    );
    for difference in &comparison.differences {
        text += &difference_line(difference);
    }
    text += "A:B:= counts where A is better, B is better, and neither is.";
    text += match comparison.differences.iter().find(|d| d.interval.is_some()) {
        Some(one) if one.videos < bootstrap::FEW_VIDEOS => {
            " Intervals are from draws of videos; so few videos make them too narrow.\n"
        }
        Some(_) => " Intervals are from draws of videos.\n",
        None => " No intervals: they need scenes of at least two videos.\n",
    };
    text
}

fn difference_line(difference: &Difference) -> String {
    let arrow = match difference.direction {
        Some(Direction::HigherIsBetter) => "higher is better",
        Some(Direction::LowerIsBetter) => "lower is better",
        None => "",
    };
    let name = format!("{} {}", difference.view, difference.metric);
    let [left, right] = difference.means;
    let interval = difference.interval.map_or_else(String::new, |[low, high]| {
        format!("[{low:+.4}, {high:+.4}]")
    });
    let counts = |WinsAndLosses { wins, losses, ties }| format!("{wins}:{losses}:{ties}");
    let line = format!(
        "{name:<28} {left:>10.4} {right:>10.4} {:>+10.4}  {interval:<24} {:>14} {:>16}  {arrow}",
        difference.mean,
        counts(difference.scenes),
        counts(difference.views)
    );
    line.trim_end().to_owned() + "\n"
}
