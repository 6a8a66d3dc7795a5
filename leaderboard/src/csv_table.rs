//! The CSV table: one row per method and scene, and the means.

use std::{
    collections::{BTreeMap, BTreeSet},
    io,
    path::Path,
};

use omnilife_schemas::{records::ResultRecord, store::StoreError};

use crate::{
    format::csv_score,
    ranking::{Group, MethodMean, Quantity, ViewKind},
};

/// Columns before the scores. `row` is `scene`, or `mean` for a method's mean over scenes, whose
/// `scene` column counts the scenes that went in.
const LEADING: [&str; 5] = ["protocol", "protocol_hash", "row", "scene", "method"];

/// Columns after the scores.
const TRAILING: [&str; 6] = [
    "training_seconds",
    "gaussians",
    "iterations",
    "input_views_scored",
    "novel_views_scored",
    "failures",
];

/// Renders all groups; columns of scores are the union of all metrics, `<view>_<metric>`, empty
/// where a result lacks one. `path` is named in errors.
pub(crate) fn render(groups: &[Group<'_>], path: &Path) -> Result<String, StoreError> {
    let quantities: BTreeSet<Quantity> = groups
        .iter()
        .flat_map(|group| {
            ViewKind::ALL.into_iter().flat_map(|kind| {
                group
                    .directions
                    .keys()
                    .map(move |metric| (kind, metric.clone()))
            })
        })
        .collect();
    let failed = |error: csv::Error| StoreError::write(path, io::Error::other(error));
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut header: Vec<String> = LEADING.map(str::to_owned).to_vec();
    header.extend(
        quantities
            .iter()
            .map(|(kind, metric)| format!("{}_{metric}", kind.name())),
    );
    header.extend(TRAILING.map(str::to_owned));
    writer.write_record(&header).map_err(failed)?;
    for group in groups {
        for result in &group.results {
            let row = result_row(group, result, &quantities);
            writer.write_record(&row).map_err(failed)?;
        }
        for mean in &group.means {
            let row = mean_row(group, mean, &quantities);
            writer.write_record(&row).map_err(failed)?;
        }
    }
    let bytes = writer
        .into_inner()
        .map_err(|error| StoreError::write(path, error.into_error()))?;
    String::from_utf8(bytes).map_err(|error| StoreError::write(path, io::Error::other(error)))
}

fn result_row(
    group: &Group<'_>,
    result: &ResultRecord,
    quantities: &BTreeSet<Quantity>,
) -> Vec<String> {
    let mut row = leading(group, "scene", &result.scene, &result.method);
    row.extend(quantities.iter().map(|(kind, metric)| {
        kind.scores(result)
            .get(metric)
            .map(|summary| csv_score(summary.mean))
            .unwrap_or_default()
    }));
    let views = |kind: ViewKind| {
        let scored = kind.scores(result).values().map(|summary| summary.views);
        scored.max().unwrap_or(0).to_string()
    };
    row.extend([
        optional(
            result
                .training_seconds
                .map(|seconds| format!("{seconds:.3}")),
        ),
        optional(result.gaussians),
        optional(result.iterations),
        views(ViewKind::Input),
        views(ViewKind::Novel),
        result.failures.len().to_string(),
    ]);
    row
}

fn mean_row(
    group: &Group<'_>,
    mean: &MethodMean<'_>,
    quantities: &BTreeSet<Quantity>,
) -> Vec<String> {
    let mut row = leading(group, "mean", &mean.scenes.to_string(), mean.method);
    let scores: &BTreeMap<Quantity, f64> = &mean.scores;
    row.extend(
        quantities
            .iter()
            .map(|quantity| optional(scores.get(quantity).copied().map(csv_score))),
    );
    let three = |value: Option<f64>| optional(value.map(|value| format!("{value:.3}")));
    row.extend([
        three(mean.training_seconds),
        three(mean.gaussians),
        three(mean.iterations),
        String::new(),
        String::new(),
        mean.failures.to_string(),
    ]);
    row
}

fn leading(group: &Group<'_>, row: &str, scene: &str, method: &str) -> Vec<String> {
    [&group.protocol, &group.protocol_hash, row, scene, method]
        .map(str::to_owned)
        .to_vec()
}

fn optional(value: Option<impl ToString>) -> String {
    value.map(|value| value.to_string()).unwrap_or_default()
}
