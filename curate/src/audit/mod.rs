//! The audit page: one self-contained HTML file on which a person plays a small copy of a video, marks boundaries and
//! segments, and labels segments by the taxonomy. An expert also accepts, rejects and moves proposals.
//!
//! The page needs no network and saves an [`AuditDecisions`] file, which `ledger::merge` takes. Its script is in
//! `page/`; its data is one JSON object in the page, see `PageData`. [`indoor_outdoor`] suggests passages between
//! indoors and outdoors: no suggestion enters a ledger before a person accepts it.

mod filmstrip;
mod look;
mod proxy;

use std::path::Path;

use omnilife_schemas::{
    ownership::refuse_another_kind,
    progress::Progress,
    records::{
        AuditDecisions, Author, Boundary, BoundaryKind, PersonRole, SegmentLabel, SourceVideo,
        Taxonomy,
    },
    store::{self, Record},
};
use serde::Serialize;

use crate::{
    annotation::taxonomy,
    boundaries::indoor_outdoor,
    error::CurateError,
    ledger::{Candidate, Evidence, candidates, labels, resolve::MERGE_SECONDS},
};
use filmstrip::Filmstrips;
use look::{DecodeInputs, PageImages};
pub use proxy::EMBEDDED_BYTES;
use proxy::Proxy;

/// The script, in order.
const SCRIPT: [&str; 5] = [
    include_str!("page/state.js"),
    include_str!("page/player.js"),
    include_str!("page/boundaries.js"),
    include_str!("page/labels.js"),
    include_str!("page/main.js"),
];

/// Input of a page.
#[derive(Debug, Clone)]
pub struct PageRequest<'a> {
    /// Folder of a curated video.
    pub folder: &'a Path,
    /// The video it was curated from.
    pub video: &'a Path,
    /// The page to write.
    pub page: &'a Path,
    /// Taxonomy file; the built-in one where none is given.
    pub taxonomy: Option<&'a Path>,
    /// A small video of more bytes than this is written beside the page: [`EMBEDDED_BYTES`].
    pub embedded_bytes: u64,
}

#[derive(Serialize)]
struct PageData<'a> {
    /// Schema of the file that the page saves.
    schema: &'static str,
    source: &'a SourceVideo,
    /// Timestamps of all frames, seconds.
    times: &'a [f64],
    /// End of the last frame.
    end_seconds: f64,
    kinds: [&'static str; 4],
    roles: [PersonRole; 2],
    taxonomy: &'a Taxonomy,
    candidates: &'a [Candidate],
    suggestions: Vec<Suggestion>,
    labels: Vec<SegmentLabelEntry<'a>>,
    /// Frames around each candidate, in the order of the candidates.
    filmstrips: Vec<Vec<Image>>,
    /// Frames spread over the video.
    overview: Vec<Image>,
    /// Path of the small video beside the page, unless it is embedded.
    proxy_file: Option<String>,
}

/// A boundary that no ledger holds.
#[derive(Serialize)]
struct Suggestion {
    author: Author,
    boundary: Boundary,
}

/// A label of the ledger.
#[derive(Serialize)]
struct SegmentLabelEntry<'a> {
    author: &'a Author,
    label: &'a SegmentLabel,
}

/// A small image of a frame.
#[derive(Debug, Clone, Serialize)]
struct Image {
    frame: usize,
    /// JPEG as a data URL.
    url: String,
}

/// Writes the audit page of a curated video and returns the number of boundaries on it.
///
/// # Errors
/// When the folder holds no curated video, `video` differs from the file it was curated from, or the page or its small
/// video cannot be written.
pub fn write_page(
    request: &PageRequest<'_>,
    progress: &dyn Progress,
) -> Result<usize, CurateError> {
    let PageRequest {
        folder,
        video,
        page,
        ..
    } = *request;
    let template = include_str!("page/page.html");
    let first_line = template.lines().next().unwrap_or_default();
    refuse_another_kind(page, first_line.as_bytes())?;
    let taxonomy = taxonomy::load(request.taxonomy)?;
    let evidence = Evidence::read(folder)?;
    refuse_other_video(video, &evidence.analysis.source, folder, progress)?;
    let ledger = evidence.ledger(folder)?;
    // The page refers to lines of the ledger, so they have to be on disk.
    ledger.write()?;
    let candidates = candidates(ledger.entries(), MERGE_SECONDS);
    let times = &evidence.signals.times;
    let PageImages {
        filmstrips,
        overview,
        proxy,
        suggestions,
    } = DecodeInputs {
        video,
        page,
        analysis: &evidence.analysis,
        times,
        strips: &Filmstrips::plan(times, &candidates),
        embedded_bytes: request.embedded_bytes,
    }
    .look(progress)?;
    let (embedded, proxy_file) = match proxy {
        Proxy::Embedded(base64) => (base64, None),
        Proxy::Beside { file, bytes } => {
            progress.note(&format!(
                "{}: its video ({:.0} MB) is too large to stand in the page and lies in {file}; \
                 keep both together",
                page.display(),
                bytes as f64 / 1e6
            ));
            (String::new(), Some(file))
        }
    };
    let author = Author::Detector(indoor_outdoor::DETECTOR.author_name());
    let data = PageData {
        schema: AuditDecisions::SCHEMA,
        source: &evidence.analysis.source,
        times,
        end_seconds: evidence.analysis.range.end_seconds,
        kinds: BoundaryKind::ALL.map(BoundaryKind::name),
        roles: [PersonRole::Expert, PersonRole::Annotator],
        taxonomy: &taxonomy,
        candidates: &candidates,
        suggestions: suggestions
            .into_iter()
            .map(|boundary| Suggestion {
                author: author.clone(),
                boundary,
            })
            .collect(),
        labels: labels::all(ledger.entries())
            .map(|(author, label)| SegmentLabelEntry { author, label })
            .collect(),
        filmstrips,
        overview,
        proxy_file,
    };
    let json = serde_json::to_string(&data).map_err(|error| CurateError::internal(page, error))?;
    // Inside a script element only `<` could end it early.
    let json = json.replace('<', "\\u003c");
    let html = template
        .replace("/*STYLE*/", include_str!("page/page.css"))
        .replace("/*SCRIPT*/", &SCRIPT.concat())
        .replace("/*PROXY*/", &embedded)
        .replace("/*DATA*/", &json);
    store::write_bytes(page, html.as_bytes())?;
    Ok(candidates.len())
}

fn refuse_other_video(
    video: &Path,
    source: &SourceVideo,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<(), CurateError> {
    progress.begin("hashing", None);
    let sha256 = store::sha256_file(video);
    progress.end();
    if sha256? == source.sha256 {
        return Ok(());
    }
    let reason = format!(
        "is not {}, from which {} was curated",
        source.file_name,
        folder.display()
    );
    Err(CurateError::input(video, reason))
}
