//! Pictures for people: prediction left, ground truth right.

use std::{fs, path::Path};

use omnilife_schemas::{
    rgb,
    store::{self, StoreError},
};

use crate::{metrics::ViewPair, scoring::job::View};

/// Folder of the pictures in the output folder.
const FOLDER: &str = "comparisons";

/// Width of the white line between the two images in pixels.
const SEPARATOR: usize = 4;

/// Makes the folder and removes the pictures of an earlier scoring: one of a view that is not
/// scored any more would pass for a current one.
pub(crate) fn prepare_folder(out: &Path) -> Result<(), StoreError> {
    let folder = out.join(FOLDER);
    store::create_folder(&folder)?;
    let entries = fs::read_dir(&folder).map_err(|source| StoreError::read(&folder, source))?;
    for entry in entries {
        let path = entry
            .map_err(|source| StoreError::read(&folder, source))?
            .path();
        if is_picture(&path) {
            fs::remove_file(&path).map_err(|source| StoreError::write(&path, source))?;
        }
    }
    Ok(())
}

/// Writes a view's picture; returns its file relative to `out`.
pub(crate) fn write(out: &Path, view: View, pair: &ViewPair) -> Result<String, StoreError> {
    let file = format!("{FOLDER}/{}-{:06}.png", view.kind, view.frame);
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

/// Whether a file is named as [`write`] names them.
fn is_picture(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    ["input-", "novel-"].iter().any(|kind| {
        name.strip_prefix(kind)
            .and_then(|rest| rest.strip_suffix(".png"))
            .is_some_and(|digits| digits.len() >= 6 && digits.bytes().all(|b| b.is_ascii_digit()))
    })
}
