//! Image files of others: their size is known before a pixel is decoded.
//!
//! A file of some kilobytes can state any number of pixels. Whoever knows what size an image should
//! have looks at [`ImageFile::size`] first; what nobody knows the size of is bounded by
//! [`MOST_PIXELS`].
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{fs::File, io::BufReader, path::Path};

use image::{DynamicImage, ImageDecoder, ImageReader};

use crate::{error_kind, store::StoreError};

/// Pixels of an image at most: those of a panorama of 16384 x 8192.
pub const MOST_PIXELS: u64 = 1 << 27;

/// A PNG or JPEG file of which only the header has been read.
pub struct ImageFile<'a> {
    path: &'a Path,
    decoder: Box<dyn ImageDecoder + 'a>,
    size: [usize; 2],
}

impl<'a> ImageFile<'a> {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// When the file is missing, is no image, or states no pixels or more than [`MOST_PIXELS`].
    pub fn open(path: &'a Path) -> Result<Self, StoreError> {
        error_kind::reading(path);
        let file = File::open(path).map_err(|source| StoreError::read(path, source))?;
        let reader = ImageReader::new(BufReader::new(file))
            .with_guessed_format()
            .map_err(|source| StoreError::read(path, source))?;
        let decoder = reader
            .into_decoder()
            .map_err(|error| unusable(path, &error))?;
        let (width, height) = decoder.dimensions();
        if u64::from(width).saturating_mul(u64::from(height)) > MOST_PIXELS
            || width == 0
            || height == 0
        {
            return Err(StoreError::malformed(
                path,
                format!("is {width}x{height} pixels, expected 1 to {MOST_PIXELS} of them"),
            ));
        }
        Ok(Self {
            path,
            decoder: Box::new(decoder),
            size: [width as usize, height as usize],
        })
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Refuses an image that is not `width` x `height` pixels.
    ///
    /// # Errors
    /// Names the file and both sizes.
    pub fn expect_size(self, [width, height]: [usize; 2]) -> Result<Self, StoreError> {
        if self.size == [width, height] {
            return Ok(self);
        }
        let [found_width, found_height] = self.size;
        Err(StoreError::malformed(
            self.path,
            format!("is {found_width}x{found_height} pixels, expected {width}x{height}"),
        ))
    }

    /// Decodes the pixels.
    ///
    /// # Errors
    /// When they are damaged.
    pub fn decode(self) -> Result<DynamicImage, StoreError> {
        DynamicImage::from_decoder(self.decoder).map_err(|error| unusable(self.path, &error))
    }

    /// Decodes an image of 16-bit grey values, row by row.
    ///
    /// # Errors
    /// When it is of another kind, or damaged.
    pub fn decode_grey16(self) -> Result<Vec<u16>, StoreError> {
        let colour = self.decoder.color_type();
        let path = self.path;
        let of_another_kind =
            || StoreError::malformed(path, format!("is {colour:?}, expected 16-bit grey"));
        if colour != image::ColorType::L16 {
            return Err(of_another_kind());
        }
        match self.decode()? {
            DynamicImage::ImageLuma16(image) => Ok(image.into_raw()),
            _ => Err(of_another_kind()),
        }
    }
}

fn unusable(path: &Path, error: &image::ImageError) -> StoreError {
    StoreError::malformed(path, format!("not a usable image: {error}"))
}
