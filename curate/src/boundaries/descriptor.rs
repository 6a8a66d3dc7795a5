//! Descriptor of a frame for boundary detection: colours without places, and a layout without colours.
//!
//! Colours are HSV histograms of four latitude bands, rows weighted by the cosine of their latitude.
//! A camera that yaws moves colours along the bands and leaves the histograms as they are.

use opencv::{
    core::{Mat, MatTraitConst, MatTraitConstManual},
    imgproc,
};

use crate::video::Rgb8Image;

const BANDS: usize = 4;
const HUES: usize = 12;
const SATURATIONS: usize = 4;
const VALUES: usize = 8;
const BAND_BINS: usize = HUES * SATURATIONS * VALUES;
const LAYOUT_COLUMNS: usize = 32;
const LAYOUT_ROWS: usize = 16;
/// Length of a histogram of all bands.
pub(super) const HISTOGRAM_BINS: usize = BANDS * BAND_BINS;

/// Descriptor of a frame, kept while its neighbourhood passes by.
pub(super) struct Descriptor {
    pub(super) time_seconds: f64,
    /// Colour bins by band; the sum is 1.
    pub(super) histogram: Vec<f32>,
    /// Luminance thumbnail, every row with zero mean, of unit norm; all zero without such detail.
    pub(super) layout: Vec<f32>,
}

impl Descriptor {
    /// # Errors
    /// One line when an image operation fails.
    pub(super) fn of(time_seconds: f64, image: &Rgb8Image) -> Result<Self, String> {
        Ok(Self {
            time_seconds,
            histogram: band_histograms(image).map_err(|error| error.to_string())?,
            layout: luminance_layout(image),
        })
    }
}

/// Returns the share of weight that lies in other bins, 0 to 1: half the L1 distance.
pub(super) fn distance(a: &[f32], b: &[f32]) -> f32 {
    0.5 * a.iter().zip(b).map(|(x, y)| (x - y).abs()).sum::<f32>()
}

/// Returns the correlation of two layouts at the yaw between them that makes it largest: a camera that turned sees the
/// same place. 1 for two without detail, 0 for one with and one without.
pub(super) fn correlation(a: &[f32], b: &[f32]) -> f32 {
    let is_flat = |layout: &[f32]| layout.iter().all(|&value| value == 0.0);
    if is_flat(a) && is_flat(b) {
        return 1.0;
    }
    (0..LAYOUT_COLUMNS)
        .map(|turn| {
            a.chunks_exact(LAYOUT_COLUMNS)
                .zip(b.chunks_exact(LAYOUT_COLUMNS))
                .map(|(a, b)| {
                    let (wrapped, rest) = a.split_at(turn);
                    product(rest, &b[..rest.len()]) + product(wrapped, &b[rest.len()..])
                })
                .sum()
        })
        .fold(f32::NEG_INFINITY, f32::max)
}

fn product(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

fn band_histograms(image: &Rgb8Image) -> opencv::Result<Vec<f32>> {
    let rgb = Mat::from_slice(&image.data)?;
    let rgb = rgb.reshape(3, image.height as i32)?;
    let mut hsv = Mat::default();
    imgproc::cvt_color_def(&rgb, &mut hsv, imgproc::COLOR_RGB2HSV)?;
    let pixels = hsv.data_bytes()?;
    let mut histogram = vec![0.0_f32; HISTOGRAM_BINS];
    for (y, row) in pixels.chunks_exact(image.width * 3).enumerate() {
        let latitude = (0.5 - (y as f64 + 0.5) / image.height as f64) * std::f64::consts::PI;
        let weight = latitude.cos() as f32;
        let band = y * BANDS / image.height;
        let bins = &mut histogram[band * BAND_BINS..(band + 1) * BAND_BINS];
        for &pixel in row.as_chunks::<3>().0 {
            add_softly(bins, pixel, weight);
        }
    }
    let total: f32 = histogram.iter().sum();
    if total > 0.0 {
        histogram.iter_mut().for_each(|value| *value /= total);
    }
    Ok(histogram)
}

/// Shares the weight of a pixel between the eight bins around its colour. So colours near the border of two bins do not
/// jump with noise or a slow change of light. Grey has no hue, and black no saturation either: their bins are shared by
/// all.
fn add_softly(bins: &mut [f32], [hue, saturation, value]: [u8; 3], weight: f32) {
    // OpenCV's 8-bit hue runs from 0 to 179, around the circle.
    let hue = f32::from(hue) / 180.0 * HUES as f32;
    let saturation = f32::from(saturation) / 255.0 * (SATURATIONS - 1) as f32;
    let value = f32::from(value) / 255.0 * (VALUES - 1) as f32;
    for (v, share_v) in neighbours(value) {
        for (s, share_s) in neighbours(saturation) {
            for (h, share_h) in neighbours(hue) {
                let h = if s == 0 || v == 0 { 0 } else { h % HUES };
                let s = if v == 0 { 0 } else { s };
                let share = share_v * share_s * share_h;
                if share > 0.0 {
                    bins[(h * SATURATIONS + s) * VALUES + v] += weight * share;
                }
            }
        }
    }
}

/// Returns the two bins around a position and their shares.
fn neighbours(position: f32) -> [(usize, f32); 2] {
    let below = position.floor();
    let share = position - below;
    [(below as usize, 1.0 - share), (below as usize + 1, share)]
}

fn luminance_layout(image: &Rgb8Image) -> Vec<f32> {
    let mut sums = vec![0.0_f32; LAYOUT_COLUMNS * LAYOUT_ROWS];
    let mut counts = vec![0.0_f32; LAYOUT_COLUMNS * LAYOUT_ROWS];
    for y in 0..image.height {
        for x in 0..image.width {
            let cell =
                y * LAYOUT_ROWS / image.height * LAYOUT_COLUMNS + x * LAYOUT_COLUMNS / image.width;
            let [red, green, blue] = image.pixel(x, y).map(f32::from);
            sums[cell] += 0.299 * red + 0.587 * green + 0.114 * blue;
            counts[cell] += 1.0;
        }
    }
    let mut cells: Vec<f32> = sums
        .iter()
        .zip(&counts)
        .map(|(sum, count)| sum / count.max(1.0))
        .collect();
    // Bright above and dark below is the layout of every outdoor shot; the variation of a latitude with longitude tells
    // them apart.
    for row in cells.chunks_exact_mut(LAYOUT_COLUMNS) {
        let mean = row.iter().sum::<f32>() / row.len() as f32;
        row.iter_mut().for_each(|cell| *cell -= mean);
    }
    let norm = cells.iter().map(|cell| cell * cell).sum::<f32>().sqrt();
    // Below one grey level of deviation per cell there is no layout, only noise.
    let scale = if norm < (cells.len() as f32).sqrt() {
        0.0
    } else {
        1.0 / norm
    };
    cells.iter_mut().for_each(|cell| *cell *= scale);
    cells
}
