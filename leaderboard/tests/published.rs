//! The published tables: transcribed rightly, and what does not add up in them.
#![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

use std::{
    fs,
    path::{Path, PathBuf},
};

use omnilife_leaderboard::published::{
    Paper, PublishedCell, findings, inconsistencies_markdown, papers,
};

const REPORT: &str = "../docs/published-inconsistencies.md";

/// Text versions of the papers by id, where they are at hand.
fn paper_texts() -> Option<Vec<(&'static str, String)>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/papers");
    let Ok(entries) = fs::read_dir(&folder) else {
        println!("skipped: the papers are not at {}", folder.display());
        return None;
    };
    let files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    let numbers = [
        ("omnilife360", "000_"),
        ("panogs", "001_"),
        ("uav-urban", "002_"),
        ("neural-atlas-graphs", "003_"),
    ];
    let read = |prefix: &str| {
        let file = files.iter().find(|file| {
            file.file_name()
                .unwrap()
                .to_string_lossy()
                .starts_with(prefix)
        });
        fs::read_to_string(file.unwrap()).unwrap()
    };
    Some(numbers.map(|(id, prefix)| (id, read(prefix))).to_vec())
}

#[test]
fn every_table_of_the_four_papers_is_there() {
    let numbers: Vec<(String, Vec<u32>)> = papers()
        .unwrap()
        .into_iter()
        .map(|paper| {
            let tables = paper.tables.iter().map(|table| table.number).collect();
            (paper.id, tables)
        })
        .collect();
    let expected = [
        ("omnilife360", 6),
        ("panogs", 4),
        ("uav-urban", 1),
        ("neural-atlas-graphs", 13),
    ];
    let expected = expected.map(|(id, last)| (id.to_owned(), (1..=last).collect()));
    assert_eq!(numbers, expected);
}

#[test]
fn cells_fit_their_columns() {
    for paper in papers().unwrap() {
        for table in &paper.tables {
            for row in &table.rows {
                let place = format!("{}, table {}, line {}", paper.id, table.number, row.line);
                assert_eq!(row.cells.len(), table.columns.len(), "{place}");
                for (column, cell) in row.cells.iter().enumerate() {
                    let quantity = table.quantity(row, column);
                    assert!(
                        cell.number().is_none() || quantity.is_some(),
                        "{place}: no unit"
                    );
                    if let Some(value) = cell.number() {
                        assert!(value.is_finite() && value >= 0.0, "{place}: {value}");
                    }
                }
            }
        }
    }
}

/// Every number and name of a row stands in the line that the row names, in the same order.
#[test]
fn rows_are_what_the_papers_print() {
    let Some(texts) = paper_texts() else { return };
    let papers = papers().unwrap();
    for (id, text) in &texts {
        let paper = papers.iter().find(|paper| paper.id == *id).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        for table in &paper.tables {
            let caption = lines[table.line - 1];
            assert!(
                caption.contains(&format!("Table {}", table.number)),
                "{caption}"
            );
            for row in &table.rows {
                let line = lines[row.line - 1].replace("\\geq", "≥").replace('$', "");
                let mut rest = line.as_str();
                for (column, cell) in row.cells.iter().enumerate() {
                    let decimals = table.quantity(row, column).map_or(0, |of| of.decimals);
                    for printed in printed_forms(cell, decimals) {
                        // A name that a row shares with the one above is printed there alone.
                        let shared = column == 0 && line.starts_with('\t');
                        let Some(at) = find_either(rest, &printed) else {
                            assert!(shared, "{id}, line {}: {printed:?} not in {rest}", row.line);
                            continue;
                        };
                        rest = &rest[at..];
                    }
                }
            }
        }
    }
}

/// What has to be found for a cell, one after the other.
fn printed_forms(cell: &PublishedCell, decimals: usize) -> Vec<Vec<String>> {
    let number = |value: f64| {
        let text = format!("{value:.decimals$}");
        let digits = text.len();
        let grouped = if decimals == 0 && digits > 3 {
            let mut grouped = text.clone();
            let mut at = digits;
            while at > 3 {
                at -= 3;
                grouped.insert(at, ',');
            }
            grouped
        } else {
            text.clone()
        };
        // FID is printed with three digits where FVD has none; a single form must be there.
        vec![text, grouped]
    };
    match cell {
        PublishedCell::Number(value) => vec![number(*value)],
        PublishedCell::Spread([mean, deviation]) => vec![number(*mean), number(*deviation)],
        PublishedCell::Text(text) => {
            let words = text.split([' ', '=']).filter(|word| !word.is_empty());
            // "3F/4" is printed as "F3/4".
            words
                .map(|word| vec![word.to_owned(), word.replace("3F/4", "F3/4")])
                .collect()
        }
        PublishedCell::Empty => Vec::new(),
    }
}

/// The end of the first place where one of the forms stands.
fn find_either(text: &str, forms: &[String]) -> Option<usize> {
    let ends = forms
        .iter()
        .filter_map(|form| text.find(form.as_str()).map(|at| at + form.len()));
    ends.min()
}

#[test]
fn quotations_are_to_the_letter() {
    let Some(texts) = paper_texts() else { return };
    for finding in findings(&papers().unwrap()) {
        let (_, text) = texts.iter().find(|(id, _)| *id == finding.paper).unwrap();
        for quote in finding.quotes {
            assert!(text.contains(quote), "{}: {quote}", finding.place);
        }
    }
}

/// A check that finds no table or row says nothing, so the number of findings is fixed here.
#[test]
fn the_report_is_what_the_tables_give() {
    let papers = papers().unwrap();
    let findings = findings(&papers);
    let count = |id: &str| {
        findings
            .iter()
            .filter(|finding| finding.paper == id)
            .count()
    };
    let counts: Vec<usize> = papers.iter().map(|paper| count(&paper.id)).collect();
    assert_eq!(counts, [10, 6, 2, 21]);
    let report = inconsistencies_markdown(&papers, &findings);
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(REPORT);
    if std::env::var_os("UPDATE_DOCS").is_some() {
        fs::write(&path, &report).unwrap();
    }
    assert_eq!(
        fs::read_to_string(&path).unwrap(),
        report,
        "run with UPDATE_DOCS=1"
    );
}

fn with_cell(table: u32, row: usize, column: usize, value: f64) -> Vec<Paper> {
    let mut papers = papers().unwrap();
    let paper = papers.iter_mut().find(|paper| paper.id == "omnilife360");
    let tables = &mut paper.unwrap().tables;
    let table = tables
        .iter_mut()
        .find(|found| found.number == table)
        .unwrap();
    table.rows[row].cells[column] = PublishedCell::Number(value);
    papers
}

/// The checks can fail: a changed digit is found.
#[test]
fn a_wrong_digit_is_found() {
    let holds = |papers: &[Paper], place: &str| {
        let found = findings(papers);
        let mut of_place = found
            .iter()
            .filter(|finding| finding.paper == "omnilife360" && finding.place == place);
        of_place.next().unwrap().holds
    };
    assert!(holds(&papers().unwrap(), "Table 4"));
    assert!(!holds(&with_cell(4, 0, 2, 15.978), "Table 4"));
    assert!(holds(&papers().unwrap(), "Table 6"));
    assert!(!holds(&with_cell(6, 0, 1, 21.474), "Table 6"));
    assert!(holds(&papers().unwrap(), "Table 1 and Section 3"));
    assert!(!holds(&with_cell(1, 7, 4, 2470.0), "Table 1 and Section 3"));
}
