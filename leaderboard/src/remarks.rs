//! Remarks of results, the most serious first: warnings of a wrong convention, then failures, then other warnings. A
//! line shared by several results is one line with their number.

use std::collections::BTreeMap;

use omnilife_schemas::records::ResultRecord;

use crate::{group::SceneRow, numbers::is_diagnosis};

/// Number of results that a shared line names.
const NAMED: usize = 3;

/// Remarks of some rows.
pub(crate) struct Remarks {
    /// Warnings of a wrong convention.
    pub(crate) diagnoses: Vec<String>,
    /// Failed runs, then results with views that could not be scored.
    pub(crate) failures: Vec<String>,
    pub(crate) warnings: Vec<String>,
}

impl Remarks {
    pub(crate) fn of(rows: &[&SceneRow<'_>]) -> Self {
        let mut diagnoses = Lines::default();
        let mut runs = Lines::default();
        let mut views = Lines::default();
        let mut warnings = Lines::default();
        for row in rows {
            for result in &row.results {
                let place = place(row, result);
                if let Some(reason) = result.why_incomplete() {
                    let failures = match result.run_failure {
                        Some(_) => &mut runs,
                        None => &mut views,
                    };
                    failures.add(&reason, &place);
                }
                for warning in &result.warnings {
                    let lines = match is_diagnosis(warning) {
                        true => &mut diagnoses,
                        false => &mut warnings,
                    };
                    lines.add(warning, &place);
                }
            }
        }
        let mut failures = runs.merged();
        failures.extend(views.merged());
        Self {
            diagnoses: diagnoses.merged(),
            failures,
            warnings: warnings.merged(),
        }
    }

    /// Returns the lines that a reader must know before any score.
    pub(crate) fn serious(&self) -> impl Iterator<Item = &String> {
        self.diagnoses.iter().chain(&self.failures)
    }
}

/// Returns why a method is not complete, in a line: its first failed run, or else its first result with failed views.
pub(crate) fn why_incomplete(rows: &[&SceneRow<'_>]) -> Option<String> {
    let results = || rows.iter().flat_map(|row| row.results.iter().copied());
    let failed_run = results().find(|result| result.run_failure.is_some());
    let result = failed_run.or_else(|| results().find(|result| !result.is_complete()))?;
    Some(format!("{}: {}", result.scene, result.why_incomplete()?))
}

/// Returns the name of a result among others.
fn place(row: &SceneRow<'_>, result: &ResultRecord) -> String {
    let place = format!("{}, {}", row.scene, row.method);
    match result.seed.filter(|_| row.results.len() > 1) {
        Some(seed) => format!("{place}, seed {seed}"),
        None => place,
    }
}

/// Lines in the order of their first mention.
#[derive(Default)]
struct Lines {
    lines: Vec<(String, Vec<String>)>,
    known: BTreeMap<String, usize>,
}

impl Lines {
    fn add(&mut self, line: &str, place: &str) {
        let at = *self.known.entry(line.to_owned()).or_insert_with(|| {
            self.lines.push((line.to_owned(), Vec::new()));
            self.lines.len() - 1
        });
        let places = &mut self.lines[at].1;
        if places.last().is_none_or(|last| last != place) {
            places.push(place.to_owned());
        }
    }

    fn merged(self) -> Vec<String> {
        let lines = self.lines.into_iter();
        lines.map(|(line, places)| merged(&line, &places)).collect()
    }
}

/// Returns a line with the results that have it.
fn merged(line: &str, places: &[String]) -> String {
    if let [place] = places {
        return format!("{place}: {line}");
    }
    let named = places[..places.len().min(NAMED)].join("; ");
    let more = match places.len().saturating_sub(NAMED) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    format!("{} results: {line} ({named}{more})", places.len())
}

#[cfg(test)]
mod tests {
    use super::merged;

    #[test]
    fn a_shared_line_is_counted_and_names_the_first_results() {
        let places: Vec<String> = (0..5).map(|place| format!("p{place}")).collect();
        assert_eq!(merged("dark", &places[..1]), "p0: dark");
        assert_eq!(merged("dark", &places[..2]), "2 results: dark (p0; p1)");
        assert_eq!(
            merged("dark", &places),
            "5 results: dark (p0; p1; p2 and 2 more)"
        );
    }
}
