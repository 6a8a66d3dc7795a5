//! A curated video's ledger: creation, merging of files, and its use in curation.

use std::{fs, path::Path};

use omnilife_schemas::{
    layout::{ANALYSIS_FILE, LEDGER_FILE, SIGNALS_FILE},
    progress::Progress,
    records::{AuditDecisions, Author, VideoAnalysis},
    store::{self, Record, StoreError},
};

use super::{
    Ledger,
    formats::{self, Frames},
    resolve,
};
use crate::{
    boundaries::{self, Signals},
    error::CurateError,
};

/// Role of an author.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// A program.
    Detector,
    /// A person who annotates.
    Annotator,
    /// A person who audits.
    Expert,
}

impl Role {
    /// Returns the author of this name in this role.
    pub fn author(self, name: &str) -> Author {
        match self {
            Self::Detector => Author::Detector(name.to_owned()),
            Self::Annotator => Author::Annotator(name.to_owned()),
            Self::Expert => Author::Expert(name.to_owned()),
        }
    }
}

/// Origin of merged boundary files.
#[derive(Debug, Clone)]
pub struct MergeRequest {
    /// The author.
    pub author: Author,
    /// Time of the statement (RFC 3339).
    pub time: Option<String>,
    /// Reason.
    pub reason: Option<String>,
}

/// Results of curation for a video: the base of its ledger.
#[derive(Debug, Clone)]
pub struct Evidence {
    /// The analysis.
    pub analysis: VideoAnalysis,
    /// The detector's signals with the timestamps of all frames.
    pub signals: Signals,
}

impl Evidence {
    /// Reads the folder of a curated video.
    ///
    /// # Errors
    /// When there is no `analysis.json` with its signals.
    pub fn read(folder: &Path) -> Result<Self, CurateError> {
        let analysis: VideoAnalysis = store::read_record(&folder.join(ANALYSIS_FILE))?;
        let signals = Signals::read_parquet(&folder.join(SIGNALS_FILE))?;
        Ok(Self { analysis, signals })
    }

    /// Returns the timestamps of all frames.
    pub fn frames(&self) -> Frames<'_> {
        Frames {
            times: &self.signals.times,
            video: &self.analysis.source.file_name,
        }
    }

    /// Returns the ledger of the video; if it has none yet, a new one with the detector's boundaries, in memory alone.
    ///
    /// # Errors
    /// When the ledger is damaged or about another video.
    pub fn ledger(&self, folder: &Path) -> Result<Ledger, CurateError> {
        let path = folder.join(LEDGER_FILE);
        let source = &self.analysis.source;
        let mut ledger = if path.is_file() {
            let ledger = Ledger::read(&path)?;
            if ledger.source().sha256 != source.sha256 {
                return Err(CurateError::input(
                    &path,
                    format!(
                        "is the ledger of another video ({}, sha256 {:.12})",
                        ledger.source().file_name,
                        ledger.source().sha256
                    ),
                ));
            }
            ledger
        } else {
            Ledger::open_new(&path, source.clone(), self.analysis.range)?
        };
        if let Some((detector, found)) = boundaries::detected(&self.signals) {
            let author = Author::Detector(detector.author_name());
            ledger.propose(&author, None, None, found)?;
        }
        Ok(ledger)
    }
}

/// Merges files into the ledger of a curated video: boundaries in any of the [`formats`] by the author of the request,
/// or decisions of an audit page, which names its author itself. All files or none are merged.
///
/// # Errors
/// [`CurateError::Input`] that names the file, for boundaries outside the video, overlapping ones,
/// unreadable formats, and decisions about another video.
pub fn merge(
    folder: &Path,
    files: &[std::path::PathBuf],
    request: Option<&MergeRequest>,
    progress: &dyn Progress,
) -> Result<Ledger, CurateError> {
    let evidence = Evidence::read(folder)?;
    let mut ledger = evidence.ledger(folder)?;
    for path in files {
        let text = fs::read_to_string(path).map_err(|source| StoreError::read(path, source))?;
        let refused = |error: CurateError| match error {
            CurateError::Input { reason, .. } => CurateError::input(path, reason),
            other => other,
        };
        let added = if text.contains(AuditDecisions::SCHEMA) {
            let audit: AuditDecisions = store::read_record(path)?;
            ledger.decide(&audit).map_err(refused)?
        } else {
            let found = formats::read_any(&text, &evidence.frames())
                .map_err(|reason| CurateError::input(path, reason))?;
            let request = request.ok_or_else(|| {
                CurateError::input(path, "says nothing of its author; name one with --author")
            })?;
            let (time, reason) = (request.time.as_deref(), request.reason.as_deref());
            ledger
                .propose(&request.author, time, reason, found)
                .map_err(refused)?
        };
        progress.note(&format!("{}: {added} new lines", path.display()));
    }
    ledger.write()?;
    Ok(ledger)
}

/// Returns the boundaries in force of a curated video, in the format with this id.
///
/// # Errors
/// [`CurateError::Input`] if the format is unknown or cannot express them.
pub fn export(folder: &Path, format: &str) -> Result<String, CurateError> {
    let refused = |reason: String| CurateError::input(folder, reason);
    let format = formats::format(format).map_err(refused)?;
    let evidence = Evidence::read(folder)?;
    let ledger = evidence.ledger(folder)?;
    (format.write)(&resolve(ledger.entries()), &evidence.frames()).map_err(refused)
}

/// Returns the ledger of a video; `None` if the folder has none.
///
/// # Errors
/// When the ledger is damaged or about another video.
pub fn of_video(folder: &Path, source_sha256: &str) -> Result<Option<Ledger>, CurateError> {
    let path = folder.join(LEDGER_FILE);
    if !path.is_file() {
        return Ok(None);
    }
    let ledger = Ledger::read(&path)?;
    if ledger.source().sha256 != source_sha256 {
        return Err(CurateError::input(&path, "is the ledger of another video"));
    }
    Ok(Some(ledger))
}
