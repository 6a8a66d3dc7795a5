//! Image files of others: their size is known before a pixel is decoded.
//!
//! A file of some kilobytes can state any number of pixels. Callers that know the size that an image should have
//! check [`ImageFile::size`] first; all other sizes are bounded by [`MOST_PIXELS`].
//!
//! Scene images and predictions are read by one rule, [`plain_rgb8`]. It refuses images that programs show in
//! different ways: transparent ones, and those with a rotation in their EXIF data. An import reads such files as
//! viewers show them, [`ImageFile::decode_shown`], or as a program reads them that ignores the rotation,
//! [`ImageFile::decode_stored`], and writes plain ones.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    fs::{self, File},
    io::{BufRead, BufReader},
    path::Path,
};

use image::{
    DynamicImage, ImageDecoder, ImageError, ImageReader, LumaA, Rgba, metadata::Orientation,
};

use crate::{error_kind, mask::Mask, store::StoreError};

/// Largest number of pixels of an image: that of a panorama of 16384 x 8192.
pub const MOST_PIXELS: u64 = 1 << 27;

/// PNG or JPEG file of which only the header has been read.
pub struct ImageFile<'a> {
    path: &'a Path,
    decoder: Box<dyn ImageDecoder + 'a>,
    size: [usize; 2],
    format: FileFormat,
}

/// Meaning of the values in a file's pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FileFormat {
    /// Values that the file keeps nearly (lossy compression).
    Jpeg,
    /// Indices of a palette.
    PalettePng,
    /// Values that the file keeps exactly.
    Png,
}

impl FileFormat {
    /// Returns the format by the beginning of a file; all that is not JPEG counts as PNG.
    fn of(beginning: &[u8]) -> Self {
        // The header chunk comes first and has the colour type in its tenth byte.
        const COLOUR_TYPE: usize = 25;
        const INDEXED: u8 = 3;
        if beginning.starts_with(&[0xff, 0xd8, 0xff]) {
            Self::Jpeg
        } else if beginning.starts_with(b"\x89PNG") && beginning.get(COLOUR_TYPE) == Some(&INDEXED)
        {
            Self::PalettePng
        } else {
            Self::Png
        }
    }
}

/// Returns true where a JPEG file has the marker of its end behind its first scan. In a scan that marker has no other
/// meaning. The segments before it, which may hold whole thumbnails, are skipped by their lengths.
fn jpeg_ends(bytes: &[u8]) -> bool {
    const START_OF_SCAN: u8 = 0xda;
    const END: [u8; 2] = [0xff, 0xd9];
    let mut rest = bytes.get(2..).unwrap_or_default();
    loop {
        // Any number of 0xff may precede the code of a marker.
        let Some(at) = rest.iter().position(|&byte| byte != 0xff) else {
            return false;
        };
        let Some((&code, segment)) = rest.get(at..).and_then(<[u8]>::split_first) else {
            return false;
        };
        let Some(&[high, low]) = segment.first_chunk::<2>() else {
            return false;
        };
        let length = usize::from(u16::from_be_bytes([high, low]));
        let Some(after) = segment.get(length..) else {
            return false;
        };
        if code == START_OF_SCAN {
            return after.array_windows().any(|pair: &[u8; 2]| *pair == END);
        }
        rest = after;
    }
}

/// Reason why programs show an image in different ways.
#[derive(Debug, thiserror::Error)]
pub enum NotPlain {
    /// It cannot be decoded.
    #[error("not a usable image: {0}")]
    Damaged(ImageError),
    /// Its EXIF data ask for a rotation, which only some viewers apply.
    #[error("asks by its EXIF orientation to be turned or mirrored")]
    Turned,
    /// It is transparent: some viewers show a background and some the stored colours.
    #[error("is transparent in places, expected opaque pixels")]
    Transparent,
}

/// Decodes 8-bit interleaved RGB that every program shows alike. Grey becomes RGB, 16 bits are rounded to 8, and an
/// alpha channel is left out where every pixel is opaque.
///
/// # Errors
/// When it is damaged, transparent anywhere, or asks to be rotated or mirrored.
pub fn plain_rgb8(mut decoder: impl ImageDecoder) -> Result<Vec<u8>, NotPlain> {
    if decoder.orientation().map_err(NotPlain::Damaged)? != Orientation::NoTransforms {
        return Err(NotPlain::Turned);
    }
    let image = DynamicImage::from_decoder(decoder).map_err(NotPlain::Damaged)?;
    if transparent_pixels(&image).is_some() {
        return Err(NotPlain::Transparent);
    }
    Ok(image.into_rgb8().into_raw())
}

/// Image as viewers show it, or without the rotation that its EXIF data ask for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ShownImage {
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// `height * width * 3` values, 8-bit interleaved RGB; black where it is not opaque.
    pub rgb: Vec<u8>,
    /// Mask of every pixel that is not opaque; `None` where all are.
    pub transparent: Option<Mask>,
    /// True where its EXIF data ask for a rotation or a mirror image.
    pub is_turned: bool,
}

impl<'a> ImageFile<'a> {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// When the file is missing, is not an image, or states no pixels or more than [`MOST_PIXELS`].
    pub fn open(path: &'a Path) -> Result<Self, StoreError> {
        error_kind::reading(path);
        let failed = |source| StoreError::read(path, source);
        let mut file = BufReader::new(File::open(path).map_err(failed)?);
        let format = FileFormat::of(file.fill_buf().map_err(failed)?);
        let reader = ImageReader::new(file)
            .with_guessed_format()
            .map_err(failed)?;
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
            format,
        })
    }

    /// Returns width and height in pixels, as stored.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Returns width and height in pixels after the rotation that its EXIF data ask for.
    ///
    /// # Errors
    /// When its EXIF data cannot be read.
    pub fn shown_size(&mut self) -> Result<[usize; 2], StoreError> {
        let [width, height] = self.size;
        Ok(match self.orientation()? {
            Orientation::NoTransforms
            | Orientation::Rotate180
            | Orientation::FlipHorizontal
            | Orientation::FlipVertical => [width, height],
            Orientation::Rotate90
            | Orientation::Rotate270
            | Orientation::Rotate90FlipH
            | Orientation::Rotate270FlipH => [height, width],
        })
    }

    /// Returns its EXIF data, a TIFF structure, if any.
    ///
    /// # Errors
    /// When they cannot be read.
    pub fn exif(&mut self) -> Result<Option<Vec<u8>>, StoreError> {
        let data = self.decoder.exif_metadata();
        data.map_err(|error| unusable(self.path, &error))
    }

    /// Returns its XMP data, XML, if any.
    ///
    /// # Errors
    /// When they cannot be read.
    pub fn xmp(&mut self) -> Result<Option<Vec<u8>>, StoreError> {
        let data = self.decoder.xmp_metadata();
        data.map_err(|error| unusable(self.path, &error))
    }

    /// Returns its ICC colour profile, if any.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn colour_profile(&mut self) -> Result<Option<Vec<u8>>, StoreError> {
        let data = self.decoder.icc_profile();
        data.map_err(|error| unusable(self.path, &error))
    }

    /// Returns true where its values have 16 bits.
    pub fn is_deep(&self) -> bool {
        use image::ColorType::{L16, La16, Rgb16, Rgba16};
        matches!(self.decoder.color_type(), L16 | La16 | Rgb16 | Rgba16)
    }

    /// Returns true where its values are grey.
    pub fn is_grey(&self) -> bool {
        !self.decoder.color_type().has_color()
    }

    /// Refuses a JPEG file that ends within its image, which its decoder would fill with grey.
    fn refuse_cut_off(&self) -> Result<(), StoreError> {
        if self.format != FileFormat::Jpeg {
            return Ok(());
        }
        let bytes = fs::read(self.path).map_err(|source| StoreError::read(self.path, source))?;
        match jpeg_ends(&bytes) {
            true => Ok(()),
            false => Err(StoreError::malformed(
                self.path,
                "not a usable image: its data end before its last row",
            )),
        }
    }

    /// Returns true where its EXIF data ask for a rotation or a mirror image.
    ///
    /// # Errors
    /// When its EXIF data cannot be read.
    pub(crate) fn is_turned(&mut self) -> Result<bool, StoreError> {
        Ok(self.orientation()? != Orientation::NoTransforms)
    }

    fn orientation(&mut self) -> Result<Orientation, StoreError> {
        let orientation = self.decoder.orientation();
        orientation.map_err(|error| unusable(self.path, &error))
    }

    /// Returns the path of the file.
    pub(crate) fn path(&self) -> &'a Path {
        self.path
    }

    /// Returns the meaning of its values.
    pub(crate) fn format(&self) -> FileFormat {
        self.format
    }

    /// Refuses an image that is not `width` x `height` pixels.
    ///
    /// # Errors
    /// When the sizes differ; names the file and both sizes.
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

    /// Decodes the pixels as stored.
    ///
    /// # Errors
    /// When they are damaged.
    pub fn decode(self) -> Result<DynamicImage, StoreError> {
        self.refuse_cut_off()?;
        DynamicImage::from_decoder(self.decoder).map_err(|error| unusable(self.path, &error))
    }

    /// Decodes 8-bit RGB by [`plain_rgb8`].
    ///
    /// # Errors
    /// Those of [`plain_rgb8`].
    pub fn decode_plain(self) -> Result<Vec<u8>, StoreError> {
        self.refuse_cut_off()?;
        plain_rgb8(self.decoder)
            .map_err(|error| StoreError::malformed(self.path, error.to_string()))
    }

    /// Decodes the image as viewers show it.
    ///
    /// # Errors
    /// When it is damaged.
    pub fn decode_shown(mut self) -> Result<ShownImage, StoreError> {
        let orientation = self.orientation()?;
        let mut image = self.decode()?;
        image.apply_orientation(orientation);
        Ok(shown(image, orientation))
    }

    /// Decodes the image without the rotation that its EXIF data ask for.
    ///
    /// # Errors
    /// When it is damaged.
    pub fn decode_stored(mut self) -> Result<ShownImage, StoreError> {
        let orientation = self.orientation()?;
        Ok(shown(self.decode()?, orientation))
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

/// Returns the pixels of an image whose EXIF data ask for a rotation.
fn shown(image: DynamicImage, orientation: Orientation) -> ShownImage {
    let [width, height] = [image.width(), image.height()].map(|side| side as usize);
    let transparent = transparent_pixels(&image).map(|data| Mask::new(width, height, data));
    let mut rgb = image.into_rgb8().into_raw();
    if let Some(mask) = &transparent {
        let pixels = rgb.as_chunks_mut::<3>().0.iter_mut().zip(&mask.data);
        for (pixel, _) in pixels.filter(|(_, mark)| **mark != 0) {
            *pixel = [0; 3];
        }
    }
    ShownImage {
        size: [width, height],
        rgb,
        transparent,
        is_turned: orientation != Orientation::NoTransforms,
    }
}

/// Returns 255 for every pixel that is not opaque and 0 for the others; `None` where all are opaque.
fn transparent_pixels(image: &DynamicImage) -> Option<Vec<u8>> {
    let mark = |is_opaque: bool| if is_opaque { 0 } else { u8::MAX };
    let marks: Vec<u8> = match image {
        DynamicImage::ImageLumaA8(image) => (image.pixels())
            .map(|&LumaA([_, alpha])| mark(alpha == u8::MAX))
            .collect(),
        DynamicImage::ImageLumaA16(image) => (image.pixels())
            .map(|&LumaA([_, alpha])| mark(alpha == u16::MAX))
            .collect(),
        DynamicImage::ImageRgba8(image) => (image.pixels())
            .map(|&Rgba([_, _, _, alpha])| mark(alpha == u8::MAX))
            .collect(),
        DynamicImage::ImageRgba16(image) => (image.pixels())
            .map(|&Rgba([_, _, _, alpha])| mark(alpha == u16::MAX))
            .collect(),
        // Neither PNG nor JPEG files have other kinds of alpha channels.
        _ => return None,
    };
    marks.iter().any(|&mark| mark != 0).then_some(marks)
}

pub(crate) fn unusable(path: &Path, error: &impl std::fmt::Display) -> StoreError {
    StoreError::malformed(path, format!("not a usable image: {error}"))
}
