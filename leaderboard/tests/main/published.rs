//! The published tables that are shown are whole.

use omnilife_leaderboard::published::papers;

#[test]
fn every_table_that_is_shown_is_there() {
    let numbers: Vec<(String, Vec<u32>)> = papers()
        .unwrap()
        .into_iter()
        .map(|paper| {
            let tables = paper.tables.iter().map(|table| table.number).collect();
            (paper.id, tables)
        })
        .collect();
    let expected = [
        ("omnilife360", vec![2, 3, 4, 5, 6]),
        ("panogs", vec![2, 3]),
        ("anchors", vec![1, 2, 3, 4, 5, 6]),
        ("neural-atlas-graphs", (3..=12).collect()),
        ("uav-urban", vec![1]),
    ];
    let expected = expected.map(|(id, tables)| (id.to_owned(), tables));
    assert_eq!(numbers, expected);
}

#[test]
fn cells_fit_their_columns() {
    for paper in papers().unwrap() {
        for table in &paper.tables {
            for row in &table.rows {
                let place = format!("{}, table {}, {}", paper.id, table.number, row.name());
                assert_eq!(row.cells.len(), table.columns.len(), "{place}");
                for (column, cell) in row.cells.iter().enumerate() {
                    let quantity = table.quantity(row, column);
                    assert!(
                        cell.number().is_none() || quantity.is_some(),
                        "{place}: no metric"
                    );
                    if let Some(value) = cell.number() {
                        assert!(value.is_finite() && value >= 0.0, "{place}: {value}");
                    }
                }
            }
        }
    }
}

#[test]
fn anchors_have_sources_and_a_mean_that_is_one() {
    let papers = papers().unwrap();
    for paper in &papers {
        for table in &paper.tables {
            let source = table.source.as_deref();
            let is_anchor = paper.id == "anchors";
            assert_eq!(
                source.is_some(),
                is_anchor,
                "{}, {}",
                paper.id,
                table.number
            );
            assert!(source.is_none_or(|source| source.starts_with("https://")));
        }
    }
    let anchors = papers.iter().find(|paper| paper.id == "anchors").unwrap();
    let (mean, scenes) = anchors.tables[0].rows.split_last().unwrap();
    assert_eq!(scenes.len(), 11);
    for (column, rounding) in [(1, 6e-5), (2, 6e-7), (3, 6e-7)] {
        let sum: f64 = scenes
            .iter()
            .filter_map(|row| row.cells[column].number())
            .sum();
        let printed = mean.cells[column].number().unwrap();
        assert!(
            (sum / 11.0 - printed).abs() < rounding,
            "{column}: {printed}"
        );
    }
}

#[test]
fn the_page_on_anchors_has_their_figures() {
    let page = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/guides/anchor.md");
    let page = std::fs::read_to_string(page).unwrap();
    let papers = papers().unwrap();
    let anchors = papers.iter().find(|paper| paper.id == "anchors").unwrap();
    // The page has the mean of the first table alone.
    assert!(page.contains("| 34.43 | 0.936 | 0.140 |"));
    for table in anchors.tables.iter().skip(1) {
        for row in &table.rows {
            let figures: Vec<String> = (1..row.cells.len())
                .map(|column| {
                    let decimals = table.quantity(row, column).unwrap().decimals;
                    format!("{:.decimals$}", row.cells[column].number().unwrap())
                })
                .collect();
            let has_all = |line: &str| {
                let cells: Vec<&str> = line.split('|').map(str::trim).collect();
                figures
                    .iter()
                    .all(|figure| cells.contains(&figure.as_str()))
            };
            assert!(page.lines().any(has_all), "{}: {figures:?}", row.name());
        }
    }
}

/// Rows of means of Neural Atlas Graphs on DAVIS, which weigh each sequence alike, are those of the other rows.
#[test]
fn printed_means_are_those_of_their_rows() {
    let papers = papers().unwrap();
    let paper = papers
        .iter()
        .find(|paper| paper.id == "neural-atlas-graphs");
    let table = paper.unwrap().table(5).unwrap();
    for method in ["Ours", "OmnimatteRF", "Layered Neural Atlases"] {
        let rows = table.rows.iter();
        let rows: Vec<_> = rows
            .filter(|row| row.cells[1].text() == Some(method))
            .collect();
        let (mean, sequences) = rows.split_last().unwrap();
        assert_eq!((mean.name(), sequences.len()), ("Mean", 15));
        for (column, rounding) in [(2, 0.006), (3, 0.0006), (4, 0.0007)] {
            let scores = sequences
                .iter()
                .filter_map(|row| row.cells[column].number());
            let off = scores.sum::<f64>() / 15.0 - mean.cells[column].number().unwrap();
            assert!(off.abs() < rounding, "{method}, {column}: {off}");
        }
    }
}
