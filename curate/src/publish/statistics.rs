//! Statistics of a dataset.

use std::{collections::BTreeMap, path::Path};

use omnilife_schemas::{
    layout::{ANNOTATION_FILE, SCENE_FILE, SEQUENCE_FILE},
    plain_text::serialize_for_spreadsheet,
    records::{Annotation, Dataset, Scene, Sequence, ValidationStatus, VideoStatus},
    store,
};
use serde::Serialize;

use crate::error::CurateError;

/// Sequences longer than this are counted apart, seconds (the paper's "two minutes").
const LONG_SECONDS: f64 = 120.0;
/// Class of sequences without annotation.
const UNKNOWN: &str = "not annotated";

/// One sequence of a dataset.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SequenceRow {
    /// Id of the sequence.
    #[serde(serialize_with = "serialize_for_spreadsheet")]
    pub sequence: String,
    /// Its folder in the dataset.
    #[serde(serialize_with = "serialize_for_spreadsheet")]
    pub folder: String,
    /// File name of the source video.
    #[serde(serialize_with = "serialize_for_spreadsheet")]
    pub source: String,
    /// Its start in the source, seconds.
    pub begin_seconds: f64,
    /// Its end in the source, seconds.
    pub end_seconds: f64,
    /// Its length, seconds.
    pub duration_seconds: f64,
    /// Width of the source's panorama in pixels.
    pub source_width: u32,
    /// Height of the source's panorama in pixels.
    pub source_height: u32,
    /// Sampled frames.
    pub frames: usize,
    /// Semantic group.
    #[serde(serialize_with = "serialize_for_spreadsheet")]
    pub group: String,
    /// Scene category.
    #[serde(serialize_with = "serialize_for_spreadsheet")]
    pub scene: String,
    /// Action class.
    #[serde(serialize_with = "serialize_for_spreadsheet")]
    pub action: String,
    /// Ego-motion class.
    pub ego_motion: String,
    /// Level of dynamic content.
    pub dynamics: String,
    /// Frames with a pose.
    pub posed_frames: usize,
    /// Outcome of the pose validation; empty without poses.
    pub poses: String,
}

/// Number and length of the sequences of a class.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tally {
    /// Sequences.
    pub sequences: usize,
    /// Their length, seconds.
    pub seconds: f64,
}

impl Tally {
    fn add(&mut self, seconds: f64) {
        self.sequences += 1;
        self.seconds += seconds;
    }
}

/// Statistics of a dataset.
#[derive(Debug, Clone, PartialEq)]
pub struct Statistics {
    /// One row per sequence, in the dataset's order.
    pub rows: Vec<SequenceRow>,
    /// Input videos.
    pub videos: usize,
    /// Videos that gave sequences.
    pub curated_videos: usize,
    /// Sequences of perspective images; all others are panoramas.
    pub perspective_sequences: usize,
}

/// A property by which sequences are counted.
#[derive(Debug, Clone, Copy)]
pub(super) struct Distribution {
    /// Name in `distributions.csv`.
    pub(super) id: &'static str,
    /// The class of a sequence.
    pub(super) class: fn(&SequenceRow) -> String,
}

/// All distributions.
pub(super) const DISTRIBUTIONS: &[Distribution] = &[
    Distribution {
        id: "group",
        class: |row| row.group.clone(),
    },
    Distribution {
        id: "scene",
        class: |row| row.scene.clone(),
    },
    Distribution {
        id: "action",
        class: |row| row.action.clone(),
    },
    Distribution {
        id: "ego-motion",
        class: |row| row.ego_motion.clone(),
    },
    Distribution {
        id: "dynamics",
        class: |row| row.dynamics.clone(),
    },
    Distribution {
        id: "duration",
        class: |row| duration_class(row.duration_seconds).to_owned(),
    },
];

/// Classes of duration, in a form that sorts.
fn duration_class(seconds: f64) -> &'static str {
    match seconds {
        s if s < 10.0 => "under 10 s",
        s if s < 30.0 => "10 to 30 s",
        s if s < 60.0 => "30 to 60 s",
        s if s <= LONG_SECONDS => "1 to 2 min",
        _ => "above 2 min",
    }
}

/// Returns true if a class of a distribution is annotated, or there are no sequences to annotate.
pub(crate) fn is_annotated(tallies: &[(String, Tally)]) -> bool {
    tallies.is_empty() || tallies.iter().any(|(class, _)| class != UNKNOWN)
}

#[derive(Serialize)]
struct SummaryRow {
    measure: &'static str,
    value: String,
    unit: &'static str,
}

#[derive(Serialize)]
struct DistributionRow<'a> {
    distribution: &'a str,
    #[serde(serialize_with = "serialize_for_spreadsheet")]
    class: &'a str,
    sequences: usize,
    share: f64,
    seconds: f64,
}

impl Statistics {
    /// Reads the records of all sequences of a dataset.
    ///
    /// # Errors
    /// When a record is missing or malformed.
    pub fn collect(folder: &Path, dataset: &Dataset) -> Result<Self, CurateError> {
        let mut rows = Vec::new();
        let (mut curated_videos, mut perspective_sequences) = (0, 0);
        for video in &dataset.videos {
            if let VideoStatus::Curated { sequences } = &video.status {
                curated_videos += 1;
                for name in sequences {
                    let file = folder.join(name).join(SEQUENCE_FILE);
                    let sequence: Sequence = store::read_record(&file)?;
                    perspective_sequences += usize::from(sequence.is_pinhole());
                    rows.push(row(folder, name, sequence)?);
                }
            }
        }
        Ok(Self {
            rows,
            videos: dataset.videos.len(),
            curated_videos,
            perspective_sequences,
        })
    }

    /// Returns the length of all sequences, seconds.
    pub fn seconds(&self) -> f64 {
        // The sum of nothing is -0, which prints its sign.
        self.rows
            .iter()
            .map(|row| row.duration_seconds)
            .sum::<f64>()
            + 0.0
    }

    /// Returns the mean length of a sequence, seconds; 0 without sequences.
    pub fn mean_seconds(&self) -> f64 {
        self.seconds() / self.rows.len().max(1) as f64
    }

    /// Returns the share of the sequences that are longer than two minutes; 0 without sequences.
    pub fn long_share(&self) -> f64 {
        let long = self
            .rows
            .iter()
            .filter(|row| row.duration_seconds > LONG_SECONDS);
        long.count() as f64 / self.rows.len().max(1) as f64
    }

    /// Returns every property with its classes, the most frequent class first.
    pub(crate) fn distributions(
        &self,
    ) -> impl Iterator<Item = (&'static str, Vec<(String, Tally)>)> + '_ {
        let all = DISTRIBUTIONS.iter();
        all.map(|distribution| (distribution.id, self.tally(distribution)))
    }

    /// Sequences and their length per class, the most frequent class first.
    pub(super) fn tally(&self, distribution: &Distribution) -> Vec<(String, Tally)> {
        let mut tallies: BTreeMap<String, Tally> = BTreeMap::new();
        for row in &self.rows {
            tallies
                .entry((distribution.class)(row))
                .or_default()
                .add(row.duration_seconds);
        }
        let mut tallies: Vec<(String, Tally)> = tallies.into_iter().collect();
        tallies.sort_by(|a, b| {
            b.1.sequences
                .cmp(&a.1.sequences)
                .then_with(|| a.0.cmp(&b.0))
        });
        tallies
    }

    pub(super) fn summary_csv(&self) -> Result<String, CurateError> {
        let counts = |measure, count: usize| SummaryRow {
            measure,
            value: count.to_string(),
            unit: "",
        };
        // A count is an integer in the table, a measure never.
        let decimal = |value: f64| format!("{:?}", to_microseconds(value));
        let frames: usize = self.rows.iter().map(|row| row.frames).sum();
        let posed = self.rows.iter().filter(|row| row.posed_frames > 0).count();
        table([
            counts("videos", self.videos),
            counts("videos with sequences", self.curated_videos),
            counts("sequences", self.rows.len()),
            counts("sequences with poses", posed),
            counts("sampled frames", frames),
            SummaryRow {
                measure: "total duration",
                value: decimal(self.seconds()),
                unit: "seconds",
            },
            SummaryRow {
                measure: "mean duration",
                value: decimal(self.mean_seconds()),
                unit: "seconds",
            },
            SummaryRow {
                measure: "share above two minutes",
                value: decimal(self.long_share()),
                unit: "",
            },
        ])
    }

    pub(super) fn sequences_csv(&self) -> Result<String, CurateError> {
        table(&self.rows)
    }

    pub(super) fn distributions_csv(&self) -> Result<String, CurateError> {
        let mut rows = Vec::new();
        let tallies: Vec<_> = self.distributions().collect();
        for (distribution, tallies) in &tallies {
            for (class, tally) in tallies {
                rows.push(DistributionRow {
                    distribution,
                    class,
                    sequences: tally.sequences,
                    share: tally.sequences as f64 / self.rows.len() as f64,
                    seconds: to_microseconds(tally.seconds),
                });
            }
        }
        table(rows)
    }
}

/// Returns rows as CSV with a header.
pub(super) fn table(rows: impl IntoIterator<Item = impl Serialize>) -> Result<String, CurateError> {
    let failed = |error: String| CurateError::internal(Path::new("statistics"), error);
    let mut table = csv::Writer::from_writer(Vec::new());
    for row in rows {
        table
            .serialize(row)
            .map_err(|error| failed(error.to_string()))?;
    }
    let bytes = table
        .into_inner()
        .map_err(|error| failed(error.to_string()))?;
    let text = String::from_utf8(bytes).map_err(|error| failed(error.to_string()))?;
    // A table without rows has no header, and an empty file looks truncated.
    Ok(if text.is_empty() {
        "\n".to_owned()
    } else {
        text
    })
}

fn row(folder: &Path, name: &str, sequence: Sequence) -> Result<SequenceRow, CurateError> {
    let at = folder.join(name);
    let annotation: Annotation = optional(&at.join(ANNOTATION_FILE))?.unwrap_or_default();
    let scene: Option<Scene> = optional(&at.join(SCENE_FILE))?;
    let or_unknown = |class: Option<&str>| class.unwrap_or(UNKNOWN).to_owned();
    let posed_frames = scene.as_ref().map_or(0, |scene| {
        scene
            .frames
            .iter()
            .filter(|frame| frame.pose.is_some())
            .count()
    });
    let (source_width, source_height) = sequence.source_size();
    Ok(SequenceRow {
        folder: name.to_owned(),
        source: sequence.source.file_name.clone(),
        begin_seconds: sequence.range.begin_seconds,
        end_seconds: sequence.range.end_seconds,
        duration_seconds: sequence.range.duration_seconds(),
        source_width,
        source_height,
        frames: sequence.frames.entries.len(),
        group: or_unknown(annotation.group.as_deref()),
        scene: or_unknown(annotation.scene.as_ref().map(|tag| tag.name.as_str())),
        action: or_unknown(annotation.action.as_ref().map(|tag| tag.name.as_str())),
        ego_motion: or_unknown(annotation.ego_motion.class()),
        dynamics: or_unknown(annotation.dynamics.as_ref().map(|d| d.class.as_str())),
        posed_frames,
        poses: scene.map_or_else(String::new, |scene| {
            status_name(scene.validation.status).to_owned()
        }),
        sequence: sequence.id,
    })
}

/// Rounds seconds: sums end in digits that say nothing.
fn to_microseconds(seconds: f64) -> f64 {
    (seconds * 1e6).round() / 1e6
}

/// Returns a duration in words, in the largest unit of which it has two.
pub fn duration_in_words(seconds: f64) -> String {
    match seconds {
        seconds if seconds < 120.0 => format!("{seconds:.1} s"),
        seconds if seconds < 7200.0 => format!("{:.1} min", seconds / 60.0),
        seconds => format!("{:.2} hours", seconds / 3600.0),
    }
}

/// Returns the outcome of a pose validation in tables.
pub(crate) fn status_name(status: ValidationStatus) -> &'static str {
    match status {
        ValidationStatus::Valid => "valid",
        ValidationStatus::Unstable => "unstable",
        ValidationStatus::Unchecked => "unchecked",
    }
}

/// Reads an optional record.
pub(crate) fn optional<T: store::Record>(path: &Path) -> Result<Option<T>, CurateError> {
    if path.is_file() {
        Ok(Some(store::read_record(path)?))
    } else {
        Ok(None)
    }
}
