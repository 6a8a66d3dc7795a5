//! Masks of others: the marked pixels of a file, by its kind.
//!
//! | file | marked |
//! |---|---|
//! | grey with white, soft edges too; 1, 2, 4, 8 and 16 bits | above half of the range |
//! | grey, nothing above half of the range | labels: all but 0 |
//! | grey, some above half, none near white | above half of the range |
//! | palette | by index: all but 0; a palette of greys by its greys |
//! | colours | all but black |
//! | alpha over one colour | the alpha, as grey |
//!
//! Only the first row is certain; [`MaskEncoding::assumption`] names the assumptions of the others. JPEG files keep
//! no labels: above half of the range is marked there, and a file that is dark all over without being black is
//! refused. An alpha channel and colours that mark different pixels are refused too.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{borrow::Cow, fs::File, io::BufReader, path::Path};

use image::DynamicImage;

use crate::{
    image_file::{self, FileFormat, ImageFile, NotPlain},
    mask::Mask,
    store::StoreError,
};

/// Rule by which a mask's file was read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum MaskEncoding {
    /// White on black, with soft edges at most.
    BlackAndWhite,
    /// Greys without white.
    WithoutWhite,
    /// Small numbers of objects or classes.
    Labels,
    /// Indices of a palette.
    Palette,
    /// Colours of objects.
    Colours,
    /// An alpha channel over a single colour.
    Alpha,
}

impl MaskEncoding {
    /// Returns the assumption about such a file, for a report; `None` without one.
    pub fn assumption(self) -> Option<&'static str> {
        match self {
            Self::BlackAndWhite => None,
            Self::WithoutWhite => {
                Some("as greys without white (what is above half of their range is marked)")
            }
            Self::Labels => Some("as labels (every value but 0 is marked)"),
            Self::Palette => Some("by the index in their palette (every one but 0 is marked)"),
            Self::Colours => Some("as colours (all but black is marked)"),
            Self::Alpha => Some("by their alpha channel (what is opaque is marked)"),
        }
    }
}

/// Greys that count as marked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MarkedGreys {
    /// Those above half of the range, in files that have any: masks with soft edges.
    AboveHalf,
    /// All except black: the rule of tools whose masks mark the pixels to use.
    NotBlack,
}

/// Mask and the rule by which it was read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DecodedMask {
    /// Mask of the file.
    pub mask: Mask,
    /// Rule by which it was read.
    pub encoding: MaskEncoding,
}

/// Decodes a mask whose size has been checked.
///
/// # Errors
/// When it is damaged, asks by its EXIF data for a rotation, or marks pixels in two ways that differ.
pub fn decode(mut file: ImageFile<'_>, greys: MarkedGreys) -> Result<DecodedMask, StoreError> {
    let (path, [width, height]) = (file.path(), file.size());
    let malformed = |reason: String| StoreError::malformed(path, reason);
    if file.is_turned()? {
        return Err(malformed(NotPlain::Turned.to_string()));
    }
    let reader = Reader {
        greys,
        is_lossy: file.format() == FileFormat::Jpeg,
    };
    let marks = match file.format() {
        FileFormat::PalettePng => reader.of_palette(&PaletteImage::read(path, [width, height])?),
        FileFormat::Jpeg | FileFormat::Png => reader.of_image(file.decode()?),
    };
    let (data, encoding) = marks.map_err(|reason| malformed(reason.to_owned()))?;
    Ok(DecodedMask {
        mask: Mask::new(width, height, data),
        encoding,
    })
}

/// Byte per pixel, 0 or 255, with the rule; or the reason for a refusal.
type Marks = Result<(Vec<u8>, MaskEncoding), &'static str>;

const DARK_JPEG: &str =
    "is a dark JPEG without white, which holds neither a mask nor labels; save it as PNG";
const AMBIGUOUS_ALPHA: &str =
    "has an alpha channel and colours that mark different pixels; save the mask without alpha";

/// Values of a channel, of which the largest is white or opaque.
trait Value: Copy + PartialEq {
    const FULL: u32;
    fn number(self) -> u32;
}

impl Value for u8 {
    const FULL: u32 = 0xff;
    fn number(self) -> u32 {
        self.into()
    }
}

impl Value for u16 {
    const FULL: u32 = 0xffff;
    fn number(self) -> u32 {
        self.into()
    }
}

/// Returns the largest value that is not above half.
const fn half(full: u32) -> u32 {
    full >> 1
}

struct Reader {
    greys: MarkedGreys,
    is_lossy: bool,
}

impl Reader {
    fn of_image(&self, image: DynamicImage) -> Marks {
        match image {
            DynamicImage::ImageLuma8(image) => self.of_greys(image.as_raw()),
            DynamicImage::ImageLuma16(image) => self.of_greys(image.as_raw()),
            DynamicImage::ImageLumaA8(image) => self.of_greys_with_alpha(image.as_raw()),
            DynamicImage::ImageLumaA16(image) => self.of_greys_with_alpha(image.as_raw()),
            DynamicImage::ImageRgb16(image) => self.of_colours(image.as_raw().as_chunks::<3>().0),
            DynamicImage::ImageRgba8(image) => self.of_colours_with_alpha(image.as_raw()),
            DynamicImage::ImageRgba16(image) => self.of_colours_with_alpha(image.as_raw()),
            image => self.of_colours(image.into_rgb8().as_raw().as_chunks::<3>().0),
        }
    }

    fn of_greys<T: Value>(&self, values: &[T]) -> Marks {
        let largest = values.iter().map(|value| value.number()).max().unwrap_or(0);
        // Sixteen steps of 8 bits below white: JPEG does not keep it exactly.
        let nearly_white = T::FULL.saturating_sub(T::FULL >> 4);
        let encoding = match largest {
            0 => MaskEncoding::BlackAndWhite,
            dark if dark <= half(T::FULL) && self.is_lossy => return Err(DARK_JPEG),
            dark if dark <= half(T::FULL) => MaskEncoding::Labels,
            _ if self.greys == MarkedGreys::NotBlack => MaskEncoding::BlackAndWhite,
            grey if grey < nearly_white => MaskEncoding::WithoutWhite,
            _ => MaskEncoding::BlackAndWhite,
        };
        let keeps_all = self.greys == MarkedGreys::NotBlack && !self.is_lossy;
        let above = match encoding {
            MaskEncoding::Labels => 0,
            _ if keeps_all => 0,
            _ => half(T::FULL),
        };
        Ok((marked(values, |value| value.number() > above), encoding))
    }

    fn of_colours<T: Value>(&self, pixels: &[[T; 3]]) -> Marks {
        if pixels.iter().all(|[r, g, b]| r == g && g == b) {
            let greys: Vec<T> = pixels.iter().map(|[grey, ..]| *grey).collect();
            return self.of_greys(&greys);
        }
        let brightest = |pixel: &[T; 3]| pixel.map(T::number).into_iter().max().unwrap_or(0);
        let above = if self.is_lossy { half(T::FULL) } else { 0 };
        if !pixels.iter().any(|pixel| brightest(pixel) > above) {
            return Err(DARK_JPEG);
        }
        let data = marked(pixels, |pixel| brightest(&pixel) > above);
        Ok((data, MaskEncoding::Colours))
    }

    fn of_greys_with_alpha<T: Value>(&self, values: &[T]) -> Marks {
        let (pixels, _) = values.as_chunks::<2>();
        let colours: Vec<[T; 3]> = pixels.iter().map(|[grey, _]| [*grey; 3]).collect();
        let alphas: Vec<T> = pixels.iter().map(|[_, alpha]| *alpha).collect();
        self.of_colours_under(&colours, &alphas)
    }

    fn of_colours_with_alpha<T: Value>(&self, values: &[T]) -> Marks {
        let (pixels, _) = values.as_chunks::<4>();
        let colours: Vec<[T; 3]> = pixels.iter().map(|[r, g, b, _]| [*r, *g, *b]).collect();
        let alphas: Vec<T> = pixels.iter().map(|[.., alpha]| *alpha).collect();
        self.of_colours_under(&colours, &alphas)
    }

    fn of_colours_under<T: Value>(&self, colours: &[[T; 3]], alphas: &[T]) -> Marks {
        if alphas.iter().all(|alpha| alpha.number() == T::FULL) {
            return self.of_colours(colours);
        }
        let (by_alpha, _) = self.of_greys(alphas)?;
        let is_constant = colours.iter().all(|colour| Some(colour) == colours.first());
        let varies = alphas.iter().any(|alpha| Some(alpha) != alphas.first());
        let is_clear = alphas.iter().all(|alpha| alpha.number() == 0);
        if is_constant && (varies || is_clear) {
            return Ok((by_alpha, MaskEncoding::Alpha));
        }
        match self.of_colours(colours)? {
            (by_colour, encoding) if by_colour == by_alpha => Ok((by_colour, encoding)),
            _ => Err(AMBIGUOUS_ALPHA),
        }
    }

    fn of_palette(&self, image: &PaletteImage) -> Marks {
        let used = image.used_entries();
        let hidden = || used.iter().filter(|entry| !entry.is_opaque);
        // The background may be transparent: its index marks the same.
        if hidden().any(|entry| entry.index != 0) {
            return Err(AMBIGUOUS_ALPHA);
        }
        if used.iter().all(|entry| entry.colour == [entry.index; 3]) {
            return self.of_greys(&image.indices);
        }
        if hidden().next().is_none()
            && let Some(white) = image.white_on_black(&used)
        {
            let data = marked(&image.indices, |index| index == white);
            return Ok((data, MaskEncoding::BlackAndWhite));
        }
        let data = marked(&image.indices, |index| index != 0);
        Ok((data, MaskEncoding::Palette))
    }
}

fn marked<T: Copy>(pixels: &[T], is_marked: impl Fn(T) -> bool) -> Vec<u8> {
    let marks = pixels.iter().map(|&pixel| is_marked(pixel));
    marks.map(|mark| if mark { u8::MAX } else { 0 }).collect()
}

/// Indices of a PNG file, with their palette.
struct PaletteImage {
    indices: Vec<u8>,
    colours: Vec<[u8; 3]>,
    /// Opacities of the first entries; the others are opaque.
    alphas: Vec<u8>,
}

/// Entry of a palette that pixels use.
struct UsedEntry {
    index: u8,
    /// Colour; black where the palette has no such entry.
    colour: [u8; 3],
    is_opaque: bool,
}

const BLACK: [u8; 3] = [0; 3];
const WHITE: [u8; 3] = [u8::MAX; 3];

impl PaletteImage {
    fn read(path: &Path, size: [usize; 2]) -> Result<Self, StoreError> {
        let unusable = |error: png::DecodingError| image_file::unusable(path, &error);
        let file = File::open(path).map_err(|source| StoreError::read(path, source))?;
        let mut reader = png::Decoder::new(BufReader::new(file))
            .read_info()
            .map_err(unusable)?;
        let info = reader.info();
        let shifts: &[u32] = match info.bit_depth {
            png::BitDepth::One => &[7, 6, 5, 4, 3, 2, 1, 0],
            png::BitDepth::Two => &[6, 4, 2, 0],
            png::BitDepth::Four => &[4, 0],
            png::BitDepth::Eight | png::BitDepth::Sixteen => &[0],
        };
        let lowest_bits = match info.bit_depth {
            png::BitDepth::One => 0b1,
            png::BitDepth::Two => 0b11,
            png::BitDepth::Four => 0b1111,
            png::BitDepth::Eight | png::BitDepth::Sixteen => u8::MAX,
        };
        let colours = info.palette.as_deref().unwrap_or_default();
        let (colours, alphas) = (colours.as_chunks::<3>().0.to_vec(), info.trns.clone());
        let is_as_before = [info.width as usize, info.height as usize] == size;
        let length = reader.output_buffer_size().filter(|_| is_as_before);
        let length =
            length.ok_or_else(|| StoreError::malformed(path, "changes while it is read"))?;
        let mut packed = vec![0; length];
        let row = reader.next_frame(&mut packed).map_err(unusable)?.line_size;
        let [width, height] = size;
        let unpacked = |byte: &u8| {
            let byte = *byte;
            shifts
                .iter()
                .map(move |&shift| byte.wrapping_shr(shift) & lowest_bits)
        };
        let rows = packed.chunks(row.max(1)).take(height);
        let indices: Vec<u8> = rows
            .flat_map(|row| row.iter().flat_map(unpacked).take(width))
            .collect();
        if indices.len() != width.saturating_mul(height) {
            return Err(StoreError::malformed(
                path,
                "has fewer pixels than it states",
            ));
        }
        Ok(Self {
            indices,
            colours,
            alphas: alphas.map(Cow::into_owned).unwrap_or_default(),
        })
    }

    fn used_entries(&self) -> Vec<UsedEntry> {
        let mut is_used = [false; 256];
        for &index in &self.indices {
            if let Some(used) = is_used.get_mut(usize::from(index)) {
                *used = true;
            }
        }
        let used = (0..=u8::MAX).zip(is_used).filter(|(_, is_used)| *is_used);
        used.map(|(index, _)| {
            let at = usize::from(index);
            UsedEntry {
                index,
                colour: self.colours.get(at).copied().unwrap_or(BLACK),
                is_opaque: self.alphas.get(at).is_none_or(|&alpha| alpha == u8::MAX),
            }
        })
        .collect()
    }

    /// Returns the index of white in an image that programs have made of black and white, in either order; `None` for
    /// others.
    fn white_on_black(&self, used: &[UsedEntry]) -> Option<u8> {
        let is_palette = match self.colours.as_slice() {
            [one] => *one == WHITE,
            [one, other] => [*one, *other] == [BLACK, WHITE] || [*one, *other] == [WHITE, BLACK],
            _ => false,
        };
        let is_used = match used {
            [one, other] => {
                [one.colour, other.colour] == [BLACK, WHITE]
                    || [one.colour, other.colour] == [WHITE, BLACK]
            }
            _ => false,
        };
        let of_palette = self.colours.iter().position(|colour| *colour == WHITE);
        let of_used = used.iter().find(|entry| entry.colour == WHITE);
        match (is_palette, is_used) {
            (true, _) => of_palette.and_then(|index| u8::try_from(index).ok()),
            (false, true) => of_used.map(|entry| entry.index),
            (false, false) => None,
        }
    }
}
