//! Exposure gains over time, for a camera with automatic exposure.
//!
//! A view's gain is the median, over points of its image, of the image divided by a static render of the same
//! pixels, per channel. A gain of light is a gain of gamma-coded values too. Images are divided by the gain
//! of their time before they are compared with Gaussians, and renders are multiplied by it before they are
//! shown. The Gaussians thus store the scene at the median gain of all views. A saturated value is only a
//! lower bound; [`PixelMarks`](crate::losses::photometric::PixelMarks) handles it in losses. Between the
//! estimated views, and for novel views, the logarithm of the gain is interpolated in time.

use omnilife_schemas::statistics::median;
use serde::{Deserialize, Serialize};

/// Rendered levels in `[0, 1]` used for the estimate: darker ones are noisy, brighter ones may be clipped.
const USABLE_LEVELS: std::ops::Range<f32> = 0.05..0.9;
/// Least number of points for an estimate of a view's gain.
const LEAST_PLACES: usize = 50;

/// Gains over time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Exposure {
    /// Times of the estimated views, seconds, increasing.
    times_seconds: Vec<f64>,
    /// Natural logarithms of their gains, channel by channel; their median is 0.
    log_gains: Vec<[f32; 3]>,
}

impl Exposure {
    /// Estimates gains from pairs of colours: per view its time, and the colours of the image and of a static
    /// render at the same points. Views with too few points are ignored. `None` if no view remains.
    pub fn estimate(views: &[(f64, Vec<[[f32; 3]; 2]>)]) -> Option<Self> {
        let mut found: Vec<(f64, [f32; 3])> = views
            .iter()
            .filter_map(|(time, pairs)| Some((*time, log_gain(pairs)?)))
            .collect();
        found.sort_by(|left, right| left.0.total_cmp(&right.0));
        let middle = [0, 1, 2].map(|channel| {
            let gains: Vec<f32> = found.iter().map(|(_, gain)| gain[channel]).collect();
            median(&gains)
        });
        let middle = [middle[0]?, middle[1]?, middle[2]?];
        let relative = |gain: [f32; 3]| [0, 1, 2].map(|channel| gain[channel] - middle[channel]);
        Some(Self {
            times_seconds: found.iter().map(|(time, _)| *time).collect(),
            log_gains: found.iter().map(|(_, gain)| relative(*gain)).collect(),
        })
    }

    /// Returns the standard deviation of the gains, as a share: 0.02 is 2 %.
    pub fn drift(&self) -> f64 {
        let squares = self.log_gains.iter().flatten();
        let sum: f64 = squares.map(|&log| f64::from(log).powi(2)).sum();
        (sum / (3 * self.log_gains.len()).max(1) as f64).sqrt()
    }

    /// Returns the number of estimated views.
    pub fn views(&self) -> usize {
        self.times_seconds.len()
    }

    /// Returns the gain of each channel at a time.
    pub fn gain(&self, seconds: f64) -> [f32; 3] {
        let after = self.times_seconds.partition_point(|&time| time < seconds);
        let last = self.times_seconds.len() - 1;
        let (left, right) = (after.saturating_sub(1).min(last), after.min(last));
        let span = self.times_seconds[right] - self.times_seconds[left];
        let share = if span > 0.0 {
            ((seconds - self.times_seconds[left]) / span).clamp(0.0, 1.0) as f32
        } else {
            0.0
        };
        let (from, to) = (self.log_gains[left], self.log_gains[right]);
        [0, 1, 2].map(|channel| (from[channel] + share * (to[channel] - from[channel])).exp())
    }

    /// Removes the gain of a time from an image (HWC).
    pub fn normalize(&self, image: &mut [f32], seconds: f64) {
        let gain = self.gain(seconds);
        for rgb in image.as_chunks_mut::<3>().0 {
            *rgb = [0, 1, 2].map(|channel| rgb[channel] / gain[channel]);
        }
    }

    /// Applies the gain of a time to a render (HWC).
    pub fn apply(&self, image: &mut [f32], seconds: f64) {
        let gain = self.gain(seconds);
        for rgb in image.as_chunks_mut::<3>().0 {
            *rgb = [0, 1, 2].map(|channel| (rgb[channel] * gain[channel]).min(1.0));
        }
    }
}

/// Returns the logarithms of the medians of `shown / rendered`; dark and bright renders are left out.
fn log_gain(pairs: &[[[f32; 3]; 2]]) -> Option<[f32; 3]> {
    let of_channel = |channel: usize| {
        // Selected by the render alone: selecting noisy image values by their level would bias the gain.
        let (levels, ratios): (Vec<f32>, Vec<f32>) = pairs
            .iter()
            .map(|[shown, rendered]| [shown[channel], rendered[channel]])
            .filter(|[_, rendered]| USABLE_LEVELS.contains(rendered))
            .map(|[shown, rendered]| (rendered, shown / rendered))
            .unzip();
        let ratio = (ratios.len() >= LEAST_PLACES)
            .then(|| median(&ratios))
            .flatten()?;
        let is_usable = ratio * median(&levels)? >= USABLE_LEVELS.start;
        is_usable.then(|| ratio.ln())
    };
    Some([of_channel(0)?, of_channel(1)?, of_channel(2)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a view at a time whose light is a gain times that of the render.
    fn view(time: f64, gain: f32) -> (f64, Vec<[[f32; 3]; 2]>) {
        let level = |point: usize| 0.1 + 0.004 * point as f32;
        let pair = |point: usize| [[level(point) * gain; 3], [level(point); 3]];
        (time, (0..100).map(pair).collect())
    }

    #[test]
    fn noise_in_the_dark_is_no_exposure() {
        // Levels near the limit, in one view with noise that makes some darker than the limit.
        let views = [0.0, 0.04].map(|noise: f32| {
            let pair = |point: usize| {
                let level = 0.045 + 0.0002 * (point % 100) as f32;
                // The sum of two uniform numbers concentrates around its middle.
                let uniform = |step: usize| (point * step % 101) as f32 / 50.0 - 1.0;
                let noise = noise * 0.5 * (uniform(37) + uniform(61));
                [[level + noise; 3], [level; 3]]
            };
            (f64::from(noise), (0..2_000).map(pair).collect())
        });
        let drift = Exposure::estimate(&views).map(|found| found.drift());
        assert!(drift.is_some_and(|drift| drift < 0.04), "{drift:?}");
    }

    #[test]
    fn gains_are_found_and_interpolated() -> Result<(), &'static str> {
        let views = [view(4.0, 1.25), view(0.0, 0.8), view(2.0, 1.0)];
        let exposure = Exposure::estimate(&views).ok_or("no gains")?;
        for (time, expected) in [
            (-1.0, 0.8),
            (0.0, 0.8),
            (2.0, 1.0),
            (3.0, 1.25_f32.sqrt()),
            (4.0, 1.25),
            (9.0, 1.25),
        ] {
            let gain = exposure.gain(time);
            assert!((gain[1] - expected).abs() < 1e-4, "{time}: {gain:?}");
        }
        let expected = (2.0 * 0.8_f64.ln().powi(2) / 3.0).sqrt();
        assert!((exposure.drift() - expected).abs() < 1e-3);
        let mut image = vec![0.4, 0.2, 0.9];
        exposure.apply(&mut image, 4.0);
        assert!((image[0] - 0.5).abs() < 1e-5 && image[2] == 1.0);
        exposure.normalize(&mut image, 4.0);
        assert!((image[1] - 0.2).abs() < 1e-5);
        Ok(())
    }

    #[test]
    fn views_with_too_little_to_see_have_no_say() {
        let mut dark = view(1.0, 0.01);
        let mut few = view(2.0, 1.0);
        few.1.truncate(20);
        dark.1.truncate(90);
        assert_eq!(Exposure::estimate(&[dark, few]), None);
        assert_eq!(Exposure::estimate(&[]), None);
    }
}
