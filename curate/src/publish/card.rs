//! The dataset card: a description of the dataset, in Markdown.

use std::fmt::Write;

use omnilife_schemas::{
    layout::{DATASHEET_FILE, SLICES_FOLDER, STATISTICS_FOLDER, TABLES_FOLDER, TRACKS_FILE},
    plain_text::{counted, for_markdown, without_folders},
    records::{Dataset, VideoEntry, VideoStatus},
};

use super::{
    Release, figures, licence,
    statements::unstated,
    statistics::{Statistics, duration_in_words, is_annotated},
};

/// Writes the card. Dataset hubs read the head between dashes.
pub(super) fn card(release: &Release<'_>) -> String {
    let (about, statistics) = (release.about, release.statistics);
    let mut text = format!("---\npretty_name: {}\n", quoted(&about.name));
    licence_lines(&mut text, about.licence.as_deref());
    let size = size_category(statistics.rows.len());
    line(&mut text, &format!("size_categories:\n- {size}"));
    head(&mut text, release);
    configs(&mut text, release);
    line(&mut text, "---\n");
    line(&mut text, &format!("# {}\n", about.name));
    if let Some(description) = &about.description {
        line(&mut text, &format!("{description}\n"));
    }
    line(
        &mut text,
        &format!(
            "{} from {} of {}, {} of {}; {:.1} s on average, {:.1} % above two minutes. Made by omnilife {}.\n",
            counted(statistics.rows.len(), "sequence"),
            statistics.curated_videos,
            counted(statistics.videos, "video"),
            duration_in_words(statistics.seconds()),
            release.footage().words,
            statistics.mean_seconds(),
            100.0 * statistics.long_share(),
            env!("CARGO_PKG_VERSION")
        ),
    );
    distributions(&mut text, statistics);
    sources(&mut text, release.dataset);
    files(&mut text, release);
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

/// Adds metadata for search and display on hubs: task, keywords, and the begin of the viewer's tables.
fn head(text: &mut String, release: &Release<'_>) {
    line(text, "task_categories:\n- image-to-3d\ntags:");
    for keyword in release.footage().keywords {
        line(text, &format!("- {keyword}"));
    }
    line(text, "- 3d-reconstruction\nconfigs:");
}

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

/// Files of a dataset: an entry of a video's folder without which the row is left out (empty for files of every
/// dataset), their names, and their content.
const FILES: [(&str, &str, &str); 28] = [
    (
        "",
        "`dataset.json`",
        "every video with its outcome and the folders of its sequences",
    ),
    (
        "",
        "`attrition.csv`, `funnel.csv`",
        "every reject with its reason, and the losses of each step",
    ),
    (
        "analysis.json",
        "`videos/*/analysis.json`",
        "probe and projection, with evidence",
    ),
    (
        "boundaries.json",
        "`videos/*/boundaries.json`",
        "shot boundaries",
    ),
    (
        "signals.parquet",
        "`videos/*/signals.parquet`",
        "measurements of every frame",
    ),
    (
        "samples.parquet",
        "`videos/*/samples.parquet`",
        "measurements by which shots are judged, of a frame every 0.4 s",
    ),
    (
        "signature.parquet",
        "`videos/*/signature.parquet`",
        "appearance over time, by which repeated footage is found",
    ),
    (
        "slices.json",
        "`videos/*/slices.json`",
        "segments of the video, kept or left out",
    ),
    (
        SLICES_FOLDER,
        "`videos/*/slices/*.mp4`, `metadata.csv`",
        "the sequences as video, and their classes",
    ),
    (
        "sequence.json",
        "`videos/*/seq-*/sequence.json`, `frames/`",
        "a sequence and its sampled frames",
    ),
    (
        "motion",
        "`videos/*/seq-*/motion/`",
        "small frames in pairs close in time, for the measurement of motion",
    ),
    (
        "annotation.json",
        "`videos/*/seq-*/annotation.json`",
        "tags, captions and measured motion",
    ),
    (
        "scene.json",
        "`videos/*/seq-*/scene.json`",
        "cameras and the files of each image",
    ),
    (
        "points.ply",
        "`videos/*/seq-*/points.ply`",
        "points of the world",
    ),
    (
        "masks",
        "`videos/*/seq-*/masks/`",
        "dynamic masks of the scene, white where something moves",
    ),
    (
        "ignore",
        "`videos/*/seq-*/ignore/`",
        "masks of ignored regions, white",
    ),
    (
        "depth",
        "`videos/*/seq-*/depth/`",
        "distances along the rays",
    ),
    (
        "frames-straight",
        "`videos/*/seq-*/frames-straight/`",
        "perspective frames without the distortion of their lens",
    ),
    (
        "depth-prior",
        "`videos/*/seq-*/depth-prior/`",
        "depth priors along the rays",
    ),
    (
        "dynamic-masks",
        "`videos/*/seq-*/dynamic-masks/`",
        "dynamic masks as detected, with their source",
    ),
    (
        "classes",
        "`videos/*/seq-*/**/classes/`",
        "masks of classes, given or as detected",
    ),
    (
        "split.json",
        "`videos/*/seq-*/*/split.json`",
        "input and novel frames of a protocol",
    ),
    (
        TRACKS_FILE,
        "`videos/*/seq-*/*/tracks.*`",
        "paths of moving vehicles",
    ),
    (
        "run.json",
        "`videos/*/seq-*/*/*/run/`",
        "runs of methods on a split: record, model, predictions",
    ),
    (
        "result.json",
        "`videos/*/seq-*/*/*/score/`",
        "scores of these runs",
    ),
    ("", "`statistics/`", "counts as CSV and figures"),
    (
        "",
        "`DATASHEET.md`, `croissant.json`, `about.json`",
        "statements of the makers, and metadata for loaders",
    ),
    ("", "`SHA256SUMS`", "checksums of all files"),
];

/// Adds a table of the files that the dataset holds, and the conventions of cameras and times.
fn files(text: &mut String, release: &Release<'_>) {
    line(text, "## Files\n\n| file | content |\n|---|---|");
    let held = |entry: &str| match entry {
        "" => true,
        // The table beside the videos, which an earlier publication wrote, may be left alone there.
        SLICES_FOLDER => release.has_videos,
        entry => release.has(entry),
    };
    for (_, names, content) in FILES.iter().filter(|(entry, ..)| held(entry)) {
        line(text, &format!("| {names} | {content} |"));
    }
    for table in &release.tables {
        if table.file.starts_with(TABLES_FOLDER) {
            let row = format!("| `{}` | a row is {} |", table.file, table.kind.about);
            line(text, &row);
        }
    }
    if release.has_shards {
        line(
            text,
            "| `shards/frames-*.tar` | the frames as WebDataset shards: image, masks, and camera, pose and tags as JSON |",
        );
    }
    line(
        text,
        "\nCamera frame: x right, y down, z forward; the image centre is +z. Times are seconds of the source's \
         presentation timestamps.\n",
    );
}

fn line(text: &mut String, line: &str) {
    text.push_str(line);
    text.push('\n');
}

fn distributions(text: &mut String, statistics: &Statistics) {
    line(text, "## Statistics\n");
    let (drawn, missing) = figures::with_classes(statistics);
    for figure in drawn {
        line(
            text,
            &format!("![{}]({STATISTICS_FOLDER}/{})\n", figure.title, figure.file),
        );
    }
    if !missing.is_empty() {
        let names: Vec<&str> = missing.iter().map(|figure| figure.distribution).collect();
        line(
            text,
            &format!("Not annotated in any sequence: {}.\n", names.join(", ")),
        );
    }
    line(
        text,
        "| | class | sequences | share | length |\n|---|---|--:|--:|--:|",
    );
    for (property, tallies) in statistics.distributions() {
        if !is_annotated(&tallies) {
            continue;
        }
        for (class, tally) in tallies {
            line(
                text,
                &format!(
                    "| {property} | {} | {} | {:.1} % | {} |",
                    for_markdown(&class),
                    tally.sequences,
                    100.0 * tally.sequences as f64 / statistics.rows.len() as f64,
                    duration_in_words(tally.seconds)
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
