//! Assets for web viewers: counts, sizes and export times as in PanoGS, Tables 2 and 3, and the quality of each level
//! of detail.

use std::collections::BTreeSet;

use omnilife_schemas::records::{Asset, AssetLevel, Direction, ResultRecord};

use crate::{
    assets::FoundAsset,
    format,
    group::ViewKind,
    published::{NOT_COMPARABLE, Paper, PublishedTable},
    table::{Cell, Column, Mark, PublishedBlock, Row, Table},
};

const PAPER: &str = "panogs";
/// The levels of the paper, by our names.
const LEVELS: [&str; 3] = ["1M", "5M", "full"];
/// Bytes in a megabyte, as the paper counts them.
const MEGABYTE: f64 = 1e6;

/// Returns two tables: assets, and their levels. None without assets.
pub(crate) fn tables(assets: &[FoundAsset], papers: &[Paper]) -> Vec<Table> {
    if assets.is_empty() {
        return Vec::new();
    }
    vec![of_assets(assets, papers), of_levels(assets)]
}

fn of_assets(assets: &[FoundAsset], papers: &[Paper]) -> Table {
    let columns = [
        "Gaussians",
        "1M level",
        "5M level",
        "Full",
        "Size (MB)",
        "Export (s)",
    ];
    let row = |asset: &FoundAsset| {
        let record = &asset.record;
        let mut cells = vec![Cell::count(record.splats as usize)];
        cells.extend(LEVELS.map(|name| {
            let level = record.levels.iter().find(|level| level.name == name);
            level.map_or(Cell::Missing, |level| Cell::count(level.splats as usize))
        }));
        let largest = record.levels.last();
        cells.push(Cell::number(largest.map(megabytes), 2));
        cells.push(Cell::number(Some(record.wall_seconds), 3));
        Row {
            names: names(record),
            cells,
            ..Row::default()
        }
    };
    let paper = papers.iter().find(|paper| paper.id == PAPER);
    // Table 3 has the number of scenes before the numbers of Table 2.
    let published = [(2, 1), (3, 2)].into_iter().filter_map(|(number, first)| {
        let paper = paper?;
        Some(published(paper, paper.table(number)?, first))
    });
    Table {
        title: "Assets".to_owned(),
        names: ["Scene", "Method"].map(str::to_owned).into(),
        columns: columns
            .map(|name| Column {
                missing: Some("not among the levels that were asked for, or not smaller than the scene".to_owned()),
                ..Column::plain(name)
            })
            .into(),
        rows: assets.iter().map(row).collect(),
        published: published.collect(),
        notes: vec![
            "Gaussians are those that a viewer can draw; the size is that of the largest level, 32 bytes a \
             Gaussian, in millions of bytes. Export is the wall-clock time of all levels together, written, \
             hashed and synced; the paper does not say what its own includes, or on which machine. \
             Nothing is ranked."
                .to_owned(),
        ],
    }
}

fn of_levels(assets: &[FoundAsset]) -> Table {
    let mut columns: Vec<Column> = ["Gaussians", "Size (MB)", "Growth"]
        .map(Column::plain)
        .into();
    columns.extend(["psnr", "ssim"].map(|metric| Column {
        direction: Some(Direction::HigherIsBetter),
        missing: Some("the level was not scored".to_owned()),
        ..Column::plain(&format::metric_title(metric))
    }));
    let row = |record: &Asset, level: &AssetLevel, scores: Option<&ResultRecord>| {
        let mut names = names(record);
        names.push(level.name.clone());
        let score = |metric: &str| {
            let summary = scores.and_then(|scores| ViewKind::Novel.scores(scores).get(metric));
            Cell::score(summary.map(|summary| summary.mean), metric, None)
        };
        Row {
            names,
            cells: vec![
                Cell::count(level.splats as usize),
                Cell::number(Some(megabytes(level)), 2),
                Cell::number(Some(level.growth), 2),
                score("psnr"),
                score("ssim"),
            ],
            class: None,
            failures: scores.map_or(0, |scores| scores.failures.len()),
            marks: scores
                .filter(|scores| !scores.is_complete())
                .map(|_| Mark::Incomplete)
                .into_iter()
                .collect(),
        }
    };
    let rows = assets.iter().flat_map(|asset| {
        let levels = asset.record.levels.iter().zip(&asset.scores);
        levels.map(|(level, scores)| row(&asset.record, level, scores.as_ref()))
    });
    let scored = || {
        let scores = assets.iter().flat_map(|asset| &asset.scores);
        scores.flatten()
    };
    let protocols: BTreeSet<String> = scored()
        .map(|result| format!("{} ({:.12})", result.protocol, result.protocol_hash))
        .collect();
    let protocols: Vec<String> = protocols.into_iter().collect();
    let mut notes =
        vec!["Gaussians of smaller levels are larger by the growth, for being fewer.".to_owned()];
    if !protocols.is_empty() {
        notes.push(format!(
            "PSNR and SSIM of novel views by protocol {}.",
            protocols.join(", ")
        ));
    }
    let incomplete: BTreeSet<String> = scored().filter_map(ResultRecord::why_incomplete).collect();
    notes.extend(
        (incomplete.iter()).map(|reason| format!("{} {reason}.", Mark::Incomplete.symbol())),
    );
    Table {
        title: "Levels of detail".to_owned(),
        names: ["Scene", "Method", "Level"].map(str::to_owned).into(),
        columns,
        rows: rows.collect(),
        published: Vec::new(),
        notes,
    }
}

/// Returns scene and method; an asset of a file of Gaussians has neither.
fn names(record: &Asset) -> Vec<String> {
    let source = &record.source;
    [&source.scene, &source.method]
        .map(|name| name.clone().unwrap_or_else(|| "unknown".to_owned()))
        .into()
}

fn megabytes(level: &AssetLevel) -> f64 {
    level.bytes as f64 / MEGABYTE
}

/// Returns the rows of a published table whose numbers start in column `first`.
fn published(paper: &Paper, table: &PublishedTable, first: usize) -> PublishedBlock {
    let rows = table.rows.iter().map(|row| {
        let numbers = row.cells.iter().enumerate().skip(first);
        Row {
            names: vec![row.name().to_owned(), paper.name_outside("Ours")],
            cells: numbers
                .map(|(column, cell)| {
                    let decimals = table.quantity(row, column).map_or(0, |of| of.decimals);
                    Cell::number(cell.number(), decimals)
                })
                .collect(),
            ..Row::default()
        }
    });
    PublishedBlock {
        source: format!("Authors' figures: PanoGS, Table {}", table.number),
        rows: rows.collect(),
        notes: vec![NOT_COMPARABLE.to_owned()],
    }
}
