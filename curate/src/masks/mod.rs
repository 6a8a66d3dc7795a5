//! Masks of moving content in a sequence: from files or another program, by class ([`deeplab`]), from motion that the
//! camera's own does not explain ([`residual`]), or by both ([`combined`]).
//!
//! They are written as `dynamic-masks/NNNNNN.png` with a `masks.json`, which
//! `omnilife curate poses --masks` takes. A method is one entry in [`METHODS`]; [`reliability`] has its scores on
//! labelled footage.

mod changes;
pub mod combined;
pub mod deeplab;
mod field;
mod given;
pub mod operator;
mod plane;
pub mod reliability;
pub mod residual;
mod still;
mod vote;

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    camera::ErpCamera,
    elapsed::Stopwatch,
    layout::{DYNAMIC_MASKS_FILE, DYNAMIC_MASKS_FOLDER, SEQUENCE_FILE},
    names, plain_text,
    progress::Progress,
    records::{MaskEntry, Masks, Sequence},
    rgb::Mask,
    stage::StagePlan,
    staging::Staging,
    store,
};

use self::reliability::Target;
use crate::{
    edited_frames::with_edited_frames,
    error::CurateError,
    poses::{self, MaskProgram},
};

/// Folder of the masks of classes, beside the record.
const CLASSES_FOLDER: &str = "classes";
/// Class of what the camera carries.
const OPERATOR_CLASS: &str = "operator";

/// Source of masks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum MaskSource {
    /// Given images, named as the frames; white is moving content.
    Files(PathBuf),
    /// A program that leaves such images.
    Program(MaskProgram),
    /// A method of [`METHODS`].
    Method(String),
}

/// Masks of one frame, at its size.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameMasks {
    /// Everything that moves, of any class.
    pub moving: Mask,
    /// Content of a class, by its name.
    pub classes: BTreeMap<&'static str, Mask>,
}

impl From<Mask> for FrameMasks {
    fn from(moving: Mask) -> Self {
        Self {
            moving,
            classes: BTreeMap::new(),
        }
    }
}

/// Finds the masks of the sequence in a folder.
pub type FindMasks = fn(&Path, &Sequence, &dyn Progress) -> Result<Vec<FrameMasks>, CurateError>;

/// A method of finding moving content.
#[derive(Debug, Clone, Copy)]
pub struct MaskMethod {
    /// Name on the command line.
    pub id: &'static str,
    /// One line.
    pub about: &'static str,
    /// Settings, for the record.
    pub settings: fn() -> String,
    /// Returns the masks of every frame of the sequence in a folder, at frame size.
    pub find: FindMasks,
}

/// All methods. Without a name, the first that reaches its bar is used ([`default_method`]).
pub const METHODS: &[MaskMethod] = &[residual::METHOD, deeplab::METHOD, combined::METHOD];

/// Returns the first method that reaches its bar on labelled footage, which is used without a request.
pub fn default_method() -> Option<&'static MaskMethod> {
    let reaches_bar = |method: &&MaskMethod| reliability::of(method.id, Target::Moving).reaches_bar;
    METHODS.iter().find(reaches_bar)
}

/// Returns the default method, for the sequence in a folder.
///
/// # Errors
/// [`CurateError::Input`] when no method reaches its bar; the line has the score of each and the option that names one.
pub fn require_default_method(folder: &Path) -> Result<&'static MaskMethod, CurateError> {
    default_method().ok_or_else(|| {
        let reason = format!(
            "must be given a method: no detector of moving content reaches its bar, so --method NAME has \
             to take one ({})",
            scores_in_words()
        );
        CurateError::input(folder, reason)
    })
}

/// Returns all methods with their scores on labelled footage, in words.
pub fn scores_in_words() -> String {
    let words = METHODS.iter().map(|method| {
        let reliability = reliability::of(method.id, Target::Moving);
        format!("{}: {}", method.id, reliability.text)
    });
    let words: Vec<String> = words.collect();
    words.join(". ")
}

/// Writes the masks of a sequence; skipped, with a note, if frames and source are unchanged.
///
/// # Errors
/// [`CurateError::Input`] for an unknown method, files that fit no frame and a program that fails,
/// [`CurateError::Store`] when a file cannot be read or written.
pub fn write_masks(
    folder: &Path,
    source: &MaskSource,
    progress: &dyn Progress,
) -> Result<Masks, CurateError> {
    let sequence_path = folder.join(SEQUENCE_FILE);
    let sequence: Sequence = store::read_record(&sequence_path)?;
    let given = match source {
        MaskSource::Files(from) => poses::masks::find(from, &sequence.frames.entries)?,
        MaskSource::Program(_) | MaskSource::Method(_) => Vec::new(),
    };
    let described = SourceDescription::of(source, folder)?;
    let mut plan = StagePlan::new(folder, "masks")
        .with_file(&sequence_path)?
        .with_text("method", &described.method)
        .with_text("settings", &described.settings);
    if !matches!(source, MaskSource::Files(_)) {
        plan = with_edited_frames(plan, (folder, &sequence), progress)?;
    }
    if let MaskSource::Program(program) = source {
        plan = plan.with_text("command", program.text());
    }
    for file in &given {
        plan = plan.with_file(file)?;
    }
    let operator = match source {
        MaskSource::Method(_) => operator::found_mask(folder)?,
        MaskSource::Files(_) | MaskSource::Program(_) => None,
    };
    if let Some(file) = &operator {
        plan = plan.with_file(file)?;
    }
    let out = folder.join(DYNAMIC_MASKS_FOLDER);
    if plan.is_done() {
        progress.note(&format!("{}: masks unchanged, skipped", sequence.id));
        return Ok(store::read_record(&out.join(DYNAMIC_MASKS_FILE))?);
    }
    let started = Stopwatch::with_children();
    let mut found = find(folder, &sequence, source, &given, progress)?;
    if let Some(file) = &operator {
        found.leave_out_operator(&Mask::read(file)?);
    }
    for note in &found.notes {
        progress.note(&format!("{}: {note}", sequence.id));
    }
    let record_file = format!("{DYNAMIC_MASKS_FOLDER}/{DYNAMIC_MASKS_FILE}");
    plan.run([&record_file], progress, |made| {
        made.count_from(started);
        let mut staging = Staging::new(folder, DYNAMIC_MASKS_FOLDER)?;
        let entries = stage(&mut staging, &sequence, &found.frames)?;
        let record = described.record(sequence.id, found.notes, entries);
        made.replace(&staging.folder, &staging.files)?;
        made.write_record(&record_file, &record)?;
        Ok(record)
    })
}

/// Masks of all frames, with lines on assumptions about them.
struct MaskSet {
    frames: Vec<FrameMasks>,
    notes: Vec<String>,
}

impl MaskSet {
    /// Makes what the camera carries a class of its own, which does not count as moving.
    fn leave_out_operator(&mut self, operator: &Mask) {
        for frame in &mut self.frames {
            let moving = &mut frame.moving;
            let operator = operator.resized_to_nearest(moving.width, moving.height);
            *moving = moving.clone().without(&operator);
            frame.classes.insert(OPERATOR_CLASS, operator);
        }
    }
}

fn find(
    folder: &Path,
    sequence: &Sequence,
    source: &MaskSource,
    given: &[PathBuf],
    progress: &dyn Progress,
) -> Result<MaskSet, CurateError> {
    match source {
        MaskSource::Files(_) => given::read(given, sequence),
        MaskSource::Program(program) => {
            let room = Staging::new(folder, "mask-program")?;
            let files = program.run(folder, sequence, &room.folder, progress)?;
            given::read(&files, sequence)
        }
        MaskSource::Method(id) => {
            let method = find_method(id, folder)?;
            Ok(MaskSet {
                frames: (method.find)(folder, sequence, progress)?,
                notes: Vec::new(),
            })
        }
    }
}

/// Writes all masks into a staging folder; returns their entries.
fn stage(
    staging: &mut Staging,
    sequence: &Sequence,
    frames: &[FrameMasks],
) -> Result<Vec<MaskEntry>, CurateError> {
    let share = |mask: &Mask| match sequence.is_pinhole() {
        true => marked_share(mask),
        false => dynamic_share(mask),
    };
    let mut entries = Vec::new();
    for (frame, masks) in sequence.frames.entries.iter().zip(frames) {
        let file = format!("{}.png", stem(&frame.file));
        let path = staging.begin(&format!("{DYNAMIC_MASKS_FOLDER}/{file}"))?;
        masks.moving.write_png(&path)?;
        let mut classes = BTreeMap::new();
        for (&class, mask) in &masks.classes {
            let place = format!("{DYNAMIC_MASKS_FOLDER}/{CLASSES_FOLDER}/{class}/{file}");
            mask.write_png(&staging.begin(&place)?)?;
            classes.insert(class.to_owned(), share(mask));
        }
        entries.push(MaskEntry {
            file,
            dynamic_share: share(&masks.moving),
            classes,
        });
    }
    Ok(entries)
}

fn find_method(id: &str, folder: &Path) -> Result<&'static MaskMethod, CurateError> {
    names::find("mask method", id, METHODS, |method| method.id).map_err(|unknown| {
        let reason = format!("{unknown}; masks of any other program can be given as files");
        CurateError::input(folder, reason)
    })
}

/// Description of a source, for the record.
struct SourceDescription {
    method: String,
    settings: String,
    reliability: Option<String>,
}

impl SourceDescription {
    fn of(source: &MaskSource, folder: &Path) -> Result<Self, CurateError> {
        Ok(match source {
            MaskSource::Files(_) => Self {
                method: "files".to_owned(),
                settings: "as given".to_owned(),
                reliability: None,
            },
            MaskSource::Program(program) => Self {
                method: "command".to_owned(),
                settings: plain_text::without_folders(program.text()),
                reliability: None,
            },
            MaskSource::Method(id) => Self {
                method: id.clone(),
                settings: (find_method(id, folder)?.settings)(),
                reliability: Some(reliability::of(id, Target::Moving).text),
            },
        })
    }

    fn record(self, sequence: String, notes: Vec<String>, frames: Vec<MaskEntry>) -> Masks {
        Masks {
            sequence,
            method: self.method,
            settings: [vec![self.settings], notes].concat().join("; "),
            reliability: self.reliability,
            frames,
        }
    }
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
    let camera = ErpCamera::new(mask.width as u32, mask.height as u32);
    mask.marked_share(&camera.into())
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::{Classified, ErrorKind};

    use super::*;

    #[test]
    fn without_a_reliable_method_one_has_to_be_named() {
        match require_default_method(Path::new("seq-000")) {
            Ok(method) => assert!(reliability::of(method.id, Target::Moving).reaches_bar),
            Err(error) => {
                assert_eq!(error.error_kind(), ErrorKind::User);
                let line = error.to_string();
                assert!(
                    line.starts_with("seq-000: ") && line.contains("--method"),
                    "{line}"
                );
                assert!(!line.contains('\n'), "{line}");
                for method in METHODS {
                    let score = reliability::of(method.id, Target::Moving).text;
                    assert!(line.contains(&format!("{}: {score}", method.id)), "{line}");
                }
            }
        }
    }

    #[test]
    fn what_the_camera_carries_does_not_move() {
        let mask = |data: [u8; 4]| Mask::new(4, 1, data.to_vec());
        let mut found = MaskSet {
            frames: vec![mask([255, 255, 0, 0]).into()],
            notes: Vec::new(),
        };
        found.leave_out_operator(&mask([0, 255, 255, 0]));
        assert_eq!(found.frames[0].moving, mask([255, 0, 0, 0]));
        assert_eq!(found.frames[0].classes["operator"], mask([0, 255, 255, 0]));
    }
}
