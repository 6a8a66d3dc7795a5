//! The metrics: definitions of scores.
//!
//! To add one: a file with a [`Metric`], a line in [`METRICS`], and golden values through
//! `scripts/golden/metrics.py`, an implementation apart from this one. A protocol that scores it names it among its
//! metrics, which makes a new version of the protocol; tables, sites and queries take the metrics of the results.
//!
//! All metrics compare 8-bit images, as 3DGS's `metrics.py` does, which reads rendered and captured views back from PNG
//! files: prediction and ground truth are both quantized. Against scores of unquantized renderings (ODGS and PVG during
//! training) this matters above about 45 dB. Values are `byte / 255` in f64 and sums are taken in a fixed order. So a
//! score is the same on every machine and for every number of threads; for LPIPS see [`crate::lpips`].
//!
//! Pixels that a scene marks as outside of it do not count. There both images of a [`ViewPair`] have the ground truth,
//! for windows and networks that reach over it. Means are over the other pixels (LPIPS is divided by their share,
//! temporal LPIPS is not).
//!
//! A metric is given a [`Sample`], all data of a view, declares its requirements ([`Need`]), and may be [`Undefined`]
//! for a view.

mod cube;
mod cube_faces;
mod depth;
mod latitude;
mod lpips;
mod masked;
mod object;
mod psnr;
mod psnr_channels;
mod sample;
mod ssim;
mod ssim_4dgf;
mod ssim_map;
mod ssim_skimage;
mod ssim_uniform;
mod temporal_lpips;
mod view_pair;
mod ws_psnr;
mod ws_ssim;

pub use sample::{DepthPair, Sample, Undefined};
pub use view_pair::ViewPair;

use omnilife_schemas::{
    names,
    records::{Direction, Protocol},
};

use crate::{error::BenchError, lpips::Backbone, protocols};

/// A metric: a number for a prediction compared with its ground truth.
#[derive(Debug, Clone, Copy)]
pub struct Metric {
    /// Id, unique in [`METRICS`]. Variants of a metric are metrics of their own.
    pub id: &'static str,
    /// Name for people.
    pub title: &'static str,
    /// Unit; empty for plain numbers.
    pub unit: &'static str,
    /// Direction of better scores; `None` for a number that only complements another.
    pub direction: Option<Direction>,
    /// Lowest and highest possible value.
    pub range: [f64; 2],
    /// The definition: formula, conventions and publication.
    pub source: &'static str,
    /// Requirements beside prediction and ground truth. Without them the metric is unavailable if none exist at all,
    /// and undefined for a view if only that lacks them.
    pub needs: &'static [Need],
    /// Computes it; deterministic, finite if defined.
    pub function: Function,
}

/// Computes a metric of a view.
pub type Function = fn(&Sample<'_>) -> Result<f64, Undefined>;

/// A requirement of a metric beside a prediction and its ground truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// The weights of a network.
    Network(Backbone),
    /// Images of the whole sphere: an ERP camera.
    Sphere,
    /// Masks of moving content.
    DynamicMask,
    /// Masks of the objects of a class.
    ClassMask(&'static str),
    /// Masks of single objects.
    ObjectMasks,
    /// Predicted and true depth.
    Depth,
    /// The view of the same kind before it in time.
    PreviousView,
}

/// Every metric.
pub static METRICS: &[Metric] = &[
    psnr::METRIC,
    psnr_channels::METRIC,
    ssim::METRIC,
    ssim_skimage::METRIC,
    ssim_uniform::METRIC,
    ssim_4dgf::METRIC,
    lpips::VGG,
    lpips::ALEX,
    lpips::VGG_UNSCALED,
    lpips::ALEX_UNSCALED,
    ws_psnr::METRIC,
    ws_ssim::METRIC,
    cube::PSNR,
    cube::SSIM,
    masked::PSNR_STATIC,
    masked::SSIM_STATIC,
    masked::PSNR_DYNAMIC,
    masked::SSIM_DYNAMIC,
    masked::PSNR_HUMAN,
    masked::SSIM_HUMAN,
    masked::PSNR_VEHICLE,
    masked::SSIM_VEHICLE,
    object::PSNR,
    object::PSNR_MASKED,
    object::SSIM,
    object::SSIM_MASKED,
    temporal_lpips::PREDICTION,
    temporal_lpips::TRUTH,
    temporal_lpips::ERROR,
    depth::ABS_REL,
    depth::DELTA,
];

/// Returns the metrics of a protocol, in its order.
///
/// # Errors
/// [`BenchError::UnknownMetric`], which lists the known ids.
pub fn of_protocol(protocol: &Protocol) -> Result<Vec<&'static Metric>, BenchError> {
    among(METRICS, protocol)
}

/// Returns the metrics of a protocol as [`of_protocol`] does, out of these.
fn among<'m>(metrics: &'m [Metric], protocol: &Protocol) -> Result<Vec<&'m Metric>, BenchError> {
    protocol
        .metrics
        .iter()
        .map(|id| {
            names::find("metric", id, metrics, |metric| metric.id).map_err(|unknown| {
                BenchError::UnknownMetric {
                    protocol: protocols::title(protocol),
                    unknown,
                }
            })
        })
        .collect()
}

/// The mean squared error, in squared `[0, 1]` units, below which PSNR values are cut off.
const MSE_FLOOR: f64 = 1e-10;

/// Returns the PSNR in decibels, in [0, 100], of a mean squared error in squared `[0, 1]` units.
fn decibels(mse: f64) -> f64 {
    // Subtracted from zero, so that an error of 1 gives 0 and not -0.
    0.0 - 10.0 * mse.clamp(MSE_FLOOR, 1.0).log10()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tenth of the view's width.
    const TOY: Metric = Metric {
        id: "toy",
        title: "Toy",
        unit: "",
        direction: Some(Direction::LowerIsBetter),
        range: [0.0, 1.0],
        source: "Nowhere.",
        needs: &[],
        function: |sample| Ok(sample.pair.width() as f64 / 10.0),
    };

    #[test]
    fn a_metric_is_a_row_and_a_function() {
        let mut protocol = protocols::protocol("per-scene").expect("it is known");
        protocol.metrics = ["psnr", TOY.id].map(str::to_owned).into();
        let unknown = of_protocol(&protocol)
            .map(|_| ())
            .map_err(|error| error.to_string());
        assert!(unknown.is_err_and(|message| message.contains("\"toy\"")));
        let all = [psnr::METRIC, TOY];
        let metrics = among(&all, &protocol).expect("both are there");
        let pair = ViewPair::new(2, 1, vec![0; 6], vec![0; 6]).expect("two pixels");
        let scores = metrics
            .iter()
            .map(|metric| (metric.function)(&Sample::new(&pair)));
        let scores: Vec<_> = scores.collect();
        assert!(scores.len() == 2 && scores[1] == Ok(0.2), "{scores:?}");
    }
}
