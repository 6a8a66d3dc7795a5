//! The audit page: one self-contained HTML file on which an expert sees the frames around each
//! boundary of a video and accepts, rejects, moves or adds.
//!
//! The page needs no network and saves an [`AuditDecisions`]
//! file, which `ledger::merge` takes. Its script is `page.js`; what it shows is in one JSON object
//! in the page, see `PageData`.

mod filmstrip;

use std::path::Path;

use omnilife_schemas::{
    ownership::refuse_another_kind,
    progress::Progress,
    records::{AuditDecisions, BoundaryKind, SourceVideo},
    store::{self, Record},
};
use serde::Serialize;

use crate::{
    error::CurateError,
    ledger::{Candidate, Evidence, candidates, resolve::MERGE_SECONDS},
};
use filmstrip::Filmstrips;

/// What the page shows.
#[derive(Serialize)]
struct PageData<'a> {
    /// Schema of the file that the page saves.
    schema: &'static str,
    source: &'a SourceVideo,
    /// Timestamps of all frames, seconds.
    times: &'a [f64],
    kinds: [&'static str; 4],
    candidates: &'a [Candidate],
    /// Frames around each candidate, in the order of the candidates.
    filmstrips: Vec<Vec<Image>>,
    /// Frames spread over the video.
    overview: Vec<Image>,
}

/// A small image of a frame.
#[derive(Debug, Clone, Serialize)]
struct Image {
    /// Index of the frame.
    frame: usize,
    /// JPEG as a data URL.
    url: String,
}

/// Writes the audit page of a curated video and returns the number of boundaries on it.
///
/// # Errors
/// When the folder holds no curated video, `video` is another file than the one it was curated
/// from, or the page cannot be written.
pub fn write_page(
    folder: &Path,
    video: &Path,
    page: &Path,
    progress: &dyn Progress,
) -> Result<usize, CurateError> {
    let template = include_str!("page.html");
    let first_line = template.lines().next().unwrap_or_default();
    refuse_another_kind(page, first_line.as_bytes())?;
    let evidence = Evidence::read(folder)?;
    let source = &evidence.analysis.source;
    progress.begin("hashing", None);
    let sha256 = store::sha256_file(video);
    progress.end();
    if sha256? != source.sha256 {
        return Err(CurateError::input(
            video,
            format!(
                "is not {}, from which {} was curated",
                source.file_name,
                folder.display()
            ),
        ));
    }
    let ledger = evidence.ledger(folder)?;
    // The page refers to lines of the ledger, so they have to be on disk.
    ledger.write()?;
    let candidates = candidates(ledger.entries(), MERGE_SECONDS);
    let strips = Filmstrips::plan(&evidence.signals.times, &candidates);
    let (filmstrips, overview) = strips.draw(video, &evidence.analysis.probe, progress)?;
    let data = PageData {
        schema: AuditDecisions::SCHEMA,
        source,
        times: &evidence.signals.times,
        kinds: BoundaryKind::ALL.map(BoundaryKind::name),
        candidates: &candidates,
        filmstrips,
        overview,
    };
    let json = serde_json::to_string(&data).map_err(|error| CurateError::internal(page, error))?;
    // Inside a script element only this could end it early.
    let json = json.replace('<', "\\u003c");
    let html = template
        .replace("/*STYLE*/", include_str!("page.css"))
        .replace("/*SCRIPT*/", include_str!("page.js"))
        .replace("/*DATA*/", &json);
    store::write_bytes(page, html.as_bytes())?;
    Ok(candidates.len())
}
