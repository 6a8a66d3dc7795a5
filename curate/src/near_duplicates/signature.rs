//! Signature of a video over time: few numbers that hardly change under re-encoding, scaling or a rotation about the
//! vertical.
//!
//! The sphere is divided into bands of equal solid angle. A band contributes its mean colour and the magnitudes of the
//! first orders of luminance around the vertical: a rotation changes only their phases. All means are weighted by solid
//! angle, and over [`WINDOW_SECONDS`] in time.

use std::{
    collections::BTreeMap,
    f32::consts::{PI, TAU},
};

use omnilife_video::Rgb8Image;

use crate::boundaries::Signals;

/// Width of the images from which signatures are computed, pixels.
pub(crate) const WIDTH_PIXELS: u32 = 64;
/// Bands of equal solid angle.
const BANDS: usize = 6;
/// Orders around the vertical.
const ORDERS: usize = 3;
/// Numbers per band: red, green, blue and the orders.
const PER_BAND: usize = 3 + ORDERS;
/// Numbers of one window.
pub(super) const NUMBERS: usize = BANDS * PER_BAND;
/// A row of a signature is a mean over this long ...
pub(super) const WINDOW_SECONDS: f64 = 0.5;
/// ... and there is one for every such step with frames.
const STEP_SECONDS: f64 = 0.25;
const STEPS_PER_WINDOW: u64 = 2;
/// Frames closer than this to the last used one are skipped.
const FRAME_SECONDS: f64 = 0.09;
/// Time that the last window may lack at its end: used frames are up to this far apart at the usual rates.
const LAST_FRAME_SECONDS: f64 = 0.15;

/// Settings in the cache key of stages.
pub(crate) const SETTINGS: &str =
    "6 bands, colour and 3 orders, windows of 0.5 s every 0.25 s, frames 0.09 s apart";

/// One window.
pub(super) type Numbers = [f32; NUMBERS];

/// Collects the signature of a video while it is decoded.
#[derive(Debug, Default)]
pub struct SignaturePass {
    frames: Vec<(f64, Numbers)>,
}

impl SignaturePass {
    /// Returns true if the frame at this time is used.
    pub(crate) fn wants(&self, time_seconds: f64) -> bool {
        let last = self.frames.last();
        last.is_none_or(|(last, _)| time_seconds - last >= FRAME_SECONDS)
    }

    /// Adds an equirectangular image.
    pub(crate) fn observe(&mut self, time_seconds: f64, image: &Rgb8Image) {
        self.frames.push((time_seconds, numbers(image)));
    }

    /// Returns the signature as a table: one row per window, by the time since the first frame.
    pub(crate) fn finish(&self) -> Signals {
        let begin = self.frames.first().map_or(0.0, |(time, _)| *time);
        let end = self.frames.last().map_or(0.0, |(time, _)| *time);
        // Only windows that hold frames: timestamps may leap by years.
        let mut windows: BTreeMap<u64, (Numbers, f32)> = BTreeMap::new();
        for (time, numbers) in &self.frames {
            let last = ((time - begin) / STEP_SECONDS) as u64;
            for step in last.saturating_sub(STEPS_PER_WINDOW - 1)..=last {
                let (sum, count) = windows.entry(step).or_insert(([0.0; NUMBERS], 0.0));
                *count += 1.0;
                for (sum, value) in sum.iter_mut().zip(numbers) {
                    *sum += value;
                }
            }
        }
        let (mut times, mut rows): (Vec<f64>, Vec<Numbers>) = (Vec::new(), Vec::new());
        for (step, (sum, count)) in windows {
            let from = step as f64 * STEP_SECONDS;
            // A short video has one window all the same.
            if step == 0 || begin + from + WINDOW_SECONDS <= end + LAST_FRAME_SECONDS {
                times.push(from);
                rows.push(sum.map(|sum| sum / count));
            }
        }
        let columns = (0..NUMBERS).map(|number| {
            let name = format!("band{}_{}", number / PER_BAND, NAMES[number % PER_BAND]);
            (name, rows.iter().map(|row| row[number]).collect())
        });
        Signals {
            times,
            columns: columns.collect(),
        }
    }
}

/// Names of the numbers of a band.
const NAMES: [&str; PER_BAND] = ["red", "green", "blue", "order1", "order2", "order3"];

fn numbers(image: &Rgb8Image) -> Numbers {
    let (width, height) = (image.width, image.height);
    let mut numbers = [0.0; NUMBERS];
    let mut weights = [0.0; BANDS];
    // Real and imaginary parts of the orders of a band.
    let mut orders = [[[0.0; 2]; ORDERS]; BANDS];
    for y in 0..height {
        let latitude = (0.5 - (y as f32 + 0.5) / height as f32) * PI;
        let band = ((0.5 * (1.0 - latitude.sin()) * BANDS as f32) as usize).min(BANDS - 1);
        let weight = latitude.cos() / width as f32;
        weights[band] += latitude.cos();
        for x in 0..width {
            let rgb = image.pixel(x, y).map(|level| f32::from(level) / 255.0);
            for (sum, level) in numbers[band * PER_BAND..].iter_mut().zip(rgb) {
                *sum += weight * level;
            }
            let luminance = 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
            for (order, [real, imaginary]) in orders[band].iter_mut().enumerate() {
                let angle = TAU * ((order + 1) * x % width) as f32 / width as f32;
                *real += weight * luminance * angle.cos();
                *imaginary += weight * luminance * angle.sin();
            }
        }
    }
    for band in 0..BANDS {
        let total = weights[band].max(f32::MIN_POSITIVE);
        let of_band = &mut numbers[band * PER_BAND..(band + 1) * PER_BAND];
        for (number, [real, imaginary]) in of_band[3..].iter_mut().zip(orders[band]) {
            *number = real.hypot(imaginary);
        }
        of_band.iter_mut().for_each(|number| *number /= total);
    }
    numbers
}

/// Returns the rows of a table that [`SignaturePass::finish`] left; `None` for another table.
pub(super) fn rows(signals: &Signals) -> Option<Vec<Numbers>> {
    if signals.columns.len() != NUMBERS {
        return None;
    }
    let mut rows = vec![[0.0; NUMBERS]; signals.times.len()];
    for (number, (_, values)) in signals.columns.iter().enumerate() {
        if values.len() != rows.len() || values.iter().any(|value| !value.is_finite()) {
            return None;
        }
        for (row, value) in rows.iter_mut().zip(values) {
            row[number] = *value;
        }
    }
    Some(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turn_about_the_vertical_changes_nothing() {
        let (width, height) = (64, 32);
        let image = |turn: usize| {
            let level = |x: usize, y: usize| ((x * 7 + x * x * y) % 200) as u8;
            let data = (0..width * height)
                .flat_map(|at| [level((at % width + turn) % width, at / width); 3])
                .collect();
            Rgb8Image::new(width, height, data)
        };
        let (straight, turned) = (numbers(&image(0)), numbers(&image(19)));
        for (a, b) in straight.iter().zip(&turned) {
            assert!((a - b).abs() < 1e-5, "{a} {b}");
        }
        assert!(straight[3] > 1e-4, "there is something to turn");
    }

    #[test]
    fn timestamps_that_leap_cost_nothing() {
        let mut pass = SignaturePass::default();
        let black = Rgb8Image::new(64, 32, vec![0; 64 * 32 * 3]);
        for time in [-5.0, 0.0, 1e9, 1e15] {
            pass.observe(time, &black);
        }
        let times = pass.finish().times;
        assert!(times.len() <= 8 && times.is_sorted(), "{times:?}");
        assert!(SignaturePass::default().finish().times.is_empty());
    }

    #[test]
    fn windows_do_not_depend_on_the_frame_rate() {
        let of_rate = |rate: usize| {
            let mut pass = SignaturePass::default();
            for frame in 0..3 * rate {
                let time = frame as f64 / rate as f64;
                let data = vec![(60.0 * time) as u8; 64 * 32 * 3];
                if pass.wants(time) {
                    pass.observe(time, &Rgb8Image::new(64, 32, data));
                }
            }
            pass.finish()
        };
        let (slow, fast) = (of_rate(24), of_rate(60));
        assert_eq!(slow.times.len(), fast.times.len());
        assert_eq!(slow.times.len(), 11);
        let (slow, fast) = (rows(&slow).expect("rows"), rows(&fast).expect("rows"));
        for (a, b) in slow.iter().zip(&fast) {
            assert!((a[0] - b[0]).abs() < 0.02, "{} {}", a[0], b[0]);
        }
    }
}
