//! Table of datasets: one's own, from their records, beside published ones.
//!
//! The columns are those of Table 1 of OmniLife360, with minutes, the camera's motion and the origin of the dynamics.
//! An unknown value is shown as unknown.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use omnilife_results::{Answer, AnswerColumn, AnswerFormat, Values};
use omnilife_schemas::{
    layout::{ANNOTATION_FILE, DATASET_FILE, SEQUENCE_FILE},
    records::{Annotation, Dataset, Dynamics, Sequence, VideoStatus},
    store::{self, StoreError},
};
use serde::Deserialize;

use crate::{
    error::LeaderboardError,
    render,
    table::{Cell, Column, ColumnContent, PublishedBlock, Row, Table},
};

const FILE: &str = "datasets.json";
const PUBLISHED: &str = include_str!("../published/datasets.json");
const TITLE: &str = "Datasets for panoramic reconstruction";
const UNKNOWN: &str = "unknown";
/// Headings of the columns after the name, with their names in CSV.
const COLUMNS: [(&str, &str); 8] = [
    ("Source", "source"),
    ("Env.", "environment"),
    ("Res.", "resolution"),
    ("#Scenes", "scenes"),
    ("Minutes", "minutes"),
    ("Motion", "motion"),
    ("Dyn.", "dynamics"),
    ("Dyn. from", "dynamics_from"),
];

/// Format of the table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DatasetsFormat {
    /// One table to read, with all rows.
    Table,
    /// Comma-separated values with a header; an unknown value is an empty cell.
    Csv,
    /// Markdown, with the published rows in a table of their own.
    Markdown,
    /// LaTeX.
    Latex,
}

/// Published datasets with their source.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct PublishedDatasets {
    source: String,
    notes: Vec<String>,
    rows: Vec<Facts>,
}

/// Facts of a dataset; `None` where they are unknown.
#[derive(Debug, Clone, PartialEq, Eq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Facts {
    name: String,
    source: Option<String>,
    environment: Option<String>,
    resolution: Option<String>,
    scenes: Option<String>,
    minutes: Option<String>,
    motion: Option<String>,
    dynamics: Option<String>,
    dynamics_from: Option<String>,
}

impl Facts {
    /// Returns the cells of [`COLUMNS`].
    fn cells(&self) -> [&Option<String>; 8] {
        [
            &self.source,
            &self.environment,
            &self.resolution,
            &self.scenes,
            &self.minutes,
            &self.motion,
            &self.dynamics,
            &self.dynamics_from,
        ]
    }

    fn row(&self) -> Row {
        let cells = self.cells().into_iter();
        Row {
            names: vec![self.name.clone()],
            cells: cells
                .map(|cell| Cell::Text(cell.as_deref().unwrap_or(UNKNOWN).to_owned()))
                .collect(),
            ..Row::default()
        }
    }
}

/// Returns the table of these datasets, folders or `dataset.json` files, and of published ones.
///
/// # Errors
/// When a record is missing or malformed.
pub fn datasets(datasets: &[PathBuf], format: DatasetsFormat) -> Result<Vec<u8>, LeaderboardError> {
    let own = datasets.iter().map(|path| of_records(path));
    let own = own.collect::<Result<Vec<_>, _>>()?;
    let published: PublishedDatasets =
        serde_json::from_str(PUBLISHED).map_err(|error| LeaderboardError::Published {
            file: FILE,
            reason: error.to_string(),
        })?;
    let text = match format {
        DatasetsFormat::Table => return answer(&own, &published, AnswerFormat::Table),
        DatasetsFormat::Csv => return answer(&own, &published, AnswerFormat::Csv),
        DatasetsFormat::Markdown => render::markdown::render(&table(&own, published), 2),
        DatasetsFormat::Latex => render::latex::render(&table(&own, published)),
    };
    Ok(text.into_bytes())
}

fn table(own: &[Facts], published: PublishedDatasets) -> Table {
    let columns = COLUMNS.map(|(name, _)| Column {
        group: None,
        name: name.to_owned(),
        direction: None,
        holds: ColumnContent::Other,
        missing: None,
    });
    Table {
        title: TITLE.to_owned(),
        names: vec!["Dataset".to_owned()],
        columns: columns.into(),
        rows: own.iter().map(Facts::row).collect(),
        published: vec![PublishedBlock {
            rows: published.rows.iter().map(Facts::row).collect(),
            source: published.source,
            notes: published.notes,
        }],
        notes: Vec::new(),
    }
}

/// Returns all rows in one table, own ones first.
fn answer(
    own: &[Facts],
    published: &PublishedDatasets,
    format: AnswerFormat,
) -> Result<Vec<u8>, LeaderboardError> {
    let rows = || own.iter().chain(&published.rows);
    let column = |name: &str, values: Vec<Option<String>>| AnswerColumn {
        name: name.to_owned(),
        values: Values::Text(values),
    };
    let origins = own.iter().map(|_| "records".to_owned());
    let origins = origins.chain(published.rows.iter().map(|_| published.source.clone()));
    let mut columns = vec![
        column(
            "dataset",
            rows().map(|row| Some(row.name.clone())).collect(),
        ),
        column("origin", origins.map(Some).collect()),
    ];
    for (at, (_, name)) in COLUMNS.into_iter().enumerate() {
        let cells = rows().map(|row| row.cells()[at].clone());
        let shown = match format {
            AnswerFormat::Table => cells
                .map(|cell| cell.or_else(|| Some(UNKNOWN.to_owned())))
                .collect(),
            _ => cells.collect(),
        };
        columns.push(column(name, shown));
    }
    let answer = Answer {
        columns,
        notes: Vec::new(),
    };
    Ok(render(&answer, format)?)
}

/// Returns the facts in the records of a dataset. Sequences count, not the videos that gave none.
fn of_records(path: &Path) -> Result<Facts, LeaderboardError> {
    let file = if path.is_dir() {
        path.join(DATASET_FILE)
    } else {
        path.to_owned()
    };
    let dataset: Dataset = store::read_record(&file)?;
    let mut sources = Vec::new();
    let mut sequences = Vec::new();
    for video in &dataset.videos {
        if let VideoStatus::Curated { sequences: folders } = &video.status {
            let kind = (video.origin.as_ref()).and_then(|origin| origin.kind);
            for folder in folders {
                sequences.push(AnnotatedSequence::read(&file.with_file_name(folder))?);
                sources.push(kind.map(|kind| kind.words().to_owned()));
            }
        }
    }
    let dynamics = |of: fn(&Dynamics) -> &String| {
        let of_sequence =
            |sequence: &AnnotatedSequence| sequence.annotation.dynamics.as_ref().map(of).cloned();
        counted(sequences.iter().map(of_sequence))
    };
    let motion =
        |sequence: &AnnotatedSequence| sequence.annotation.ego_motion.class().map(str::to_owned);
    // The sum of nothing is -0, which prints its sign.
    let seconds: f64 = (sequences.iter())
        .map(|sequence| sequence.record.range.duration_seconds())
        .sum();
    Ok(Facts {
        name: name(&file),
        source: counted(sources.into_iter()),
        environment: environment(&sequences),
        resolution: resolution(&sequences),
        scenes: Some(sequences.len().to_string()),
        minutes: Some(format!("{:.1}", seconds / 60.0 + 0.0)),
        motion: counted(sequences.iter().map(motion)),
        dynamics: dynamics(|dynamics| &dynamics.class),
        dynamics_from: dynamics(|dynamics| &dynamics.from),
    })
}

/// A sequence with its annotation, an empty one without a file.
struct AnnotatedSequence {
    record: Sequence,
    annotation: Annotation,
}

impl AnnotatedSequence {
    fn read(folder: &Path) -> Result<Self, StoreError> {
        let annotation = folder.join(ANNOTATION_FILE);
        Ok(Self {
            record: store::read_record(&folder.join(SEQUENCE_FILE))?,
            annotation: if annotation.is_file() {
                store::read_record(&annotation)?
            } else {
                Annotation::default()
            },
        })
    }

    /// Returns `Indoor` or `Outdoor` where the name of its semantic group says so, and `Both` for a traversal.
    fn environment(&self) -> Option<&'static str> {
        if self.annotation.traversal {
            return Some("Both");
        }
        let group = self.annotation.group.as_deref()?;
        let has = |word: &str| group.split('-').any(|part| part == word);
        match (has("indoor"), has("outdoor")) {
            (true, false) => Some("Indoor"),
            (false, true) => Some("Outdoor"),
            _ => None,
        }
    }
}

/// Returns the name of the folder of a dataset's record.
fn name(file: &Path) -> String {
    let file = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
    let folder = file.parent().and_then(Path::file_name);
    folder.map_or_else(
        || UNKNOWN.to_owned(),
        |name| name.to_string_lossy().into_owned(),
    )
}

/// Returns the environment of all sequences, with the number of those whose own is unknown; `None` where all are.
fn environment(sequences: &[AnnotatedSequence]) -> Option<String> {
    let known: Vec<_> = sequences
        .iter()
        .filter_map(AnnotatedSequence::environment)
        .collect();
    let first = *known.first()?;
    let environment = if known.iter().all(|other| *other == first) {
        first
    } else {
        "Both"
    };
    Some(match sequences.len() - known.len() {
        0 => environment.to_owned(),
        unknown => format!("{environment}, {unknown} {UNKNOWN}"),
    })
}

/// Returns the size of the source videos, or the smallest and the largest one.
fn resolution(sequences: &[AnnotatedSequence]) -> Option<String> {
    let sizes = || (sequences.iter()).map(|sequence| sequence.record.source_size());
    let area = |&(width, height): &(u32, u32)| u64::from(width) * u64::from(height);
    let (least, most) = (sizes().min_by_key(area)?, sizes().max_by_key(area)?);
    let text = |(width, height): (u32, u32)| format!("{width}x{height}");
    Some(if least == most {
        text(least)
    } else {
        format!("{} to {}", text(least), text(most))
    })
}

/// Returns the classes of sequences with their numbers, the most frequent first and unknown ones last. One class alone
/// stands without a number; `None` where all are unknown.
fn counted(classes: impl Iterator<Item = Option<String>>) -> Option<String> {
    let (mut counts, mut unknown) = (BTreeMap::<String, usize>::new(), 0);
    for class in classes {
        match class {
            Some(class) => *counts.entry(class).or_default() += 1,
            None => unknown += 1,
        }
    }
    let mut counts: Vec<_> = counts.into_iter().collect();
    counts.sort_by(|one, other| other.1.cmp(&one.1).then_with(|| one.0.cmp(&other.0)));
    if counts.is_empty() {
        return None;
    }
    if unknown > 0 {
        counts.push((UNKNOWN.to_owned(), unknown));
    } else if let [(class, _)] = &counts[..] {
        return Some(class.clone());
    }
    let parts: Vec<String> = (counts.iter())
        .map(|(class, count)| format!("{class} {count}"))
        .collect();
    Some(parts.join(", "))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use serde_json::{Value, json};

    use super::*;

    fn write(path: &Path, record: &Value) {
        let folder = path.parent().expect("a folder");
        fs::create_dir_all(folder).expect("created");
        fs::write(path, record.to_string()).expect("written");
    }

    fn sequence(id: &str, seconds: f64, width: u32) -> Value {
        json!({
            "schema": "omnilife/sequence/2",
            "id": id,
            "source": {"file_name": "a.mp4", "sha256": "00", "bytes": 1},
            "range": {"begin_seconds": 1.0, "end_seconds": 1.0 + seconds},
            "probe": {
                "container": "mp4", "codec": "h264", "width": width, "height": width / 2,
                "pixel_format": "yuv420p", "bit_depth": 8, "frames_per_second": 30.0,
                "duration_seconds": 9.0, "decoded_frames": null, "variable_frame_rate": null,
                "longest_interval_seconds": null, "rotation_degrees": 0.0,
                "pixel_aspect_ratio": 1.0, "transfer": "bt709", "spherical": null,
            },
            "projection": {
                "projection": "erp", "overridden": null, "evidence": [], "disagreement": null,
            },
            "admission": {"profile": "none", "checks": [], "admitted": true, "enforced": false},
            "frames": {
                "width": 8, "height": 4, "sampling": {"max-frames": 3}, "resampling": "none",
                "entries": [],
            },
        })
    }

    fn annotation(group: &str, motion: &str, dynamics: &Value) -> Value {
        json!({
            "schema": "omnilife/annotation/1", "sequence": "s", "taxonomy": "1.0", "scene": null,
            "group": group, "traversal": false, "action": null, "captions": [],
            "ego_motion": {"of_action": motion, "measured": null}, "dynamics": dynamics,
        })
    }

    /// Writes a dataset of three sequences, the last of which nothing describes.
    fn dataset(folder: &Path) -> PathBuf {
        let data = folder.join("my_streets");
        let video = |name: &str, origin: Value, sequences: &[&str]| {
            json!({
                "file": name, "sha256": null, "duration_seconds": null, "origin": origin,
                "status": {"outcome": "curated", "sequences": sequences},
            })
        };
        write(
            &data.join(DATASET_FILE),
            &json!({"schema": "omnilife/dataset/1", "videos": [
                video("a.mp4", json!({"kind": "own-capture"}), &["videos/a/0", "videos/a/1"]),
                video("b.mp4", Value::Null, &["videos/b/0"]),
                {"file": "c.mp4", "sha256": null, "duration_seconds": null,
                 "status": {"outcome": "failed", "reason": "damaged"}},
            ]}),
        );
        let measured = |class: &str| json!({"class": class, "from": "masks", "evidence": []});
        let at = |name: &str, file: &str| data.join("videos").join(name).join(file);
        for (name, seconds, width) in [
            ("a/0", 30.0, 3840),
            ("a/1", 42.0, 3840),
            ("b/0", 48.0, 5760),
        ] {
            write(&at(name, SEQUENCE_FILE), &sequence(name, seconds, width));
        }
        let first = annotation("urban-outdoor", "walking", &measured("low"));
        write(&at("a/0", ANNOTATION_FILE), &first);
        let second = annotation("indoor-venues", "walking", &Value::Null);
        write(&at("a/1", ANNOTATION_FILE), &second);
        data
    }

    #[test]
    fn own_rows_say_what_the_records_do_and_no_more() {
        let folder = tempfile::tempdir().expect("a folder");
        let data = dataset(folder.path());
        let facts = of_records(&data).expect("facts");
        let text = |text: &str| Some(text.to_owned());
        let expected = Facts {
            name: "my_streets".to_owned(),
            source: text("own capture 2, unknown 1"),
            environment: text("Both, 1 unknown"),
            resolution: text("3840x1920 to 5760x2880"),
            scenes: text("3"),
            minutes: text("2.0"),
            motion: text("walking 2, unknown 1"),
            dynamics: text("low 1, unknown 2"),
            dynamics_from: text("masks 1, unknown 2"),
        };
        assert_eq!(facts, expected);
        assert_eq!(of_records(&data.join(DATASET_FILE)).expect("facts"), facts);
        for file in ["a/0", "a/1"] {
            fs::remove_file(data.join("videos").join(file).join(ANNOTATION_FILE)).expect("removed");
        }
        let facts = of_records(&data).expect("facts");
        let unknown = [
            &facts.environment,
            &facts.motion,
            &facts.dynamics,
            &facts.dynamics_from,
        ];
        assert_eq!(unknown, [&None; 4]);
        fs::remove_file(data.join("videos/b/0").join(SEQUENCE_FILE)).expect("removed");
        let error = of_records(&data).expect_err("a record is missing");
        assert!(error.to_string().contains("sequence.json"), "{error}");
    }

    #[test]
    fn every_format_has_own_and_published_rows() {
        let folder = tempfile::tempdir().expect("a folder");
        let data = dataset(folder.path());
        let made = |format| {
            let bytes = datasets(std::slice::from_ref(&data), format).expect("a table");
            String::from_utf8(bytes).expect("text")
        };
        for format in [
            DatasetsFormat::Table,
            DatasetsFormat::Csv,
            DatasetsFormat::Markdown,
            DatasetsFormat::Latex,
        ] {
            let text = made(format);
            assert!(text.contains("OmniLife360, Table 1"), "{text}");
            assert!(
                text.contains("360Roam") && text.contains("3840x1920"),
                "{text}"
            );
        }
        let csv = made(DatasetsFormat::Csv);
        let lines: Vec<&str> = csv.lines().collect();
        assert_eq!(lines.len(), 1 + 1 + 8, "{csv}");
        assert!(lines[0].starts_with("dataset,origin,source,environment,resolution,scenes,"));
        assert!(lines[1].starts_with("my_streets,records,"), "{csv}");
        let roam = "360Roam,\"OmniLife360, Table 1\",Real,Indoor,6K,10,,,Low,authors' judgement";
        assert!(lines.contains(&roam), "{csv}");
        assert!(made(DatasetsFormat::Table).contains("unknown"));
        let latex = made(DatasetsFormat::Latex);
        assert!(
            latex.contains("my\\_streets") && latex.contains("\\#Scenes"),
            "{latex}"
        );
        assert!(latex.contains("$\\geq$2K"), "{latex}");
    }
}
