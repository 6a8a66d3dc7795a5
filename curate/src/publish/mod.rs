//! Publication of a dataset: statistics, figures, a card and checksums, and their verification.
//!
//! [`publish`] adds to the folder that curation filled:
//!
//! ```text
//! about.json                   name, licence and description, as its makers give them
//! statistics/summary.csv       counts, hours, mean duration, share above two minutes
//! statistics/sequences.csv     one row per sequence
//! statistics/distributions.csv sequences and hours per group, scene, action, ego-motion, dynamics
//! statistics/*.svg             the distributions as figures
//! README.md                    the dataset card
//! croissant.json               the same for loaders of machine-learning data
//! shards/frames-*.tar          the frames as WebDataset shards, if requested
//! SHA256SUMS                   of every file, as `sha256sum -c` reads it
//! ```
//!
//! [`select`] finds a representative subset. [`verify`] returns one line per fault of such a folder.

mod card;
mod checksums;
mod croissant;
mod figures;
mod selection;
mod shards;
mod statistics;
mod verify;

use std::path::Path;

use omnilife_schemas::{
    layout::{ABOUT_FILE, CARD_FILE, CHECKSUMS_FILE, DATASET_FILE, STATISTICS_FOLDER},
    lock::FolderLock,
    progress::Progress,
    records::{About, Dataset},
    stage::StagePlan,
    store,
};

pub use selection::{SelectRequest, Selection, properties, select};
pub use statistics::{SequenceRow, Statistics, Tally};
pub use verify::verify;

use crate::error::CurateError;

/// Statements on a dataset beside its measurements; `None` keeps an earlier one.
#[derive(Debug, Clone, Default)]
pub struct PublishSettings {
    /// Name of the dataset; the folder's name if none was ever given.
    pub name: Option<String>,
    /// Licence of the whole.
    pub licence: Option<String>,
    /// Description.
    pub description: Option<String>,
    /// Approximate size of the shards of frames, bytes; `None` for no shards, and earlier ones are removed.
    pub shard_bytes: Option<u64>,
}

/// Writes statistics, figures, card and checksums of the dataset in `folder`.
///
/// # Errors
/// When the folder holds no dataset, a record of it is missing or malformed, a foreign or changed file is in the way,
/// or a file cannot be written.
pub fn publish(
    folder: &Path,
    settings: &PublishSettings,
    progress: &dyn Progress,
) -> Result<Statistics, CurateError> {
    let dataset: Dataset = store::read_record(&folder.join(DATASET_FILE))?;
    let _lock = FolderLock::take(folder, progress)?;
    let about = about(folder, settings)?;
    let statistics = Statistics::collect(folder, &dataset)?;
    let bytes = settings.shard_bytes;
    let shards = bytes.map(|bytes| shards::plan(folder, &statistics, bytes));
    let shards = shards.transpose()?.unwrap_or_default();
    let derived = derived_files(&about, &dataset, &statistics, !shards.is_empty())?;
    let stage = StagePlan::new(folder, "publish");
    for (file, content) in &derived {
        // The card is meant for reading, so somebody may have edited it.
        let sha256 = store::sha256_bytes(content.as_bytes());
        stage.own_files().refuse_changed(file, &sha256)?;
    }
    let files = derived.iter().map(|(file, _)| file.as_str());
    let archives = shards.iter().map(|shard| shard.file.as_str());
    let files: Vec<&str> = files.chain(archives).chain([CHECKSUMS_FILE]).collect();
    stage.run(&files, progress, |out| {
        // From here on the old checksums may be wrong: none are better.
        store::remove(&folder.join(CHECKSUMS_FILE))?;
        store::write_record(&folder.join(ABOUT_FILE), &about)?;
        stage.own_files().remove(|file| !files.contains(&file))?;
        store::create_folder(&folder.join(STATISTICS_FOLDER))?;
        shards::write(folder, &shards, progress)?;
        out.add_all(shards.iter().map(|shard| &shard.file));
        for (file, content) in &derived {
            out.write_bytes(file, content.as_bytes())?;
        }
        checksums::write(folder, progress)?;
        out.add(CHECKSUMS_FILE);
        Ok(statistics)
    })
}

/// Returns everything that follows from the records: file names with their contents.
fn derived_files(
    about: &About,
    dataset: &Dataset,
    statistics: &Statistics,
    has_shards: bool,
) -> Result<Vec<(String, String)>, CurateError> {
    let card = card::card(about, dataset, statistics, has_shards);
    let mut files = vec![(CARD_FILE.to_owned(), card)];
    let mut add =
        |name: &str, content| files.push((format!("{STATISTICS_FOLDER}/{name}"), content));
    add("summary.csv", statistics.summary_csv()?);
    let sequences = statistics.sequences_csv()?;
    let metadata = croissant::metadata(about, statistics, &sequences);
    add("sequences.csv", sequences);
    add("distributions.csv", statistics.distributions_csv()?);
    for figure in figures::FIGURES {
        add(figure.file, figures::draw(figure, statistics)?);
    }
    files.push((croissant::FILE.to_owned(), metadata));
    Ok(files)
}

/// Returns the earlier statements, updated by the new ones.
fn about(folder: &Path, settings: &PublishSettings) -> Result<About, CurateError> {
    let path = folder.join(ABOUT_FILE);
    let before = if path.is_file() {
        store::read_record(&path)?
    } else {
        let absolute =
            std::path::absolute(folder).map_err(|error| store::StoreError::read(folder, error))?;
        let name = absolute.file_name().unwrap_or_default();
        About {
            name: name.to_string_lossy().into_owned(),
            ..About::default()
        }
    };
    Ok(About {
        name: settings.name.clone().unwrap_or(before.name),
        licence: settings.licence.clone().or(before.licence),
        description: settings.description.clone().or(before.description),
    })
}
