//! Mask images: finding those of a sequence's frames and writing them at frame size.

use std::{
    fs,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    records::Sequence,
    rgb::Mask,
    store::{self, StoreError},
};

use crate::error::CurateError;

/// Folder of a sequence's masks, relative to the sequence.
const FOLDER: &str = "masks";
/// Radius in pixels by which masks grow before features are left out under them: outlines of
/// moving objects give features too.
const GROWTH_PIXELS: usize = 4;

/// The image files of a folder, sorted.
pub(super) fn files(folder: &Path) -> Result<Vec<PathBuf>, CurateError> {
    let entries = fs::read_dir(folder).map_err(|error| StoreError::read(folder, error))?;
    let mut files: Vec<PathBuf> = entries
        .filter_map(Result::ok)
        .map(|entry| entry.path())
        .filter(|path| {
            path.extension()
                .is_some_and(|extension| ["png", "jpg", "jpeg"].iter().any(|e| extension == *e))
        })
        .collect();
    files.sort();
    Ok(files)
}

/// For every frame of a sequence, the file in `folder` with its name or stem.
///
/// # Errors
/// When the folder cannot be read or has a mask for no frame.
pub(super) fn find(
    folder: &Path,
    sequence: &Sequence,
) -> Result<Vec<Option<PathBuf>>, CurateError> {
    let files = files(folder)?;
    let found: Vec<Option<PathBuf>> = sequence
        .frames
        .entries
        .iter()
        .map(|entry| {
            let stem = Path::new(&entry.file).file_stem();
            files.iter().find(|file| file.file_stem() == stem).cloned()
        })
        .collect();
    if found.iter().all(Option::is_none) {
        return Err(CurateError::input(
            folder,
            "has a mask for no frame (expected the frames' names, such as 000000.png)",
        ));
    }
    Ok(found)
}

/// Writes masks as `masks/NNNNNN.png` at frame size in place of those that are there; pixels are
/// taken from the nearest of the given mask. Returns the files relative to the sequence's folder.
pub(super) fn copy(
    sequence_folder: &Path,
    masks: &[Option<PathBuf>],
    (width, height): (usize, usize),
) -> Result<Vec<Option<String>>, CurateError> {
    let folder = sequence_folder.join(FOLDER);
    if folder.is_dir() {
        fs::remove_dir_all(&folder).map_err(|error| StoreError::write(&folder, error))?;
    }
    if masks.iter().all(Option::is_none) {
        return Ok(vec![None; masks.len()]);
    }
    store::create_folder(&folder)?;
    masks
        .iter()
        .enumerate()
        .map(|(index, source)| {
            let Some(source) = source else {
                return Ok(None);
            };
            let file = format!("{FOLDER}/{index:06}.png");
            let mask = resized(&Mask::read(source)?, width, height);
            write_grey(&sequence_folder.join(&file), &mask)?;
            Ok(Some(file))
        })
        .collect()
}

/// Writes masks as COLMAP reads them: `<image file name>.png`, black where features are ignored,
/// grown by a few pixels.
pub(super) fn write_for_colmap(
    folder: &Path,
    masks: &[Option<PathBuf>],
    sequence: &Sequence,
) -> Result<(), CurateError> {
    store::create_folder(folder)?;
    let (width, height) = (sequence.frames.width, sequence.frames.height);
    for (entry, source) in sequence.frames.entries.iter().zip(masks) {
        let Some(source) = source else { continue };
        let name = Path::new(&entry.file)
            .file_name()
            .unwrap_or_default()
            .to_string_lossy();
        let mut mask = grown(&resized(
            &Mask::read(source)?,
            width as usize,
            height as usize,
        ));
        mask.data.iter_mut().for_each(|value| *value = !*value);
        write_grey(&folder.join(format!("{name}.png")), &mask)?;
    }
    Ok(())
}

/// Nearest-pixel resampling.
fn resized(mask: &Mask, width: usize, height: usize) -> Mask {
    if (mask.width, mask.height) == (width, height) {
        return mask.clone();
    }
    let mut data = Vec::with_capacity(width * height);
    for y in 0..height {
        let row = (2 * y + 1) * mask.height / (2 * height);
        for x in 0..width {
            data.push(mask.data[row * mask.width + (2 * x + 1) * mask.width / (2 * width)]);
        }
    }
    Mask {
        width,
        height,
        data,
    }
}

/// Marks every pixel within `GROWTH_PIXELS` rows and columns of a marked one, across the seam too.
fn grown(mask: &Mask) -> Mask {
    let (width, height) = (mask.width, mask.height);
    let mut wide = vec![0_u8; mask.data.len()];
    for y in 0..height {
        for x in (0..width).filter(|x| mask.data[y * width + x] != 0) {
            for shift in 0..=2 * GROWTH_PIXELS {
                let column = (x + width * GROWTH_PIXELS + shift - GROWTH_PIXELS) % width;
                wide[y * width + column] = 255;
            }
        }
    }
    let mut data = vec![0_u8; mask.data.len()];
    for y in 0..height {
        let rows = y.saturating_sub(GROWTH_PIXELS)..=(y + GROWTH_PIXELS).min(height - 1);
        for row in rows {
            for x in 0..width {
                data[row * width + x] |= wide[y * width + x];
            }
        }
    }
    Mask {
        width,
        height,
        data,
    }
}

fn write_grey(path: &Path, mask: &Mask) -> Result<(), CurateError> {
    Ok(store::write_with(path, |writer| {
        let encoder = image::codecs::png::PngEncoder::new(writer);
        image::ImageEncoder::write_image(
            encoder,
            &mask.data,
            mask.width as u32,
            mask.height as u32,
            image::ExtendedColorType::L8,
        )
        .map_err(|error| match error {
            image::ImageError::IoError(source) => source,
            other => std::io::Error::other(other),
        })
    })?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_grow_across_the_seam_and_stop_at_the_poles() {
        let mut mask = Mask {
            width: 32,
            height: 16,
            data: vec![0; 32 * 16],
        };
        mask.data[0] = 255;
        let grown = grown(&mask);
        let marked = grown.data.iter().filter(|&&value| value != 0).count();
        assert_eq!(marked, 9 * 5);
        assert_eq!(grown.data[28], 255);
        assert_eq!(grown.data[27], 0);
    }

    #[test]
    fn nearest_resampling_keeps_halves() {
        let mask = Mask {
            width: 4,
            height: 2,
            data: vec![0, 0, 255, 255, 0, 0, 255, 255],
        };
        let large = resized(&mask, 8, 4);
        assert!(
            large
                .data
                .chunks(8)
                .all(|row| row == [0, 0, 0, 0, 255, 255, 255, 255])
        );
        assert_eq!(resized(&large, 4, 2), mask);
    }
}
