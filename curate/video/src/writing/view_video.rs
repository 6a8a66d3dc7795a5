//! Video from RGB images, for rendered views.

use std::path::Path;

use ffmpeg::{Rational, color, software::scaling::Flags};
use ffmpeg_next as ffmpeg;

use super::{
    mp4::{Mp4Encoder, Projection, Quality, VideoFormat},
    spherical_boxes::Orientation,
};
use crate::{
    error::VideoError,
    matrix::Matrix,
    pixel_format::PixelFormat,
    planes::{allocated, rows_mut},
    raw_fields::Colour,
    scaler::{FrameShape, Scaler},
};

/// Ticks per second of written videos, the usual clock of video.
const TICKS_PER_SECOND: i32 = 90_000;

/// Writes images as an H.264 mp4. Players show images of the whole sphere as 360-degree video.
///
/// An odd side is widened by repeating its last pixels: video has half as many colours as pixels.
///
/// ```no_run
/// # fn main() -> Result<(), omnilife_video::VideoError> {
/// use omnilife_video::{Projection, ViewVideoWriter};
/// let mut video = ViewVideoWriter::create("views.mp4".as_ref(), [1024, 512], Projection::Equirectangular)?;
/// for frame in 0..30 {
///     video.push(&vec![128; 1024 * 512 * 3], f64::from(frame) / 30.0)?;
/// }
/// video.finish(1.0)
/// # }
/// ```
pub struct ViewVideoWriter {
    encoder: Mp4Encoder,
    scaler: Scaler,
    size: [u32; 2],
    path: std::path::PathBuf,
}

impl ViewVideoWriter {
    /// Creates a video of images of `size` pixels (width and height).
    ///
    /// # Errors
    /// When a side is zero, FFmpeg has no H.264 encoder, or the file cannot be created.
    pub fn create(path: &Path, size: [u32; 2], projection: Projection) -> Result<Self, VideoError> {
        Self::with_quality(path, size, projection, Quality::VisuallyLossless)
    }

    /// [`create`](Self::create) with another quality.
    ///
    /// # Errors
    /// Those of [`create`](Self::create).
    pub fn with_quality(
        path: &Path,
        size: [u32; 2],
        projection: Projection,
        quality: Quality,
    ) -> Result<Self, VideoError> {
        if size.contains(&0) {
            return Err(VideoError::internal(path, "a video of empty images"));
        }
        let [width, height] = size.map(|side| side.next_multiple_of(2));
        let encoder = Mp4Encoder::create(
            path,
            VideoFormat {
                width,
                height,
                pixel: PixelFormat::YUV420P,
                time_base: Rational::new(1, TICKS_PER_SECOND),
                pixel_aspect: Rational::new(1, 1),
                colour: Colour {
                    space: color::Space::BT709,
                    range: color::Range::MPEG,
                    primaries: color::Primaries::BT709,
                    transfer: color::TransferCharacteristic::BT709,
                },
                orientation: Orientation::default(),
                projection,
                quality,
            },
            None,
        )?;
        Ok(Self {
            encoder,
            scaler: to_bt709(width, height).map_err(|error| VideoError::internal(path, error))?,
            size,
            path: path.to_owned(),
        })
    }

    /// Adds an image of 8-bit interleaved RGB, shown from `seconds` on.
    ///
    /// # Errors
    /// When the image has another size, time does not increase, or the file cannot be written.
    pub fn push(&mut self, rgb: &[u8], seconds: f64) -> Result<(), VideoError> {
        let [width, height] = self.size;
        let row = width as usize * 3;
        if rgb.len() != row * height as usize {
            return Err(VideoError::internal(
                &self.path,
                format!(
                    "an image of {} bytes is not {width}x{height} RGB",
                    rgb.len()
                ),
            ));
        }
        let [even_width, even_height] = self.size.map(|side| side.next_multiple_of(2));
        let internal = |error: ffmpeg::Error| VideoError::internal(&self.path, error);
        let mut image = allocated(PixelFormat::RGB24, even_width, even_height).map_err(internal)?;
        let rows = (0..even_height as usize).map(|at| at.min(height as usize - 1));
        for (to, at) in rows_mut(&mut image, 0).map_err(internal)?.zip(rows) {
            let from = &rgb[at * row..(at + 1) * row];
            to[..row].copy_from_slice(from);
            if even_width > width {
                to[row..row + 3].copy_from_slice(&from[row - 3..]);
            }
        }
        let yuv = self.scaler.run(&image).map_err(internal)?;
        self.encoder.push(yuv, ticks(seconds))
    }

    /// Ends the last image at `seconds` and puts the file under its name.
    ///
    /// # Errors
    /// When there is no image or the file cannot be written.
    pub fn finish(self, seconds: f64) -> Result<(), VideoError> {
        self.encoder.finish(ticks(seconds))
    }
}

fn ticks(seconds: f64) -> i64 {
    (seconds * f64::from(TICKS_PER_SECOND)).round() as i64
}

/// Returns a scaler from RGB to limited-range BT.709, the matrix that players assume for video of this size.
fn to_bt709(width: u32, height: u32) -> Result<Scaler, ffmpeg::Error> {
    let shape = |format| FrameShape {
        format,
        width,
        height,
    };
    let flags = Flags::BICUBIC | Flags::ACCURATE_RND;
    let (source, target) = (shape(PixelFormat::RGB24), shape(PixelFormat::YUV420P));
    let mut scaler = Scaler::new(source, target, flags)?;
    scaler.set_colours(Matrix::Bt709, true, false);
    Ok(scaler)
}
