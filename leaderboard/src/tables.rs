//! Building and writing of the tables.

use std::path::{Path, PathBuf};

use omnilife_schemas::{records::ResultRecord, store};

use crate::{
    aids,
    error::LeaderboardError,
    format::slug,
    group::{self, Group},
    layouts::{self, Layout, REGION_METRICS},
    outputs::Outputs,
    published::Paper,
    quantity::ViewKind,
    render, repeats, results_csv,
    table::{ColumnContent, Table},
};

/// File name of the table of all results in Markdown.
pub const MARKDOWN_FILE: &str = "table.md";

/// File name of the table of all results in CSV.
pub const CSV_FILE: &str = "table.csv";

/// Folder of the tables in the layouts of the paper.
pub(crate) const LAYOUT_FOLDER: &str = "tables";

/// The tables of all results as written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tables {
    /// Content of [`MARKDOWN_FILE`].
    pub markdown: String,
    /// The same tables with the few columns that fit a terminal.
    pub short: String,
    /// Content of [`CSV_FILE`].
    pub csv: Vec<u8>,
    /// The file of the Markdown.
    pub markdown_file: PathBuf,
    /// The file of the CSV.
    pub csv_file: PathBuf,
}

/// Builds the tables of all results, each with its source file, and writes them to the folder `out`, which is created
/// if missing.
///
/// Markdown holds one table per protocol, never a mixed one; CSV holds every metric. The same results in any order give
/// the same bytes.
///
/// # Errors
/// When there are no results, when two of them claim the same row or contradict each other, and
/// when a file cannot be written.
pub fn build(results: &[(PathBuf, ResultRecord)], out: &Path) -> Result<Tables, LeaderboardError> {
    if results.is_empty() {
        return Err(LeaderboardError::NoResults {
            folder: out.to_owned(),
        });
    }
    let tables = all_results(&group::groups(results)?, out)?;
    store::create_folder(out)?;
    store::write_bytes(&tables.markdown_file, tables.markdown.as_bytes())?;
    store::write_bytes(&tables.csv_file, &tables.csv)?;
    Ok(tables)
}

/// Returns the tables of all results; nothing is written.
pub(crate) fn all_results(groups: &[Group<'_>], out: &Path) -> Result<Tables, LeaderboardError> {
    let mut markdown = String::from("# Leaderboard\n");
    let mut short = String::new();
    for group in groups {
        markdown.push('\n');
        let all = layouts::all_results(group);
        markdown.push_str(&render::markdown::render(&all, 2));
        let table = short_table(group, all);
        short.push_str(&format!("{}\n", table.title));
        for (class, lines) in render::markdown::terminal_blocks(&table) {
            let class = class.unwrap_or_default();
            short.push_str(&format!("\n{class}\n\n{}\n", lines.join("\n")));
        }
        for line in layouts::remarks_of(group).serious() {
            short.push_str(&format!("\n{line}\n"));
        }
        let of_aids = [aids::warning(group), aids::note(group)];
        for line in repeats::warnings(group)
            .iter()
            .chain(of_aids.iter().flatten())
        {
            short.push_str(&format!("\n{line}\n"));
        }
    }
    let csv_file = out.join(CSV_FILE);
    Ok(Tables {
        markdown,
        short,
        csv: results_csv::render(groups, &csv_file)?,
        markdown_file: out.join(MARKDOWN_FILE),
        csv_file,
    })
}

/// Returns the main scores for comparing methods: of novel views if scored, PSNR, SSIM and one LPIPS, PSNR of static
/// and dynamic regions, and training cost; `all` is the full table.
pub(crate) fn short_table(group: &Group<'_>, all: Table) -> Table {
    let has = |kind: ViewKind, metric: &str| {
        let mut quantities = group.quantities.iter();
        quantities.any(|(quantity, _)| quantity.kind == kind && quantity.metric == metric)
    };
    let kind = if has(ViewKind::Novel, "psnr") {
        ViewKind::Novel
    } else {
        ViewKind::Input
    };
    let mut metrics = vec!["psnr", "ssim"];
    let lpips = ["lpips-alex", "lpips-vgg"];
    metrics.extend(lpips.into_iter().find(|metric| has(kind, metric)));
    metrics.extend(
        REGION_METRICS
            .into_iter()
            .filter(|metric| metric.starts_with("psnr")),
    );
    let has_failures = group.scene_rows.iter().any(|row| !row.numbers.complete);
    all.with_columns(|column| match &column.holds {
        ColumnContent::Score(quantity) => {
            quantity.kind == kind && metrics.contains(&quantity.metric.as_str())
        }
        _ => column.name == "Training (s)" || (has_failures && column.name == "Failures"),
    })
}

/// Returns the folder of a protocol's tables, relative to the leaderboard.
pub(crate) fn layout_folder(group: &Group<'_>) -> String {
    let (protocol, hash) = (slug(group.protocol), slug(&group.short_hash()));
    format!("{LAYOUT_FOLDER}/{protocol}-{hash}")
}

/// Returns the tables in these layouts, `tables/<protocol>-<hash>/<layout>.{md,tex,csv}`.
pub(crate) fn in_all_layouts(
    layouts: &[Layout],
    groups: &[Group<'_>],
    papers: &[Paper],
    out: &Path,
) -> Result<Outputs, LeaderboardError> {
    let mut outputs = Outputs::default();
    for group in groups {
        let folder = layout_folder(group);
        for layout in layouts {
            let tables = (layout.tables)(group, papers);
            if tables.is_empty() {
                continue;
            }
            add_tables(
                &mut outputs,
                &format!("{folder}/{}", layout.id),
                &tables,
                out,
            )?;
        }
    }
    Ok(outputs)
}

/// Adds the tables of assets, `tables/assets.{md,tex,csv}`, if there are any.
pub(crate) fn add_assets(
    outputs: &mut Outputs,
    tables: &[Table],
    out: &Path,
) -> Result<(), LeaderboardError> {
    if tables.is_empty() {
        return Ok(());
    }
    add_tables(outputs, &format!("{LAYOUT_FOLDER}/assets"), tables, out)
}

/// Tables as `<path>.{md,tex,csv}`.
fn add_tables(
    outputs: &mut Outputs,
    path: &str,
    tables: &[Table],
    out: &Path,
) -> Result<(), LeaderboardError> {
    let file = |extension: &str| format!("{path}.{extension}");
    let join = |render: &dyn Fn(&Table) -> String| {
        tables.iter().map(render).collect::<Vec<_>>().join("\n")
    };
    outputs.add(
        file("md"),
        join(&|table| render::markdown::render(table, 1)),
    );
    outputs.add(file("tex"), join(&render::latex::render));
    let csv = render::csv::render(tables, &out.join(file("csv")))?;
    outputs.add(file("csv"), csv);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::{Cell, Column, Row};

    fn toy_tables(group: &Group<'_>, _: &[Paper]) -> Vec<Table> {
        vec![Table {
            title: format!("Scenes of {}", group.protocol),
            names: vec!["Place".to_owned()],
            columns: vec![Column::plain("Scenes")],
            rows: vec![Row {
                names: vec!["all".to_owned()],
                cells: vec![Cell::count(group.scenes.len())],
                ..Row::default()
            }],
            published: Vec::new(),
            notes: Vec::new(),
        }]
    }

    #[test]
    fn a_layout_is_a_row_and_a_function() {
        let record = serde_json::json!({
            "method": "odgs", "scene": "walk", "scene_sha256": "00", "protocol": "per-scene/1",
            "protocol_hash": "abc", "scored_size": [64, 32], "input_views": {},
            "novel_views": {"psnr": {"mean": 20.0, "views": 2, "direction": "higher-is-better"}},
            "failures": [], "frames_table": "frames.csv", "warnings": []
        });
        let record: ResultRecord = serde_json::from_value(record).expect("a result");
        let results = [(PathBuf::from("result.json"), record)];
        let groups = group::groups(&results).expect("one group");
        let toy = Layout {
            id: "toy",
            is_in_first_table: false,
            tables: toy_tables,
        };
        let folder = tempfile::tempdir().expect("a folder");
        let outputs = in_all_layouts(&[toy], &groups, &[], folder.path()).expect("its tables");
        outputs.write(folder.path()).expect("written");
        for extension in ["md", "tex", "csv"] {
            let file = format!("{LAYOUT_FOLDER}/per-scene-1-abc/toy.{extension}");
            assert!(folder.path().join(&file).is_file(), "{file}");
        }
    }
}
