//! Table of the roads that `omnilife curate poses --compare` took.

use omnilife_schemas::records::{SfmAttempt, SfmReport, ValidationStatus};

const HEADINGS: [&str; 8] = [
    "road",
    "registered",
    "error deg",
    "held-out deg",
    "score",
    "loops",
    "CPU s",
    "outcome",
];

/// Returns one row per attempt, and a note on the columns. Absent numbers are dashes; the chosen row has a star.
pub(super) fn road_table(report: &SfmReport) -> String {
    let rows = report
        .attempts
        .iter()
        .enumerate()
        .map(|(index, attempt)| row(attempt, report.chosen == Some(index)));
    let rows: Vec<[String; 8]> = std::iter::once(HEADINGS.map(str::to_owned))
        .chain(rows)
        .collect();
    let width = |column: usize| {
        rows.iter()
            .map(|row| row[column].len())
            .max()
            .unwrap_or_default()
    };
    let widths: [usize; 8] = std::array::from_fn(width);
    let mut text = String::new();
    for row in &rows {
        let cells = row.iter().zip(widths);
        let cells: Vec<String> = cells
            .map(|(cell, width)| format!("{cell:<width$}"))
            .collect();
        text.push_str(cells.join("  ").trim_end());
        text.push('\n');
    }
    text.push_str(
        "error: median reprojection angle; held-out: median angle of tracks that the mapper of their own road did not \
         see (other roads may have found the same points); score: their mean credit, 1 at best; *: chosen\n",
    );
    text
}

fn row(attempt: &SfmAttempt, is_chosen: bool) -> [String; 8] {
    let number = |value: Option<f64>, digits: usize| {
        value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
    };
    let validation = attempt.validation.as_ref();
    let registered = validation.map_or_else(
        || "-".to_owned(),
        |validation| {
            format!(
                "{}/{}",
                validation.registered_frames, validation.total_frames
            )
        },
    );
    let error = validation.and_then(|validation| validation.measures.get("median_error_degrees"));
    let outcome = match (
        validation.map(|validation| validation.status),
        &attempt.failure,
    ) {
        (Some(ValidationStatus::Valid), _) => "valid",
        (Some(ValidationStatus::Unstable), _) => "unstable",
        (Some(ValidationStatus::Unchecked), _) => "not checked",
        (None, failure) => failure.as_deref().unwrap_or("no model"),
    };
    let held_out = attempt.held_out;
    [
        format!(
            "{}{}",
            attempt.configuration,
            if is_chosen { " *" } else { "" }
        ),
        registered,
        number(error.copied(), 3),
        number(held_out.and_then(|held_out| held_out.median_degrees), 3),
        number(held_out.map(|held_out| held_out.score), 3),
        attempt
            .loops
            .map_or_else(|| "-".to_owned(), |loops| loops.to_string()),
        number(attempt.cpu_seconds, 1),
        outcome.to_owned(),
    ]
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::records::{HeldOutScore, PoseValidation};

    use super::*;

    #[test]
    fn rows_have_a_cell_for_every_heading_and_the_chosen_one_a_star() {
        let failed = SfmAttempt {
            configuration: "faces".to_owned(),
            wall_seconds: 9.0,
            cpu_seconds: Some(17.21),
            loops: None,
            models: 0,
            validation: None,
            held_out: None,
            failure: Some("no features".to_owned()),
        };
        let found = SfmAttempt {
            configuration: "mixed".to_owned(),
            loops: Some(3),
            validation: Some(PoseValidation {
                status: ValidationStatus::Valid,
                registered_frames: 29,
                total_frames: 30,
                measures: [("median_error_degrees".to_owned(), 0.0624)].into(),
                problems: Vec::new(),
            }),
            held_out: Some(HeldOutScore {
                observations: 100,
                median_degrees: Some(0.0624),
                score: 0.75,
            }),
            failure: None,
            ..failed.clone()
        };
        let table = road_table(&SfmReport {
            attempts: vec![failed, found],
            chosen: Some(1),
            advice: Vec::new(),
        });
        let lines: Vec<&str> = table.lines().collect();
        assert_eq!(lines.len(), 4);
        let words: Vec<&str> = lines[2].split_whitespace().collect();
        assert_eq!(
            words,
            [
                "mixed", "*", "29/30", "0.062", "0.062", "0.750", "3", "17.2", "valid"
            ]
        );
        assert!(lines[1].ends_with("no features") && !lines[1].contains('*'));
    }
}
