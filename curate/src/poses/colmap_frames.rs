//! COLMAP's `frames.txt` and `frames.bin` (since 3.12): simultaneous images of a rig of several cameras.
//!
//! ```text
//! frames.txt     frame, rig, qw qx qy qz tx ty tz, count, then sensor type, sensor, image
//! frames.bin     u64 count, then u32 frame, u32 rig, f64 qw qx qy qz tx ty tz,
//!                u32 count, then i32 sensor type, u32 sensor, u64 image
//! ```
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use omnilife_schemas::store::{self, StoreError};

use super::{
    colmap_binary::{self, Bytes},
    colmap_text,
};

/// Returns the simultaneous images, by their id, each with the id of its frame. Empty if the model has no such file, or
/// no rig of several cameras.
///
/// # Errors
/// When the file is malformed.
pub(crate) fn together([cameras, ..]: &[PathBuf; 3]) -> Result<BTreeMap<u32, u32>, StoreError> {
    let is_binary = cameras
        .extension()
        .is_some_and(|extension| extension == "bin");
    let file = cameras.with_file_name(if is_binary {
        "frames.bin"
    } else {
        "frames.txt"
    });
    if !file.is_file() {
        return Ok(BTreeMap::new());
    }
    let frames = if is_binary {
        colmap_binary::read_file(&file, read_binary)?
    } else {
        read_text(&file)?
    };
    let shared = frames.into_iter().filter(|(_, images)| images.len() > 1);
    Ok(shared
        .flat_map(|(frame, images)| images.into_iter().map(move |image| (image, frame)))
        .collect())
}

/// Images by their frame.
type Frames = BTreeMap<u32, Vec<u32>>;

fn read_binary(bytes: &mut Bytes<'_>) -> Result<Frames, String> {
    let mut frames = Frames::new();
    for _ in 0..bytes.u64()? {
        let frame = bytes.u32()?;
        let _rig = bytes.u32()?;
        bytes.numbers::<7>()?;
        let mut images = Vec::new();
        for _ in 0..bytes.u32()? {
            let sensor_type = i32::from_le_bytes(bytes.take()?);
            let _sensor = bytes.u32()?;
            let data = bytes.u64()?;
            // Others are inertial units.
            if sensor_type == 0 {
                images.push(u32::try_from(data).map_err(|_| "an image id is too large")?);
            }
        }
        frames.insert(frame, images);
    }
    Ok(frames)
}

fn read_text(path: &Path) -> Result<Frames, StoreError> {
    let text = store::read_text(path)?;
    let mut frames = Frames::new();
    for line in colmap_text::filled_lines(path, &text) {
        let frame = line.field(0, "frame id")?;
        let count: usize = line.field(9, "number of images")?;
        let words = line.words_from(10);
        let (triples, rest) = words.as_chunks::<3>();
        if !rest.is_empty() || triples.len() != count {
            return Err(line.malformed("sensors and images must be triples"));
        }
        let images: Vec<u32> = triples
            .iter()
            .filter(|[sensor_type, ..]| ["CAMERA", "0"].contains(sensor_type))
            .map(|[_, _, image]| image.parse())
            .collect::<Result<_, _>>()
            .map_err(|_| line.malformed("no image id"))?;
        frames.insert(frame, images);
    }
    Ok(frames)
}
