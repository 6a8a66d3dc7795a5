//! Writing a video from RGB pictures, for rendered views.

use std::path::Path;

use ffmpeg::{
    Rational, color, ffi,
    format::Pixel,
    frame,
    software::scaling::{self, Flags},
};
use ffmpeg_next as ffmpeg;

use super::mp4::{Colour, Mp4Encoder, Projection, VideoFormat};
use crate::error::CurateError;

/// Ticks per second of written videos, the usual clock of video.
const TICKS_PER_SECOND: i32 = 90_000;

/// Writes pictures as an H.264 mp4. Players show pictures of the whole sphere as 360-degree video.
///
/// An odd side is widened by repeating its last pixels: video has half as many colours as pixels.
///
/// ```no_run
/// # fn main() -> Result<(), omnilife_curate::CurateError> {
/// use omnilife_curate::slicing::{Projection, ViewVideoWriter};
/// let mut video = ViewVideoWriter::create("views.mp4".as_ref(), [1024, 512], Projection::Equirectangular)?;
/// for frame in 0..30 {
///     video.push(&vec![128; 1024 * 512 * 3], f64::from(frame) / 30.0)?;
/// }
/// video.finish(1.0)
/// # }
/// ```
pub struct ViewVideoWriter {
    encoder: Mp4Encoder,
    scaler: scaling::Context,
    size: [u32; 2],
    path: std::path::PathBuf,
}

impl ViewVideoWriter {
    /// Begins a video of pictures of `size` pixels (width and height).
    ///
    /// # Errors
    /// When a side is zero, FFmpeg has no H.264 encoder, or the file cannot be created.
    pub fn create(
        path: &Path,
        size: [u32; 2],
        projection: Projection,
    ) -> Result<Self, CurateError> {
        if size.contains(&0) {
            return Err(CurateError::internal(path, "a video of empty pictures"));
        }
        let [width, height] = size.map(|side| side.next_multiple_of(2));
        let encoder = Mp4Encoder::create(
            path,
            VideoFormat {
                width,
                height,
                pixel: Pixel::YUV420P,
                time_base: Rational::new(1, TICKS_PER_SECOND),
                pixel_aspect: Rational::new(1, 1),
                colour: Colour {
                    space: color::Space::BT709,
                    range: color::Range::MPEG,
                    primaries: color::Primaries::BT709,
                    transfer: color::TransferCharacteristic::BT709,
                },
                quarter_turns: 0,
                projection,
            },
            None,
        )?;
        Ok(Self {
            encoder,
            scaler: to_bt709(width, height).map_err(|error| CurateError::internal(path, error))?,
            size,
            path: path.to_owned(),
        })
    }

    /// Adds a picture of 8-bit interleaved RGB, shown from `seconds` on.
    ///
    /// # Errors
    /// When the picture has another size, time does not increase, or the file cannot be written.
    pub fn push(&mut self, rgb: &[u8], seconds: f64) -> Result<(), CurateError> {
        let [width, height] = self.size;
        let row = width as usize * 3;
        if rgb.len() != row * height as usize {
            return Err(CurateError::internal(
                &self.path,
                format!(
                    "a picture of {} bytes is not {width}x{height} RGB",
                    rgb.len()
                ),
            ));
        }
        let [even_width, even_height] = self.size.map(|side| side.next_multiple_of(2));
        let mut picture = frame::Video::new(Pixel::RGB24, even_width, even_height);
        let stride = picture.stride(0);
        let rows = (0..even_height as usize).map(|at| at.min(height as usize - 1));
        for (to, at) in picture.data_mut(0).chunks_mut(stride).zip(rows) {
            let from = &rgb[at * row..(at + 1) * row];
            to[..row].copy_from_slice(from);
            if even_width > width {
                to[row..row + 3].copy_from_slice(&from[row - 3..]);
            }
        }
        let mut yuv = frame::Video::empty();
        self.scaler
            .run(&picture, &mut yuv)
            .map_err(|error| CurateError::internal(&self.path, error))?;
        self.encoder.push(yuv, ticks(seconds))
    }

    /// Ends the last picture at `seconds` and puts the file under its name.
    ///
    /// # Errors
    /// When there is no picture or the file cannot be written.
    pub fn finish(self, seconds: f64) -> Result<(), CurateError> {
        self.encoder.finish(ticks(seconds))
    }
}

fn ticks(seconds: f64) -> i64 {
    (seconds * f64::from(TICKS_PER_SECOND)).round() as i64
}

/// RGB to limited-range BT.709, the matrix that players take for video of this size.
fn to_bt709(width: u32, height: u32) -> Result<scaling::Context, ffmpeg::Error> {
    let mut context = scaling::Context::get(
        Pixel::RGB24,
        width,
        height,
        Pixel::YUV420P,
        width,
        height,
        Flags::BICUBIC | Flags::ACCURATE_RND,
    )?;
    // SAFETY: the context is live, and `sws_getCoefficients` returns a pointer to a static table of
    // four integers, which is what `sws_setColorspaceDetails` reads. RGB is of full range (1), the
    // video of limited range (0); the rest is neutral brightness, contrast and saturation in 16.16.
    unsafe {
        let matrix = ffi::sws_getCoefficients(ffi::SWS_CS_ITU709);
        ffi::sws_setColorspaceDetails(
            context.as_mut_ptr(),
            matrix,
            1,
            matrix,
            0,
            0,
            1 << 16,
            1 << 16,
        );
    }
    Ok(context)
}
