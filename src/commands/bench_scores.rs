//! `omnilife bench validate` and `omnilife bench compare`.

use std::path::Path;

use omnilife_bench::{Difference, PairedComparison, Predictions, WinsAndLosses};
use omnilife_schemas::{ErrorKind, progress::Progress, records::Direction};

use crate::exit::{self, PartialFailure};

/// Prints what is wrong with predictions, and fails when anything is.
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
    if report.findings.is_empty() {
        text += &format!("{} views, nothing wrong\n", report.views);
    }
    exit::print(&text)?;
    match report.findings.len() {
        0 => Ok(()),
        count => Err(PartialFailure {
            message: format!(
                "{count} faults in the predictions of {} views",
                report.views
            ),
            blame: ErrorKind::User,
        }
        .into()),
    }
}

/// Prints how the results below two folders compare.
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
    text += &format!(
        "{:<28} {:>10} {:>10} {:>10}  {:<24} {:>14} {:>16}\n",
        "", "A", "B", "A - B", "95 % interval", "scenes A:B:=", "views A:B:="
    );
    for difference in &comparison.differences {
        text += &difference_line(difference);
    }
    text += "A:B:= counts where A is better, B is better, and neither is.";
    text += match comparison.differences.iter().find(|d| d.interval.is_some()) {
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
