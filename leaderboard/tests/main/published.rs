//! The published tables are whole; `scripts/published-tables` checks what stands in them.

use omnilife_leaderboard::published::{findings, papers};

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

#[test]
fn findings_are_of_tables_that_are_there() {
    let papers = papers().unwrap();
    for finding in findings().unwrap() {
        let paper = papers.iter().find(|paper| paper.id == finding.paper);
        let place = finding
            .place
            .replace("Tables", "Table")
            .replace(" and ", " ");
        if let Some(numbers) = place.strip_prefix("Table ") {
            let first = numbers.split(' ').next().unwrap().parse().unwrap();
            assert!(paper.unwrap().table(first).is_some(), "{place}");
        }
    }
}
