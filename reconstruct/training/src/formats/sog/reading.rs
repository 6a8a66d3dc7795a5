//! Reading of the images with their record.

use std::{
    borrow::Cow,
    fs,
    path::{Component, Path},
};

use omnilife_engine::{
    gaussians::{MAX_SH_DEGREE, sh_rest_count},
    parameters::ParameterTable,
};
use omnilife_schemas::{records::InvalidGaussians, store::StoreError};

use super::{
    MOST_STEPS, RECORD_FILE, ROWS_A_LINE,
    archive::Archive,
    images,
    record::{Harmonics, Means, Record},
    unfolded, unpacked,
};
use crate::{
    error::ReconstructError,
    formats::{
        exchange::{self, FileRows},
        validity::FileGaussian,
    },
};

/// Pixels that an image may have beyond twice its Gaussians; programs fill up its last lines.
const MOST_EMPTY_PIXELS: usize = 1 << 16;

/// Reads Gaussians in units of the file: an archive, or the record of a folder with its images beside it.
pub(in crate::formats) fn read(
    path: &Path,
    bytes: &[u8],
    invalid: &mut InvalidGaussians,
) -> Result<ParameterTable, ReconstructError> {
    let malformed = |reason: String| StoreError::malformed(path, reason);
    let is_record = path.file_name().is_some_and(|name| name == RECORD_FILE);
    let files = if is_record {
        Files::Folder(path.parent().unwrap_or(Path::new("")))
    } else {
        Files::Archive(Archive::open(bytes).map_err(malformed)?)
    };
    let record = match &files {
        Files::Folder(_) => Record::parse(bytes),
        Files::Archive(archive) => archive
            .file(RECORD_FILE)
            .and_then(|file| Record::parse(&file)),
    };
    let record = record.map_err(malformed)?;
    let degree = record
        .harmonics
        .as_ref()
        .map_or(0, |harmonics| harmonics.bands);
    if degree > MAX_SH_DEGREE {
        let reason = format!(
            "has harmonics of degree {degree}, and {MAX_SH_DEGREE} is the highest that is read"
        );
        return Err(malformed(reason).into());
    }
    // Images are decoded into memory: the number in the record has to fit before.
    exchange::require(path, record.count, degree)?;
    let images = Images::decode(&files, &record, degree).map_err(malformed)?;
    let len = record.count as usize;
    invalid.is_antialiased |= record.antialias;
    let mut gathered = FileRows::new(path, len, degree, invalid)?;
    let mut harmonics = Vec::with_capacity(sh_rest_count(degree));
    for number in 0..len {
        let gaussian = images.gaussian(&record, number);
        let (gaussian, colour) = gaussian.map_err(malformed)?;
        images
            .harmonics(&record, number, &mut harmonics)
            .map_err(malformed)?;
        gathered
            .push(&gaussian, colour, &harmonics)
            .map_err(malformed)?;
    }
    Ok(gathered.into_table())
}

/// Files that a record names.
enum Files<'a> {
    Archive(Archive<'a>),
    Folder(&'a Path),
}

impl Files<'_> {
    fn read(&self, name: &str) -> Result<Cow<'_, [u8]>, String> {
        match self {
            Self::Archive(archive) => archive.file(name),
            Self::Folder(folder) => {
                let mut parts = Path::new(name).components();
                let (Some(Component::Normal(_)), None) = (parts.next(), parts.next()) else {
                    return Err(format!("names {name:?}, which must be a file beside it"));
                };
                let bytes = fs::read(folder.join(name));
                bytes
                    .map(Cow::Owned)
                    .map_err(|error| format!("names {name}: {error}"))
            }
        }
    }

    /// Decodes an image of at least so many pixels, but not many more, of a given width or any.
    fn image(
        &self,
        name: &str,
        least: usize,
        width: Option<usize>,
    ) -> Result<Vec<[u8; 4]>, String> {
        let bytes = self.read(name)?;
        let check = |[found, height]: [usize; 2]| {
            let pixels = found.saturating_mul(height);
            let most = least.saturating_mul(2).saturating_add(MOST_EMPTY_PIXELS);
            if (least..=most).contains(&pixels) && width.is_none_or(|width| width == found) {
                Ok(())
            } else {
                Err(format!(
                    "has {found}x{height} pixels, which does not fit to {least} values"
                ))
            }
        };
        images::pixels(&bytes, check).map_err(|reason| format!("{name}: {reason}"))
    }
}

/// Decoded images: a pixel per Gaussian.
struct Images {
    lower: Vec<[u8; 4]>,
    upper: Vec<[u8; 4]>,
    rotations: Vec<[u8; 4]>,
    sizes: Vec<[u8; 4]>,
    colours: Vec<[u8; 4]>,
    palette: Option<PaletteImages>,
}

/// The palette and its row for each Gaussian.
struct PaletteImages {
    pixels: Vec<[u8; 4]>,
    labels: Vec<[u8; 4]>,
    coefficients: usize,
}

impl Images {
    fn decode(files: &Files<'_>, record: &Record, degree: usize) -> Result<Self, String> {
        let len = record.count as usize;
        let image = |name: &str| files.image(name, len, None);
        let [lower, upper] = &record.means.files;
        let [rotations] = &record.quats.files;
        let [sizes] = &record.scales.files;
        let [colours] = &record.sh0.files;
        let palette = match &record.harmonics {
            Some(harmonics) if degree > 0 => Some(PaletteImages::decode(files, harmonics, len)?),
            _ => None,
        };
        Ok(Self {
            lower: image(lower)?,
            upper: image(upper)?,
            rotations: image(rotations)?,
            sizes: image(sizes)?,
            colours: image(colours)?,
            palette,
        })
    }

    /// Returns a Gaussian with the coefficients of the constant harmonic.
    fn gaussian(&self, record: &Record, number: usize) -> Result<(FileGaussian, [f32; 3]), String> {
        let pixel = |image: &[[u8; 4]]| image.get(number).copied().unwrap_or_default();
        let quaternion = unpacked(pixel(&self.rotations))
            .ok_or_else(|| format!("has no rotation for Gaussian {number}"))?;
        let of = |what: &str, codebook: &[f32], pixel: [u8; 4]| {
            coded(codebook, pixel).ok_or_else(|| format!("has no {what} for Gaussian {number}"))
        };
        let log_scales = of("size", &record.scales.codebook, pixel(&self.sizes))?;
        let colour = pixel(&self.colours);
        let [.., opacity] = colour;
        let opacity = f64::from(opacity) / 255.0;
        let gaussian = FileGaussian {
            position: place(&record.means, pixel(&self.lower), pixel(&self.upper)),
            log_scales: log_scales.map(f64::from),
            opacity_logit: (opacity / (1.0 - opacity)).ln(),
            quaternion: quaternion.map(f64::from),
        };
        Ok((gaussian, of("colour", &record.sh0.codebook, colour)?))
    }

    /// Looks a Gaussian's harmonics up.
    fn harmonics(
        &self,
        record: &Record,
        number: usize,
        found: &mut Vec<[f32; 3]>,
    ) -> Result<(), String> {
        found.clear();
        if let (Some(images), Some(harmonics)) = (&self.palette, &record.harmonics) {
            let row = images.row(number, harmonics.count);
            let row = row.ok_or_else(|| format!("has no harmonics for Gaussian {number}"))?;
            for pixel in row {
                let coefficient = coded(&harmonics.codebook, *pixel);
                found.push(coefficient.ok_or("has harmonics that are not in their codebook")?);
            }
        }
        Ok(())
    }
}

impl PaletteImages {
    fn decode(files: &Files<'_>, harmonics: &Harmonics, len: usize) -> Result<Self, String> {
        let [palette, labels] = &harmonics.files;
        let coefficients = sh_rest_count(harmonics.bands);
        // Labels have 16 bits.
        let rows = harmonics.count.min(1 << 16) as usize;
        let width = coefficients.saturating_mul(ROWS_A_LINE);
        let pixels = rows.div_ceil(ROWS_A_LINE).saturating_mul(width);
        Ok(Self {
            pixels: files.image(palette, pixels, Some(width))?,
            labels: files.image(labels, len, None)?,
            coefficients,
        })
    }

    /// Returns the pixels of a Gaussian's row.
    fn row(&self, number: usize, rows: u64) -> Option<&[[u8; 4]]> {
        let [lower, upper, ..] = *self.labels.get(number)?;
        let label = u16::from_le_bytes([lower, upper]);
        // Rows follow each other, as a line of the image is full of them.
        let at = usize::from(label).saturating_mul(self.coefficients);
        let row = self.pixels.get(at..)?.get(..self.coefficients)?;
        (u64::from(label) < rows).then_some(row)
    }
}

/// Returns the position in two pixels.
fn place(means: &Means, lower: [u8; 4], upper: [u8; 4]) -> [f64; 3] {
    let ([a, b, c, _], [d, e, f, _]) = (lower, upper);
    let steps = [[a, d], [b, e], [c, f]].map(|bytes| f64::from(u16::from_le_bytes(bytes)));
    let ([x, y, z], [u, v, w]) = (means.mins, means.maxs);
    let mut bounds = [[x, u], [y, v], [z, w]].into_iter();
    steps.map(|steps| {
        let [least, largest] = bounds.next().unwrap_or_default();
        let share = steps / MOST_STEPS;
        unfolded(least * (1.0 - share) + largest * share)
    })
}

/// Returns the values of a pixel's codes; `None` where the codebook lacks one.
fn coded(codebook: &[f32], [r, g, b, _]: [u8; 4]) -> Option<[f32; 3]> {
    let value = |code: u8| codebook.get(usize::from(code)).copied();
    Some([value(r)?, value(g)?, value(b)?])
}
