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
    let expected = [("omnilife360", vec![2, 3, 4, 5, 6]), ("panogs", vec![2, 3])];
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
