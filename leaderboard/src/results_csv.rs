//! `table.csv`: one row per result, and the means over scenes, with every metric.

use std::{io, path::Path};

use omnilife_schemas::{plain_text::for_spreadsheet, records::ResultRecord, store::StoreError};

use crate::{
    class::MethodClass,
    group::{Group, MethodRow, Quantity, ViewKind},
    numbers::Numbers,
    render::csv::number,
};

/// Columns before the scores. `row` is `scene`, or `mean` for a method's mean over scenes, whose `scene` column is the
/// number of scenes.
const LEADING: [&str; 6] = [
    "protocol",
    "protocol_hash",
    "row",
    "scene",
    "method",
    "seed",
];

/// Columns after the scores. `run_failure` is the reason of a failed run, which has no scores and no costs; `stated`
/// lists the columns whose numbers are stated by authors instead of measured.
const TRAILING: [&str; 12] = [
    "training_seconds",
    "rendering_seconds",
    "peak_memory_bytes",
    "primitives",
    "iterations",
    "input_views_scored",
    "novel_views_scored",
    "failures",
    "run_failure",
    "class",
    "stated",
    "clock",
];

/// Renders all groups; columns of scores are the union of all metrics, `<view>_<metric>`, empty if a result lacks one.
/// `path` is named in errors.
pub(crate) fn render(groups: &[Group<'_>], path: &Path) -> Result<Vec<u8>, StoreError> {
    let mut quantities: Vec<&Quantity> = groups
        .iter()
        .flat_map(|group| group.quantities.iter().map(|(quantity, _)| quantity))
        .collect();
    quantities.sort();
    quantities.dedup();
    let failed = |error: csv::Error| StoreError::write(path, io::Error::other(error));
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut header: Vec<String> = LEADING.map(str::to_owned).to_vec();
    let names = quantities
        .iter()
        .map(|quantity| format!("{}_{}", quantity.kind.name(), quantity.metric));
    header.extend(names);
    header.extend(TRAILING.map(str::to_owned));
    writer.write_record(&header).map_err(failed)?;
    for group in groups {
        for scene_row in &group.scene_rows {
            for result in &scene_row.results {
                let row = result_row(group, scene_row.class, result, &quantities);
                writer.write_record(&row).map_err(failed)?;
            }
        }
        if group.scenes.len() > 1 {
            for method in &group.methods {
                let row = mean_row(group, method, &quantities);
                writer.write_record(&row).map_err(failed)?;
            }
        }
    }
    writer
        .into_inner()
        .map_err(|error| StoreError::write(path, error.into_error()))
}

fn result_row(
    group: &Group<'_>,
    class: MethodClass,
    result: &ResultRecord,
    quantities: &[&Quantity],
) -> Vec<String> {
    let mut row = leading(group, "scene", &result.scene, &result.method);
    row.push(optional(result.seed));
    row.extend(quantities.iter().map(|quantity| {
        let scores = quantity.kind.scores(result);
        optional(
            scores
                .get(&quantity.metric)
                .map(|summary| number(summary.mean)),
        )
    }));
    let views = |kind: ViewKind| {
        let scored = kind.scores(result).values().map(|summary| summary.views);
        scored.max().unwrap_or(0).to_string()
    };
    let run = result.run_failure.is_none().then_some(result);
    let seconds = |of: fn(&ResultRecord) -> Option<f64>| {
        optional(run.and_then(of).map(|seconds| format!("{seconds:.3}")))
    };
    row.extend([
        seconds(|run| run.training_seconds),
        seconds(|run| run.rendering_seconds),
        optional(run.and_then(|run| run.peak_memory_bytes)),
        optional(run.and_then(|run| run.primitives)),
        optional(run.and_then(|run| run.iterations)),
        views(ViewKind::Input),
        views(ViewKind::Novel),
        result.failures.len().to_string(),
        for_spreadsheet(result.run_failure.as_deref().unwrap_or_default()).into_owned(),
    ]);
    row.extend(origin(class, &group.numbers_of(result)));
    row
}

/// Returns the class, the stated numbers and the clock of the training time.
fn origin(class: MethodClass, numbers: &Numbers) -> [String; 3] {
    let stated: Vec<&str> = numbers.stated.iter().map(String::as_str).collect();
    [
        class.title().to_owned(),
        for_spreadsheet(&stated.join(" ")).into_owned(),
        numbers.clocks().unwrap_or_default(),
    ]
}

fn mean_row(group: &Group<'_>, method: &MethodRow<'_>, quantities: &[&Quantity]) -> Vec<String> {
    let mut row = leading(group, "mean", &method.scenes.to_string(), method.method);
    row.push(String::new());
    row.extend(quantities.iter().map(|quantity| {
        let index = group.quantity(quantity.kind, &quantity.metric);
        optional(
            index
                .and_then(|index| method.numbers.scores[index])
                .map(number),
        )
    }));
    let three = |value: Option<f64>| optional(value.map(|value| format!("{value:.3}")));
    let numbers = &method.numbers;
    row.extend([
        three(numbers.training_seconds),
        String::new(),
        three(numbers.peak_memory_bytes),
        three(numbers.primitives),
        three(numbers.iterations),
        String::new(),
        String::new(),
        numbers.failures.to_string(),
        String::new(),
    ]);
    row.extend(origin(method.class, numbers));
    row
}

fn leading(group: &Group<'_>, row: &str, scene: &str, method: &str) -> Vec<String> {
    [group.protocol, group.protocol_hash, row, scene, method]
        .map(|text| for_spreadsheet(text).into_owned())
        .to_vec()
}

fn optional(value: Option<impl ToString>) -> String {
    value.map(|value| value.to_string()).unwrap_or_default()
}
