//! OmniLife360 and Omni4DGS.

use super::{Finding, beaten, is_mean, listed, weighted_mean};
use crate::published::{Paper, PublishedTable};

pub(super) const ID: &str = "omnilife360";

/// Column of the average in Table 4; the scenes follow.
const AVERAGE: usize = 2;

pub(super) fn check(paper: &Paper) -> Option<Vec<Finding>> {
    let mut findings = vec![duration(paper.table(1)?)?];
    findings.extend(per_scene_methods(paper.table(2)?)?);
    findings.push(best_feed_forward(paper.table(3)?));
    findings.extend(dynamic_scenes(paper.table(4)?)?);
    findings.push(coincidence(paper.table(2)?, paper.table(4)?)?);
    findings.push(dynamic_methods(paper.table(5)?));
    findings.extend(ablation(paper.table(4)?, paper.table(6)?)?);
    Some(findings)
}

fn finding(place: &str, holds: bool, text: String) -> Finding {
    Finding::new(ID, place, holds, text)
}

/// 2,407 sequences of 98 s on average should make about 66 hours.
fn duration(datasets: &PublishedTable) -> Option<Finding> {
    let sequences = datasets.number("OmniLife360 (Ours)", 4)?;
    let (hours, seconds) = (66.0, 98.0);
    let derived = sequences * seconds / 3600.0;
    let text = format!(
        "{sequences} sequences of {seconds} s on average are {derived:.1} hours; {hours} hours \
         printed. {:.1} sequences come from each of the 418 raw videos, and {:.0} % of their 80 \
         hours are kept.",
        sequences / 418.0,
        100.0 * hours / 80.0
    );
    Some(
        finding("Table 1 and Section 3", derived.round() == hours, text)
            .quoting("2,407 geometrically consistent sequences, spanning approximately 66 hours in total")
            .quoting("The average sequence duration reaches 98 seconds")
            .quoting("418 raw panoramic sequences totaling approximately 80 hours"),
    )
}

fn per_scene_methods(table: &PublishedTable) -> Option<Vec<Finding>> {
    let lost = beaten(table, "Ours", 1..7);
    let lost: Vec<String> = lost
        .iter()
        .map(|(heading, own, best, who)| format!("{heading} {own:.3} against {best:.3} of {who}"))
        .collect();
    let gap = table.number("Ours", 1)? - table.number("Ours", 4)?;
    let other_gap = table.number("ODGS", 1)? - table.number("ODGS", 4)?;
    Some(vec![
        finding(
            "Table 2",
            lost.is_empty(),
            format!(
                "The claim leaves out one of the six columns, where Omni4DGS is worse: {}.",
                listed(&lost)
            ),
        )
        .quoting(
            "consistently improves reconstruction quality and stability in dynamic 360° scenarios",
        ),
        finding(
            "Table 2",
            gap < other_gap,
            format!(
                "Omni4DGS loses {gap:.3} dB from input to novel views, ODGS {other_gap:.3} dB: \
                 most of the gain on input views does not carry over to novel views."
            ),
        )
        .quoting("our method achieves a remarkable boost in PSNR"),
    ])
}

fn best_feed_forward(table: &PublishedTable) -> Finding {
    let lost: Vec<String> = beaten(table, "PanoSplatt3R", 1..4)
        .iter()
        .map(|(heading, own, best, who)| format!("{heading} ({best:.3} of {who}, {own:.3})"))
        .collect();
    finding(
        "Table 3",
        lost.is_empty(),
        format!(
            "PanoSplatt3R is the best feed-forward method except in {}.",
            listed(&lost)
        ),
    )
    .quoting("Compared to the best-performing feed-forward method, PanoSplatt3R")
}

fn dynamic_scenes(table: &PublishedTable) -> Option<Vec<Finding>> {
    let wrong: Vec<String> = table
        .rows
        .iter()
        .filter_map(|row| {
            let scenes: Vec<(f64, f64)> = row.cells[AVERAGE + 1..]
                .iter()
                .filter_map(|cell| Some((cell.number()?, 1.0)))
                .collect();
            let (derived, printed) = (weighted_mean(&scenes)?, row.cells[AVERAGE].number()?);
            let holds = is_mean(printed, derived, row.of.as_ref()?.decimals);
            (!holds).then(|| format!("{} ({derived:.4}, printed {printed:.3})", row.name()))
        })
        .collect();
    let averages = if wrong.is_empty() {
        format!(
            "The averages of all {} rows are the means of the four scenes, after rounding.",
            table.rows.len()
        )
    } else {
        format!(
            "Averages are not the means of the scenes: {}.",
            listed(&wrong)
        )
    };
    let of = |name: &str, metric: &str| {
        let mut rows = table.rows.iter();
        rows.find(|row| row.name() == name && row.cells[1].text() == Some(metric))
    };
    let (ours, odgs) = (of("Ours", "SSIM")?, of("ODGS", "SSIM")?);
    let lost: Vec<String> = (AVERAGE + 1..table.columns.len())
        .filter_map(|column| {
            let (own, rival) = (ours.cells[column].number()?, odgs.cells[column].number()?);
            let scene = &table.columns[column].name;
            (rival > own).then(|| format!("{scene} ({own:.3} against {rival:.3})"))
        })
        .collect();
    Some(vec![
        finding("Table 4", wrong.is_empty(), averages),
        finding(
            "Table 4",
            lost.is_empty(),
            format!(
                "SSIM of Omni4DGS is below that of ODGS in {} of 4 scenes: {}.",
                lost.len(),
                listed(&lost)
            ),
        )
        .quoting("Our method achieves the best performance across all scenes."),
    ])
}

/// One number in two places where nothing relates them.
fn coincidence(per_scene: &PublishedTable, dynamic: &PublishedTable) -> Option<Finding> {
    let odgs = per_scene.number("ODGS", 1)?;
    let ours = dynamic.rows.iter().find(|row| row.name() == "Ours")?;
    let same: Vec<String> = (AVERAGE..dynamic.columns.len())
        .filter(|&column| ours.cells[column].number() == Some(odgs))
        .map(|column| dynamic.columns[column].name.clone())
        .collect();
    Some(finding(
        "Tables 2 and 4",
        same.is_empty(),
        format!(
            "{odgs:.3} dB stands for ODGS on the input views of 111 scenes and for Omni4DGS on \
             the scene {}: chance, or a number copied into the wrong place.",
            listed(&same)
        ),
    ))
}

fn dynamic_methods(table: &PublishedTable) -> Finding {
    let lost = beaten(table, "Ours", 2..6);
    let scenes: Vec<String> = table.columns[2..]
        .iter()
        .map(|column| column.name.clone())
        .collect();
    finding(
        "Table 5",
        lost.is_empty(),
        format!(
            "Omni4DGS has the best PSNR in all four scenes. They are called {} and share no name \
             with the four scenes of Table 4; neither SSIM nor LPIPS is given.",
            listed(&scenes)
        ),
    )
    .quoting("our method consistently outperforms existing 4DGS approaches")
}

fn ablation(scenes: &PublishedTable, table: &PublishedTable) -> Option<Vec<Finding>> {
    let lost = beaten(table, "Ours (full)", 1..4);
    let average = scenes.rows.iter().find(|row| row.name() == "Ours")?.cells[AVERAGE].number()?;
    let full = table.number("Ours (full)", 1)?;
    let column = |name: &str| scenes.columns.iter().position(|column| column.name == name);
    let ours = scenes.rows.iter().find(|row| row.name() == "Ours")?;
    let mut known = 0.0;
    for name in ["Lake", "Market", "Urban Street"] {
        known += ours.cells[column(name)?].number()?;
    }
    Some(vec![
        finding(
            "Table 6",
            lost.is_empty(),
            "The full model is best in PSNR, SSIM and LPIPS.".to_owned(),
        )
        .quoting(
            "the full model achieves the best average performance across PSNR, SSIM, and LPIPS",
        ),
        finding(
            "Tables 4 and 6",
            (average - full).abs() < 5e-4,
            format!(
                "The full model has {average:.3} dB on average in Table 4 and {full:.3} dB in \
                 Table 6. The lists of scenes differ by Mountain and Space; the three that both \
                 name imply {:.3} dB for Space, which is published nowhere.",
                4.0 * full - known
            ),
        )
        .quoting("*Space*, *Lake*, *Market*, and *Urban Street*"),
    ])
}
