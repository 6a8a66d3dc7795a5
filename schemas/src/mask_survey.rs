//! Oddities of masks, looked for before they are relied on: encodings that leave something to assume, masks of
//! what is no part of a scene that mark most of it, or nothing.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use crate::{
    camera::Camera,
    image_file::ImageFile,
    mask_file::{self, DecodedMask, MarkedGreys, MaskEncoding},
    plain_text,
    statistics::median,
    store::StoreError,
};

/// Share of the sphere above which masks look as if they marked the rest.
pub const INVERTED_SHARE: f64 = 0.6;

/// Masks that were looked at.
#[derive(Debug, Default)]
pub struct MaskSurvey {
    /// Share of the sphere that each file marks.
    shares: BTreeMap<PathBuf, f64>,
    /// Files of each encoding that something was assumed of.
    assumed: BTreeMap<MaskEncoding, Vec<PathBuf>>,
    /// Share that each frame's ignore mask marks.
    ignored_shares: Vec<f64>,
}

impl MaskSurvey {
    /// Looks at a mask of frames that `camera` took; at each file once. Returns the share that it marks, as
    /// [`Mask::marked_share`](crate::rgb::Mask::marked_share).
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn add(
        &mut self,
        file: &Path,
        camera: &Camera,
        greys: MarkedGreys,
    ) -> Result<f64, StoreError> {
        if let Some(&share) = self.shares.get(file) {
            return Ok(share);
        }
        let DecodedMask { mask, encoding } = mask_file::decode(ImageFile::open(file)?, greys)?;
        let share = mask.marked_share(camera);
        self.shares.insert(file.to_owned(), share);
        if encoding.assumption().is_some() {
            let files = self.assumed.entry(encoding).or_default();
            files.push(file.to_owned());
        }
        Ok(share)
    }

    /// Looks at a frame's mask of what is no part of the scene.
    ///
    /// # Errors
    /// Those of [`MaskSurvey::add`].
    pub fn add_ignored(&mut self, file: &Path, camera: &Camera) -> Result<(), StoreError> {
        let share = self.add(file, camera, MarkedGreys::AboveHalf)?;
        self.add_ignored_share(share);
        Ok(())
    }

    /// Counts a frame of which a mask marks this share as no part of the scene.
    pub fn add_ignored_share(&mut self, share: f64) {
        self.ignored_shares.push(share);
    }

    /// Lines that a user should see, and a reader of results. They name files without the folders above that of
    /// the mask, so that they do not depend on where a scene lies.
    pub fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        for (encoding, files) in &self.assumed {
            if let Some(assumption) = encoding.assumption() {
                let files: Vec<String> = files.iter().map(|file| short_name(file)).collect();
                notes.push(format!(
                    "{} masks are read {assumption}: {}",
                    files.len(),
                    plain_text::first_of(&files)
                ));
            }
        }
        let frames = self.ignored_shares.len();
        let empty = self.ignored_shares.iter().filter(|&&share| share == 0.0);
        let empty = empty.count();
        if empty > 0 {
            notes.push(format!(
                "{empty} of {frames} masks of what is no part of the scene mark nothing"
            ));
        }
        if let Some(share) = median(&self.ignored_shares).filter(|&share| share > INVERTED_SHARE) {
            notes.push(format!(
                "what is no part of the scene is {:.0} % of the sphere (median of {frames} frames): is its mask \
                 inverted? It is white where nothing is to be learned or scored",
                100.0 * share
            ));
        }
        notes
    }
}

/// A file with the folder that it lies in.
fn short_name(file: &Path) -> String {
    let name = |path: &Path| {
        let name = path.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    };
    match file.parent().map(name) {
        Some(folder) if !folder.is_empty() => format!("{folder}/{}", name(file)),
        _ => name(file),
    }
}
