//! The dataset card: a description of the dataset, in Markdown.

use std::fmt::Write;

use omnilife_schemas::{
    layout::{DATASHEET_FILE, STATISTICS_FOLDER},
    plain_text::{counted, for_markdown, without_folders},
    records::{Dataset, VideoEntry, VideoStatus},
};

use super::{
    Release,
    figures::FIGURES,
    licence,
    statements::unstated,
    statistics::{DISTRIBUTIONS, Statistics},
};

/// Writes the card. Dataset hubs read the head between dashes.
pub(super) fn card(release: &Release<'_>) -> String {
    let (about, statistics) = (release.about, release.statistics);
    let mut text = format!("---\npretty_name: {}\n", quoted(&about.name));
    licence_lines(&mut text, about.licence.as_deref());
    let size = size_category(statistics.rows.len());
    line(&mut text, &format!("size_categories:\n- {size}"));
    text.push_str(HEAD);
    configs(&mut text, release);
    line(&mut text, "---\n");
    line(&mut text, &format!("# {}\n", about.name));
    if let Some(description) = &about.description {
        line(&mut text, &format!("{description}\n"));
    }
    line(
        &mut text,
        &format!(
            "{} from {} of {}, {:.2} hours of equirectangular 360-degree video; \
             {:.1} s on average, {:.1} % above two minutes. Made by omnilife {}.\n",
            counted(statistics.rows.len(), "sequence"),
            statistics.curated_videos,
            counted(statistics.videos, "video"),
            statistics.seconds() / 3600.0,
            statistics.mean_seconds(),
            100.0 * statistics.long_share(),
            env!("CARGO_PKG_VERSION")
        ),
    );
    distributions(&mut text, statistics);
    sources(&mut text, release.dataset);
    text.push_str(FILES);
    let licence = about.licence.as_deref().unwrap_or(
        "None was stated. Footage keeps the licence of its source until its owner says otherwise.",
    );
    line(&mut text, &format!("## Licence\n\n{licence}\n"));
    let unstated = unstated(&release.answers);
    let missing = if unstated.is_empty() {
        String::new()
    } else {
        format!(" Not stated: {}.", unstated.join(", "))
    };
    line(
        &mut text,
        &format!(
            "## Statements of the makers\n\nPurpose, limits, biases, personal information, uses and maintenance are \
             in the [datasheet]({DATASHEET_FILE}).{missing}"
        ),
    );
    text
}

/// Adds the tables of the hub's viewer: videos, tables and shards.
fn configs(text: &mut String, release: &Release<'_>) {
    if release.has_videos {
        line(
            text,
            "- config_name: videos\n  data_files: videos/*/slices/*",
        );
    }
    for table in &release.tables {
        // Shards hold the frames with their images.
        if !(release.has_shards && table.kind.name == "frames") {
            let name = table.kind.name;
            line(
                text,
                &format!("- config_name: {name}\n  data_files: {}", table.file),
            );
        }
    }
    if release.has_shards {
        line(
            text,
            "- config_name: frames\n  data_files: shards/frames-*.tar",
        );
    }
}

/// Metadata for search and display on hubs: task, keywords, and the begin of the viewer's tables.
const HEAD: &str = "\
task_categories:
- image-to-3d
tags:
- 360-degree video
- equirectangular
- 3d-reconstruction
configs:
";

/// Writes the licence in the form of hubs: their identifier, or `other` with the given name, and its address.
fn licence_lines(text: &mut String, stated: Option<&str>) {
    let Some(stated) = stated else {
        return;
    };
    if let Some(id) = licence::hub_identifier(stated) {
        line(text, &format!("license: {id}"));
        return;
    }
    line(text, "license: other");
    line(text, &format!("license_name: {}", quoted(stated)));
    if licence::is_address(stated) {
        line(text, &format!("license_link: {}", quoted(stated)));
    }
}

/// Returns the hub's class of a number of rows.
fn size_category(rows: usize) -> &'static str {
    match rows {
        0..1_000 => "n<1K",
        1_000..10_000 => "1K<n<10K",
        10_000..100_000 => "10K<n<100K",
        _ => "100K<n<1M",
    }
}

const FILES: &str = "\
## Files

| file | what |
|---|---|
| `dataset.json` | every video with its outcome and the folders of its sequences |
| `attrition.csv`, `funnel.csv` | every reject with its reason, and what each step leaves |
| `videos/*/analysis.json` | probe and ERP projection, with evidence |
| `videos/*/boundaries.json` | shot boundaries |
| `videos/*/samples.parquet` | what shots are judged by: numbers of a frame every 0.4 s |
| `videos/*/signature.parquet` | what the video looks like over time, to find footage that is there twice |
| `videos/*/slices.json` | what became of every second of the video |
| `videos/*/slices/*.mp4`, `metadata.csv` | the sequences as video, where they were asked for, and their classes |
| `videos/*/seq-*/sequence.json`, `frames/` | a sequence and its sampled frames |
| `videos/*/seq-*/annotation.json` | what it shows and how it moves |
| `videos/*/seq-*/scene.json`, `points.ply`, `masks/`, `ignore/` | cameras, world points, masks of dynamic and of ignored regions of the scene |
| `statistics/` | counts as CSV and figures |
| `tables/*.csv` | frames, masks, poses, points, annotations and splits, one row each |
| `DATASHEET.md`, `croissant.json` | statements of the makers, and metadata for loaders |
| `shards/frames-*.tar` | where they were asked for, the frames as WebDataset shards: image, masks, and camera, pose and tags as JSON |
| `SHA256SUMS` | checksums of all files |

Camera frame: x right, y down, z forward; the image centre is +z, north is up. Times are seconds of
the source's presentation timestamps.

";

fn line(text: &mut String, line: &str) {
    text.push_str(line);
    text.push('\n');
}

fn distributions(text: &mut String, statistics: &Statistics) {
    line(text, "## Statistics\n");
    for figure in FIGURES {
        line(
            text,
            &format!("![{}]({STATISTICS_FOLDER}/{})\n", figure.title, figure.file),
        );
    }
    line(
        text,
        "| | class | sequences | share | hours |\n|---|---|--:|--:|--:|",
    );
    for distribution in DISTRIBUTIONS {
        for (class, tally) in statistics.tally(distribution) {
            line(
                text,
                &format!(
                    "| {} | {} | {} | {:.1} % | {:.3} |",
                    distribution.id,
                    for_markdown(&class),
                    tally.sequences,
                    100.0 * tally.sequences as f64 / statistics.rows.len() as f64,
                    tally.seconds / 3600.0
                ),
            );
        }
    }
    text.push('\n');
}

fn sources(text: &mut String, dataset: &Dataset) {
    line(
        text,
        "## Sources\n\n| video | SHA-256 | outcome |\n|---|---|---|",
    );
    for video in &dataset.videos {
        let outcome = match &video.status {
            VideoStatus::Curated { sequences } => counted(sequences.len(), "sequence"),
            VideoStatus::Rejected { reason, .. } => format!("rejected: {}", for_markdown(reason)),
            VideoStatus::Failed { reason } => format!("failed: {}", for_markdown(reason)),
            VideoStatus::Duplicate { of } => format!("the same content as {}", for_markdown(of)),
            VideoStatus::Pending => "not reached".to_owned(),
        };
        let sha256 = video.sha256.as_deref().unwrap_or("unreadable");
        // Writing to a string does not fail.
        let _ = writeln!(text, "| {} | `{sha256}` | {outcome} |", name(video));
    }
    text.push('\n');
    origins(text, dataset);
}

/// Returns the name of a video, also from records of older versions, which hold paths.
fn name(video: &VideoEntry) -> String {
    for_markdown(&without_folders(&video.file))
}

/// Adds the origins of the videos, if given.
fn origins(text: &mut String, dataset: &Dataset) {
    let stated = || {
        let videos = dataset.videos.iter();
        videos.filter_map(|video| Some((video, video.origin.as_ref()?)))
    };
    if stated().next().is_none() {
        return;
    }
    line(
        text,
        &format!(
            "Origins of {} of {}, as stated by the makers of the dataset:\n\n\
             | video | from | by | licence | date | keywords |\n|---|---|---|---|---|---|",
            stated().count(),
            counted(dataset.videos.len(), "video")
        ),
    );
    for (video, origin) in stated() {
        let cell = |text: &Option<String>| for_markdown(text.as_deref().unwrap_or_default());
        let kind = origin.kind.map_or("", |kind| kind.words());
        let from = format!("{kind} {}", cell(&origin.url));
        // Writing to a string does not fail.
        let _ = writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} |",
            name(video),
            from.trim(),
            cell(&origin.uploader),
            cell(&origin.licence),
            cell(&origin.date),
            for_markdown(&origin.keywords.join(", "))
        );
    }
    text.push('\n');
}

/// Returns a YAML string; JSON's quoting is a part of YAML's.
fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}
