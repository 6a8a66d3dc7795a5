//! Images to a video, with the program `ffmpeg`.

use std::{
    fs::{self, File},
    io::{ErrorKind, Write},
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

use anyhow::Context;
use omnilife_schemas::{
    RgbImage,
    store::{self, StoreError},
};

use crate::exit::BadRequest;

/// Frames per second where times do not say.
const DEFAULT_RATE: f64 = 30.0;

/// Whether a video can be written to `file`.
///
/// # Errors
/// When the file is no `.mp4` or the program `ffmpeg` is missing.
pub(crate) fn check(file: &Path) -> anyhow::Result<()> {
    if file.extension().is_none_or(|extension| extension != "mp4") {
        return Err(BadRequest(format!("{}: a video is an .mp4 file", file.display())).into());
    }
    match Command::new("ffmpeg").arg("-version").output() {
        Ok(output) if output.status.success() => Ok(()),
        Err(error) if error.kind() == ErrorKind::NotFound => Err(BadRequest(
            "--video needs the program ffmpeg, which is not installed".to_owned(),
        )
        .into()),
        _ => Err(
            BadRequest("--video needs the program ffmpeg, which does not run".to_owned()).into(),
        ),
    }
}

/// Encodes PNG files of one size as H.264, evenly timed, and returns the frames per second: one over
/// the median of the times between frames.
///
/// # Errors
/// When an image cannot be read or ffmpeg fails.
pub(crate) fn encode(images: &[PathBuf], times: &[f64], file: &Path) -> anyhow::Result<f64> {
    let first = images.first().context("no images")?;
    let RgbImage { width, height, .. } = RgbImage::read(first)?;
    let rate = frames_per_second(times);
    let temporary = store::temporary_beside(file);
    let mut encoder = Command::new("ffmpeg")
        .args(["-v", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"])
        .args(["-s", &format!("{width}x{height}"), "-r", &rate.to_string()])
        // Half as many colours as pixels: an odd side is padded by one pixel.
        .args(["-i", "pipe:0", "-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2"])
        .args(["-c:v", "libx264", "-crf", "16", "-pix_fmt", "yuv420p"])
        .args(["-movflags", "+faststart"])
        .arg(&temporary)
        .stdin(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .context("ffmpeg does not start")?;
    let mut pipe = encoder.stdin.take().context("ffmpeg has no input")?;
    let written = images.iter().try_for_each(|image| {
        let pixels = RgbImage::read(image)?.to_rgb8();
        // Where ffmpeg has gone away, its own message says why.
        drop(pipe.write_all(&pixels));
        Ok::<(), StoreError>(())
    });
    drop(pipe);
    let ended = encoder.wait_with_output()?;
    let published = written.map_err(anyhow::Error::from).and_then(|()| {
        if ended.status.success() {
            return Ok(publish(&temporary, file)?);
        }
        let message = String::from_utf8_lossy(&ended.stderr);
        let reason = message.lines().next().unwrap_or("it ended early");
        anyhow::bail!("{}: ffmpeg: {reason}", file.display())
    });
    if published.is_err() {
        // The encoding has failed already: a temporary file that stays changes nothing.
        drop(fs::remove_file(&temporary));
    }
    published.map(|()| rate)
}

/// Puts what ffmpeg wrote under its final name.
fn publish(temporary: &Path, file: &Path) -> Result<(), StoreError> {
    File::open(temporary)
        .and_then(|written| written.sync_all())
        .and_then(|()| fs::rename(temporary, file))
        .map_err(|source| StoreError::write(file, source))
}

fn frames_per_second(times: &[f64]) -> f64 {
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_by(f64::total_cmp);
    match steps.get(steps.len() / 2) {
        Some(&median) if median > 1e-3 => 1.0 / median,
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
