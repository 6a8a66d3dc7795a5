//! RGB images as the workspace computes with them.

use std::path::Path;

pub use crate::mask::{Mask, nearest_pixels};
use crate::{
    image_file::ImageFile,
    mask_file::{self, MarkedGreys},
    store::{self, StoreError},
};

/// Image of `[0, 1]` f32, row-major, three interleaved channels (HWC), as decoded (sRGB).
#[derive(Debug, Clone, PartialEq)]
pub struct RgbImage {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `height * width * 3` values.
    pub data: Vec<f32>,
}

impl RgbImage {
    /// Makes an image of `height * width * 3` values.
    pub fn new(width: usize, height: usize, data: Vec<f32>) -> Self {
        Self {
            width,
            height,
            data,
        }
    }

    /// Makes a black image.
    pub fn black(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            data: vec![0.0; width * height * 3],
        }
    }

    /// Converts from 8-bit interleaved RGB; `bytes` holds `width * height * 3` values.
    pub fn from_rgb8(width: usize, height: usize, bytes: &[u8]) -> Self {
        debug_assert_eq!(bytes.len(), width * height * 3);
        Self {
            width,
            height,
            data: bytes.iter().map(|&byte| f32::from(byte) / 255.0).collect(),
        }
    }

    /// Converts to 8-bit interleaved RGB: clamped to `[0, 1]` and rounded to nearest; NaN becomes 0.
    pub fn to_rgb8(&self) -> Vec<u8> {
        self.data
            .iter()
            .map(|&value| (value.clamp(0.0, 1.0) * 255.0).round() as u8)
            .collect()
    }

    /// Reads a PNG or JPEG file by [`plain_rgb8`](crate::image_file::plain_rgb8).
    ///
    /// # Errors
    /// When the file is missing, larger than [`MOST_PIXELS`](crate::image_file::MOST_PIXELS), not a
    /// decodable image, transparent anywhere, or asks by its EXIF data to be turned.
    pub fn read(path: &Path) -> Result<Self, StoreError> {
        Self::decode(ImageFile::open(path)?)
    }

    /// Decodes an image whose size has been checked; as [`RgbImage::read`].
    ///
    /// # Errors
    /// When it is damaged, transparent anywhere, or asks by its EXIF data to be rotated.
    pub fn decode(file: ImageFile<'_>) -> Result<Self, StoreError> {
        let [width, height] = file.size();
        Ok(Self::from_rgb8(width, height, &file.decode_plain()?))
    }

    /// Writes an 8-bit PNG, whole or not at all.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_png(&self, path: &Path) -> Result<(), StoreError> {
        write_rgb8_png(path, self.width, self.height, &self.to_rgb8())
    }

    /// Returns the image as an 8-bit PNG.
    ///
    /// # Errors
    /// When the image is empty.
    pub fn png(&self) -> std::io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        let (size, colours) = ((self.width, self.height), image::ExtendedColorType::Rgb8);
        encode_png(&mut bytes, size, &self.to_rgb8(), colours)?;
        Ok(bytes)
    }

    /// Returns the image at another size by area averaging: every new pixel is the mean of the old image over the new
    /// pixel's footprint. Enlarging repeats pixels.
    ///
    /// # Panics
    /// When `width` or `height` is zero.
    pub fn resized_by_area(&self, width: usize, height: usize) -> Self {
        assert!(width > 0 && height > 0, "an image has at least one pixel");
        if (width, height) == (self.width, self.height) {
            return self.clone();
        }
        let columns = area_weights(self.width, width);
        let rows = area_weights(self.height, height);
        let mut narrow = Self::black(width, self.height);
        for y in 0..self.height {
            for (x, weights) in columns.iter().enumerate() {
                for &(source, weight) in weights {
                    for channel in 0..3 {
                        narrow.data[(y * width + x) * 3 + channel] +=
                            weight * self.data[(y * self.width + source) * 3 + channel];
                    }
                }
            }
        }
        let mut resized = Self::black(width, height);
        for (y, weights) in rows.iter().enumerate() {
            let row = &mut resized.data[y * width * 3..(y + 1) * width * 3];
            for &(source, weight) in weights {
                let from = &narrow.data[source * width * 3..(source + 1) * width * 3];
                for (value, &other) in row.iter_mut().zip(from) {
                    *value += weight * other;
                }
            }
        }
        resized
    }
}

/// Returns for every new pixel the old pixels that its footprint covers with their shares (which sum to 1).
fn area_weights(old: usize, new: usize) -> Vec<Vec<(usize, f32)>> {
    let ratio = old as f64 / new as f64;
    (0..new)
        .map(|index| {
            let begin = index as f64 * ratio;
            let end = (begin + ratio).min(old as f64);
            let first = begin.floor() as usize;
            let last = (end.ceil() as usize).clamp(first + 1, old);
            (first..last)
                .map(|source| {
                    let overlap =
                        (end.min(source as f64 + 1.0) - begin.max(source as f64)).max(0.0);
                    (source, (overlap / ratio) as f32)
                })
                .filter(|&(_, weight)| weight > 0.0)
                .collect()
        })
        .collect()
}

/// Writes 8-bit interleaved RGB as a PNG, whole or not at all.
///
/// # Errors
/// When the file cannot be written.
pub fn write_rgb8_png(
    path: &Path,
    width: usize,
    height: usize,
    rgb: &[u8],
) -> Result<(), StoreError> {
    write_png(path, (width, height), rgb, image::ExtendedColorType::Rgb8)
}

/// Writes 8-bit values as a PNG of `size` (width, height), whole or not at all.
pub(crate) fn write_png(
    path: &Path,
    size: (usize, usize),
    bytes: &[u8],
    colours: image::ExtendedColorType,
) -> Result<(), StoreError> {
    store::write_with(path, |writer| encode_png(writer, size, bytes, colours))
}

pub(crate) fn encode_png(
    writer: impl std::io::Write,
    size: (usize, usize),
    bytes: &[u8],
    colours: image::ExtendedColorType,
) -> std::io::Result<()> {
    let encoder = image::codecs::png::PngEncoder::new_with_quality(
        writer,
        image::codecs::png::CompressionType::Fast,
        image::codecs::png::FilterType::Adaptive,
    );
    image::ImageEncoder::write_image(encoder, bytes, size.0 as u32, size.1 as u32, colours).map_err(
        |error| match error {
            image::ImageError::IoError(source) => source,
            other => std::io::Error::other(other),
        },
    )
}

/// Returns true where all pixels of 8-bit interleaved RGB are equal: a black frame, or one of a single colour.
pub fn is_single_colour(rgb: &[u8]) -> bool {
    let (pixels, _) = rgb.as_chunks::<3>();
    pixels.iter().all(|pixel| Some(pixel) == pixels.first())
}

impl Mask {
    /// Reads a mask from any encoding that [`mask_file`] knows.
    ///
    /// # Errors
    /// Those of [`Mask::decode`], and when the file is missing or larger than
    /// [`MOST_PIXELS`](crate::image_file::MOST_PIXELS).
    pub fn read(path: &Path) -> Result<Self, StoreError> {
        Self::decode(ImageFile::open(path)?)
    }

    /// Decodes a mask whose size has been checked; as [`Mask::read`].
    ///
    /// # Errors
    /// Those of [`mask_file::decode`](crate::mask_file::decode()).
    pub fn decode(file: ImageFile<'_>) -> Result<Self, StoreError> {
        Ok(mask_file::decode(file, MarkedGreys::AboveHalf)?.mask)
    }

    /// Writes the mask as an 8-bit grey PNG, whole or not at all.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write_png(&self, path: &Path) -> Result<(), StoreError> {
        let size = (self.width, self.height);
        write_png(path, size, &self.data, image::ExtendedColorType::L8)
    }
}
