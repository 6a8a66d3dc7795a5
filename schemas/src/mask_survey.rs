//! Oddities of masks, checked before their use: encodings that need an assumption, masks that mark most of a scene, and
//! masks of the ignored region that mark nothing.

use std::{
    collections::{BTreeMap, BTreeSet},
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

/// Share of the sphere above which masks look inverted.
pub const INVERTED_SHARE: f64 = 0.6;

/// Masks in notes on all of them.
const MOVING: &str = "masks of moving content";
const IGNORED: &str = "ignored regions are";

fn of_class(class: &str) -> String {
    format!("masks of {class}")
}

/// Returns true for a note on all masks of moving content, which new masks make outdated.
pub fn is_of_moving(note: &str) -> bool {
    // The second is that of older records.
    note.starts_with(MOVING) || note.starts_with("masks mark ")
}

/// Returns true for a note on all masks of ignored regions.
pub fn is_of_ignored(note: &str) -> bool {
    note.starts_with(IGNORED)
}

/// Returns true for a note on all masks of a class.
pub fn is_of_class(note: &str, class: &str) -> bool {
    note.starts_with(&format!("{} mark ", of_class(class)))
}

/// Surveyed masks.
#[derive(Debug, Default)]
pub struct MaskSurvey {
    /// Share of the sphere that each file marks.
    shares: BTreeMap<PathBuf, f64>,
    /// Files of each encoding that needs an assumption.
    assumed: BTreeMap<MaskEncoding, Vec<PathBuf>>,
    /// Files of another shape than their frames, with width and height, pixels.
    stretched: Vec<(PathBuf, [usize; 2])>,
    /// Files that leave a rectangle of a pinhole's image: a smaller image in the frame of a wider camera.
    framed: BTreeSet<PathBuf>,
    /// Number of frames whose ignore mask does.
    framed_frames: usize,
    /// Share that each frame's ignore mask marks.
    ignored_shares: Vec<f64>,
    /// Share that each frame's mask marks as moving.
    moving_shares: Vec<f64>,
    /// Share that each frame's mask of a class marks.
    class_shares: BTreeMap<String, Vec<f64>>,
}

impl MaskSurvey {
    /// Checks a mask of frames that `camera` took; each file once. Returns the share that it marks, as
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
        let image = ImageFile::open(file)?;
        let size = image.size();
        if !has_shape(size, camera.size()) {
            self.stretched.push((file.to_owned(), size));
        }
        let DecodedMask { mask, encoding } = mask_file::decode(image, greys)?;
        let share = mask.marked_share(camera);
        if matches!(camera, Camera::Pinhole(_)) && mask.leaves_rectangle() {
            self.framed.insert(file.to_owned());
        }
        self.shares.insert(file.to_owned(), share);
        if encoding.assumption().is_some() {
            let files = self.assumed.entry(encoding).or_default();
            files.push(file.to_owned());
        }
        Ok(share)
    }

    /// Checks a frame's mask of the ignored region.
    ///
    /// # Errors
    /// Those of [`MaskSurvey::add`].
    pub fn add_ignored(&mut self, file: &Path, camera: &Camera) -> Result<(), StoreError> {
        let share = self.add(file, camera, MarkedGreys::AboveHalf)?;
        self.add_ignored_share(share);
        if self.framed.contains(file) {
            self.framed_frames = self.framed_frames.saturating_add(1);
        }
        Ok(())
    }

    /// Counts a frame of which a mask ignores this share.
    pub fn add_ignored_share(&mut self, share: f64) {
        self.ignored_shares.push(share);
    }

    /// Checks a frame's mask of moving content.
    ///
    /// # Errors
    /// Those of [`MaskSurvey::add`].
    pub fn add_moving(&mut self, file: &Path, camera: &Camera) -> Result<(), StoreError> {
        let share = self.add(file, camera, MarkedGreys::AboveHalf)?;
        self.add_moving_share(share);
        Ok(())
    }

    /// Checks a frame's mask of the objects of a class.
    ///
    /// # Errors
    /// Those of [`MaskSurvey::add`].
    pub fn add_of_class(
        &mut self,
        class: &str,
        file: &Path,
        camera: &Camera,
    ) -> Result<(), StoreError> {
        let share = self.add(file, camera, MarkedGreys::AboveHalf)?;
        let shares = self.class_shares.entry(class.to_owned()).or_default();
        shares.push(share);
        Ok(())
    }

    /// Counts a frame of which a mask marks this share as moving.
    pub fn add_moving_share(&mut self, share: f64) {
        self.moving_shares.push(share);
    }

    /// Returns notes for users and for readers of results. They name files with their own folder alone, so that they
    /// do not depend on the location of a scene.
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
        if let Some((_, [width, height])) = self.stretched.first() {
            let files = self.stretched.iter().map(|(file, _)| short_name(file));
            let files: Vec<String> = files.collect();
            notes.push(format!(
                "{} masks are of another shape than their frames, such as {width}x{height}, and are stretched: {}",
                files.len(),
                plain_text::first_of(&files)
            ));
        }
        let frames = self.ignored_shares.len();
        let empty = self.ignored_shares.iter().filter(|&&share| share == 0.0);
        let empty = empty.count();
        if empty > 0 {
            notes.push(format!(
                "{empty} of {frames} masks of ignored regions mark nothing"
            ));
        }
        let is_framed = 2 * self.framed_frames > frames;
        let share = median(&self.ignored_shares).filter(|&share| share > INVERTED_SHARE);
        if let Some(share) = share.filter(|_| !is_framed) {
            notes.push(format!(
                "{IGNORED} {:.0} % of what the camera sees (median of {frames} frames): is its mask \
                 inverted? It is white where nothing is to be learned or scored",
                100.0 * share
            ));
        }
        let of_classes = self.class_shares.iter();
        let of_classes = of_classes.map(|(class, shares)| (of_class(class), shares));
        let all = std::iter::once((MOVING.to_owned(), &self.moving_shares)).chain(of_classes);
        for (masks, shares) in all {
            let share = median(shares).filter(|&share| share > INVERTED_SHARE);
            notes.extend(share.map(|share| {
                format!(
                    "{masks} mark {:.0} % of what the camera sees (median of {} frames): are black and white exchanged?",
                    100.0 * share,
                    shares.len()
                )
            }));
        }
        notes
    }
}

/// Returns true where an image of a size (width, height) is a scaled one of another size: half a pixel of either may
/// be missing.
pub fn has_shape([width, height]: [usize; 2], [other_width, other_height]: [usize; 2]) -> bool {
    let products = [
        width.saturating_mul(other_height),
        height.saturating_mul(other_width),
    ];
    products[0].abs_diff(products[1]) <= width.max(other_width)
}

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

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

    use super::*;
    use crate::{camera::ErpCamera, rgb::Mask};

    #[test]
    fn masks_of_another_shape_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let camera: Camera = ErpCamera::new(64, 32).into();
        let mut survey = MaskSurvey::default();
        for (name, width, height) in [
            ("same.png", 64, 32),
            ("half.png", 32, 16),
            // Half of 33 rows is 16 or 17.
            ("rounded.png", 31, 16),
            ("wide.png", 64, 36),
        ] {
            let mut data = vec![0; width * height];
            data[0] = 255;
            let mask = Mask::new(width, height, data);
            let file = folder.path().join(name);
            mask.write_png(&file).unwrap();
            survey.add(&file, &camera, MarkedGreys::AboveHalf).unwrap();
        }
        let notes = survey.notes();
        assert_eq!(notes.len(), 1);
        assert!(notes[0].starts_with("1 masks") && notes[0].contains("64x36"));
        assert!(notes[0].contains("wide.png"));
    }
}
