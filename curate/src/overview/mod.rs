//! Overview of a dataset: parts that each sequence has and lacks, and a page to look at.
//!
//! [`status()`] reads the records and writes nothing, [`table()`] makes text of them. [`write_page`] adds to the dataset's folder:
//!
//! ```text
//! index.html   contact sheets, camera paths, coverage of the sphere, losses of curation, statistics
//! status.json  the parts of every sequence, with the commands that make them
//! ```
//!
//! Both follow from the records and images alone, so that the same dataset gives the same bytes. They are not part of
//! the published dataset: its checksums leave them out.

mod commands;
mod coverage;
mod finds;
mod marks;
mod page;
mod parts;
mod path;
mod sheet;
mod table;

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    layout::{ABOUT_FILE, DATASET_FILE, PAGE_FILE, SCENE_FILE, SEQUENCE_FILE, STATUS_FILE},
    progress::Progress,
    records::{About, Dataset, DatasetStatus, LostVideo, VideoStatus},
    stage::StagePlan,
    store,
};
use rayon::prelude::*;

pub use commands::COMMANDS;
pub use table::{StatusTable, table};

use crate::{
    attrition::Attrition,
    error::CurateError,
    publish::{Statistics, optional},
};
use page::{Page, SequenceImages};
use parts::Records;

/// The page and its record.
const FILES: [&str; 2] = [PAGE_FILE, STATUS_FILE];
/// Largest number of sequences with contact sheets, about 0.1 MB each.
const MOST_SHEETS: usize = 200;

/// Dataset or folder of imported scenes, with the records of its sequences.
struct Source {
    /// Record of the dataset; `None` for imported scenes.
    dataset: Option<Dataset>,
    sequences: Vec<Records>,
}

/// Returns the state of every sequence of the dataset, of the sequence, or of the imported scenes in `folder`. Commands
/// name the folder as `shown`; `.` suits a reader who works in it.
///
/// # Errors
/// When the folder is missing or holds none of them, or a record is malformed.
pub fn status(folder: &Path, shown: &str) -> Result<DatasetStatus, CurateError> {
    Ok(Source::read(folder)?.status(shown))
}

/// Refuses a folder in which a file of another origin has the name of the page or of its record. Checked before long
/// work that ends with [`write_page`].
///
/// # Errors
/// When there is one.
pub fn refuse_foreign_page(folder: &Path) -> Result<(), CurateError> {
    let own = stage(folder).own_files();
    for file in FILES {
        own.refuse_foreign(file)?;
    }
    Ok(())
}

/// Writes the page of a folder and its record; returns the path of the page.
///
/// # Errors
/// Those of [`status()`], when the records of curation contradict each other, a file of another origin is in the way, or
/// one cannot be written. An unreadable image is reported on the page.
pub fn write_page(folder: &Path, progress: &dyn Progress) -> Result<PathBuf, CurateError> {
    let source = Source::read(folder)?;
    stage(folder).run(FILES, progress, |made| {
        let status = source.status(".");
        let shown = &source.sequences[..source.sequences.len().min(MOST_SHEETS)];
        progress.begin("drawing the page", Some(shown.len() as u64));
        let looks = shown.par_iter().map(|records| {
            let look = SequenceImages::at(records);
            progress.advance(1);
            look
        });
        let looks: Vec<SequenceImages> = looks.collect();
        progress.end();
        let about: Option<About> = optional(&folder.join(ABOUT_FILE))?;
        let (attrition, statistics) = match &source.dataset {
            Some(dataset) => (
                Some(Attrition::of(dataset, folder)?),
                Some(Statistics::collect(folder, dataset)?),
            ),
            None => (None, None),
        };
        let page = Page {
            title: about.map_or_else(|| "Unnamed dataset".to_owned(), |about| about.name),
            status: &status,
            looks: &looks,
            attrition: attrition.as_ref(),
            statistics: statistics.as_ref(),
        };
        made.write_bytes(PAGE_FILE, page.html().as_bytes())?;
        made.write_record(STATUS_FILE, &status)?;
        Ok(folder.join(PAGE_FILE))
    })
}

fn stage(folder: &Path) -> StagePlan {
    StagePlan::new(folder, "overview")
}

impl Source {
    fn read(folder: &Path) -> Result<Self, CurateError> {
        if !folder.is_dir() {
            return Err(CurateError::input(
                folder,
                "must be the folder of a dataset",
            ));
        }
        let dataset: Option<Dataset> = optional(&folder.join(DATASET_FILE))?;
        let folders = match &dataset {
            Some(dataset) => curated(dataset),
            None => scenes_in(folder)?,
        };
        if dataset.is_none() && folders.is_empty() {
            let reason = format!(
                "holds neither a {DATASET_FILE} nor a {SCENE_FILE}; name the folder that `omnilife curate` or \
                 `omnilife curate import` filled"
            );
            return Err(CurateError::input(folder, reason));
        }
        let read = |name| Records::read(folder, name, dataset.is_some());
        let sequences = folders.into_iter().map(read).collect::<Result<_, _>>()?;
        Ok(Self { dataset, sequences })
    }

    fn status(&self, shown: &str) -> DatasetStatus {
        let videos = self.dataset.iter().flat_map(|dataset| &dataset.videos);
        let lost = videos.filter_map(|video| {
            let (outcome, reason) = match &video.status {
                VideoStatus::Curated { .. } => return None,
                VideoStatus::Pending => ("pending", "not reached".to_owned()),
                VideoStatus::Rejected { reason, .. } => ("rejected", reason.clone()),
                VideoStatus::Duplicate { of } => ("duplicate", format!("the same content as {of}")),
                VideoStatus::Failed { reason } => ("failed", reason.clone()),
            };
            Some(LostVideo {
                file: video.file.clone(),
                outcome: outcome.to_owned(),
                reason,
            })
        });
        DatasetStatus {
            sequences: self.sequences.iter().map(|one| one.status(shown)).collect(),
            lost: lost.collect(),
        }
    }
}

/// Returns the folders of a dataset's sequences, in its order.
fn curated(dataset: &Dataset) -> Vec<String> {
    let folders = dataset
        .videos
        .iter()
        .filter_map(|video| match &video.status {
            VideoStatus::Curated { sequences } => Some(sequences),
            _ => None,
        });
    folders.flatten().cloned().collect()
}

/// Returns the folders with a scene or a sequence in or below a folder, relative to it and sorted.
fn scenes_in(folder: &Path) -> Result<Vec<String>, CurateError> {
    /// Depth of `DATASET/videos/NAME/seq-000`.
    const MOST_LEVELS: usize = 3;
    let mut found = Vec::new();
    let mut pending = vec![(folder.to_owned(), ".".to_owned(), 0)];
    while let Some((path, name, level)) = pending.pop() {
        let has = |file: &str| path.join(file).is_file();
        if has(SCENE_FILE) || has(SEQUENCE_FILE) {
            found.push(name);
            continue;
        }
        if level == MOST_LEVELS {
            continue;
        }
        for inner in store::names_in(&path)? {
            let below = path.join(&inner);
            if inner.starts_with('.') || !below.is_dir() {
                continue;
            }
            let relative = match name.as_str() {
                "." => inner,
                name => format!("{name}/{inner}"),
            };
            pending.push((below, relative, level + 1));
        }
    }
    found.sort();
    Ok(found)
}
