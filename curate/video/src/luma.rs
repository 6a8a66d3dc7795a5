//! Luminance of frames at decoded size, for details that scaling would blur away.

use std::path::Path;

use ffmpeg_next as ffmpeg;

use super::{Converter, PixelFormat, Scaling, planes::Plane};
use crate::error::VideoError;

/// Luminance of a frame: 8 bits as stored, in the stream's own range. Its first columns are repeated to the right of
/// its last, so that content across the seam is whole there.
#[derive(Debug, Default)]
pub struct LumaImage {
    /// Pixels per row, without repeated ones.
    pub width: usize,
    /// Rows.
    pub height: usize,
    margin: usize,
    levels: Vec<u8>,
}

/// Storage of luminance in a plane.
enum Samples {
    Bytes,
    /// 10 bits in two bytes, the lower first.
    Words,
}

impl Samples {
    /// Returns `None` if the first plane is not luminance.
    fn of(format: PixelFormat) -> Option<Self> {
        match format {
            PixelFormat::GRAY8
            | PixelFormat::NV12
            | PixelFormat::YUV420P
            | PixelFormat::YUVJ420P
            | PixelFormat::YUV422P
            | PixelFormat::YUVJ422P
            | PixelFormat::YUV444P
            | PixelFormat::YUVJ444P => Some(Self::Bytes),
            PixelFormat::YUV420P10LE | PixelFormat::YUV422P10LE | PixelFormat::YUV444P10LE => {
                Some(Self::Words)
            }
            _ => None,
        }
    }
}

impl LumaImage {
    /// Returns pixels per row, with repeated ones.
    pub fn stride(&self) -> usize {
        self.width + self.margin
    }

    /// Returns a row, with its repeated pixels.
    pub fn row(&self, y: usize) -> &[u8] {
        &self.levels[y * self.stride()..(y + 1) * self.stride()]
    }

    /// Takes an image of other levels; `margin` gives the number of repeated columns for its width. Reuses allocated
    /// memory.
    pub fn fill<'a>(
        &mut self,
        (width, height): (usize, usize),
        margin: fn(usize) -> usize,
        rows: impl Iterator<Item = &'a [u8]>,
    ) {
        (self.width, self.height) = (width, height);
        self.margin = margin(width).min(width);
        self.levels.clear();
        self.levels.reserve(self.stride() * height);
        for row in rows {
            self.levels.extend_from_slice(row);
            self.levels.extend_from_slice(&row[..self.margin]);
        }
    }

    /// Takes a decoded frame of the video at `path`, turned clockwise by quarter turns.
    ///
    /// # Errors
    /// [`VideoError::Unusable`] when the pixel format cannot be converted.
    pub fn read(
        &mut self,
        path: &Path,
        frame: &ffmpeg::frame::Video,
        quarter_turns: u32,
        margin: fn(usize) -> usize,
    ) -> Result<(), VideoError> {
        let plane = || {
            Plane::of(frame, 0).ok_or_else(|| {
                VideoError::unusable(path, "a frame holds no image of the size that it states")
            })
        };
        let samples =
            Samples::of(PixelFormat::of(frame)).filter(|_| quarter_turns.is_multiple_of(4));
        match samples {
            Some(Samples::Bytes) => {
                let plane = plane()?;
                let size = (plane.row(0).len(), plane.rows());
                self.fill(size, margin, (0..size.1).map(|y| plane.row(y)));
            }
            Some(Samples::Words) => {
                let plane = plane()?;
                let size = (plane.row(0).len() / 2, plane.rows());
                let levels: Vec<u8> = (0..size.1)
                    .flat_map(|y| plane.row(y).as_chunks::<2>().0)
                    .map(|&bytes| (u16::from_le_bytes(bytes) >> 2) as u8)
                    .collect();
                self.fill(size, margin, levels.chunks(size.0));
            }
            None => {
                let image = Converter::new(Scaling::Native)
                    .convert(path, frame)?
                    .turned(quarter_turns);
                let levels: Vec<u8> = image
                    .data
                    .as_chunks::<3>()
                    .0
                    .iter()
                    .map(|&rgb| {
                        let [red, green, blue] = rgb.map(u32::from);
                        ((299 * red + 587 * green + 114 * blue + 500) / 1000) as u8
                    })
                    .collect();
                let size = (image.width, image.height);
                self.fill(size, margin, levels.chunks(size.0));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use ffmpeg::format::Pixel;

    use super::*;

    #[test]
    fn ten_bits_become_eight_and_the_left_border_is_repeated() {
        let mut frame = ffmpeg::frame::Video::new(Pixel::YUV420P10LE, 32, 4);
        let stride = frame.stride(0);
        for y in 0..4 {
            for x in 0..32 {
                let sample = ((x * 8 + y) as u16 * 4 + 3).to_le_bytes();
                frame.data_mut(0)[y * stride + 2 * x..][..2].copy_from_slice(&sample);
            }
        }
        let mut luma = LumaImage::default();
        luma.read(Path::new("deep.mp4"), &frame, 0, |_| 2)
            .expect("read");
        assert_eq!((luma.width, luma.height, luma.stride()), (32, 4, 34));
        assert_eq!(luma.row(3)[..3], [3, 11, 19]);
        assert_eq!(luma.row(3)[31..], [251, 3, 11]);
    }

    #[test]
    fn frames_without_a_plane_of_luminance_are_converted_and_turned() {
        let mut frame = ffmpeg::frame::Video::new(Pixel::RGB24, 32, 16);
        let stride = frame.stride(0);
        frame.data_mut(0).fill(0);
        frame.data_mut(0)[15 * stride..][..3].fill(255);
        let mut luma = LumaImage::default();
        luma.read(Path::new("rgb.mp4"), &frame, 1, |_| 0)
            .expect("read");
        assert_eq!((luma.width, luma.height), (16, 32));
        // The lower left corner goes to the upper left.
        assert_eq!(luma.row(0)[..2], [255, 0]);
    }
}
