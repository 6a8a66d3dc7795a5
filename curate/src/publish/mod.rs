//! Publication of a dataset: statistics, figures, a card and checksums, and their verification.
//!
//! [`publish`] adds to the folder that curation filled:
//!
//! ```text
//! about.json                   name, licence and description, as its makers give them
//! statistics/summary.csv       counts, total and mean duration, share above two minutes
//! statistics/sequences.csv     one row per sequence
//! statistics/distributions.csv sequences and seconds per group, scene, action, ego-motion, dynamics
//! statistics/*.svg             the distributions as figures
//! tables/*.csv                 frames, masks, poses, points, annotations and splits
//! videos/*/slices/metadata.csv the sequences beside their videos, as viewers of hubs read them
//! README.md                    the dataset card
//! DATASHEET.md                 the makers' statements and the records, by the questions of a datasheet
//! croissant.json               the same for loaders of machine-learning data
//! shards/frames-*.tar          the frames as WebDataset shards, if requested
//! SHA256SUMS                   of every file, as `sha256sum -c` reads it
//! ```
//!
//! [`select`] finds a representative subset. [`verify`] returns one line per fault of such a folder.

mod card;
mod checksums;
mod croissant;
mod datasheet;
mod figures;
mod kinds;
mod licence;
mod selection;
mod shards;
mod soundness;
mod statements;
mod statistics;
mod tables;
mod verify;

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    layout::{
        ABOUT_FILE, CARD_FILE, CHECKSUMS_FILE, DATASET_FILE, DATASHEET_FILE, STATISTICS_FOLDER,
        TABLES_FOLDER,
    },
    lock::FolderLock,
    plain_text::counted,
    progress::Progress,
    records::{About, Dataset, Statements},
    stage::StagePlan,
    store, toml_file,
};
use serde::Deserialize;

pub use licence::licence;
pub use selection::{SelectRequest, Selection, properties, select};
pub use statistics::{SequenceRow, Statistics, Tally, duration_in_words};
pub(crate) use statistics::{is_annotated, optional, status_name};
pub use verify::verify;

use crate::error::CurateError;

/// Statements on a dataset beside its measurements; `None` keeps an earlier one.
#[derive(Debug, Clone, Default)]
pub struct PublishSettings {
    /// Name of the dataset; the folder's name if none was ever given.
    pub name: Option<String>,
    /// Licence of the whole, as [`licence()`] accepts it.
    pub licence: Option<String>,
    /// Description.
    pub description: Option<String>,
    /// TOML file with entries `name`, `licence` and `description`, which give way to those above, and a table
    /// `[statements]` of [`Statements`], which replaces earlier ones.
    pub about: Option<PathBuf>,
    /// Refuses to publish while anything is unstated; see [`unstated`].
    pub is_strict: bool,
    /// Approximate size of the shards of frames, bytes; `None` for no shards, and earlier ones are removed.
    pub shard_bytes: Option<u64>,
}

/// Refuses a folder in which a file of another origin has the name of the card, the datasheet, the metadata or the
/// checksums. Checked before long work that ends with [`publish`].
///
/// # Errors
/// When there is one.
pub fn refuse_foreign(folder: &Path) -> Result<(), CurateError> {
    let own = stage(folder).own_files();
    for file in [CARD_FILE, DATASHEET_FILE, croissant::FILE, CHECKSUMS_FILE] {
        own.refuse_foreign(file)?;
    }
    Ok(())
}

/// Returns the entries of a dataset's folder that must be left out of an upload: the page with its record, and hidden
/// ones. A release is what the checksums list.
///
/// # Errors
/// When the folder cannot be listed.
pub fn working_files(folder: &Path) -> Result<Vec<String>, CurateError> {
    Ok(checksums::working_files(folder)?)
}

/// Writes statistics, figures, card and checksums of the dataset in `folder`.
///
/// # Errors
/// When the folder holds no dataset, a record of it is missing or malformed, a strict publication leaves something
/// unstated, a foreign or changed file is in the way, or a file cannot be written.
pub fn publish(
    folder: &Path,
    settings: &PublishSettings,
    progress: &dyn Progress,
) -> Result<Statistics, CurateError> {
    let dataset: Dataset = store::read_record(&folder.join(DATASET_FILE))?;
    let _lock = FolderLock::take(folder, progress)?;
    let about = about(folder, settings)?;
    let unstated = statements::unstated(&statements::answers(&about, &dataset)?);
    if settings.is_strict && !unstated.is_empty() {
        let keys = unstated.join(", ");
        let reason = format!("must state {keys}; a file of statements (--about) gives them");
        return Err(CurateError::input(folder, reason));
    }
    let statistics = Statistics::collect(folder, &dataset)?;
    soundness::refuse(folder, &statistics)?;
    let bytes = settings.shard_bytes;
    let shards = bytes.map(|bytes| shards::plan(folder, &statistics, bytes));
    let shards = shards.transpose()?.unwrap_or_default();
    let derived = derived_files(folder, &about, &dataset, &statistics, !shards.is_empty())?;
    let stage = stage(folder);
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
        store::create_folder(&folder.join(TABLES_FOLDER))?;
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

fn stage(folder: &Path) -> StagePlan {
    StagePlan::new(folder, "publish")
}

/// Returns the keys of the statements that the makers of the published dataset in `folder` have not made, and that its
/// records do not give.
///
/// # Errors
/// When the records are missing or malformed.
pub fn unstated(folder: &Path) -> Result<Vec<&'static str>, CurateError> {
    let about: About = store::read_record(&folder.join(ABOUT_FILE))?;
    let dataset: Dataset = store::read_record(&folder.join(DATASET_FILE))?;
    Ok(statements::unstated(&statements::answers(
        &about, &dataset,
    )?))
}

/// Everything that the pages and the metadata of a dataset are written from.
struct Release<'a> {
    about: &'a About,
    dataset: &'a Dataset,
    statistics: &'a Statistics,
    answers: statements::Answers,
    tables: Vec<tables::Table>,
    /// All files of the folder, those of an earlier publication among them.
    files: Vec<String>,
    has_videos: bool,
    has_shards: bool,
}

/// Kind of footage.
struct Footage {
    words: &'static str,
    keywords: &'static [&'static str],
}

impl Release<'_> {
    /// Returns the kind of the footage.
    fn footage(&self) -> Footage {
        let perspective = self.statistics.perspective_sequences;
        if perspective == 0 {
            Footage {
                words: "equirectangular 360-degree video",
                keywords: &["360-degree video", "equirectangular"],
            }
        } else if perspective == self.statistics.rows.len() {
            Footage {
                words: "perspective video",
                keywords: &["perspective video"],
            }
        } else {
            Footage {
                words: "equirectangular 360-degree video and perspective video",
                keywords: &["360-degree video", "equirectangular", "perspective video"],
            }
        }
    }

    /// Returns true if a video's folder, or one in it, has an entry of this name.
    fn has(&self, entry: &str) -> bool {
        let mut files = self.files.iter();
        files.any(|file| file.split('/').skip(2).any(|name| name == entry))
    }

    /// Returns how the sequences were collected, in one sentence.
    fn collection(&self) -> String {
        format!(
            "{} from {} of {}, cut at shot boundaries and sampled by omnilife {}; attrition.csv and \
             funnel.csv give what was left out and why",
            counted(self.statistics.rows.len(), "sequence"),
            self.statistics.curated_videos,
            counted(self.statistics.videos, "video"),
            env!("CARGO_PKG_VERSION")
        )
    }

    /// Returns the work that the tables come from.
    fn activities(&self) -> impl Iterator<Item = &'static str> {
        self.tables.iter().map(|table| table.kind.activity)
    }
}

/// Returns everything that follows from the records: file names with their contents.
fn derived_files(
    folder: &Path,
    about: &About,
    dataset: &Dataset,
    statistics: &Statistics,
    has_shards: bool,
) -> Result<Vec<(String, String)>, CurateError> {
    let mut files = tables::of_videos(folder, statistics)?;
    let release = Release {
        about,
        dataset,
        statistics,
        answers: statements::answers(about, dataset)?,
        tables: tables::collect(folder, statistics)?,
        files: checksums::files(folder)?,
        has_videos: !files.is_empty(),
        has_shards,
    };
    files.push((CARD_FILE.to_owned(), card::card(&release)));
    files.push((DATASHEET_FILE.to_owned(), datasheet::datasheet(&release)));
    files.push((croissant::FILE.to_owned(), croissant::metadata(&release)));
    let tables = release.tables.into_iter();
    files.extend(tables.map(|table| (table.file, table.csv)));
    let mut add =
        |name: &str, content| files.push((format!("{STATISTICS_FOLDER}/{name}"), content));
    add("summary.csv", statistics.summary_csv()?);
    add("distributions.csv", statistics.distributions_csv()?);
    for figure in figures::with_classes(statistics).0 {
        add(figure.file, figures::draw(figure, statistics)?);
    }
    Ok(files)
}

/// The file of [`PublishSettings::about`].
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct AboutFile {
    name: Option<String>,
    licence: Option<String>,
    description: Option<String>,
    statements: Option<Statements>,
}

/// Returns the earlier statements, updated by the new ones.
///
/// # Errors
/// When a file cannot be read, or the licence is not one that [`licence()`] accepts.
fn about(folder: &Path, settings: &PublishSettings) -> Result<About, CurateError> {
    let file: AboutFile =
        (settings.about.as_deref()).map_or_else(|| Ok(AboutFile::default()), toml_file::read)?;
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
    let source = (settings.about.as_deref())
        .filter(|_| file.licence.is_some())
        .unwrap_or(&path);
    let stated = settings.licence.clone().or(file.licence).or(before.licence);
    let stated = stated.map(|text| licence(&text)).transpose();
    Ok(About {
        name: settings.name.clone().or(file.name).unwrap_or(before.name),
        licence: stated
            .map_err(|reason| CurateError::input(source, format!("licence {reason}")))?,
        description: (settings.description.clone())
            .or(file.description)
            .or(before.description),
        statements: file.statements.or(before.statements),
    })
}
