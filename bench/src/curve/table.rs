//! Curves as Markdown tables.

use std::fmt::Write;

use super::{
    BELOW_END_DB, Clock, Comparison, Crossing, MOMENTS_SECONDS, QUALITIES_DB, Region, RunCurve,
    trace::{self, TracedRun},
};

/// A column that only some tables have.
struct Column {
    head: &'static str,
    digits: usize,
    value: fn(&RunCurve) -> Option<f64>,
}

/// Columns that appear together, if any run has a value in one of them.
const GROUPS: [&[Column]; 6] = [
    &[Column {
        head: "SSIM",
        digits: 4,
        value: |curve| curve.run.final_scores.ssim,
    }],
    &[Column {
        head: "Mean SSIM over log time",
        digits: 4,
        value: |curve| curve.log_area_ssim,
    }],
    &[Column {
        head: "LPIPS (AlexNet)",
        digits: 4,
        value: |curve| curve.run.final_scores.lpips_alex,
    }],
    &[Column {
        head: "Mean LPIPS over log time",
        digits: 4,
        value: |curve| curve.log_area_lpips_alex,
    }],
    &[Column {
        head: "Before training s",
        digits: 1,
        value: |curve| curve.run.preparation_seconds,
    }],
    &[
        Column {
            head: "Ghosts %",
            digits: 2,
            value: |curve| percent(curve, 0),
        },
        Column {
            head: "Holes %, input",
            digits: 2,
            value: |curve| percent(curve, 1),
        },
        Column {
            head: "Holes %, novel",
            digits: 2,
            value: |curve| percent(curve, 2),
        },
    ],
];

fn percent(curve: &RunCurve, fault: usize) -> Option<f64> {
    curve.run.faults()[fault].map(|share| 100.0 * share)
}

/// Returns the comparisons as Markdown tables, each with lines on their omissions. `<9.5` is a quality reached at or
/// before the first row, after 9.5 s.
pub fn curves_table(comparisons: &[Comparison]) -> String {
    let mut text = String::new();
    for comparison in comparisons {
        append(&mut text, comparison);
    }
    text
}

fn append(text: &mut String, comparison: &Comparison) {
    let columns: Vec<&Column> = GROUPS
        .iter()
        .copied()
        .filter(|group| {
            let is_there =
                |curve: &RunCurve| group.iter().any(|column| (column.value)(curve).is_some());
            comparison.curves.iter().any(is_there)
        })
        .flatten()
        .collect();
    let _ = writeln!(text, "{}\n", title(comparison));
    let mut heads = vec!["Run".to_owned(), "Final dB".to_owned()];
    heads.extend(BELOW_END_DB.map(|db| format!("{db} dB below its end after s")));
    heads.extend(QUALITIES_DB.map(|db| format!("{db} dB after s")));
    heads.extend(MOMENTS_SECONDS.map(|seconds| format!("dB at {seconds} s")));
    heads.extend(["Mean dB over log time", "Training s", "GiB", "Front"].map(str::to_owned));
    heads.extend(columns.iter().map(|column| column.head.to_owned()));
    let rules = heads.iter().map(|head| match head.as_str() {
        "Run" | "Front" => "---",
        _ => "---:",
    });
    let rules: Vec<&str> = rules.collect();
    let _ = writeln!(text, "| {} |\n| {} |", heads.join(" | "), rules.join(" | "));
    let runs: Vec<&TracedRun> = comparison.curves.iter().map(|curve| &curve.run).collect();
    for (curve, name) in comparison.curves.iter().zip(trace::names(&runs)) {
        let cells = cells(curve, name, &columns);
        let _ = writeln!(text, "| {} |", cells.join(" | "));
    }
    text.push('\n');
    let span = comparison.span.map(|span| {
        format!(
            "means over the logarithm of time are from {:.1} s to {:.1} s, which all curves have",
            span.from_seconds, span.until_seconds
        )
    });
    let lines: Vec<&String> = span.iter().chain(&comparison.notes).collect();
    for line in &lines {
        let _ = writeln!(text, "{line}");
    }
    if !lines.is_empty() {
        text.push('\n');
    }
}

fn title(comparison: &Comparison) -> String {
    let first = comparison.curves.first().map(|curve| &curve.run);
    let clock = match first.map(|run| run.clock) {
        Some(Clock::Cpu) => ", CPU seconds",
        _ => "",
    };
    let region = match first.map(|run| run.region) {
        Some(Region::Static) => ", where nothing moves",
        Some(Region::Dynamic) => ", where something moves",
        _ => "",
    };
    format!(
        "{}, protocol {:.12}{clock}{region}",
        comparison.scene, comparison.protocol_hash
    )
}

fn cells(curve: &RunCurve, name: String, columns: &[&Column]) -> Vec<String> {
    let run = &curve.run;
    let mut cells = vec![name, number(Some(run.final_scores.psnr_db), 3)];
    cells.extend(curve.to_own_end.iter().chain(&curve.to_quality).map(time));
    cells.extend(curve.at_moment.iter().map(|&db| number(db, 3)));
    cells.push(number(curve.log_area_db, 3));
    cells.push(number(run.training_seconds, 1));
    let bytes = run.peak_memory_bytes;
    cells.push(number(bytes.map(|b| b as f64 / f64::from(1 << 30)), 2));
    cells.push(if curve.on_front { "yes" } else { "" }.to_owned());
    let further = columns.iter();
    cells.extend(further.map(|column| number((column.value)(curve), column.digits)));
    cells
}

fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or("-".to_owned(), |value| format!("{value:.digits$}"))
}

fn time(crossing: &Crossing) -> String {
    match crossing {
        Crossing::Never => "-".to_owned(),
        Crossing::AtMost { seconds } => format!("<{seconds:.1}"),
        Crossing::At { seconds, .. } => format!("{seconds:.1}"),
    }
}
