//! Accounts for every second of input: the reason for each rejected video or segment (`attrition.csv`), and the
//! remainder after each step (`funnel.csv`). Near-duplicates are listed as well, and kept.

use std::path::Path;

use omnilife_schemas::{
    layout::{ATTRITION_FILE, BOUNDARIES_FILE, FUNNEL_FILE, SEQUENCE_FILE},
    plain_text::serialize_for_spreadsheet,
    records::{BoundaryLedger, Dataset, InputFile, Sequence, TimeRange, VideoEntry, VideoStatus},
    store::{self, Record},
};
use serde::Serialize;

use crate::{
    criteria::{CHECKS, LEFT_OUT, LEFT_OUT_THRESHOLD, PROJECTION, SHOT_LENGTH},
    error::CurateError,
    inputs::VIDEO_EXTENSIONS,
    near_duplicates::{self, LIMIT, NearDuplicate},
    shots::{self, described, limit},
};

/// Steps of the funnel that are not admission checks, in their order around those.
const RAW: &str = "raw";
const DUPLICATE: &str = "duplicate";
const READABLE: &str = "readable";
/// Footage of another video, in another file; nothing is rejected for it.
pub const NEAR_DUPLICATE: &str = "near-duplicate";
const TRANSITION: &str = "transition";
/// A video in an input folder that was not taken; it removes nothing from the funnel.
pub const INPUT: &str = "input";
const KEPT: &str = "kept";

/// One reason for which a video or a segment of one was rejected.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reject {
    /// The video as `dataset.json` calls it.
    #[serde(serialize_with = "serialize_for_spreadsheet")]
    pub video: String,
    /// Id of the check.
    pub check: String,
    /// Measured value.
    #[serde(serialize_with = "serialize_for_spreadsheet")]
    pub value: String,
    /// Required value.
    pub threshold: String,
    /// The segment; empty for a whole video.
    pub begin_seconds: Option<f64>,
    /// End of the segment.
    pub end_seconds: Option<f64>,
    /// Lost seconds; empty if a broken file has no known duration.
    pub seconds: Option<f64>,
    /// True if the funnel counts it here: a video fails once, by its first failed check.
    pub counted: bool,
}

/// One step of the funnel.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FunnelStep {
    /// The step.
    pub step: String,
    /// Videos removed by this step.
    pub removed_videos: usize,
    /// Seconds removed by this step.
    pub removed_seconds: f64,
    /// Videos left after it.
    pub left_videos: usize,
    /// Seconds left after it.
    pub left_seconds: f64,
    /// Hours left after it.
    pub left_hours: f64,
}

/// Fate of every second of a dataset's videos.
#[derive(Debug, Clone, PartialEq)]
pub struct Attrition {
    /// Every reject, in order of the videos.
    pub rejects: Vec<Reject>,
    /// From raw to kept.
    pub funnel: Vec<FunnelStep>,
    /// Seconds in sequences, as their records say.
    pub kept_seconds: f64,
    /// Sequences.
    pub kept_sequences: usize,
}

impl Attrition {
    /// Computes it from the records of the dataset in `out`.
    ///
    /// # Errors
    /// When a record cannot be read, or kept and rejected seconds do not add up to the input.
    pub fn of(dataset: &Dataset, out: &Path) -> Result<Self, CurateError> {
        let mut rejects = Vec::new();
        let mut kept_seconds = 0.0;
        let mut kept_sequences = 0;
        for video in &dataset.videos {
            match &video.status {
                VideoStatus::Curated { sequences } => {
                    let kept = kept_ranges(out, sequences)?;
                    kept_sequences += kept.len();
                    kept_seconds += kept.iter().map(TimeRange::duration_seconds).sum::<f64>();
                    rejects.extend(lost_segments(video, out, sequences, &kept)?);
                }
                status => rejects.extend(whole_video(video, status)),
            }
        }
        let funnel = funnel(dataset, &rejects);
        for pair in near_duplicates::find(dataset, out)? {
            rejects.push(near_duplicate(dataset, &pair));
        }
        rejects.extend(dataset.not_taken.iter().map(not_taken));
        let left = funnel.last().map_or(0.0, |step| step.left_seconds);
        // A microsecond per video covers the rounding of sums.
        if (left - kept_seconds).abs() > 1e-6 * (dataset.videos.len() + 1) as f64 {
            return Err(CurateError::internal(
                out,
                format!("rejects leave {left} s, sequences hold {kept_seconds} s"),
            ));
        }
        Ok(Self {
            rejects,
            funnel,
            kept_seconds,
            kept_sequences,
        })
    }

    /// Writes both tables into the dataset's folder.
    ///
    /// # Errors
    /// When they cannot be written.
    pub fn write(&self, out: &Path) -> Result<(), CurateError> {
        store::write_csv(&out.join(ATTRITION_FILE), |table| {
            if self.rejects.is_empty() {
                table.write_record(REJECT_COLUMNS)?;
            }
            self.rejects.iter().try_for_each(|row| table.serialize(row))
        })?;
        Ok(store::write_csv_rows(&out.join(FUNNEL_FILE), &self.funnel)?)
    }
}

/// Columns of a table without rows.
const REJECT_COLUMNS: &[&str] = &[
    "video",
    "check",
    "value",
    "threshold",
    "begin_seconds",
    "end_seconds",
    "seconds",
    "counted",
];

fn read<T: Record>(out: &Path, folder: &str, file: &str) -> Result<T, CurateError> {
    Ok(store::read_record(&out.join(folder).join(file))?)
}

fn kept_ranges(out: &Path, sequences: &[String]) -> Result<Vec<TimeRange>, CurateError> {
    sequences
        .iter()
        .map(|folder| Ok(read::<Sequence>(out, folder, SEQUENCE_FILE)?.range))
        .collect()
}

/// Returns the segments that a curated video loses: shots that are too short, excluded or rejected, and the insides of
/// transitions.
fn lost_segments(
    video: &VideoEntry,
    out: &Path,
    sequences: &[String],
    kept: &[TimeRange],
) -> Result<Vec<Reject>, CurateError> {
    let Some((folder, _)) = sequences.first().and_then(|first| first.rsplit_once('/')) else {
        return Ok(Vec::new());
    };
    let ledger: BoundaryLedger = read(out, folder, BOUNDARIES_FILE)?;
    let lost = |range: TimeRange, check: &str, value: String, threshold: &str| Reject {
        video: video.file.clone(),
        check: check.to_owned(),
        value,
        threshold: threshold.to_owned(),
        begin_seconds: Some(range.begin_seconds),
        end_seconds: Some(range.end_seconds),
        seconds: Some(range.duration_seconds()),
        counted: true,
    };
    let mut rejects: Vec<Reject> = ledger
        .dropped
        .iter()
        .map(|range| {
            let value = format!("{:.3} s", range.duration_seconds());
            lost(*range, SHOT_LENGTH, value, "the shortest shot asked for")
        })
        .collect();
    rejects.extend(ledger.left_out.iter().map(|range| {
        let value = format!("{:.3} s", range.duration_seconds());
        lost(*range, LEFT_OUT, value, LEFT_OUT_THRESHOLD)
    }));
    rejects.extend(
        (ledger.rejected.iter())
            .map(|shot| lost(shot.range, &shot.check, described(shot), &limit(shot))),
    );
    let rejected = ledger.rejected.iter().map(|shot| &shot.range);
    let known = kept.iter().chain(&ledger.dropped).chain(&ledger.left_out);
    let known = known.chain(rejected);
    let mut shots: Vec<TimeRange> = known.copied().collect();
    shots.sort_by(|a, b| a.begin_seconds.total_cmp(&b.begin_seconds));
    let mut at = ledger.range.begin_seconds;
    let end = TimeRange::new(ledger.range.end_seconds, ledger.range.end_seconds);
    for shot in shots.iter().chain([&end]) {
        if shot.begin_seconds > at {
            let range = TimeRange::new(at, shot.begin_seconds);
            let value = format!("{:.3} s between two shots", range.duration_seconds());
            rejects.push(lost(range, TRANSITION, value, "frames of one shot alone"));
        }
        at = shot.end_seconds.max(at);
    }
    rejects.sort_by(|a, b| {
        a.begin_seconds
            .partial_cmp(&b.begin_seconds)
            .unwrap_or(std::cmp::Ordering::Equal)
    });
    Ok(rejects)
}

/// Returns a row that removes nothing: people decide on near-duplicates.
fn near_duplicate(dataset: &Dataset, pair: &NearDuplicate) -> Reject {
    let [video, of] = [pair.video, pair.of].map(|number| &dataset.videos[number].file);
    let still = match pair.is_still {
        true => ", and too still to be told from another part of the place",
        false => "",
    };
    Reject {
        video: video.clone(),
        check: NEAR_DUPLICATE.to_owned(),
        value: format!(
            "looks like {of} from {:.2} s on (difference {:.3}{still})",
            pair.begin_in_other_seconds, pair.difference
        ),
        threshold: format!("a difference of {LIMIT}"),
        begin_seconds: Some(pair.begin_seconds),
        end_seconds: Some(pair.begin_seconds + pair.seconds),
        seconds: Some(pair.seconds),
        counted: false,
    }
}

/// Returns a row that removes nothing: the file was never taken in.
fn not_taken(file: &InputFile) -> Reject {
    Reject {
        video: file.file.clone(),
        check: INPUT.to_owned(),
        value: file.reason.clone(),
        threshold: format!(
            "a file directly in the folder ({})",
            VIDEO_EXTENSIONS.join(" ")
        ),
        begin_seconds: None,
        end_seconds: None,
        seconds: None,
        counted: false,
    }
}

fn whole_video(video: &VideoEntry, status: &VideoStatus) -> Vec<Reject> {
    let reject = |check: &str, value: &str, threshold: &str| Reject {
        video: video.file.clone(),
        check: check.to_owned(),
        value: value.to_owned(),
        threshold: threshold.to_owned(),
        begin_seconds: None,
        end_seconds: None,
        seconds: video.duration_seconds,
        counted: true,
    };
    match status {
        VideoStatus::Curated { .. } => Vec::new(),
        VideoStatus::Pending => vec![reject(READABLE, "not reached", "curated")],
        VideoStatus::Failed { reason } => vec![reject(READABLE, reason, "decodes to its end")],
        VideoStatus::Duplicate { of } => vec![reject(
            DUPLICATE,
            &format!("the same content as {of}"),
            "every content once",
        )],
        VideoStatus::Rejected { failed, .. } => failed
            .iter()
            .enumerate()
            .map(|(index, outcome)| Reject {
                counted: index == 0,
                ..reject(&outcome.check, &outcome.value, &outcome.threshold)
            })
            .collect(),
    }
}

fn funnel(dataset: &Dataset, rejects: &[Reject]) -> Vec<FunnelStep> {
    let mut left_videos = dataset.videos.len();
    let mut left_seconds: f64 = dataset
        .videos
        .iter()
        .filter_map(|video| video.duration_seconds)
        .sum();
    let checks = CHECKS.iter().map(|check| check.id);
    let names: Vec<&str> = [RAW, DUPLICATE, READABLE]
        .into_iter()
        .chain(checks)
        .chain([PROJECTION, SHOT_LENGTH, LEFT_OUT])
        .chain(shots::CHECKS.iter().map(|check| check.id))
        .chain([TRANSITION, KEPT])
        .collect();
    names
        .into_iter()
        .map(|step| {
            let counted = rejects
                .iter()
                .filter(|reject| reject.counted && reject.check == step);
            // The sum of nothing is -0, which prints its sign.
            let removed_seconds = counted
                .clone()
                .filter_map(|reject| reject.seconds)
                .sum::<f64>()
                + 0.0;
            let removed_videos = counted
                .filter(|reject| reject.begin_seconds.is_none())
                .count();
            left_videos -= removed_videos;
            left_seconds -= removed_seconds;
            FunnelStep {
                step: step.to_owned(),
                removed_videos,
                removed_seconds,
                left_videos,
                left_seconds,
                left_hours: left_seconds / 3600.0,
            }
        })
        .collect()
}
