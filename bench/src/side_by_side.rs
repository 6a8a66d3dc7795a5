//! Images for people: prediction left, ground truth right; grey in both for pixels that do not count.

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

/// Level of pixels that do not count.
const GREY: u8 = 128;

/// Returns the image of a view, relative to the output folder.
pub(crate) fn file(view: View) -> String {
    format!("{FOLDER}/{}-{:06}.png", view.kind, view.frame)
}

/// Creates the folder and removes the images of an earlier scoring: one of a view that is not scored any more would
/// pass for a current one.
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
    let shown = |image: &[u8], row: usize| -> Vec<u8> {
        let pixels = (row * width..(row + 1) * width).map(|pixel| match pair.counts(pixel) {
            true => [0, 1, 2].map(|channel| image[3 * pixel + channel]),
            false => [GREY; 3],
        });
        pixels.flatten().collect()
    };
    for row in 0..height {
        bytes.extend(shown(pair.prediction(), row));
        bytes.extend(std::iter::repeat_n(255, SEPARATOR * 3));
        bytes.extend(shown(pair.truth(), row));
    }
    rgb::write_rgb8_png(&out.join(&file), wide, height, &bytes)?;
    Ok(file)
}
