//! PanoGS.

use super::{Finding, half_digit};
use crate::published::{Paper, PublishedTable};

pub(super) const ID: &str = "panogs";

/// Bytes of one Gaussian in a `.splat` file.
const SPLAT_BYTES: f64 = 32.0;

pub(super) fn check(paper: &Paper) -> Option<Vec<Finding>> {
    let [configuration, scenes, averages, variants] = [
        paper.table(1)?,
        paper.table(2)?,
        paper.table(3)?,
        paper.table(4)?,
    ];
    Some(vec![
        sizes("Table 2", scenes, 4, 5),
        sizes("Table 3", averages, 5, 6),
        levels_of_detail(scenes),
        more_seeds_than_pixels(configuration, scenes)?,
        scene_counts(configuration, averages)?,
        rubric(variants),
    ])
}

fn finding(place: &str, holds: bool, text: String) -> Finding {
    Finding::new(ID, place, holds, text)
}

/// A `.splat` file has 32 bytes per Gaussian and nothing else.
fn sizes(place: &str, table: &PublishedTable, gaussians: usize, size: usize) -> Finding {
    let wrong = table.rows.iter().filter(|row| {
        let (Some(count), Some(megabytes)) =
            (row.cells[gaussians].number(), row.cells[size].number())
        else {
            return true;
        };
        (count * SPLAT_BYTES / 1e6 - megabytes).abs() > half_digit(2) + 1e-9
    });
    let wrong = wrong.count();
    finding(
        place,
        wrong == 0,
        format!(
            "{} of {} file sizes are 32 bytes times the Gaussians of the full-native level.",
            table.rows.len() - wrong,
            table.rows.len()
        ),
    )
}

fn levels_of_detail(scenes: &PublishedTable) -> Finding {
    let holds = scenes.rows.iter().all(|row| {
        let number = |column: usize| row.cells[column].number().unwrap_or(f64::NAN);
        number(3) == number(1).min(5e6) && number(2) == 1e6 && number(4) == number(1)
    });
    finding(
        "Table 2",
        holds,
        "Every 5M level has all seeds up to five million, every full-native level all of them."
            .to_owned(),
    )
}

/// Every seed is one pixel of one panorama.
fn more_seeds_than_pixels(
    configuration: &PublishedTable,
    scenes: &PublishedTable,
) -> Option<Finding> {
    let resolution = configuration.row("HM3D test")?.cells[3].text()?;
    let (width, height) = resolution.split_once('×')?;
    let pixels: f64 = width.parse::<f64>().ok()? * height.parse::<f64>().ok()? * 10.0;
    let scene = "HM3D 00801-HaxA7YrQdEC_0000";
    let seeds = scenes.number(scene, 1)?;
    Some(
        finding(
            "Tables 1 and 2",
            seeds <= pixels,
            format!(
                "{scene} has {seeds} seeds, one per valid depth sample, but its at most 10 \
                 panoramas of {resolution} have {pixels} pixels. The Replica scenes, at sixteen \
                 times the pixels, have about as many seeds ({}), so either the resolutions or the \
                 seeds \"at native resolution\" are not what the tables say.",
                scenes.number("Replica apartment_0_rand", 1)?
            ),
        )
        .quoting("For each valid depth sample")
        .quoting("Since native-resolution panoramas can produce tens of millions of samples"),
    )
}

fn scene_counts(configuration: &PublishedTable, averages: &PublishedTable) -> Option<Finding> {
    let listed = configuration.number("HM3D test", 1)?;
    let processed = averages.number("HM3D test", 1)?;
    Some(
        finding(
            "Tables 1 and 3",
            listed == processed,
            format!(
                "Table 1 lists {listed} HM3D scenes under the heading of what was processed; \
                 Table 3 averages over {processed}."
            ),
        )
        .quoting("HM3D is reported for the full test directory inventory"),
    )
}

fn rubric(variants: &PublishedTable) -> Finding {
    let outside: Vec<&str> = variants
        .rows
        .iter()
        .flat_map(|row| &row.cells[1..])
        .filter_map(|cell| cell.text())
        .filter(|rating| !["Low", "Medium", "High"].contains(rating))
        .collect();
    finding(
        "Table 4",
        outside.is_empty(),
        format!(
            "The rating {} is none of the three that the rubric defines.",
            outside.join(", ")
        ),
    )
    .quoting("Ratings use a fixed rubric")
}
