//! Encoding of rendered views as a video.

use std::{
    fmt,
    path::{Path, PathBuf},
};

use anyhow::Context;
use omnilife_schemas::{RgbImage, ownership::refuse_existing, rgba, statistics::frame_interval};
use omnilife_video::{Projection, ViewVideoWriter};

use crate::exit::BadRequest;

/// Frames per second where times do not give them.
const DEFAULT_RATE: f64 = 30.0;
/// Shortest time from a frame to the next.
const SHORTEST_SECONDS: f64 = 1e-3;

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

/// Timing of a video of rendered views.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Timing {
    /// Frames are as far apart as their times, most of them at this rate.
    OfFrames(f64),
    /// Times do not rise from frame to frame, so all are as far apart, at this rate.
    Even(f64),
}

impl fmt::Display for Timing {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OfFrames(rate) => write!(formatter, "at {rate:.3} frames per second"),
            Self::Even(rate) => write!(
                formatter,
                "evenly at {rate:.3} frames per second, because the times of its frames do not rise from one to the next"
            ),
        }
    }
}

impl Timing {
    fn of(times_seconds: &[f64]) -> Self {
        let rate = frames_per_second(times_seconds);
        let do_rise = times_seconds
            .windows(2)
            .all(|pair| pair[1] - pair[0] > SHORTEST_SECONDS);
        if do_rise {
            Self::OfFrames(rate)
        } else {
            Self::Even(rate)
        }
    }

    /// Returns the times at which so many frames begin, and the end of the last, seconds from the first.
    fn begins(self, times_seconds: &[f64]) -> Vec<f64> {
        match (self, times_seconds.first(), times_seconds.last()) {
            (Self::OfFrames(rate), Some(first), Some(last)) => times_seconds
                .iter()
                .map(|time| time - first)
                .chain([last - first + 1.0 / rate])
                .collect(),
            (Self::OfFrames(rate) | Self::Even(rate), ..) => (0..=times_seconds.len())
                .map(|number| number as f64 / rate)
                .collect(),
        }
    }
}

/// Encodes PNG files of one size as H.264, over black where they are transparent.
///
/// # Errors
/// When an image cannot be read or the video cannot be written.
pub(crate) fn encode(
    images: &[PathBuf],
    times_seconds: &[f64],
    projection: Projection,
    file: &Path,
) -> anyhow::Result<Timing> {
    let first = images.first().context("no images")?;
    let RgbImage { width, height, .. } = rgba::read_over_black(first)?;
    let timing = Timing::of(times_seconds);
    let begins = timing.begins(times_seconds);
    let mut video = ViewVideoWriter::create(file, [width as u32, height as u32], projection)?;
    for (image, begin) in images.iter().zip(&begins) {
        let image = rgba::read_over_black(image)?;
        video.push(&image.to_rgb8(), *begin)?;
    }
    video.finish(begins.last().copied().unwrap_or_default())?;
    Ok(timing)
}

fn frames_per_second(times_seconds: &[f64]) -> f64 {
    match frame_interval(times_seconds) {
        Some(seconds) if seconds > SHORTEST_SECONDS => 1.0 / seconds,
        _ => DEFAULT_RATE,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_keep_their_times_where_these_rise() {
        let uneven = [10.0, 10.1, 10.2, 12.0];
        let begins = Timing::of(&uneven).begins(&uneven);
        for (found, expected) in begins.iter().zip([0.0, 0.1, 0.2, 2.0, 2.1]) {
            assert!((found - expected).abs() < 1e-9, "{begins:?}");
        }
        for unsorted in [&[0.0, 0.0, 0.1, 0.1][..], &[0.5, 0.1, 9.0]] {
            let timing = Timing::of(unsorted);
            assert!(matches!(timing, Timing::Even(_)), "{timing:?}");
            let begins = timing.begins(unsorted);
            assert_eq!(begins.len(), unsorted.len() + 1);
            assert!(begins.windows(2).all(|pair| pair[1] > pair[0]));
        }
    }

    #[test]
    fn the_rate_is_that_of_most_frames() {
        assert!((frames_per_second(&[0.0, 0.04, 0.08, 0.12, 1.0]) - 25.0).abs() < 1e-9);
        for unclear in [&[][..], &[3.0], &[1.0, 1.0, 1.0]] {
            assert_eq!(frames_per_second(unclear), DEFAULT_RATE);
        }
    }
}
