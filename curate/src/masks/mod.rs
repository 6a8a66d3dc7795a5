//! Masks of moving content in a sequence: from files, by class ([`deeplab`]), or from motion that the camera's own does
//! not explain ([`residual`]).
//!
//! They are written as `dynamic-masks/NNNNNN.png` with a `masks.json`, which
//! `omnilife curate poses --masks` takes. A method is one entry in [`METHODS`].

pub mod deeplab;
mod field;
pub mod residual;

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    camera::ErpCamera,
    elapsed::Stopwatch,
    layout::{DYNAMIC_MASKS_FILE, DYNAMIC_MASKS_FOLDER, SEQUENCE_FILE},
    mask_file::MarkedGreys,
    mask_survey::MaskSurvey,
    names,
    progress::Progress,
    records::{MaskEntry, Masks, Sequence},
    rgb::Mask,
    stage::StagePlan,
    staging::Staging,
    store,
};

use crate::{error::CurateError, poses};

/// Source of masks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum MaskSource {
    /// Given images, named as the frames; white is moving content.
    Files(PathBuf),
    /// A method of [`METHODS`].
    Method(String),
}

/// Finds the masks of the sequence in a folder.
pub type FindMasks = fn(&Path, &Sequence, &dyn Progress) -> Result<Vec<Mask>, CurateError>;

/// A method of finding moving content.
#[derive(Debug, Clone, Copy)]
pub struct MaskMethod {
    /// Name on the command line.
    pub id: &'static str,
    /// One line.
    pub about: &'static str,
    /// Settings, for the record.
    pub settings: fn() -> String,
    /// Returns one mask per frame of the sequence in a folder, at frame size.
    pub find: FindMasks,
}

/// All methods, the default one first.
pub const METHODS: &[MaskMethod] = &[residual::METHOD, deeplab::METHOD];

/// Writes the masks of a sequence; skipped, with a note, if frames and source are unchanged.
///
/// # Errors
/// [`CurateError::Input`] for an unknown method and for files that fit no frame, [`CurateError::Store`] when a file
/// cannot be read or written.
pub fn write_masks(
    folder: &Path,
    source: &MaskSource,
    progress: &dyn Progress,
) -> Result<Masks, CurateError> {
    let sequence_path = folder.join(SEQUENCE_FILE);
    let sequence: Sequence = store::read_record(&sequence_path)?;
    let files = match source {
        MaskSource::Files(from) => Some(poses::masks::find(from, &sequence.frames.entries)?),
        MaskSource::Method(_) => None,
    };
    let (method, settings) = describe(source, folder)?;
    let mut plan = StagePlan::new(folder, "masks")
        .with_file(&sequence_path)?
        .with_text("method", &method)
        .with_text("settings", &settings);
    for file in files.iter().flatten() {
        plan = plan.with_file(file)?;
    }
    let out = folder.join(DYNAMIC_MASKS_FOLDER);
    if plan.is_done() {
        progress.note(&format!("{}: masks unchanged, skipped", sequence.id));
        return Ok(store::read_record(&out.join(DYNAMIC_MASKS_FILE))?);
    }
    let started = Stopwatch::with_children();
    let masks = match (&files, source) {
        (Some(files), _) => read_masks(files, &sequence)?,
        (None, MaskSource::Method(id)) if sequence.is_pinhole() => {
            let reason = format!(
                "is of a pinhole, and {id} looks at whole spheres; masks of any other program can be \
                 given as files"
            );
            return Err(CurateError::input(&sequence_path, reason));
        }
        (None, MaskSource::Method(id)) => {
            (find_method(id, folder)?.find)(folder, &sequence, progress)?
        }
        (None, MaskSource::Files(_)) => Vec::new(),
    };
    let notes = notes(files.as_deref().unwrap_or_default(), &sequence)?;
    for note in &notes {
        progress.note(&format!("{}: {note}", sequence.id));
    }
    let record_file = format!("{DYNAMIC_MASKS_FOLDER}/{DYNAMIC_MASKS_FILE}");
    plan.run([&record_file], progress, |made| {
        made.count_from(started);
        let mut staging = Staging::new(folder, DYNAMIC_MASKS_FOLDER)?;
        let mut entries = Vec::new();
        for (frame, mask) in sequence.frames.entries.iter().zip(&masks) {
            let file = format!("{}.png", stem(&frame.file));
            mask.write_png(&staging.begin(&format!("{DYNAMIC_MASKS_FOLDER}/{file}"))?)?;
            entries.push(MaskEntry {
                file,
                dynamic_share: if sequence.is_pinhole() {
                    marked_share(mask)
                } else {
                    dynamic_share(mask)
                },
            });
        }
        let record = Masks {
            sequence: sequence.id,
            method,
            settings: [vec![settings], notes].concat().join("; "),
            frames: entries,
        };
        made.replace(&staging.folder, &staging.files)?;
        made.write_record(&record_file, &record)?;
        Ok(record)
    })
}

fn find_method(id: &str, folder: &Path) -> Result<&'static MaskMethod, CurateError> {
    names::find("mask method", id, METHODS, |method| method.id).map_err(|unknown| {
        let reason = format!("{unknown}; masks of any other program can be given as files");
        CurateError::input(folder, reason)
    })
}

fn describe(source: &MaskSource, folder: &Path) -> Result<(String, String), CurateError> {
    Ok(match source {
        MaskSource::Files(_) => ("files".to_owned(), "as given".to_owned()),
        MaskSource::Method(id) => (id.clone(), (find_method(id, folder)?.settings)()),
    })
}

fn read_masks(files: &[PathBuf], sequence: &Sequence) -> Result<Vec<Mask>, CurateError> {
    let size = (
        sequence.frames.width as usize,
        sequence.frames.height as usize,
    );
    files
        .iter()
        .map(|file| {
            let mask = Mask::read(file)?;
            // Another aspect ratio means another projection, or another frame.
            if mask.width * size.1 != mask.height * size.0 {
                return Err(CurateError::input(file, "has not the shape of its frame"));
            }
            Ok(mask.resized_to_nearest(size.0, size.1))
        })
        .collect()
}

/// Returns lines on assumptions about given masks, and on masks of no frame.
fn notes(files: &[PathBuf], sequence: &Sequence) -> Result<Vec<String>, CurateError> {
    let camera = ErpCamera {
        width: sequence.frames.width,
        height: sequence.frames.height,
    };
    let mut survey = MaskSurvey::default();
    for file in files {
        survey.add(file, &camera.into(), MarkedGreys::AboveHalf)?;
    }
    let mut notes = survey.notes();
    let files: Vec<&Path> = files.iter().map(PathBuf::as_path).collect();
    notes.extend(poses::masks::surplus(&files, "masks")?);
    Ok(notes)
}

fn stem(file: &str) -> String {
    let stem = Path::new(file).file_stem().unwrap_or_default();
    stem.to_string_lossy().into_owned()
}

/// Returns the share of the pixels of an image that a mask marks.
fn marked_share(mask: &Mask) -> f64 {
    let marked = mask.data.iter().filter(|&&pixel| pixel != 0).count();
    marked as f64 / mask.data.len().max(1) as f64
}

/// Returns the share of the sphere that a mask covers: every pixel counts by its solid angle.
pub fn dynamic_share(mask: &Mask) -> f64 {
    let camera = ErpCamera {
        width: mask.width as u32,
        height: mask.height as u32,
    };
    mask.marked_share(&camera.into())
}
