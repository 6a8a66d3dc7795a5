//! SOG, the quantized Gaussians of `PlayCanvas`: version 2, a ZIP archive or a folder of `meta.json` and images.
//!
//! ```text
//! means_l, means_u   rgb    lower and upper bytes of x, y, z: 16 bits between bounds of sign(v) ln(1 + |v|)
//! quats              rgb    three values of a quaternion as 255 (q / sqrt(2) + 1/2)
//!                    alpha  252 and the number of the largest, left-out value among w, x, y, z
//! scales             rgb    numbers of log sizes in a codebook
//! sh0                rgb    numbers of constant coefficients in a codebook
//!                    alpha  opacity, of 255
//! shN_labels         rg     lower and upper byte of the number of a row in the palette of harmonics
//! shN_centroids      rgb    the palette, 64 rows of 3, 8 or 15 pixels a line: numbers in a codebook
//! ```
//!
//! Pixels are Gaussians from the upper left on, line by line, in WebP without loss. Axes are those of the PLY. The
//! description is [that of `PlayCanvas`](https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/sog).
//! Gaussians are ordered along a curve through space, so that images are small.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

mod archive;
mod images;
mod reading;
mod record;

use std::f32::consts::{FRAC_1_SQRT_2, SQRT_2};

use omnilife_engine::gaussians::{ActivatedGaussians, sh_rest_count};

use self::{
    archive::bundled,
    images::MOST_SIDE,
    record::{Asset, CodedValues, Harmonics, Means, Record, Rotations},
};
use super::codebook::{Codebook, Palette};
use crate::seeds::points::morton_code;

pub(super) use self::reading::read;

/// Name of the record, in an archive and in a folder.
pub(super) const RECORD_FILE: &str = "meta.json";
/// Rows of the palette beside each other in its image.
const ROWS_A_LINE: usize = 64;
/// Number of the mode in which the first value of a quaternion is the largest.
const FIRST_MODE: u8 = 252;
/// Maximum and minimum number of rows of the palette, and of Gaussians that share a row between them.
const MOST_ROWS: usize = 65_536;
const LEAST_ROWS: usize = 1024;
const GAUSSIANS_A_ROW: usize = 16;
/// Maximum of 16 bits.
const MOST_STEPS: f64 = 65_535.0;
/// Bounds of log sizes, those of floats.
const LOG_SIZES: [f32; 2] = [-87.0, 88.0];

/// Returns a coordinate on a logarithmic scale that keeps its sign.
fn folded(value: f32) -> f64 {
    let value = f64::from(value);
    value.signum() * value.abs().ln_1p()
}

/// Undoes [`folded`].
fn unfolded(value: f64) -> f64 {
    value.signum() * value.abs().exp_m1()
}

/// Names of the images.
const IMAGES: [&str; 7] = [
    "means_l.webp",
    "means_u.webp",
    "quats.webp",
    "scales.webp",
    "sh0.webp",
    "shN_centroids.webp",
    "shN_labels.webp",
];

pub(super) fn write(gaussians: &ActivatedGaussians) -> Result<Vec<u8>, String> {
    let size = image_size(gaussians.len())?;
    let mut order: Vec<usize> = (0..gaussians.len()).collect();
    order.sort_by_cached_key(|&index| morton_code(at(&gaussians.positions, index)));
    let image = |pixel: &dyn Fn(usize) -> [u8; 4]| {
        let mut pixels: Vec<[u8; 4]> = order.iter().map(|&index| pixel(index)).collect();
        pixels.resize(size[0].saturating_mul(size[1]), [0, 0, 0, 255]);
        images::written(&pixels, size)
    };
    let [lower, upper, rotations, sizes, colours, palette, labels] = IMAGES;
    let named = str::to_owned;

    let bounds = Bounds::of(&gaussians.positions);
    let byte_of_places = |byte: fn([u8; 2]) -> u8| {
        image(&|index| {
            let [x, y, z] = bounds.steps(at(&gaussians.positions, index));
            let [x, y, z] = [x, y, z].map(|steps| byte(steps.to_le_bytes()));
            [x, y, z, 255]
        })
    };
    let log_sizes: Vec<[f32; 3]> = (gaussians.scales.iter())
        .map(|scales| scales.map(|scale| scale.ln().clamp(LOG_SIZES[0], LOG_SIZES[1])))
        .collect();
    let size_codes = Codebook::of(log_sizes.as_flattened());
    let colour_codes = Codebook::of(gaussians.sh_constant.as_flattened());
    let mut files = vec![
        (lower, byte_of_places(|[lower, _]| lower)?),
        (upper, byte_of_places(|[_, upper]| upper)?),
        (
            rotations,
            image(&|index| packed(at(&gaussians.rotations, index)))?,
        ),
        (
            sizes,
            image(&|index| {
                let [x, y, z] = at(&log_sizes, index).map(|log| size_codes.nearest(log));
                [x, y, z, 255]
            })?,
        ),
        (
            colours,
            image(&|index| {
                let colour = at(&gaussians.sh_constant, index);
                let [r, g, b] = colour.map(|value| colour_codes.nearest(value));
                let opacity = 255.0 * at(&gaussians.opacities, index);
                [r, g, b, opacity.round() as u8]
            })?,
        ),
    ];
    let mut harmonics = None;
    if gaussians.sh_degree > 0 {
        let written = harmonics_of(gaussians)?;
        let label = |index: usize| {
            let [lower, upper] = at(&written.labels, index).to_le_bytes();
            [lower, upper, 0, 255]
        };
        files.push((palette, written.image));
        files.push((labels, image(&label)?));
        harmonics = Some(Harmonics {
            count: written.rows as u64,
            bands: gaussians.sh_degree,
            codebook: written.codebook,
            files: [palette, labels].map(named),
        });
    }
    let record = Record {
        version: record::VERSION,
        asset: Asset {
            generator: "omnilife".to_owned(),
        },
        count: gaussians.len() as u64,
        antialias: false,
        means: Means {
            mins: bounds.least,
            maxs: bounds.largest,
            files: [lower, upper].map(named),
        },
        scales: CodedValues {
            codebook: size_codes.values,
            files: [sizes].map(named),
        },
        quats: Rotations {
            files: [rotations].map(named),
        },
        sh0: CodedValues {
            codebook: colour_codes.values,
            files: [colours].map(named),
        },
        harmonics,
    };
    let record = serde_json::to_vec(&record).map_err(|error| error.to_string())?;
    files.insert(0, (RECORD_FILE, record));
    bundled(&files)
}

/// Returns an entry of an array with one per Gaussian.
#[expect(
    clippy::indexing_slicing,
    reason = "indices are those of Gaussians that are there"
)]
fn at<T: Copy>(values: &[T], index: usize) -> T {
    values[index]
}

/// Returns the width and height of images of so many pixels: nearly square, multiples of 4.
fn image_size(len: usize) -> Result<[usize; 2], String> {
    let width = len.isqrt().saturating_add(1).next_multiple_of(4);
    let height = len.div_ceil(width).max(1).next_multiple_of(4);
    if width.max(height) > MOST_SIDE {
        return Err(format!(
            "has {len} Gaussians, and images of SOG are {MOST_SIDE} pixels wide and high at most"
        ));
    }
    Ok([width, height])
}

/// Bounds of positions on their logarithmic scale.
struct Bounds {
    least: [f64; 3],
    largest: [f64; 3],
}

impl Bounds {
    fn of(positions: &[[f32; 3]]) -> Self {
        let bound = |from: f64, choose: fn(f64, f64) -> f64| {
            positions.iter().fold([from; 3], |[a, b, c], place| {
                let [x, y, z] = place.map(folded);
                [choose(a, x), choose(b, y), choose(c, z)]
            })
        };
        Self {
            least: bound(f64::INFINITY, f64::min),
            largest: bound(f64::NEG_INFINITY, f64::max),
        }
    }

    /// Returns a position in steps of 65,535 between the bounds.
    fn steps(&self, position: [f32; 3]) -> [u16; 3] {
        let ([a, b, c], [d, e, f]) = (self.least, self.largest);
        let [x, y, z] = position.map(folded);
        [[a, d, x], [b, e, y], [c, f, z]].map(|[least, largest, value]| {
            if largest > least {
                (MOST_STEPS * (value - least) / (largest - least)).round() as u16
            } else {
                0
            }
        })
    }
}

/// Packs a unit quaternion (w, x, y, z).
fn packed(quaternion: [f32; 4]) -> [u8; 4] {
    let (mut mode, mut largest) = (0_u8, 0.0_f32);
    for (number, value) in (0..).zip(quaternion) {
        if value.abs() > largest.abs() {
            (mode, largest) = (number, value);
        }
    }
    // A quaternion and its opposite are one rotation: the largest value is positive.
    let scale = FRAC_1_SQRT_2 * largest.signum();
    let others = (0..).zip(quaternion).filter(|(number, _)| *number != mode);
    let mut bytes =
        others.map(|(_, value)| (255.0 * (scale * value + 0.5)).round().clamp(0.0, 255.0) as u8);
    let [a, b, c] = [(); 3].map(|()| bytes.next().unwrap_or_default());
    [a, b, c, FIRST_MODE.saturating_add(mode)]
}

/// Unpacks a quaternion (w, x, y, z); `None` for a pixel of no rotation.
fn unpacked([a, b, c, mode]: [u8; 4]) -> Option<[f32; 4]> {
    let largest = mode.checked_sub(FIRST_MODE)?;
    let mut others = [a, b, c]
        .into_iter()
        .map(|byte| SQRT_2 * (f32::from(byte) / 255.0 - 0.5));
    let mut quaternion = [0, 1, 2, 3].map(|number| {
        if number == largest {
            0.0
        } else {
            others.next().unwrap_or_default()
        }
    });
    let squares: f32 = quaternion.iter().map(|value| value * value).sum();
    if let Some(value) = quaternion.get_mut(usize::from(largest)) {
        *value = (1.0 - squares).max(0.0).sqrt();
    }
    Some(quaternion)
}

struct WrittenHarmonics {
    rows: usize,
    codebook: Vec<f32>,
    labels: Vec<u16>,
    image: Vec<u8>,
}

fn harmonics_of(gaussians: &ActivatedGaussians) -> Result<WrittenHarmonics, String> {
    let coefficients = sh_rest_count(gaussians.sh_degree);
    let most = gaussians.len().div_ceil(GAUSSIANS_A_ROW);
    let palette = Palette::of(
        gaussians.sh_rest.as_flattened(),
        coefficients.saturating_mul(3),
        most.clamp(LEAST_ROWS, MOST_ROWS),
    );
    let codebook = Codebook::of(&palette.values);
    let mut pixels: Vec<[u8; 4]> = (palette.values.as_chunks::<3>().0.iter())
        .map(|rgb| {
            let [r, g, b] = rgb.map(|value| codebook.nearest(value));
            [r, g, b, 255]
        })
        .collect();
    let rows = pixels.len().div_ceil(coefficients);
    let size = [
        coefficients.saturating_mul(ROWS_A_LINE),
        rows.div_ceil(ROWS_A_LINE),
    ];
    pixels.resize(size[0].saturating_mul(size[1]), [0, 0, 0, 255]);
    Ok(WrittenHarmonics {
        rows,
        image: images::written(&pixels, size)?,
        codebook: codebook.values,
        labels: palette.labels,
    })
}

#[cfg(test)]
mod tests;
