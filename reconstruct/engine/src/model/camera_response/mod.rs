//! Response of the camera, learnt with the model: a gain of each view, a tone curve of the clip, and the vignette of a
//! pinhole's lens.
//!
//! A camera shows light `L` of a colour channel at level `t` (PPISP, Deutsch et al. 2026, has the same stages in this
//! order, with more numbers):
//!
//! ```text
//! z = exp(g + a1 r + a2 r^2 + a3 r^3) L        g: gain of the view and channel; r: squared radius, 1 in the corner
//! t = T(y),  y = level of light z (sRGB)       T: one curve of the clip
//! ```
//!
//! Gaussians store the scene at the mean gain, in sRGB's levels. Their render is shown through the response before it
//! is compared with the image, whose bytes stay as they are. Saturated bytes are lower bounds
//! ([`PixelMarks`](crate::losses::photometric::PixelMarks)).
//!
//! Some changes of the response leave every image as it is, if the scene changes with it:
//!
//! * One factor of all gains. The mean of their logarithms is therefore kept where it began.
//! * An exponent of the curve, nearly: a scene of other contrast with other gains looks the same (Grossberg and
//!   Nayar, "What can be known about the radiometric response from images?", 2002).
//!
//! All numbers begin at 0, the identity, or gains at those of an estimate; a quadratic term draws them to 0. It decides
//! where images do not.
//!
//! Novel views have the gain of their time, interpolated as [`Exposure`] does, and the same curve and vignette.

mod shown;
#[cfg(test)]
mod tests;

use omnilife_schemas::camera::Camera;
use serde::{Deserialize, Serialize};

use self::shown::{CURVE_VALUES, Lens, SHARED_VALUES};
pub use self::shown::{ResponseGradient, ViewResponse};
use super::exposure::Exposure;
use crate::parameters::{ParameterArray, ParameterTable, SharedParameters, adam};

/// Name of the array of gains: natural logarithms, of light, by view and channel.
pub const CAMERA_GAINS: &str = "camera_gains";
/// Name of the array of shared numbers: those of the curve, and of a pinhole's vignette.
pub const CAMERA_CURVE: &str = "camera_curve";

/// Weights of half the squares of gains and of shared numbers. L1 falls with a slope of about 0.05 for each, as long as
/// images deviate by more than their noise.
const PRIOR_WEIGHTS: [f32; 2] = [1e-3, 0.01];

/// Response with the state of its optimization.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraResponse {
    /// Times of the input views by index, seconds.
    times_seconds: Vec<f64>,
    /// [`CAMERA_GAINS`], one row per input view.
    pub gains: ParameterTable,
    /// Optimizer steps of each view so far.
    pub steps: Vec<u64>,
    /// [`CAMERA_CURVE`]: logarithms of the curve's exponent and of its further slope at white; then `a1`, `a2`, `a3` of
    /// a pinhole.
    pub shared: SharedParameters,
}

/// Numbers of a response at the end of a run, for its record.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LearntResponse {
    /// Gains of the input views over time.
    pub gains: Exposure,
    /// Logarithms of the curve's exponent and of its further slope at white.
    pub curve: [f32; 2],
    /// Coefficients of the vignette of a pinhole, from `a1` on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vignette: Option<[f32; 3]>,
}

impl CameraResponse {
    /// Creates the response of a camera at input views of these times, by index: the identity, or the gains of an
    /// estimate.
    pub fn new(times_seconds: Vec<f64>, camera: &Camera, begin: Option<&Exposure>) -> Self {
        let views = times_seconds.len();
        let gain = |&seconds: &f64| begin.map_or([1.0; 3], |begin| begin.gain(seconds));
        let gains = times_seconds.iter().flat_map(gain).map(f32::ln).collect();
        let mut table = ParameterTable::new(views);
        table.add(CAMERA_GAINS, 3, gains, 0.0);
        let shared = match camera {
            Camera::Erp(_) => CURVE_VALUES,
            Camera::Pinhole(_) => SHARED_VALUES,
        };
        Self {
            times_seconds,
            gains: table,
            steps: vec![0; views],
            shared: SharedParameters::new(CAMERA_CURVE, vec![0.0; shared]),
        }
    }

    /// Returns all arrays: [`CAMERA_GAINS`], [`CAMERA_CURVE`].
    pub fn arrays(&self) -> impl Iterator<Item = &ParameterArray> {
        self.gains.arrays.iter().chain([&self.shared.array])
    }

    /// Returns the response at an input view, for images of a camera.
    pub fn of_view(&self, view: usize, camera: &Camera) -> ViewResponse {
        let row = self.gains.row(0, view);
        self.with_gains([row[0], row[1], row[2]].map(f32::exp), camera)
    }

    /// Returns the response at a time, for images of a camera.
    pub fn at(&self, seconds: f64, camera: &Camera) -> ViewResponse {
        let gains = self.over_time();
        self.with_gains(gains.map_or([1.0; 3], |gains| gains.gain(seconds)), camera)
    }

    fn with_gains(&self, gains: [f32; 3], camera: &Camera) -> ViewResponse {
        let (curve, vignette) = self.shared_values();
        let vignette = vignette.and_then(|vignette| Some((vignette, Lens::of(camera)?)));
        ViewResponse::new(gains, vignette, curve)
    }

    /// Returns the numbers for a run's record; `None` without input views.
    pub fn learnt(&self) -> Option<LearntResponse> {
        let (curve, vignette) = self.shared_values();
        Some(LearntResponse {
            gains: self.over_time()?,
            curve,
            vignette,
        })
    }

    /// Returns the numbers of the curve and of the vignette.
    fn shared_values(&self) -> ([f32; CURVE_VALUES], Option<[f32; 3]>) {
        let values = &self.shared.array.values;
        let split = values.split_first_chunk::<CURVE_VALUES>();
        let (curve, vignette) = split.unwrap_or((&[0.0; CURVE_VALUES], &[][..]));
        (*curve, vignette.first_chunk().copied())
    }

    /// Returns the gains over time; `None` without input views.
    fn over_time(&self) -> Option<Exposure> {
        let rows = self.gains.arrays[0].values.as_chunks::<3>().0;
        let views = self.times_seconds.iter().copied().zip(rows.iter().copied());
        Exposure::of_log_gains(views.collect())
    }

    /// Takes a step of Adam on the gain of one view and on the shared numbers, with the step sizes of both arrays.
    /// Subtracts the mean motion of gains from all of them. Gradient values that are not finite count as 0; returns
    /// their number per array.
    pub fn step(
        &mut self,
        view: usize,
        gradient: &ResponseGradient,
        rates: [f32; 2],
    ) -> [usize; 2] {
        self.steps[view] += 1;
        self.shared.steps += 1;
        let views = self.times_seconds.len() as f32;
        let gains = &mut self.gains.arrays[0];
        let row = 3 * view..3 * view + 3;
        let before = [0, 1, 2].map(|channel| gains.values[3 * view + channel]);
        let mut by_gains = gradient.gains.map(|by| by as f32);
        for (by, gain) in by_gains.iter_mut().zip(before) {
            *by += PRIOR_WEIGHTS[0] * gain;
        }
        let of_gains = move_row(gains, row, &by_gains, (rates[0], self.steps[view]));
        let moved: [f32; 3] =
            std::array::from_fn(|channel| gains.values[3 * view + channel] - before[channel]);
        for gain in gains.values.as_chunks_mut::<3>().0 {
            *gain = std::array::from_fn(|channel| gain[channel] - moved[channel] / views);
        }
        let shared = &mut self.shared.array;
        let by_shared = gradient.shared.iter().zip(&shared.values);
        let by_shared: Vec<f32> = by_shared
            .map(|(&by, value)| by as f32 + PRIOR_WEIGHTS[1] * value)
            .collect();
        let row = 0..shared.values.len();
        let of_shared = move_row(shared, row, &by_shared, (rates[1], self.shared.steps));
        [of_gains, of_shared]
    }
}

/// Takes step number `step` of Adam on some values of an array; returns the number of gradients that are not finite.
fn move_row(
    array: &mut ParameterArray,
    row: std::ops::Range<usize>,
    gradients: &[f32],
    (rate, step): (f32, u64),
) -> usize {
    let corrections = adam::corrections(step, adam::SecondMomentDecay::PUBLISHED);
    adam::cpu::step_values(
        [
            &mut array.values[row.clone()],
            &mut array.first_moments[row.clone()],
            &mut array.second_moments[row],
        ],
        gradients,
        corrections.rate(rate),
        corrections,
    )
}
