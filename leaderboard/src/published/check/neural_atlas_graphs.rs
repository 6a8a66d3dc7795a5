//! Neural Atlas Graphs.

use std::collections::BTreeMap;

use super::{Finding, is_mean, listed, weighted_mean};
use crate::published::{Paper, PublishedCell, PublishedTable};

pub(super) const ID: &str = "neural-atlas-graphs";

/// Name of the row of means.
const MEAN: &str = "Mean";

pub(super) fn check(paper: &Paper) -> Option<Vec<Finding>> {
    let subsequences = subsequences(paper.table(2)?);
    let mut findings = vec![lengths(&subsequences)?, longest_of_975(&subsequences)?];
    for number in [3, 4, 5, 11, 12] {
        findings.push(mean_row(number, paper.table(number)?, &subsequences));
    }
    findings.push(same_numbers(paper, 3, 11, 3)?);
    findings.push(same_numbers(paper, 4, 12, 4)?);
    findings.push(
        best_everywhere(5, paper.table(5)?)
            .quoting("Our method consistently yields higher quality than its competitors"),
    );
    findings.push(
        best_everywhere(3, paper.table(3)?)
            .quoting("For SSIM and LPIPS we improve against both baselines."),
    );
    findings.push(temporal_consistency(paper.table(6)?)?);
    findings.push(large_motion_gain(paper.table(8)?)?);
    findings.push(large_motion_images(paper.table(9)?));
    findings.extend(ablation(paper.table(10)?, paper.table(3)?)?);
    findings.push(against_further_methods(paper.table(11)?)?);
    findings.push(against_omnire(paper.table(3)?, paper.table(11)?)?);
    findings.push(rays());
    findings.push(citation());
    Some(findings)
}

fn finding(place: impl Into<String>, holds: bool, text: String) -> Finding {
    Finding::new(ID, place, holds, text)
}

/// Frames of every subsequence by sequence, from inclusive ranges such as `0 - 40, 40 - 93`.
fn subsequences(table: &PublishedTable) -> BTreeMap<&str, Vec<u32>> {
    let length = |range: &str| {
        let (first, last) = range.split_once(" - ")?;
        Some(last.trim().parse::<u32>().ok()? + 1 - first.trim().parse::<u32>().ok()?)
    };
    table
        .rows
        .iter()
        .filter_map(|row| {
            let ranges = row.cells[2].text()?.split(',');
            Some((row.name(), ranges.filter_map(length).collect()))
        })
        .collect()
}

fn lengths(subsequences: &BTreeMap<&str, Vec<u32>>) -> Option<Finding> {
    let all = || subsequences.values().flatten();
    let (shortest, longest) = (all().min()?, all().max()?);
    Some(
        finding(
            "Table 2",
            (*shortest, *longest) == (21, 89),
            format!(
                "The {} ranges make 25 subsequences as printed, of {shortest} to {longest} frames; \
                 none has 89.",
                all().count()
            ),
        )
        .quoting("25 subsequences, ranging from 21 to 89 frames"),
    )
}

fn longest_of_975(subsequences: &BTreeMap<&str, Vec<u32>>) -> Option<Finding> {
    let lengths = subsequences.get("s-975")?;
    let listed_lengths: Vec<String> = lengths.iter().map(u32::to_string).collect();
    Some(
        finding(
            "Tables 2 and 13",
            lengths.contains(&68),
            format!(
                "The subsequences of segment 975 have {} frames; none has 68.",
                listed(&listed_lengths)
            ),
        )
        .quoting("a subsequence from segment 975 with a length of 68 frames"),
    )
}

/// A name, and the weight of a sequence from the lengths of its subsequences.
type Weighting = (&'static str, fn(&[u32]) -> f64);

/// Whether the row of means is a mean of the rows: plain, or weighted by subsequences or frames.
fn mean_row(
    number: u32,
    table: &PublishedTable,
    subsequences: &BTreeMap<&str, Vec<u32>>,
) -> Finding {
    let weights: [Weighting; 3] = [
        ("of the rows", |_| 1.0),
        ("weighted by subsequences", |lengths| lengths.len() as f64),
        ("weighted by frames", |lengths| {
            lengths.iter().map(|&frames| f64::from(frames)).sum()
        }),
    ];
    let mut misses = [const { Vec::new() }; 3];
    let mut columns = 0;
    for column in 1..table.columns.len() {
        let (Some(printed), Some(quantity)) =
            (table.number(MEAN, column), &table.columns[column].of)
        else {
            continue;
        };
        columns += 1;
        for (weighting, (_, weight)) in weights.iter().enumerate() {
            let values: Vec<(f64, f64)> = table
                .rows
                .iter()
                .filter(|row| row.name() != MEAN)
                .filter_map(|row| {
                    let lengths = subsequences.get(row.name()).map_or(&[1][..], Vec::as_slice);
                    Some((row.cells[column].number()?, weight(lengths)))
                })
                .collect();
            let derived = weighted_mean(&values).unwrap_or(f64::NAN);
            if !is_mean(printed, derived, quantity.decimals) {
                let digits = quantity.decimals;
                misses[weighting].push(format!(
                    "{} {derived:.digits$} (printed {printed:.digits$})",
                    table.heading(column)
                ));
            }
        }
    }
    let counts: Vec<String> = weights
        .iter()
        .zip(&misses)
        .map(|((name, _), misses)| {
            format!("{} of {columns} are means {name}", columns - misses.len())
        })
        .collect();
    let mut text = format!("Row of means: {}.", listed(&counts));
    let holds = misses.iter().any(Vec::is_empty);
    if !holds {
        text.push_str(&format!(
            " No weighting explains all; weights by object, which are not published, may. Plain means \
             that differ: {}.",
            listed(&misses[0])
        ));
    }
    finding(format!("Table {number}"), holds, text)
}

/// The columns of our method stand in two tables.
fn same_numbers(paper: &Paper, first: u32, second: u32, methods: usize) -> Option<Finding> {
    let (left, right) = (paper.table(first)?, paper.table(second)?);
    // Every block begins with our method; blocks of the second table have one method more.
    let methods_of_left = 3;
    let mut compared = 0;
    let mut different = Vec::new();
    for row in &left.rows {
        for block in 0..methods {
            let (here, there) = (1 + block * methods_of_left, 1 + block * 4);
            let (Some(one), Some(two)) = (
                row.cells.get(here).and_then(PublishedCell::number),
                right.number(row.name(), there),
            ) else {
                continue;
            };
            compared += 1;
            if one != two {
                different.push(format!("{} {one} and {two}", row.name()));
            }
        }
    }
    Some(finding(
        format!("Tables {first} and {second}"),
        different.is_empty(),
        format!(
            "{} of {compared} scores of the method that stand in both tables are the same.",
            compared - different.len()
        ),
    ))
}

fn best_everywhere(number: u32, table: &PublishedTable) -> Finding {
    // Tables 3 and 5: our method leads every block of three columns.
    let mut lost = Vec::new();
    for row in &table.rows {
        for block in (1..table.columns.len()).step_by(3) {
            let Some((quantity, own)) = table.columns[block]
                .of
                .as_ref()
                .zip(row.cells[block].number())
            else {
                continue;
            };
            let Some(direction) = quantity.direction else {
                continue;
            };
            for column in block + 1..block + 3 {
                let rival = row.cells[column].number();
                if let Some(rival) = rival.filter(|&rival| direction.prefers(rival, own)) {
                    let digits = quantity.decimals;
                    lost.push(format!(
                        "{} on {} ({rival:.digits$} against {own:.digits$})",
                        table.heading(column),
                        row.name()
                    ));
                }
            }
        }
    }
    let text = if lost.is_empty() {
        "The method is best in every row and metric.".to_owned()
    } else {
        format!(
            "Best in every row and metric except: {} is better.",
            listed(&lost)
        )
    };
    finding(format!("Table {number}"), lost.is_empty(), text)
}

fn temporal_consistency(table: &PublishedTable) -> Option<Finding> {
    let mut closest = Vec::new();
    for column in [2, 4] {
        let truth = table.number("GT", column)?;
        let distance = |value: f64| (value - truth).abs();
        let best = table
            .rows
            .iter()
            .filter(|row| row.name() != "GT")
            .filter_map(|row| Some((row.name(), distance(row.cells[column].number()?))))
            .min_by(|a, b| a.1.total_cmp(&b.1))?;
        closest.push(best.0);
    }
    Some(
        finding(
            "Table 6",
            closest == ["Ours", "Ours"],
            "T-LPIPS of the method is the closest to that of the ground truth on both datasets. \
             On Waymo the spread of FVD (238) exceeds its mean (174)."
                .to_owned(),
        )
        .quoting("our method’s score is the closest to that of the Ground Truth (GT) video"),
    )
}

fn large_motion_gain(table: &PublishedTable) -> Option<Finding> {
    let mut gains = Vec::new();
    for row in &table.rows {
        for block in [1, 7] {
            let number = |column: usize| row.cells[column].number();
            let strongest = number(block + 1)?.max(number(block + 2)?);
            gains.push(number(block)? - strongest);
        }
    }
    let largest = gains.iter().copied().fold(f64::MIN, f64::max);
    let ssim = (table.number("s-254", 4)?, table.number("s-254", 5)?);
    Some(
        finding(
            "Table 8",
            (largest - 8.0).abs() < 0.5,
            format!(
                "The largest gain over the stronger baseline is {largest:.2} dB, not 8. Vehicle \
                 SSIM on s-254 is lower than that of ORe ({:.3} against {:.3}).",
                ssim.0, ssim.1
            ),
        )
        .quoting("our approach achieves substantial improvements—up to 8 dB PSNR—compared to all baselines"),
    )
}

fn large_motion_images(table: &PublishedTable) -> Finding {
    let mut worse = 0;
    let mut compared = 0;
    for row in &table.rows {
        for block in [1, 4, 7] {
            let direction = table.columns[block].of.as_ref().and_then(|of| of.direction);
            let pair = row.cells[block].number().zip(row.cells[block + 1].number());
            if let Some((direction, (own, omnire))) = direction.zip(pair) {
                compared += 1;
                worse += usize::from(direction.prefers(omnire, own));
            }
        }
    }
    finding(
        "Table 9",
        worse == 0,
        format!("{worse} of {compared} scores are worse than those of ORe: lower, not merely not higher."),
    )
    .quoting("While these composite scores are comparable to competitors ORe and ERF, they are not substantially higher.")
}

fn ablation(table: &PublishedTable, waymo: &PublishedTable) -> Option<Vec<Finding>> {
    let variants = table.rows.len() - 1;
    let experiments = 8 * variants;
    let mean = (waymo.number("s-141", 1)? + waymo.number("s-975", 1)?) / 2.0;
    let large = table.number("Large", 1)?;
    Some(vec![
        finding(
            "Table 10",
            experiments == 96,
            format!(
                "{variants} variants on 8 subsequences are {experiments} experiments; 96 would be \
                 {} variants.",
                96 / 8
            ),
        )
        .quoting("yielded 96 additional experiments"),
        underlines(table).quoting("Best results are **bold**, second best are underlined."),
        finding(
            "Tables 3 and 10",
            is_mean(large, mean, 2),
            format!(
                "The reference model has {large:.2} dB in Table 10; its rows in Table 3, four \
                 subsequences each, average {mean:.2} dB."
            ),
        ),
    ])
}

/// Second-best scores that are not underlined, and underlined ones that are not second best.
fn underlines(table: &PublishedTable) -> Finding {
    let mut wrong = Vec::new();
    for column in 1..table.columns.len() {
        let Some(direction) = table.columns[column]
            .of
            .as_ref()
            .and_then(|of| of.direction)
        else {
            continue;
        };
        let scores: Vec<f64> = table
            .rows
            .iter()
            .filter_map(|row| row.cells[column].number())
            .collect();
        let best = scores
            .iter()
            .copied()
            .reduce(|a, b| if direction.prefers(b, a) { b } else { a });
        let second = scores
            .iter()
            .copied()
            .filter(|score| Some(*score) != best)
            .reduce(|a, b| if direction.prefers(b, a) { b } else { a });
        for row in &table.rows {
            let is_second =
                row.cells[column].number().is_some() && row.cells[column].number() == second;
            if is_second != row.underlined.contains(&column) {
                let what = if is_second {
                    "is second best and not underlined"
                } else {
                    "is underlined and not second best"
                };
                wrong.push(format!(
                    "{} of {} {what}",
                    table.heading(column),
                    row.name()
                ));
            }
        }
    }
    finding("Table 10", wrong.is_empty(), format!("{}.", listed(&wrong)))
}

fn against_further_methods(table: &PublishedTable) -> Option<Finding> {
    let difference =
        |own: usize, rival: usize| Some(table.number(MEAN, own)? - table.number(MEAN, rival)?);
    let (psnr, ssim, lpips) = (difference(1, 2)?, difference(5, 6)?, difference(9, 10)?);
    let holds =
        (psnr - 4.08).abs() < 1e-9 && (ssim - 0.014).abs() < 1e-9 && (lpips - 0.005).abs() < 1e-9;
    Some(
        finding(
            "Table 11",
            holds,
            format!(
                "The differences to PVG are {psnr:.2} dB, {ssim:.3} and {lpips:.3} as printed; \
                 the last one is a loss, LPIPS being better when lower."
            ),
        )
        .quoting("in terms of PSNR (+4.08 dB) and SSIM (+0.014), while remaining competitive in LPIPS (+0.005)"),
    )
}

fn against_omnire(first: &PublishedTable, second: &PublishedTable) -> Option<Finding> {
    let difference = second.number(MEAN, 2)? - first.number(MEAN, 2)?;
    Some(
        finding(
            "Tables 3 and 11",
            (difference - 0.85).abs() < 0.005,
            format!("PVG is {difference:.2} dB above ORe by the rows of means, not 0.85 dB."),
        )
        .quoting("PVG yields a 0.85 dB higher PSNR score than ORe"),
    )
}

/// 80 epochs of 140 batches of 100,000 rays at 20 times.
fn rays() -> Finding {
    let epoch = 140.0 * 1e5 * 20.0;
    finding(
        "Section B.3 and C.7",
        false,
        format!(
            "140 batches of 100,000 rays at 20 times are {epoch:.1e} rays, as printed for one \
             epoch; 80 epochs are {:.2e}, eight times the printed total.",
            80.0 * epoch
        ),
    )
    .quoting("each epoch consists of 2.8×10^8 ray-casts")
    .quoting("our full training involves 2.8×10^9 rays over 80 epochs")
}

fn citation() -> Finding {
    finding(
        "Table 11",
        false,
        "Reference [33] is Deformable 3D Gaussians in the caption and Deformable Sprites in \
         Section D; Section C.6 cites Deformable 3D Gaussians as [32]."
            .to_owned(),
    )
    .quoting("DGS to Deformable 3D Gaussians [33]")
    .quoting("Deformable 3D Gaussians (DGS) [32]")
    .quoting("Subsequent works like Deformable Sprites [33]")
}
