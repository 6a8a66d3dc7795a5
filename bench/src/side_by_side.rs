//! Images for people: prediction left, ground truth right.

use std::path::Path;

use omnilife_schemas::{
    ownership::OwnFiles,
    rgb,
    store::{self, StoreError},
};

use crate::{metrics::ViewPair, scoring::job::View};

/// Folder of the images in the output folder.
const FOLDER: &str = "comparisons";

/// Width of the white line between the two images in pixels.
const SEPARATOR: usize = 4;

/// The image of a view, relative to the output folder.
pub(crate) fn file(view: View) -> String {
    format!("{FOLDER}/{}-{:06}.png", view.kind, view.frame)
}

/// Makes the folder and removes the images of an earlier scoring: one of a view that is not
/// scored any more would pass for a current one.
pub(crate) fn prepare_folder(out: &Path, own: &OwnFiles) -> Result<(), StoreError> {
    own.remove(|file| {
        file.strip_prefix(FOLDER)
            .is_some_and(|rest| rest.starts_with('/'))
    })?;
    store::create_folder(&out.join(FOLDER))
}

/// Writes a view's image; returns its file relative to `out`.
pub(crate) fn write(out: &Path, view: View, pair: &ViewPair) -> Result<String, StoreError> {
    let file = file(view);
    let [width, height] = pair.size();
    let wide = 2 * width + SEPARATOR;
    let mut bytes = Vec::with_capacity(wide * height * 3);
    for row in 0..height {
        let range = row * width * 3..(row + 1) * width * 3;
        bytes.extend_from_slice(&pair.prediction()[range.clone()]);
        bytes.extend(std::iter::repeat_n(255, SEPARATOR * 3));
        bytes.extend_from_slice(&pair.truth()[range]);
    }
    rgb::write_rgb8_png(&out.join(&file), wide, height, &bytes)?;
    Ok(file)
}
