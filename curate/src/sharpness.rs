//! Sharpness of frames, and the choice of the sharpest one around each of evenly spaced instants.
//!
//! The measure is the root of the mean squared gradient over the standard deviation of the grey values, both weighted
//! by solid angle. Blur takes gradients and leaves contrast. On a sphere the gradient along a row is taken over an
//! equal angle everywhere: more columns towards the poles.

use std::f64::consts::{PI, TAU};

use omnilife_schemas::records::{SharpFrame, TimeRange};
use omnilife_video::Rgb8Image;

/// Name of the column of the signals that holds the sharpness of every frame.
pub(crate) const COLUMN: &str = "sharpness";
/// Width in pixels of the images that are measured, if the video is wider.
pub(crate) const WIDTH_PIXELS: u32 = 1024;
/// Images of less contrast than this standard deviation of grey values, 0 to 255, have no sharpness.
const LEAST_CONTRAST: f64 = 0.5;
/// Largest distance from an evenly spaced instant, as a share of the distance to the next one: chosen frames stay at
/// least a third of it apart.
const REACH: f64 = 1.0 / 3.0;

/// The kind of images that are measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum View {
    /// Whole spheres, equirectangular.
    Sphere,
    /// Perspective images.
    Flat,
}

impl View {
    /// Describes the measure, for records and for the inputs of stages.
    pub(crate) fn description(self) -> &'static str {
        match self {
            Self::Sphere => "gradient over contrast by solid angle, 1/rad, at most 1024 columns",
            Self::Flat => "gradient over contrast, 1/pixel, at most 1024 columns",
        }
    }
}

/// Returns the sharpness of an image, at least 0: of spheres in 1/rad, of others in 1/pixel.
pub(crate) fn sharpness(image: &Rgb8Image, view: View) -> f32 {
    let (width, height) = (image.width, image.height);
    if width < 8 || height < 3 {
        return 0.0;
    }
    let (pixels, _) = image.data.as_chunks::<3>();
    let luma: Vec<f64> = pixels
        .iter()
        .map(|&[r, g, b]| 0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b))
        .collect();
    let (mut weights, mut sum, mut squares, mut energy) = (0.0, 0.0, 0.0, 0.0);
    for row in 1..height - 1 {
        let latitude = (0.5 - (row as f64 + 0.5) / height as f64) * PI;
        let (weight, step, across, down) = match view {
            View::Sphere => {
                let cosine = latitude.cos();
                let step = (1.0 / cosine).round().min((width / 8) as f64);
                let across = 2.0 * step * cosine * TAU / width as f64;
                (cosine, step as usize, across, 2.0 * PI / height as f64)
            }
            View::Flat => (1.0, 1, 2.0, 2.0),
        };
        let columns = match view {
            View::Sphere => 0..width,
            View::Flat => 1..width - 1,
        };
        let at = |row: usize, column: usize| luma[row * width + column % width];
        for column in columns {
            let value = at(row, column);
            let slope_across = (at(row, column + step) - at(row, column + width - step)) / across;
            let slope_down = (at(row + 1, column) - at(row - 1, column)) / down;
            weights += weight;
            sum += weight * value;
            squares += weight * value * value;
            energy += weight * (slope_across * slope_across + slope_down * slope_down);
        }
    }
    let mean = sum / weights;
    let variance = squares / weights - mean * mean;
    if variance < LEAST_CONTRAST * LEAST_CONTRAST {
        return 0.0;
    }
    (energy / weights / variance).sqrt() as f32
}

/// Returns the times of the sharpest frames around evenly spaced ones of a shot, with the reason for each.
///
/// `times` are the timestamps of all frames of the video in order, `sharpness` has one value for each, and `even` holds
/// some of the shot's. The result is as long as `even` and in order of time. Of equally sharp frames the one nearest to
/// the even time is taken.
pub(crate) fn sharpest(
    times: &[f64],
    sharpness: &[f32],
    shot: TimeRange,
    even: &[f64],
) -> Vec<(f64, SharpFrame)> {
    let first = times.partition_point(|&time| time < shot.begin_seconds);
    let last = times.partition_point(|&time| time < shot.end_seconds);
    let inside = &times[first..last];
    let gap = |from: Option<&f64>, to: Option<&f64>| Some(to? - from?);
    let chosen = even.iter().enumerate().filter_map(|(index, &time)| {
        let before = gap(
            index.checked_sub(1).and_then(|index| even.get(index)),
            Some(&time),
        );
        let after = gap(Some(&time), even.get(index + 1));
        let whole = shot.duration_seconds() / REACH;
        let begin = time - REACH * before.or(after).unwrap_or(whole);
        let end = time + REACH * after.or(before).unwrap_or(whole);
        let from = inside.partition_point(|&time| time < begin);
        let to = inside.partition_point(|&time| time <= end);
        let distance = |number: usize| (inside[number] - time).abs();
        let best = (from..to).max_by(|&a, &b| {
            let by_sharpness = sharpness[first + a].total_cmp(&sharpness[first + b]);
            by_sharpness.then_with(|| distance(b).total_cmp(&distance(a)))
        })?;
        let own = (from..to).min_by(|&a, &b| distance(a).total_cmp(&distance(b)))?;
        let record = SharpFrame {
            sharpness: f64::from(sharpness[first + best]),
            even_seconds: time,
            even_sharpness: f64::from(sharpness[first + own]),
            candidates: (to - from) as u32,
        };
        Some((inside[best], record))
    });
    chosen.collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Returns a panorama of a pattern with large shapes and detail of some degrees everywhere on the sphere, turned by
    /// `yaw` and then `pitch` radians and averaged over `blur` columns to both sides.
    fn panorama([yaw, pitch]: [f64; 2], blur: i32, contrast: f64) -> Rgb8Image {
        let (width, height) = (256, 128);
        let value = |longitude: f64, latitude: f64| {
            let (x, y) = (latitude.cos() * longitude.sin(), latitude.sin());
            let z = latitude.cos() * longitude.cos();
            let (sine, cosine) = pitch.sin_cos();
            let (y, z) = (cosine * y - sine * z, sine * y + cosine * z);
            let shapes = 2.0 * (3.0 * x).sin() + 2.0 * (2.0 * y).cos();
            (31.0 * x).sin() * (27.0 * y).cos() + (29.0 * z).sin() + shapes
        };
        let mut data = Vec::new();
        for row in 0..height {
            let latitude = (0.5 - (f64::from(row) + 0.5) / f64::from(height)) * PI;
            for column in 0..width {
                let samples = (-blur..=blur).map(|offset| {
                    let at = f64::from(column) + 0.5 + f64::from(offset);
                    value(at / f64::from(width) * TAU + yaw, latitude)
                });
                let mean = samples.sum::<f64>() / f64::from(2 * blur + 1);
                let grey = (128.0 + contrast * 18.0 * mean).round() as u8;
                data.extend([grey; 3]);
            }
        }
        Rgb8Image::new(width as usize, height as usize, data)
    }

    #[test]
    fn blur_costs_sharpness_and_turns_and_contrast_do_not() {
        let of = |turn: [f64; 2], blur: i32, contrast: f64| {
            f64::from(sharpness(&panorama(turn, blur, contrast), View::Sphere))
        };
        let sharp = of([0.0; 2], 0, 1.0);
        assert!((of([0.0; 2], 0, 0.5) / sharp - 1.0).abs() < 0.02, "{sharp}");
        for turn in [[1.3, 0.0], [0.4, 0.5], [0.4, 0.9], [0.4, 1.57]] {
            let turned = of(turn, 0, 1.0);
            assert!(
                (turned / sharp - 1.0).abs() < 0.04,
                "{turn:?}: {turned}, {sharp}"
            );
        }
        let blurred = [1, 2, 4].map(|blur| of([0.0; 2], blur, 1.0));
        assert!(blurred[0] < 0.98 * sharp, "{blurred:?}");
        assert!(
            blurred[1] < blurred[0] && blurred[2] < blurred[1],
            "{blurred:?}"
        );
        let plain = Rgb8Image::new(64, 32, vec![90; 64 * 32 * 3]);
        assert_eq!(sharpness(&plain, View::Sphere), 0.0);
        assert_eq!(sharpness(&plain, View::Flat), 0.0);
    }

    fn whole(times: &[f64]) -> TimeRange {
        TimeRange::new(times[0], times[times.len() - 1] + 0.1)
    }

    #[test]
    fn the_sharpest_frame_near_every_instant_is_taken() {
        let times: Vec<f64> = (0..30).map(|index| f64::from(index) * 0.1).collect();
        let mut values = vec![1.0_f32; 30];
        (values[9], values[12], values[15]) = (5.0, 3.0, 9.0);
        let even = [times[0], times[10], times[20]];
        let chosen = sharpest(&times, &values, whole(&times), &even);
        let found: Vec<f64> = chosen.iter().map(|(time, _)| *time).collect();
        // The one at 1.5 s is as far from 1.0 s as from 2.0 s, beyond a third of the way.
        assert_eq!(found, [times[0], times[9], times[20]]);
        let reason = &chosen[1].1;
        assert_eq!((reason.sharpness, reason.even_sharpness), (5.0, 1.0));
        assert_eq!((reason.even_seconds, reason.candidates), (times[10], 7));
        // A lone frame may be any of the shot.
        let chosen = sharpest(&times, &values, whole(&times), &even[..1]);
        assert_eq!(chosen[0].0, times[15]);
    }

    proptest! {
        /// Chosen frames are of the shot, in order, as many as even ones, and no less sharp.
        #[test]
        fn no_frame_is_taken_twice(
            values in proptest::collection::vec(0.0_f32..9.0, 2..120),
            stride in 1_usize..12,
        ) {
            let times: Vec<f64> = (0..values.len()).map(|index| index as f64 / 29.97).collect();
            let even: Vec<f64> = times.iter().copied().step_by(stride).collect();
            let chosen = sharpest(&times, &values, whole(&times), &even);
            prop_assert_eq!(chosen.len(), even.len());
            prop_assert!(chosen.windows(2).all(|pair| pair[0].0 < pair[1].0));
            for (time, reason) in &chosen {
                prop_assert!(times.contains(time));
                prop_assert!(reason.sharpness >= reason.even_sharpness);
            }
        }
    }
}
