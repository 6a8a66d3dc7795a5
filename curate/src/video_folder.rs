//! The folder of one curated video.

use std::path::Path;

use omnilife_schemas::{
    layout::{ANALYSIS_FILE, SAMPLES_FILE, SIGNALS_FILE, SIGNATURE_FILE},
    records::{SourceVideo, VideoAnalysis},
    store,
};

use crate::error::CurateError;

/// Creates the folder, or checks that an existing one belongs to this video.
pub(crate) fn claim(video: &Path, folder: &Path, source: &SourceVideo) -> Result<(), CurateError> {
    let refuse = |reason: String| Err(CurateError::input(folder, reason));
    if folder.is_file() {
        return refuse("is a file; the output needs a folder".to_owned());
    }
    let record = folder.join(ANALYSIS_FILE);
    if record.is_file() {
        let held: VideoAnalysis = store::read_record(&record)?;
        if held.source.sha256 != source.sha256 {
            return refuse(format!(
                "holds another input ({}, sha256 {:.12}); remove it or choose another output for {}",
                held.source.file_name,
                held.source.sha256,
                video.display()
            ));
        }
    } else if folder.is_dir() {
        let is_foreign = |name: &String| !is_ours_before_analysis(name);
        if store::names_in(folder)?.iter().any(is_foreign) {
            return refuse("is not empty and holds no curated video".to_owned());
        }
    }
    Ok(store::create_folder(folder)?)
}

/// Outputs of the analysis.
pub(crate) const ANALYSIS_FILES: [&str; 4] =
    [ANALYSIS_FILE, SIGNALS_FILE, SAMPLES_FILE, SIGNATURE_FILE];

/// Returns true for a name that an interrupted analysis may leave: done-records, temporary files and its
/// tables, which it writes before its record.
fn is_ours_before_analysis(name: &str) -> bool {
    name.starts_with('.') || (name != ANALYSIS_FILE && ANALYSIS_FILES.contains(&name))
}

/// Returns the length of a video's frames if decoded into `folder`, else the header's duration.
pub(crate) fn duration_seconds(video: &Path, folder: &Path) -> Option<f64> {
    store::read_record::<VideoAnalysis>(&folder.join(ANALYSIS_FILE))
        .map(|analysis| analysis.range.duration_seconds())
        .ok()
        .or_else(|| {
            let probe = omnilife_video::probe(video).ok()?;
            (probe.duration_seconds > 0.0).then_some(probe.duration_seconds)
        })
}
