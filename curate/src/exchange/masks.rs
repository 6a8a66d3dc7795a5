//! Masks in exports: moving content, and pixels outside the scene.
//!
//! Most formats know a single kind of mask, for pixels to ignore, and get both in it. Pixels outside the scene are also
//! marked in a folder of their own, under the names of the images, so that an import restores them.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    layout::IGNORE_MASKS_FOLDER,
    mask_file::MarkedGreys,
    mask_survey::MaskSurvey,
    object_regions::{Region, RegionSource},
    rgb::Mask,
    store::{self, StoreError},
};

use super::{ExportFrame, ExportScene, ForeignMask};
use crate::error::CurateError;

impl ExportFrame {
    /// Returns true if anything is hidden from methods that know one kind of masks.
    pub(super) fn is_masked(&self) -> bool {
        self.mask.is_some() || self.ignore_mask.is_some()
    }

    /// Marks moving content and pixels outside the scene; `None` without masks.
    fn hidden(&self) -> Result<Option<Mask>, CurateError> {
        let mut hidden: Option<Mask> = None;
        for file in self.mask.iter().chain(&self.ignore_mask) {
            let mask = Mask::read(file)?;
            hidden = Some(match hidden {
                Some(other) => other.united(&mask),
                None => mask,
            });
        }
        Ok(hidden)
    }
}

/// Gives frames without a mask of moving content the union of their objects, which is written into a folder.
///
/// # Errors
/// When a mask cannot be read or written.
pub(super) fn unite_objects(scene: &mut ExportScene, folder: &Path) -> Result<(), CurateError> {
    let ExportScene {
        source: Some(source),
        frames,
        camera,
        ..
    } = scene
    else {
        return Ok(());
    };
    let named = source.record.frames.iter();
    let named: BTreeMap<String, _> = named
        .map(|frame| (super::file_name(&frame.image), frame))
        .collect();
    for frame in frames {
        let moving = named
            .get(&frame.name)
            .and_then(|of_record| Region::Moving.source(&source.record, of_record));
        let Some(objects @ RegionSource::Objects(_)) = moving else {
            continue;
        };
        let read = |file: &str| Mask::read(&source.folder.join(file));
        let union = objects.mask(camera, camera.size(), read)?;
        if union.marks_anything() {
            let file = folder.join(format!("{}.png", super::stem(&frame.name)));
            super::create_parent(&file)?;
            union.write_png(&file)?;
            frame.mask = Some(file);
        }
    }
    Ok(())
}

/// Returns notes on assumptions about the masks of a scene.
pub(super) fn notes(scene: &ExportScene) -> Result<Vec<String>, StoreError> {
    let mut survey = MaskSurvey::default();
    for frame in &scene.frames {
        for file in frame.mask.iter().chain(&frame.ignore_mask) {
            survey.add(file, &scene.camera, MarkedGreys::AboveHalf)?;
        }
    }
    Ok(survey.notes())
}

/// Writes the masks of a scene with moving content and pixels outside the scene in black, for tools whose masks mark
/// pixels to use. `name` gives the file name of a frame's mask.
pub(super) fn write_black_masks(
    scene: &ExportScene,
    folder: &Path,
    name: impl Fn(&str) -> String,
) -> Result<(), CurateError> {
    for frame in &scene.frames {
        if let Some(mask) = frame.hidden()? {
            write_mask(&mask.inverted(), &folder.join(name(&frame.name)))?;
        }
    }
    Ok(())
}

/// Writes white masks for the frames that hide nothing, for tools that need masks of all frames or none. Nothing is
/// written if no frame hides anything; returns true if one does.
pub(super) fn write_white_masks(
    scene: &ExportScene,
    folder: &Path,
    name: impl Fn(&str) -> String,
) -> Result<bool, CurateError> {
    if !scene.frames.iter().any(ExportFrame::is_masked) {
        return Ok(false);
    }
    let [width, height] = scene.camera.size();
    let white = Mask {
        width,
        height,
        data: vec![u8::MAX; width * height],
    };
    for frame in scene.frames.iter().filter(|frame| !frame.is_masked()) {
        write_mask(&white, &folder.join(name(&frame.name)))?;
    }
    Ok(true)
}

fn write_mask(mask: &Mask, path: &Path) -> Result<(), CurateError> {
    super::refuse_second(path)?;
    super::create_parent(path)?;
    Ok(mask.write_png(path)?)
}

/// Copies the mask of pixels outside the scene (white) to its place for an image of this name, whatever the format: an
/// import finds it there.
pub(super) fn copy_ignore_mask(
    frame: &ExportFrame,
    name: &str,
    out: &Path,
) -> Result<(), StoreError> {
    let Some(mask) = &frame.ignore_mask else {
        return Ok(());
    };
    let path = ignore_mask_path(out, name);
    super::create_parent(&path)?;
    store::copy_atomically(mask, &path)
}

/// Returns the path of a frame's mask of ignored pixels, by the frame's name.
pub(super) fn ignore_mask_path(folder: &Path, name: &str) -> PathBuf {
    folder
        .join(IGNORE_MASKS_FOLDER)
        .join(format!("{}.png", super::stem(name)))
}

/// Returns the mask in `folder` of the frame with this name, if there is one.
pub(super) fn black_mask(folder: &Path, name: &str) -> Option<ForeignMask> {
    let file = folder.join(name);
    file.is_file().then_some(ForeignMask {
        file,
        black_is_dynamic: true,
    })
}
