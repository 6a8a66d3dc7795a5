//! The Markdown tables.

use omnilife_schemas::records::ResultRecord;

use crate::{
    format::{arrow, cell, grouped, metric_title, score},
    ranking::{Group, MethodMean, Quantity, ViewKind, best},
};

/// The metrics of the published tables; the others are in the CSV.
const PUBLISHED: [&str; 2] = ["psnr", "ssim"];

/// How many digits of a protocol's hash are printed.
const HASH_DIGITS: usize = 12;

/// Columns of text, before the numbers.
const TEXT_COLUMNS: usize = 2;

/// Marks a row with views that could not be scored.
const FAILURE_MARK: &str = "†";

/// Renders one table per group.
pub(crate) fn render(groups: &[Group<'_>]) -> String {
    let mut text = String::from("# Leaderboard\n");
    for group in groups {
        text.push('\n');
        text.push_str(&table(group));
    }
    text
}

fn table(group: &Group<'_>) -> String {
    let columns = columns(group);
    let hash: String = group.protocol_hash.chars().take(HASH_DIGITS).collect();
    let title = format!("## Protocol {} ({})", cell(&group.protocol), cell(&hash));
    let mut rows = vec![header(group, &columns)];
    rows.extend(scene_rows(group, &columns));
    rows.extend(mean_rows(group, &columns));
    let mut lines = vec![title, String::new()];
    lines.extend(aligned(&rows));
    lines.push(String::new());
    lines.extend(notes(group));
    lines.push(String::new());
    lines.join("\n")
}

/// Lines of a Markdown table, padded so that it reads well in a terminal too. The first row is
/// the header; the first two columns are text, the others numbers.
fn aligned(rows: &[Vec<String>]) -> Vec<String> {
    let count = rows.first().map_or(0, Vec::len);
    let widths: Vec<usize> = (0..count)
        .map(|column| {
            let cells = rows.iter().map(|row| row[column].chars().count());
            cells.max().unwrap_or(0).max(4)
        })
        .collect();
    let line = |cells: Vec<String>| format!("| {} |", cells.join(" | "));
    let mut lines: Vec<String> = rows
        .iter()
        .map(|row| {
            let cells = row.iter().zip(&widths).enumerate();
            line(
                cells
                    .map(|(column, (cell, &width))| {
                        if column < TEXT_COLUMNS {
                            format!("{cell:<width$}")
                        } else {
                            format!("{cell:>width$}")
                        }
                    })
                    .collect(),
            )
        })
        .collect();
    let rule = widths.iter().enumerate().map(|(column, &width)| {
        if column < TEXT_COLUMNS {
            "-".repeat(width)
        } else {
            "-".repeat(width - 1) + ":"
        }
    });
    lines.insert(1, line(rule.collect()));
    lines
}

/// The published metrics that the group has, input views first.
fn columns(group: &Group<'_>) -> Vec<Quantity> {
    ViewKind::ALL
        .into_iter()
        .flat_map(|kind| {
            PUBLISHED
                .into_iter()
                .filter(|&metric| group.directions.contains_key(metric))
                .map(move |metric| (kind, metric.to_owned()))
        })
        .collect()
}

fn header(group: &Group<'_>, columns: &[Quantity]) -> Vec<String> {
    let mut cells = vec!["Scene".to_owned(), "Method".to_owned()];
    cells.extend(columns.iter().map(|(kind, metric)| {
        let direction = group.directions.get(metric).copied().map_or("", arrow);
        format!(
            "{} {} {direction}",
            title_case(kind.name()),
            metric_title(metric)
        )
    }));
    cells.extend(
        [
            "Training (s)",
            "Gaussians",
            "Iterations",
            "Views",
            "Failures",
        ]
        .map(str::to_owned),
    );
    cells
}

fn scene_rows(group: &Group<'_>, columns: &[Quantity]) -> Vec<Vec<String>> {
    let of = |result: &ResultRecord, (kind, metric): &Quantity| {
        kind.scores(result).get(metric).map(|summary| summary.mean)
    };
    let rows = group.results.iter().map(|result| {
        let mut cells = vec![
            cell(&result.scene),
            marked(&result.method, !result.failures.is_empty()),
        ];
        for quantity in columns {
            // Rivals are the methods that scored all views of the same scene.
            let rivals: Vec<f64> = group
                .results
                .iter()
                .filter(|other| other.scene == result.scene && other.failures.is_empty())
                .filter_map(|other| of(other, quantity))
                .collect();
            let competes = result.failures.is_empty();
            cells.push(score_cell(
                group,
                quantity,
                of(result, quantity),
                &rivals,
                competes,
            ));
        }
        cells.extend([
            seconds(result.training_seconds),
            count(result.gaussians),
            count(result.iterations),
            views(result),
            result.failures.len().to_string(),
        ]);
        cells
    });
    rows.collect()
}

fn mean_rows(group: &Group<'_>, columns: &[Quantity]) -> Vec<Vec<String>> {
    let complete: Vec<&MethodMean<'_>> = group
        .means
        .iter()
        .filter(|mean| mean.is_complete(group.scenes))
        .collect();
    let rows = group.means.iter().map(|mean| {
        let mut cells = vec![
            format!("*mean of {} of {} scenes*", mean.scenes, group.scenes),
            marked(mean.method, mean.failures > 0),
        ];
        for quantity in columns {
            let rivals: Vec<f64> = complete
                .iter()
                .filter_map(|other| other.scores.get(quantity).copied())
                .collect();
            let competes = mean.is_complete(group.scenes);
            let value = mean.scores.get(quantity).copied();
            cells.push(score_cell(group, quantity, value, &rivals, competes));
        }
        let rounded = |value: Option<f64>| count(value.map(|value| value.round() as u64));
        cells.extend([
            seconds(mean.training_seconds),
            rounded(mean.gaussians),
            rounded(mean.iterations),
            String::new(),
            mean.failures.to_string(),
        ]);
        cells
    });
    rows.collect()
}

/// A score, bold where it is the best of its rivals.
fn score_cell(
    group: &Group<'_>,
    (_, metric): &Quantity,
    value: Option<f64>,
    rivals: &[f64],
    competes: bool,
) -> String {
    let Some(value) = value else {
        return "–".to_owned();
    };
    let print = |value: f64| score(metric, value);
    let printed = print(value);
    let direction = group.directions.get(metric);
    let best = direction.and_then(|&direction| best(rivals, direction, print));
    if competes && best.as_ref() == Some(&printed) {
        format!("**{printed}**")
    } else {
        printed
    }
}

/// How the numbers were made, what failed and what the results remark.
fn notes(group: &Group<'_>) -> Vec<String> {
    let mut lines = vec![
        "Input: the views that a method was given; Novel: the views that it had to predict. Scores \
         are means over the views of a scene; a dash means not scored. Views: scored input + novel \
         views. Only results of this protocol hash are compared."
            .to_owned(),
    ];
    if !group.means.is_empty() {
        lines.push(
            "Mean rows are arithmetic means of the per-scene means, every scene with the same \
             weight; only methods with complete results on all scenes compete for the best mean."
                .to_owned(),
        );
    }
    lines.push("Bold: best of at least two methods without failures, after rounding.".to_owned());
    let failed = |result: &&&ResultRecord| !result.failures.is_empty();
    if group.results.iter().any(|result| failed(&result)) {
        lines.push(format!(
            "{FAILURE_MARK} Some views could not be scored; the means are over the others and are \
             not comparable."
        ));
    }
    let remarks: Vec<String> = group
        .results
        .iter()
        .flat_map(|result| remarks(result))
        .collect();
    if !remarks.is_empty() {
        lines.push(String::new());
        lines.extend(remarks);
    }
    lines
}

fn remarks(result: &ResultRecord) -> Vec<String> {
    let title = format!("{}, {}", cell(&result.scene), cell(&result.method));
    let failures = result.failures.first().map(|first| {
        format!(
            "- {title}: {} of its views failed, the first is {} view {}: {}",
            result.failures.len(),
            cell(&first.view),
            first.frame,
            cell(&first.reason)
        )
    });
    let warnings = result
        .warnings
        .iter()
        .map(|warning| format!("- {title}: {}", cell(warning)));
    failures.into_iter().chain(warnings).collect()
}

fn marked(method: &str, failures: bool) -> String {
    let mark = if failures {
        format!(" {FAILURE_MARK}")
    } else {
        String::new()
    };
    format!("{}{mark}", cell(method))
}

fn views(result: &ResultRecord) -> String {
    let scored = ViewKind::ALL.map(|kind| {
        let views = kind.scores(result).values().map(|summary| summary.views);
        views.max().unwrap_or(0)
    });
    format!("{} + {}", scored[0], scored[1])
}

fn seconds(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.1}"))
}

fn count(value: Option<u64>) -> String {
    value.map_or_else(|| "–".to_owned(), grouped)
}

fn title_case(word: &str) -> String {
    let mut characters = word.chars();
    characters.next().map_or_else(String::new, |first| {
        first.to_uppercase().collect::<String>() + characters.as_str()
    })
}
