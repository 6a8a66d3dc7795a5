//! Curation of many videos into one dataset: every video gets its outcome, and a bad one stops no other.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    layout::{ATTRITION_FILE, DATASET_FILE, VIDEOS_FOLDER},
    lock::FolderLock,
    plain_text::counted,
    progress::Progress,
    records::{Dataset, InputFile, Origin, SourceVideo, VideoEntry, VideoStatus},
    store,
};

use crate::{
    attrition::{Attrition, NEAR_DUPLICATE},
    error::CurateError,
    pipeline,
    settings::CurateSettings,
    video_folder::duration_seconds,
    video_names::video_names,
    worker::{Curated, Worker},
};

/// A dataset and the errors behind its rejected and failed videos.
#[derive(Debug)]
pub struct CuratedDataset {
    /// The record as written.
    pub record: Dataset,
    /// Number of each failed video in the record, with its error.
    pub errors: Vec<(usize, CurateError)>,
    /// Lock against other processes, for as long as the dataset is worked on.
    pub lock: FolderLock,
}

/// Process in which videos are curated.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Place {
    /// This process: a file that crashes a decoder ends it.
    ThisProcess,
    /// A process per video: a file that crashes a decoder is a failed video.
    ProcessEach(Worker),
}

impl Place {
    fn curate(
        &self,
        video: &Path,
        source: &SourceVideo,
        folder: &Path,
        settings: &CurateSettings,
        progress: &dyn Progress,
    ) -> Curated {
        match self {
            Self::ThisProcess => {
                let curated = pipeline::curate_source(video, source, folder, settings, progress);
                Curated {
                    sequences: curated,
                    duration_seconds: duration_seconds(video, folder),
                }
            }
            Self::ProcessEach(worker) => worker.curate(video, source, folder, settings, progress),
        }
    }
}

/// Curates videos as [`curate_dataset_in`] this process.
///
/// # Errors
/// Those of [`curate_dataset_in`].
pub fn curate_dataset(
    videos: &[PathBuf],
    out: &Path,
    settings: &CurateSettings,
    progress: &dyn Progress,
) -> Result<CuratedDataset, CurateError> {
    curate_dataset_in(&Place::ThisProcess, videos, &[], out, settings, progress)
}

/// Curates videos into `out`: `dataset.json` and one folder per video in `videos/`, named after the video's file. The
/// record names videos by [`video_names()`], and lists the files of folders that are `not_taken`.
///
/// # Errors
/// When the settings are invalid, `out` holds something else or the dataset of other videos, or it cannot be written.
/// Errors of single videos are in the record and in [`CuratedDataset::errors`].
pub fn curate_dataset_in(
    place: &Place,
    videos: &[PathBuf],
    not_taken: &[InputFile],
    out: &Path,
    settings: &CurateSettings,
    progress: &dyn Progress,
) -> Result<CuratedDataset, CurateError> {
    // Settings are the same for all videos: wrong ones are refused before any work is done.
    if let Some(video) = videos.first() {
        settings.check(video)?;
    }
    refuse_foreign(out)?;
    let folders = folder_names(videos);
    let sources = identify_all(videos, progress);
    let origins = held_origins(out);
    let mut record = Dataset {
        videos: video_names(videos)
            .into_iter()
            .zip(&sources)
            .map(|(name, source)| pending(name, source.as_ref().ok(), &origins))
            .collect(),
        not_taken: not_taken.to_vec(),
    };
    claim(out, &record)?;
    let lock = FolderLock::take(out, progress)?;
    store::remove_abandoned(out)?;
    let path = out.join(DATASET_FILE);
    store::write_record(&path, &record)?;
    let mut errors = Vec::new();
    for (index, (source, name)) in sources.into_iter().zip(&folders).enumerate() {
        let video = &videos[index];
        let folder = out.join(VIDEOS_FOLDER).join(name);
        if let Some(first) = first_with_this_content(&record, index) {
            let of = record.videos[first].file.clone();
            progress.note(&format!(
                "{}: the same content as {}, skipped",
                video.display(),
                videos[first].display()
            ));
            record.videos[index].duration_seconds = record.videos[first].duration_seconds;
            record.videos[index].status = VideoStatus::Duplicate { of };
            store::write_record(&path, &record)?;
            continue;
        }
        let name_of_file = &record.videos[index].file;
        let label = match videos.len() {
            1 => name_of_file.clone(),
            count => format!("{} of {count}: {name_of_file}", index + 1),
        };
        let curated = match source {
            Ok(source) => {
                progress.begin(&label, None);
                let curated = place.curate(video, &source, &folder, settings, progress);
                progress.end();
                curated
            }
            Err(error) => Curated {
                sequences: Err(error),
                duration_seconds: None,
            },
        };
        // Files of a killed process, and of a child that outlived it for a moment.
        store::remove_abandoned(&folder)?;
        let status = match curated.sequences {
            Ok(sequences) => VideoStatus::Curated {
                sequences: sequences
                    .iter()
                    .map(|sequence| format!("{VIDEOS_FOLDER}/{name}/{sequence}"))
                    .collect(),
            },
            Err(error) => {
                let reason = error.for_records();
                let status = match error.failed_checks() {
                    Some(failed) => VideoStatus::Rejected {
                        reason,
                        failed: failed.to_vec(),
                    },
                    None => VideoStatus::Failed { reason },
                };
                errors.push((index, error));
                status
            }
        };
        record.videos[index].duration_seconds = curated.duration_seconds;
        record.videos[index].status = status;
        store::write_record(&path, &record)?;
    }
    let attrition = Attrition::of(&record, out)?;
    attrition.write(out)?;
    for row in &attrition.rejects {
        if row.check == NEAR_DUPLICATE {
            progress.note(&format!("{}: {}; both are kept", row.video, row.value));
        }
    }
    let raw = attrition
        .funnel
        .first()
        // The sum of nothing is -0, which prints its sign.
        .map_or(0.0, |step| step.left_seconds + 0.0);
    progress.note(&format!(
        "kept {} of {}: {}, {:.1} of {raw:.1} s; {} has the reasons for the rest",
        attrition.funnel.last().map_or(0, |step| step.left_videos),
        counted(record.videos.len(), "video"),
        counted(attrition.kept_sequences, "sequence"),
        attrition.kept_seconds,
        out.join(ATTRITION_FILE).display()
    ));
    Ok(CuratedDataset {
        record,
        errors,
        lock,
    })
}

/// Returns the first video before `index` that has the same content.
fn first_with_this_content(record: &Dataset, index: usize) -> Option<usize> {
    let sha256 = record.videos[index].sha256.as_ref()?;
    record.videos[..index]
        .iter()
        .position(|video| video.sha256.as_ref() == Some(sha256))
}

/// Hashes every video once; errors of unreadable files appear at their turn.
fn identify_all(
    videos: &[PathBuf],
    progress: &dyn Progress,
) -> Vec<Result<SourceVideo, CurateError>> {
    progress.begin("hashing", Some(videos.len() as u64));
    let sources = videos
        .iter()
        .map(|video| {
            let source = pipeline::identify(video);
            progress.advance(1);
            source
        })
        .collect();
    progress.end();
    sources
}

fn pending(
    file: String,
    source: Option<&SourceVideo>,
    origins: &BTreeMap<String, Origin>,
) -> VideoEntry {
    VideoEntry {
        file,
        sha256: source.map(|source| source.sha256.clone()),
        duration_seconds: None,
        origin: source.and_then(|source| origins.get(&source.sha256).cloned()),
        status: VideoStatus::Pending,
    }
}

/// Returns origins of videos from the dataset's present record, by SHA-256. Errors of an unreadable record appear when
/// the dataset is claimed.
fn held_origins(out: &Path) -> BTreeMap<String, Origin> {
    let held: Option<Dataset> = store::read_record(&out.join(DATASET_FILE)).ok();
    let videos = held.into_iter().flat_map(|held| held.videos);
    videos
        .filter_map(|video| Some((video.sha256?, video.origin?)))
        .collect()
}

/// Names of the videos' folders in [`VIDEOS_FOLDER`]: the file's stem, with a number where two videos
/// share one.
pub fn folder_names(videos: &[PathBuf]) -> Vec<String> {
    let mut taken = BTreeSet::new();
    videos
        .iter()
        .map(|video| {
            let stem = pipeline::stem(video);
            let numbered = (2..).map(|number| format!("{stem}-{number}"));
            let name = std::iter::once(stem.clone())
                .chain(numbered)
                .find(|name| !taken.contains(name))
                .unwrap_or(stem);
            taken.insert(name.clone());
            name
        })
        .collect()
}

/// Refuses an output that is a file, or a folder of something else than a dataset.
///
/// # Errors
/// The reason, also when the folder cannot be read.
pub fn refuse_foreign(out: &Path) -> Result<(), CurateError> {
    if out.exists() && !out.is_dir() {
        return Err(CurateError::input(
            out,
            "is a file; the output needs a folder",
        ));
    }
    if !out.is_dir() || out.join(DATASET_FILE).is_file() {
        return Ok(());
    }
    // A killed process leaves hidden files. Units of a sweep fill the videos' folders before there is a dataset; each
    // of those is checked at its turn.
    let is_foreign = |name: &String| !name.starts_with('.') && name != VIDEOS_FOLDER;
    if store::names_in(out)?.iter().any(is_foreign) {
        return Err(CurateError::input(
            out,
            "is not empty and holds no dataset; choose another output",
        ));
    }
    Ok(())
}

/// Creates the folder, or checks that it holds a dataset of some of these videos. Videos without sequences do not
/// count: repairing or excluding a bad one costs no other its results.
fn claim(out: &Path, record: &Dataset) -> Result<(), CurateError> {
    refuse_foreign(out)?;
    let path = out.join(DATASET_FILE);
    if path.is_file() {
        let held: Dataset = store::read_record(&path)?;
        let ours: BTreeSet<_> = record
            .videos
            .iter()
            .filter_map(|v| v.sha256.as_ref())
            .collect();
        let has_results = |video: &VideoEntry| {
            matches!(
                video.status,
                VideoStatus::Curated { .. } | VideoStatus::Pending
            )
        };
        let other = held.videos.iter().find(|&video| {
            has_results(video)
                && video
                    .sha256
                    .as_ref()
                    .is_some_and(|sha256| !ours.contains(sha256))
        });
        if let Some(other) = other {
            return Err(CurateError::input(
                out,
                format!(
                    "holds the results of another input ({}); remove it or choose another output",
                    other.file
                ),
            ));
        }
    }
    Ok(store::create_folder(out)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every video name gives one visible folder in the dataset.
    #[test]
    fn dotted_and_broken_names_give_plain_folders() {
        let videos = [
            "...mp4",
            "..mp4",
            ".mp4",
            ".hidden.mp4",
            "a\nb.mp4",
            "..",
            "a.b.mp4",
        ];
        let names = folder_names(&videos.map(PathBuf::from));
        assert_eq!(names, ["__", "_", "_mp4", "_hidden", "a_b", "video", "a.b"]);
    }

    #[test]
    fn videos_of_one_name_get_folders_of_their_own() {
        let videos = ["a/x.mp4", "b/x.mp4", "x-2.mp4", "y.mov"].map(PathBuf::from);
        assert_eq!(folder_names(&videos), ["x", "x-2", "x-2-2", "y"]);
    }
}
