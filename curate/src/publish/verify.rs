//! Verification of a published dataset: complete and consistent.

use std::path::Path;

use omnilife_schemas::{
    layout::{ABOUT_FILE, CHECKSUMS_FILE, DATASET_FILE, FUNNEL_FILE, SEQUENCE_FILE, SLICES_FILE},
    progress::Progress,
    records::{
        About, Dataset, SegmentOutcome, Sequence, SliceFile, Slices, VideoStatus, check_file,
    },
    store,
};
use serde::Deserialize;

use super::{Statistics, checksums, croissant, derived_files, shards, soundness};
use crate::error::CurateError;

/// Segments meet where they differ by no more than this, seconds: they are the same numbers,
/// written and read once.
const TIME_TOLERANCE_SECONDS: f64 = 1e-9;

/// Sums of durations agree to this, seconds: they are added in another order.
const FUNNEL_TOLERANCE_SECONDS: f64 = 1e-6;

/// Checks a published dataset and returns one line per fault; an empty list means that it is sound.
///
/// Checks:
/// * a checksum of every file, no file missing and none too many; every record against its schema;
/// * sequences and frames that the records name, frames of the stated size in order of time; tags and classes of
///   annotations; segments add up to the duration of their video and the funnel to the
///   sequences; every slice lasts as long as its segment;
/// * statistics and card agree with the records.
///
/// # Errors
/// When `folder` cannot be read or holds no dataset.
pub fn verify(folder: &Path, progress: &dyn Progress) -> Result<Vec<String>, CurateError> {
    let mut faults = Faults::default();
    let file = folder.join(DATASET_FILE);
    if folder.is_dir() && !file.exists() {
        let reason =
            format!("must hold a {DATASET_FILE}; `curate VIDEO... --out DATASET` makes datasets");
        return Err(CurateError::input(folder, reason));
    }
    let dataset: Dataset = store::read_record(&file)?;
    let files = checksums::files(folder)?;
    check_sums(folder, &files, &mut faults, progress);
    // Croissant's file is in a foreign format; like all derived files it is regenerated below.
    let is_record = |file: &&String| file.ends_with(".json") && *file != croissant::FILE;
    for file in files.iter().filter(is_record) {
        faults.note(check_file(&folder.join(file)));
    }
    for video in &dataset.videos {
        match &video.status {
            VideoStatus::Curated { sequences } => {
                check_video(folder, sequences, video.sha256.as_deref(), &mut faults);
            }
            VideoStatus::Pending => faults.add(format!("{}: was never curated", video.file)),
            VideoStatus::Rejected { .. }
            | VideoStatus::Failed { .. }
            | VideoStatus::Duplicate { .. } => {}
        }
    }
    if let Some(rows) = faults.note(read_funnel(folder)) {
        check_funnel(folder, &dataset, &rows, &mut faults);
    }
    // Without sound records the statistics cannot be regenerated, and those faults are listed already.
    if faults.lines.is_empty() {
        check_derived(folder, &dataset, &mut faults)?;
    }
    Ok(faults.lines)
}

#[derive(Default)]
struct Faults {
    lines: Vec<String>,
}

impl Faults {
    fn add(&mut self, line: String) {
        self.lines.push(line);
    }

    /// Keeps an error as a fault.
    fn note<T, E: std::fmt::Display>(&mut self, outcome: Result<T, E>) -> Option<T> {
        match outcome {
            Ok(value) => Some(value),
            Err(error) => {
                let line = error.to_string();
                // A broken file is found by more than one check.
                if !self.lines.contains(&line) {
                    self.lines.push(line);
                }
                None
            }
        }
    }
}

fn check_sums(folder: &Path, files: &[String], faults: &mut Faults, progress: &dyn Progress) {
    if !folder.join(CHECKSUMS_FILE).exists() {
        let how = "was not published: `omnilife curate publish` writes the checksums";
        return faults.add(format!("{CHECKSUMS_FILE}: is missing; the dataset {how}"));
    }
    let Some(sums) = faults.note(checksums::read(folder)) else {
        return;
    };
    progress.begin("checking the dataset", Some(files.len() as u64));
    for file in files {
        progress.advance(1);
        let Some(expected) = sums.get(file) else {
            faults.add(format!("{file}: is not in {CHECKSUMS_FILE}"));
            continue;
        };
        if let Some(found) = faults.note(store::sha256_file(&folder.join(file)))
            && found != *expected
        {
            faults.add(format!(
                "{file}: has changed (sha256 {found:.12}, expected {expected:.12})"
            ));
        }
    }
    progress.end();
    for file in sums.keys() {
        if files.binary_search(file).is_err() {
            faults.add(format!("{file}: is missing"));
        }
    }
}

/// Checks sequences, frames and segments of one video.
fn check_video(folder: &Path, sequences: &[String], sha256: Option<&str>, faults: &mut Faults) {
    let mut kept = Vec::new();
    let mut video_folder = None;
    for name in sequences {
        let at = folder.join(name);
        video_folder = at.parent().map(Path::to_owned);
        let path = at.join(SEQUENCE_FILE);
        let Some(sequence) = faults.note(store::read_record::<Sequence>(&path)) else {
            continue;
        };
        if Some(sequence.source.sha256.as_str()) != sha256 {
            faults.add(format!(
                "{name}: is cut from another video than {DATASET_FILE} says"
            ));
        }
        faults
            .lines
            .extend(soundness::faults_of(folder, name, &sequence));
        kept.push((name, sequence.range));
    }
    let Some(video_folder) = video_folder else {
        return;
    };
    let path = video_folder.join(SLICES_FILE);
    let Some(slices) = faults.note(store::read_record::<Slices>(&path)) else {
        return;
    };
    let shown = path.display();
    check_partition(&slices, &shown.to_string(), faults);
    let recorded = slices
        .segments
        .iter()
        .filter_map(|segment| match &segment.outcome {
            SegmentOutcome::Kept { sequence, slice } => Some((segment.range, sequence, slice)),
            SegmentOutcome::TooShort
            | SegmentOutcome::LeftOut
            | SegmentOutcome::Rejected { .. }
            | SegmentOutcome::Transition => None,
        });
    let mut count = 0;
    for (range, sequence, slice) in recorded {
        count += 1;
        let is_known = kept
            .iter()
            .any(|(name, kept)| name.ends_with(sequence.as_str()) && *kept == range);
        if !is_known {
            faults.add(format!(
                "{shown}: {sequence} is not a sequence of this segment"
            ));
        }
        if let Some(slice) = slice {
            check_slice(&video_folder, slice, range.duration_seconds(), faults);
        }
    }
    if count != kept.len() {
        faults.add(format!(
            "{shown}: keeps {count} segments for {} sequences",
            kept.len()
        ));
    }
}

/// The columns of the funnel that are read.
#[derive(Deserialize)]
struct FunnelRow {
    step: String,
    removed_videos: u64,
    removed_seconds: f64,
    left_videos: u64,
    left_seconds: f64,
}

fn read_funnel(folder: &Path) -> Result<Vec<FunnelRow>, store::StoreError> {
    let path = folder.join(FUNNEL_FILE);
    let text = std::fs::read(&path).map_err(|error| store::StoreError::read(&path, error))?;
    csv::Reader::from_reader(text.as_slice())
        .deserialize()
        .collect::<Result<_, _>>()
        .map_err(|error: csv::Error| store::StoreError::malformed(&path, error.to_string()))
}

/// Checks that each step leaves the remainder of the one before less its removals, and the last one the length of the
/// sequences.
fn check_funnel(folder: &Path, dataset: &Dataset, rows: &[FunnelRow], faults: &mut Faults) {
    for pair in rows.windows(2) {
        let (before, after) = (&pair[0], &pair[1]);
        let videos = before.left_videos == after.left_videos + after.removed_videos;
        let seconds = before.left_seconds - after.removed_seconds - after.left_seconds;
        if !videos || seconds.abs() > FUNNEL_TOLERANCE_SECONDS {
            faults.add(format!(
                "{FUNNEL_FILE}: {} does not leave what {} left less what it removed",
                after.step, before.step
            ));
        }
    }
    let Ok(statistics) = Statistics::collect(folder, dataset) else {
        // The records that it failed on are faults already.
        return;
    };
    let kept = rows.last().map_or(0.0, |row| row.left_seconds);
    if (kept - statistics.seconds()).abs() > FUNNEL_TOLERANCE_SECONDS {
        faults.add(format!(
            "{FUNNEL_FILE}: keeps {kept:.3} s, the sequences last {:.3} s",
            statistics.seconds()
        ));
    }
}

/// Checks that segments cover the video from start to end without gaps or overlaps.
fn check_partition(slices: &Slices, name: &str, faults: &mut Faults) {
    let mut reached = slices.range.begin_seconds;
    for segment in &slices.segments {
        let gap = segment.range.begin_seconds - reached;
        if gap.abs() > TIME_TOLERANCE_SECONDS || segment.range.duration_seconds() <= 0.0 {
            faults.add(format!(
                "{name}: the segment from {} s to {} s does not follow what ends at {reached} s",
                segment.range.begin_seconds, segment.range.end_seconds
            ));
        }
        reached = segment.range.end_seconds;
    }
    if (reached - slices.range.end_seconds).abs() > TIME_TOLERANCE_SECONDS {
        faults.add(format!(
            "{name}: the segments end at {reached} s, the video at {} s",
            slices.range.end_seconds
        ));
    }
}

fn check_slice(folder: &Path, slice: &SliceFile, duration_seconds: f64, faults: &mut Faults) {
    let path = folder.join(&slice.file);
    let Some(probe) = faults.note(omnilife_video::probe(&path)) else {
        return;
    };
    let frame = 1.0 / probe.frames_per_second.max(1.0);
    if (probe.duration_seconds - duration_seconds).abs() > frame {
        faults.add(format!(
            "{}: lasts {:.3} s, its segment {duration_seconds:.3} s",
            path.display(),
            probe.duration_seconds
        ));
    }
    if probe.spherical.is_none() {
        faults.add(format!("{}: has no spherical metadata", path.display()));
    }
}

/// Checks that statistics, figures and card follow from the records.
fn check_derived(folder: &Path, dataset: &Dataset, faults: &mut Faults) -> Result<(), CurateError> {
    let about: About = store::read_record(&folder.join(ABOUT_FILE))?;
    let statistics = Statistics::collect(folder, dataset)?;
    let has_shards = shards::are_in(folder);
    for (file, content) in derived_files(folder, &about, dataset, &statistics, has_shards)? {
        let is_current =
            std::fs::read(folder.join(&file)).is_ok_and(|held| held == content.as_bytes());
        if !is_current {
            faults.add(format!(
                "{file}: does not say what the records say; run `omnilife curate publish` again"
            ));
        }
    }
    Ok(())
}
