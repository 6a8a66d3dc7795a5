//! Vehicles that touch each other in the image and are found as one: they are told apart by their colours.

use std::f64::consts::FRAC_PI_2;

use omnilife_schemas::RgbImage;

use super::{
    box_of,
    regions::{components, opened_and_closed},
};

/// What is smaller is one vehicle, square metres: a car has 8, and a van 12.
const LEAST_WHOLE: f64 = 14.0;
/// Least area of a part, square metres.
const LEAST_PART: f64 = 3.5;
/// Least share of the pixels that the parts keep.
const LEAST_KEPT: f64 = 0.6;
/// Parts differ in their mean colours by at least this, of [0, 1] per channel.
const LEAST_CONTRAST: f64 = 0.18;
/// Boxes of parts share at most this of the smaller: windows and roofs lie within their car.
const MOST_SHARED: f64 = 0.35;
/// As far apart in colour as this is as far apart as a car is long.
const COLOUR_UNIT: f64 = 0.25;
const CAR_METRES: f64 = 4.5;
const ROUNDS: usize = 12;
/// Darker pixels are of windows and of what is below a car, and say nothing of its colour; of [0, 1].
const DARK: f32 = 0.2;

/// The vehicles that a component's pixels are of; the component itself where it is one.
/// `pixel_area` is that of a pixel on the ground, square metres.
pub(super) fn parts(image: &RgbImage, pixels: &[usize], pixel_area: f64) -> Vec<Vec<usize>> {
    if pixels.len() as f64 * pixel_area >= LEAST_WHOLE {
        for count in [3, 2] {
            for across in [false, true] {
                if let Some(parts) = split(image, pixels, pixel_area, count, across) {
                    return parts;
                }
            }
        }
    }
    vec![pixels.to_vec()]
}

/// So many parts, one behind the other along the component or side by side `across` it; `None` where they
/// are not vehicles of different colours.
fn split(
    image: &RgbImage,
    pixels: &[usize],
    pixel_area: f64,
    count: usize,
    across: bool,
) -> Option<Vec<Vec<usize>>> {
    let features: Vec<[f64; 5]> = pixels
        .iter()
        .map(|&pixel| feature(image, pixel, pixel_area.sqrt()))
        .collect();
    let is_dark = |pixel: usize| {
        let colour = &image.data[3 * pixel..3 * pixel + 3];
        colour.iter().all(|&value| value < DARK)
    };
    let bright: Vec<[f64; 5]> = pixels
        .iter()
        .zip(&features)
        .filter(|&(&pixel, _)| !is_dark(pixel))
        .map(|(_, feature)| *feature)
        .collect();
    let centres = clustered(&bright, count, across)?;
    let labels: Vec<usize> = pixels
        .iter()
        .zip(&features)
        .map(|(&pixel, feature)| {
            // A dark pixel is of what it lies in.
            let axes = if is_dark(pixel) { 2 } else { 5 };
            nearest(&centres, &feature[..axes])
        })
        .collect();
    let mut parts = Vec::new();
    for label in 0..count {
        let mut mask = vec![false; image.data.len() / 3];
        let own = pixels.iter().zip(&labels).filter(|(_, of)| **of == label);
        own.for_each(|(&pixel, _)| mask[pixel] = true);
        let whole = opened_and_closed(&mask, image.width);
        let part = components(&whole, image.width)
            .into_iter()
            .max_by_key(Vec::len)?;
        if (part.len() as f64) * pixel_area < LEAST_PART {
            return None;
        }
        parts.push(part);
    }
    let kept: usize = parts.iter().map(Vec::len).sum();
    let are_apart = (0..count).all(|a| {
        (a + 1..count).all(|b| {
            contrast(image, &parts[a], &parts[b]) >= LEAST_CONTRAST
                && shared(image, &parts[a], &parts[b]) <= MOST_SHARED
        })
    });
    (are_apart && kept as f64 >= LEAST_KEPT * pixels.len() as f64).then_some(parts)
}

/// Place and colour of a pixel, in units of a car's length and of [`COLOUR_UNIT`].
fn feature(image: &RgbImage, pixel: usize, pixel_metres: f64) -> [f64; 5] {
    let place = [pixel % image.width, pixel / image.width];
    let [x, y] = place.map(|at| at as f64 * pixel_metres / CAR_METRES);
    let [r, g, b] =
        [0, 1, 2].map(|channel| f64::from(image.data[3 * pixel + channel]) / COLOUR_UNIT);
    [x, y, r, g, b]
}

/// Over the axes that both have.
fn squared_distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum()
}

/// The centre that is the nearest.
fn nearest(centres: &[[f64; 5]], feature: &[f64]) -> usize {
    let distance = |&number: &usize| squared_distance(&centres[number], feature);
    (0..centres.len())
        .min_by(|a, b| distance(a).total_cmp(&distance(b)))
        .unwrap_or(0)
}

/// The mean; `None` of nothing.
fn mean<'f>(features: impl Iterator<Item = &'f [f64; 5]>) -> Option<[f64; 5]> {
    let (mut sum, mut number) = ([0.0; 5], 0.0);
    for feature in features {
        (0..5).for_each(|axis| sum[axis] += feature[axis]);
        number += 1.0;
    }
    (number > 0.0).then(|| sum.map(|sum| sum / number))
}

/// Unit vector along which places are spread the most, or the least (`across`).
fn axis_of(features: &[[f64; 5]], across: bool) -> Option<[f64; 2]> {
    let middle = mean(features.iter())?;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for feature in features {
        let (x, y) = (feature[0] - middle[0], feature[1] - middle[1]);
        xx += x * x;
        xy += x * y;
        yy += y * y;
    }
    let angle = 0.5 * (2.0 * xy).atan2(xx - yy) + if across { FRAC_PI_2 } else { 0.0 };
    Some([angle.cos(), angle.sin()])
}

/// Centres by k-means that begins at shares of equal size along an axis of the component; `None` where a
/// cluster is empty.
fn clustered(features: &[[f64; 5]], count: usize, across: bool) -> Option<Vec<[f64; 5]>> {
    let [x, y] = axis_of(features, across)?;
    let mut along = features.to_vec();
    along.sort_by(|a, b| (x * a[0] + y * a[1]).total_cmp(&(x * b[0] + y * b[1])));
    let mut centres = along
        .chunks(along.len().div_ceil(count))
        .map(|share| mean(share.iter()))
        .collect::<Option<Vec<_>>>()?;
    if centres.len() < count {
        return None;
    }
    for _ in 0..ROUNDS {
        let labels: Vec<usize> = features
            .iter()
            .map(|feature| nearest(&centres, feature))
            .collect();
        for (number, centre) in centres.iter_mut().enumerate() {
            let own = features
                .iter()
                .zip(&labels)
                .filter(|(_, label)| **label == number);
            *centre = mean(own.map(|(feature, _)| feature))?;
        }
    }
    Some(centres)
}

/// Largest difference of the mean colours of two parts.
fn contrast(image: &RgbImage, one: &[usize], other: &[usize]) -> f64 {
    let mean = |pixels: &[usize], channel: usize| {
        let values = pixels
            .iter()
            .map(|&pixel| f64::from(image.data[3 * pixel + channel]));
        values.sum::<f64>() / pixels.len().max(1) as f64
    };
    (0..3)
        .map(|channel| (mean(one, channel) - mean(other, channel)).abs())
        .fold(0.0, f64::max)
}

/// Share of the smaller box that two parts' boxes have in common.
fn shared(image: &RgbImage, one: &[usize], other: &[usize]) -> f64 {
    let (Some(a), Some(b)) = (box_of(one, image.width), box_of(other, image.width)) else {
        return 1.0;
    };
    let side = |from: usize, size: usize| {
        let end = (a[from] + a[size]).min(b[from] + b[size]);
        (end - a[from].max(b[from])).max(0.0)
    };
    side(0, 2) * side(1, 3) / (a[2] * a[3]).min(b[2] * b[3])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rectangles `(left, top, width, height)` of colours on grey, and all their pixels.
    fn painted(rectangles: &[([usize; 4], [f32; 3])]) -> (RgbImage, Vec<usize>) {
        let (width, height) = (80, 60);
        let mut image = RgbImage {
            width,
            height,
            data: vec![0.4; 3 * width * height],
        };
        let mut pixels = Vec::new();
        for ([left, top, columns, rows], colour) in rectangles {
            for row in *top..top + rows {
                for column in *left..left + columns {
                    let pixel = row * width + column;
                    image.data[3 * pixel..3 * pixel + 3].copy_from_slice(colour);
                    pixels.push(pixel);
                }
            }
        }
        pixels.sort_unstable();
        pixels.dedup();
        (image, pixels)
    }

    #[test]
    fn cars_of_different_colours_are_told_apart_and_windows_are_not() {
        let red = ([10, 10, 36, 16], [0.8, 0.2, 0.2]);
        let blue = ([10, 26, 36, 16], [0.2, 0.3, 0.8]);
        // A pixel is 12 cm wide.
        let (image, pixels) = painted(&[red, blue]);
        let boxes: Vec<_> = parts(&image, &pixels, 0.0144)
            .iter()
            .map(|part| box_of(part, image.width))
            .collect();
        assert_eq!(boxes.len(), 2, "{boxes:?}");
        for rows in [10.0, 26.0] {
            assert!(boxes.contains(&Some([10.0, rows, 36.0, 16.0])), "{boxes:?}");
        }
        let windows = ([22, 12, 12, 12], [0.05, 0.05, 0.1]);
        let (image, pixels) = painted(&[([10, 10, 50, 18], red.1), windows]);
        assert_eq!(parts(&image, &pixels, 0.0144).len(), 1);
        let (image, pixels) = painted(&[red, (blue.0, red.1)]);
        assert_eq!(parts(&image, &pixels, 0.0144).len(), 1);
    }
}
