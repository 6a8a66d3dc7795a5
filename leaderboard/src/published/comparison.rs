//! Published rows in the columns of a measured table.

use super::{Paper, PublishedCell, PublishedRow, PublishedTable};
use crate::{
    format::slug,
    quantity::ViewKind,
    table::{Cell, Column, ColumnContent, PublishedBlock, Row, Score, ScoreRank},
};

/// Published counterpart of a layout: tables of one paper.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PublishedLayout {
    pub(crate) paper: &'static str,
    /// Numbers of the tables in the paper.
    pub(crate) numbers: &'static [u32],
    /// Id of the protocol of their scores.
    pub(crate) protocol: &'static str,
}

/// Additions of a published table to a measured one.
#[derive(Default)]
pub(crate) struct PublishedRows {
    pub(crate) blocks: Vec<PublishedBlock>,
    /// Lines of the measured table.
    pub(crate) notes: Vec<String>,
}

/// Id of the paper with the layouts of this leaderboard.
pub(crate) const OMNILIFE360: &str = "omnilife360";

/// Id of the paper on atlases of driving scenes and of clips.
pub(crate) const NEURAL_ATLAS_GRAPHS: &str = "neural-atlas-graphs";

/// Id of the paper on cities in UAV video.
pub(crate) const UAV_URBAN: &str = "uav-urban";

/// Figures that others print for public datasets, beside results under the published splits.
pub(crate) const ANCHORS: PublishedLayout = PublishedLayout {
    paper: "anchors",
    numbers: &[1, 2, 3, 4, 5, 6],
    protocol: "published",
};

pub(crate) const NOT_COMPARABLE: &str = "Figures of other scenes, as their authors print them: not \
                                         comparable with what was measured here.";

/// Note on figures for public datasets, which may be those of the measured scenes.
const NOT_RANKED: &str = "Figures that others print for a public dataset, by their own code and metric variants. \
                          Compare them only with results of the same scenes, split and image size. They take no \
                          part in any ranking.";

impl PublishedLayout {
    /// Returns true if the paper's table has this protocol, `per-scene/2`.
    pub(crate) fn is_of(self, protocol: &str) -> bool {
        let id = protocol.split_once('/').map_or(protocol, |(id, _)| id);
        id == self.protocol
    }
}

/// Returns the published rows with values in these columns, if the layout has the protocol. `names` is the
/// number of leading columns of names, 1 or 2 (method and metric).
pub(crate) fn published_rows(
    papers: &[Paper],
    layout: &PublishedLayout,
    protocol: &str,
    columns: &[Column],
    names: usize,
) -> PublishedRows {
    let mut found = PublishedRows::default();
    if !layout.is_of(protocol) {
        return found;
    }
    let Some(paper) = papers.iter().find(|paper| paper.id == layout.paper) else {
        return found;
    };
    let tables = layout.numbers.iter();
    for table in tables.filter_map(|&number| paper.table(number)) {
        add_table(&mut found, paper, table, columns, names);
    }
    found
}

/// Adds the rows of a table, or a note if no column of the measured table has a value of it.
fn add_table(
    found: &mut PublishedRows,
    paper: &Paper,
    table: &PublishedTable,
    columns: &[Column],
    names: usize,
) {
    let number = table.number;
    let rows: Vec<Row> = table
        .rows
        .iter()
        .map(|row| Row {
            names: row_names(paper, table, row, names),
            cells: columns
                .iter()
                .map(|column| cell(table, row, column))
                .collect(),
            ..Row::default()
        })
        .collect();
    let has_scores = |row: &Row| row.cells.iter().any(|cell| matches!(cell, Cell::Score(_)));
    if !rows.iter().any(has_scores) {
        if table.source.is_none() {
            found.notes.push(format!(
                "Table {number} of OmniLife360 has this layout and shares no scene with these \
                 results."
            ));
        }
        return;
    }
    if let Some(source) = &table.source {
        found.blocks.push(PublishedBlock {
            source: format!("Published figures: {}", table.title),
            rows,
            notes: vec![format!("{NOT_RANKED} Source: {source}.")],
        });
        return;
    }
    // Another scene may have the same name.
    let places = columns.iter().filter(|column| {
        let is_place = matches!(column.holds, ColumnContent::Place(_));
        let printed = table.columns.iter();
        is_place
            && printed
                .skip(1)
                .any(|published| slug(&published.name) == slug(&column.name))
    });
    let places: Vec<&str> = places.map(|column| column.name.as_str()).collect();
    let by_name = if places.is_empty() {
        ""
    } else {
        " (scenes by name alone)"
    };
    let mut notes = vec![format!(
        "{NOT_COMPARABLE} They are of the metric variants of their authors, who do not state which \
         LPIPS they mean, and take no part in any ranking."
    )];
    if !places.is_empty() {
        notes.push(format!(
            "Published columns are found by name alone: nothing shows that {} here and in the paper \
             are the same recording.",
            places.join(", ")
        ));
    }
    found.blocks.push(PublishedBlock {
        source: format!("Authors' figures: OmniLife360, Table {number}{by_name}"),
        rows,
        notes,
    });
}

fn row_names(
    paper: &Paper,
    table: &PublishedTable,
    row: &PublishedRow,
    names: usize,
) -> Vec<String> {
    // Table 5 names its one metric in a column; measured tables of this layout do not.
    let texts = table.columns.iter().zip(&row.cells);
    texts
        .map(|(_, cell)| paper.name_outside(cell.text().unwrap_or("")))
        .take(names)
        .collect()
}

fn cell(table: &PublishedTable, row: &PublishedRow, column: &Column) -> Cell {
    let found = (1..table.columns.len()).find(|&index| {
        let published = &table.columns[index];
        match &column.holds {
            ColumnContent::Score(quantity) => {
                let of_metric = published.of.as_ref().map(|of| of.metric.as_str());
                let kind = match published.group.as_deref() {
                    Some("Input View") => ViewKind::Input,
                    _ => ViewKind::Novel,
                };
                of_metric == Some(&quantity.metric) && kind == quantity.kind
            }
            ColumnContent::Place(place) => slug(&published.name) == slug(place),
            ColumnContent::Average => published.name == "Avg.",
            ColumnContent::Other => false,
        }
    });
    let Some(index) = found else {
        return Cell::Missing;
    };
    let decimals = table.decimals(row, index);
    match &row.cells[index] {
        PublishedCell::Number(value) | PublishedCell::Deviating([value, _]) => Cell::Score(Score {
            value: *value,
            decimals,
            interval: None,
            standing: ScoreRank::Other,
        }),
        PublishedCell::Text(text) => Cell::Text(text.clone()),
    }
}
