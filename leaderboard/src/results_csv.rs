//! `table.csv`: one row per result, and the means over scenes, with every metric.

use std::{io, path::Path};

use omnilife_schemas::{plain_text::for_spreadsheet, records::ResultRecord, store::StoreError};

use crate::{
    group::{Group, MethodRow, Quantity, ViewKind},
    render::csv::number,
};

/// Columns before the scores. `row` is `scene`, or `mean` for a method's mean over scenes, whose
/// `scene` column counts the scenes that went in.
const LEADING: [&str; 6] = [
    "protocol",
    "protocol_hash",
    "row",
    "scene",
    "method",
    "seed",
];

/// Columns after the scores.
const TRAILING: [&str; 8] = [
    "training_seconds",
    "rendering_seconds",
    "peak_memory_bytes",
    "primitives",
    "iterations",
    "input_views_scored",
    "novel_views_scored",
    "failures",
];

/// All groups; columns of scores are the union of all metrics, `<view>_<metric>`, empty where a
/// result lacks one. `path` is named in errors.
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
        for result in group.scene_rows.iter().flat_map(|row| &row.results) {
            let row = result_row(group, result, &quantities);
            writer.write_record(&row).map_err(failed)?;
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

fn result_row(group: &Group<'_>, result: &ResultRecord, quantities: &[&Quantity]) -> Vec<String> {
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
    let seconds = |value: Option<f64>| optional(value.map(|seconds| format!("{seconds:.3}")));
    row.extend([
        seconds(result.training_seconds),
        seconds(result.rendering_seconds),
        optional(result.peak_memory_bytes),
        optional(result.primitives),
        optional(result.iterations),
        views(ViewKind::Input),
        views(ViewKind::Novel),
        result.failures.len().to_string(),
    ]);
    row
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
    ]);
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
