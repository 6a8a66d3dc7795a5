//! `depth-abs-rel` and `depth-delta`: errors of predicted distances.

use omnilife_schemas::records::Direction;

use super::{Metric, Need, Sample, Undefined};

/// Mean relative error.
pub(super) const ABS_REL: Metric = Metric {
    id: "depth-abs-rel",
    title: "AbsRel",
    unit: "",
    direction: Some(Direction::LowerIsBetter),
    range: [0.0, f64::MAX],
    source: "mean of |d - d*| / d* over the pixels with a true distance d* along the ray (Eigen, \
             Puhrsch and Fergus 2014), in the world units of the poses, without any alignment; a \
             pixel without a predicted distance counts as distance 0, an error of 1",
    needs: &[Need::Depth],
    function: |sample| mean(sample, |predicted, truth| (predicted - truth).abs() / truth),
};

/// Share of pixels within a factor of the true depth.
pub(super) const DELTA: Metric = Metric {
    id: "depth-delta",
    title: "δ < 1.25",
    unit: "",
    direction: Some(Direction::HigherIsBetter),
    range: [0.0, 1.0],
    source: "share of the pixels with a true distance d* whose predicted distance d has \
             max(d / d*, d* / d) < 1.25 (Eigen, Puhrsch and Fergus 2014); a pixel without a \
             predicted distance is not among them",
    needs: &[Need::Depth],
    function: |sample| {
        mean(sample, |predicted, truth| {
            f64::from((predicted / truth).max(truth / predicted) < 1.25)
        })
    },
};

fn mean(sample: &Sample<'_>, of: impl Fn(f64, f64) -> f64) -> Result<f64, Undefined> {
    let depth = sample.depth()?;
    let (mut sum, mut pixels) = (0.0, 0_u64);
    let distances = depth.prediction.iter().zip(&depth.truth).enumerate();
    for (pixel, (&predicted, &truth)) in distances {
        if truth > 0.0 && sample.pair.counts(pixel) {
            let predicted = if predicted.is_finite() {
                predicted.max(0.0)
            } else {
                0.0
            };
            sum += of(f64::from(predicted), f64::from(truth));
            pixels += 1;
        }
    }
    if pixels == 0 {
        return Err(Undefined("no pixel has a true distance"));
    }
    Ok(sum / pixels as f64)
}
