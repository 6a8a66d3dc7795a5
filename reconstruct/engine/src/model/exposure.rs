//! Exposure gains over time, for a camera with automatic exposure.
//!
//! Gains are those of linear light ([`srgb`]): the same gain changes dark levels by a larger share than bright ones.
//! A view's gain is the median, over points of its image, of the light of the image divided by that of a static
//! render of the same pixels, per channel. The light of images is divided by the gain of their time before they
//! are compared with Gaussians, and that of renders is multiplied by it before they are shown. The Gaussians thus
//! store the scene at the median gain of all views. A saturated value is only a lower bound;
//! [`PixelMarks`](crate::losses::photometric::PixelMarks) handles it in losses. Between the estimated views, and
//! for novel views, the logarithm of the gain is interpolated in time.

use omnilife_schemas::{srgb, statistics::median};
use serde::{Deserialize, Serialize};

/// Light used for the estimate, of the render and of the render under the gain: levels of 0.05 to 0.9. Darker ones are
/// noisy or clipped at 0, brighter ones may be clipped at 1.
const USABLE_LIGHT: std::ops::Range<f32> = 0.003_935_9..0.787_412_3;
/// Least number of points for an estimate of a view's gain.
const LEAST_PLACES: usize = 50;
/// Rounds of the estimate: the gain decides which points are usable under it.
const ROUNDS: usize = 3;

/// Gains over time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RecordedExposure")]
pub struct Exposure {
    /// Times of the estimated views, seconds, increasing; at least one.
    times_seconds: Vec<f64>,
    /// Natural logarithms of their gains of light, channel by channel; the median of estimated ones is 0.
    log_light_gains: Vec<[f32; 3]>,
}

/// Gains as a record has them, before they are checked.
#[derive(Deserialize)]
struct RecordedExposure {
    times_seconds: Vec<f64>,
    log_light_gains: Vec<[f32; 3]>,
}

impl TryFrom<RecordedExposure> for Exposure {
    type Error = &'static str;

    fn try_from(recorded: RecordedExposure) -> Result<Self, Self::Error> {
        let RecordedExposure {
            times_seconds,
            log_light_gains,
        } = recorded;
        if times_seconds.is_empty() || times_seconds.len() != log_light_gains.len() {
            return Err("an exposure has at least one time, and a gain for each");
        }
        // A number that is too large for 32 bits is read as infinite.
        let is_finite = times_seconds.iter().all(|time| time.is_finite())
            && log_light_gains.iter().flatten().all(|log| log.is_finite());
        if !is_finite || !times_seconds.is_sorted() {
            return Err("an exposure has increasing times, and finite gains");
        }
        Ok(Self {
            times_seconds,
            log_light_gains,
        })
    }
}

impl Exposure {
    /// Estimates gains from pairs of colours in linear light: per view its time, and the light of the image and of a
    /// static render at the same points. Views with too few points are ignored. `None` if no view remains.
    pub fn estimate(views: &[(f64, Vec<[[f32; 3]; 2]>)]) -> Option<Self> {
        let mut found: Vec<(f64, [f32; 3])> = views
            .iter()
            .filter_map(|(time, pairs)| Some((*time, log_gain(pairs)?)))
            .collect();
        let middle = [0, 1, 2].map(|channel| {
            let gains: Vec<f32> = found.iter().map(|(_, gain)| gain[channel]).collect();
            median(&gains)
        });
        let middle = [middle[0]?, middle[1]?, middle[2]?];
        let relative = |gain: [f32; 3]| [0, 1, 2].map(|channel| gain[channel] - middle[channel]);
        for (_, gain) in &mut found {
            *gain = relative(*gain);
        }
        Self::of_log_gains(found)
    }

    /// Creates gains of times in seconds, from their natural logarithms; `None` without any.
    pub(crate) fn of_log_gains(mut views: Vec<(f64, [f32; 3])>) -> Option<Self> {
        views.sort_by(|left, right| left.0.total_cmp(&right.0));
        let (times_seconds, log_light_gains): (Vec<_>, Vec<_>) = views.into_iter().unzip();
        (!times_seconds.is_empty()).then_some(Self {
            times_seconds,
            log_light_gains,
        })
    }

    /// Returns the standard deviation of the gains of light, as a share: 0.02 is 2 %.
    pub fn drift(&self) -> f64 {
        let squares = self.log_light_gains.iter().flatten();
        let sum: f64 = squares.map(|&log| f64::from(log).powi(2)).sum();
        (sum / (3 * self.log_light_gains.len()).max(1) as f64).sqrt()
    }

    /// Returns the number of estimated views.
    pub fn views(&self) -> usize {
        self.times_seconds.len()
    }

    /// Returns the gain of the light of each channel at a time.
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
        let (from, to) = (self.log_light_gains[left], self.log_light_gains[right]);
        [0, 1, 2].map(|channel| (from[channel] + share * (to[channel] - from[channel])).exp())
    }

    /// Returns the level of every byte of each channel, once the gain of a time is removed.
    pub fn levels(&self, seconds: f64) -> [[f32; 256]; 3] {
        self.gain(seconds).map(|gain| {
            std::array::from_fn(|byte| srgb::brightened(byte as f32 / 255.0, 1.0 / gain))
        })
    }

    /// Returns a colour without the gain of a time.
    pub fn normalized(&self, rgb: [f32; 3], seconds: f64) -> [f32; 3] {
        let gain = self.gain(seconds);
        [0, 1, 2].map(|channel| srgb::brightened(rgb[channel], 1.0 / gain[channel]))
    }

    /// Writes an image of bytes (HWC) into `out`, without the gain of a time.
    pub fn write_normalized(&self, pixels: &[u8], seconds: f64, out: &mut Vec<f32>) {
        let levels = self.levels(seconds);
        out.clear();
        let colours = pixels.as_chunks::<3>().0.iter();
        out.extend(
            colours.flat_map(|rgb| {
                [0, 1, 2].map(|channel| levels[channel][usize::from(rgb[channel])])
            }),
        );
    }

    /// Applies the gain of a time to a render (HWC).
    pub fn apply(&self, image: &mut [f32], seconds: f64) {
        let gain = self.gain(seconds);
        for rgb in image.as_chunks_mut::<3>().0 {
            *rgb = [0, 1, 2].map(|channel| srgb::brightened(rgb[channel], gain[channel]).min(1.0));
        }
    }
}

/// Returns the logarithms of the medians of `shown / rendered`. Points are left out whose light, in the render or under
/// the gain, is too dark or may be clipped.
fn log_gain(pairs: &[[[f32; 3]; 2]]) -> Option<[f32; 3]> {
    let of_channel = |channel: usize| {
        let mut gain = 1.0_f32;
        for _ in 0..ROUNDS {
            // Selected by the render alone: selecting noisy image values by their level would bias the gain.
            let ratios: Vec<f32> = pairs
                .iter()
                .map(|[shown, rendered]| [shown[channel], rendered[channel]])
                .filter(|[_, rendered]| {
                    USABLE_LIGHT.contains(rendered) && USABLE_LIGHT.contains(&(gain * *rendered))
                })
                .map(|[shown, rendered]| shown / rendered)
                .collect();
            gain = (ratios.len() >= LEAST_PLACES)
                .then(|| median(&ratios))
                .flatten()?;
        }
        (gain > 0.0).then(|| gain.ln())
    };
    Some([of_channel(0)?, of_channel(1)?, of_channel(2)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a view at a time whose light is a gain times that of the render, up to what a camera can show.
    fn view(time: f64, gain: f32) -> (f64, Vec<[[f32; 3]; 2]>) {
        let light = |point: usize| 0.1 + 0.004 * point as f32;
        let pair = |point: usize| [[(light(point) * gain).min(1.0); 3], [light(point); 3]];
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
                [level + noise, level].map(|level| [srgb::to_linear(level.max(0.0)); 3])
            };
            (f64::from(noise), (0..2_000).map(pair).collect())
        });
        let drift = Exposure::estimate(&views).map(|found| found.drift());
        assert!(drift.is_some_and(|drift| drift < 0.04), "{drift:?}");
    }

    /// Checks a scene of levels around 0.05 and one of levels around 0.6, half of which a bright view clips.
    #[test]
    fn gains_are_found_by_night_and_where_much_is_clipped() {
        for (first, step, gains) in [
            (0.04, 0.0003, [0.8, 1.0, 1.3]),
            (0.3, 0.0045, [0.5, 1.0, 2.5]),
        ] {
            let views: Vec<(f64, Vec<[[f32; 3]; 2]>)> = (0..3)
                .map(|view: usize| {
                    let pair = |point: usize| {
                        let light = srgb::to_linear(first + step * point as f32);
                        let byte = 255.0 * srgb::from_linear(gains[view] * light).min(1.0);
                        // Rounding to bytes, evenly spread over the points of a level.
                        let spread = (point * 37 % 101) as f32 / 101.0;
                        let shown = (byte + spread).floor() / 255.0;
                        [[srgb::to_linear(shown.min(1.0)); 3], [light; 3]]
                    };
                    (view as f64, (0..150).map(pair).collect())
                })
                .collect();
            let found =
                Exposure::estimate(&views).map(|found| [0.0, 1.0, 2.0].map(|at| found.gain(at)[1]));
            for (found, expected) in found.into_iter().flatten().zip(gains) {
                assert!((found / expected - 1.0).abs() < 0.03, "{found} {expected}");
            }
            assert!(found.is_some());
        }
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
        let mut image = vec![0.4, 0.2, 0.98];
        exposure.apply(&mut image, 4.0);
        // Linear light of 0.4 is 0.13287; 1.25 times it is the level 0.44433.
        assert!(
            (image[0] - 0.444_333).abs() < 1e-4 && image[2] == 1.0,
            "{image:?}"
        );
        let normalized = exposure.normalized([image[0], image[1], 1.0], 4.0);
        assert!((normalized[0] - 0.4).abs() < 1e-5 && (normalized[1] - 0.2).abs() < 1e-5);
        let mut written = Vec::new();
        exposure.write_normalized(&[102, 51, 255, 0, 128, 9], 4.0, &mut written);
        for (byte, found) in [102.0, 51.0, 255.0, 0.0, 128.0, 9.0]
            .into_iter()
            .zip(written)
        {
            let expected = exposure.normalized([byte / 255.0; 3], 4.0)[0];
            assert!(
                (found - expected).abs() < 1e-6,
                "{byte}: {found} {expected}"
            );
        }
        Ok(())
    }

    #[test]
    fn malformed_records_are_refused_and_others_come_back() -> Result<(), serde_json::Error> {
        for (times, gains, reason) in [
            ("[]", "[]", "at least one time"),
            ("[0.0, 1.0]", "[[0, 0, 0]]", "a gain for each"),
            ("[1.0, 0.0]", "[[0, 0, 0], [0, 0, 0]]", "increasing"),
            ("[0.0]", "[[0, 1e300, 0]]", "out of range"),
        ] {
            let text = format!(r#"{{"times_seconds": {times}, "log_light_gains": {gains}}}"#);
            let refused =
                serde_json::from_str::<Exposure>(&text).map_err(|error| error.to_string());
            assert!(
                refused.as_ref().is_err_and(|error| error.contains(reason)),
                "{refused:?}"
            );
        }
        let exposure = Exposure::estimate(&[view(0.0, 0.8), view(2.0, 1.0)]);
        let text = serde_json::to_string(&exposure)?;
        assert_eq!(serde_json::from_str::<Option<Exposure>>(&text)?, exposure);
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
