//! Encoding of rendered views as a video.

use std::path::{Path, PathBuf};

use anyhow::Context;
use omnilife_schemas::{RgbImage, ownership::refuse_existing, rgba, statistics::frame_interval};
use omnilife_video::{Projection, ViewVideoWriter};

use crate::exit::BadRequest;

/// Frames per second where times do not give them.
const DEFAULT_RATE: f64 = 30.0;

/// Refuses a path to which no video can be written.
///
/// # Errors
/// When the file is no `.mp4`, or exists already.
pub(crate) fn check(file: &Path) -> anyhow::Result<()> {
    if file.extension().is_some_and(|extension| extension == "mp4") {
        return Ok(refuse_existing(file)?);
    }
    Err(BadRequest(format!("{}: a video is an .mp4 file", file.display())).into())
}

/// Encodes PNG files of one size as H.264, evenly timed and over black where they are transparent. Returns the frames
/// per second: one over the typical time between frames.
///
/// # Errors
/// When an image cannot be read or the video cannot be written.
pub(crate) fn encode(
    images: &[PathBuf],
    times_seconds: &[f64],
    projection: Projection,
    file: &Path,
) -> anyhow::Result<f64> {
    let first = images.first().context("no images")?;
    let RgbImage { width, height, .. } = rgba::read_over_black(first)?;
    let rate = frames_per_second(times_seconds);
    let mut video = ViewVideoWriter::create(file, [width as u32, height as u32], projection)?;
    for (number, image) in images.iter().enumerate() {
        let image = rgba::read_over_black(image)?;
        video.push(&image.to_rgb8(), number as f64 / rate)?;
    }
    video.finish(images.len() as f64 / rate)?;
    Ok(rate)
}

fn frames_per_second(times_seconds: &[f64]) -> f64 {
    match frame_interval(times_seconds) {
        Some(seconds) if seconds > 1e-3 => 1.0 / seconds,
        _ => DEFAULT_RATE,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_is_that_of_most_frames() {
        assert!((frames_per_second(&[0.0, 0.04, 0.08, 0.12, 1.0]) - 25.0).abs() < 1e-9);
        for unclear in [&[][..], &[3.0], &[1.0, 1.0, 1.0]] {
            assert_eq!(frames_per_second(unclear), DEFAULT_RATE);
        }
    }
}
