//! Temporal LPIPS: perceptual change of a video from view to view.

use omnilife_schemas::records::Direction;

use super::{Metric, Need, sample::TemporalLpips};
use crate::lpips::Backbone;

const NEEDS: &[Need] = &[Need::Network(Backbone::Alex), Need::PreviousView];

/// Temporal LPIPS of the prediction.
pub(super) const PREDICTION: Metric = Metric {
    id: "temporal-lpips",
    title: "T-LPIPS",
    unit: "",
    direction: None,
    range: [0.0, f64::MAX],
    source: "lpips-alex between a predicted view and the predicted view of the same kind that is \
             scored before it (T-LPIPS of Neural Atlas Graphs, supplement C.2), over the whole images, \
             with the ground truth of each where pixels do not count. Scene and camera \
             move too, so neither more nor less is better: read it beside temporal-lpips-truth. \
             Undefined for the first view",
    needs: NEEDS,
    function: |sample| Ok(sample.temporal_lpips()?.prediction),
};

/// Temporal LPIPS of the ground truth.
pub(super) const TRUTH: Metric = Metric {
    id: "temporal-lpips-truth",
    title: "T-LPIPS of the ground truth",
    unit: "",
    direction: None,
    range: [0.0, f64::MAX],
    source: "lpips-alex between the ground truth of a view and that of the view of the same kind \
             that is scored before it: what temporal-lpips of a perfect prediction is. Undefined \
             for the first view",
    needs: NEEDS,
    function: |sample| Ok(sample.temporal_lpips()?.truth),
};

/// Difference of the two.
pub(super) const ERROR: Metric = Metric {
    id: "temporal-lpips-error",
    title: "T-LPIPS error",
    unit: "",
    direction: Some(Direction::LowerIsBetter),
    range: [0.0, f64::MAX],
    source: "absolute difference of temporal-lpips and temporal-lpips-truth of the view: a \
             prediction that flickers changes too much, one that freezes too little. Undefined for \
             the first view",
    needs: NEEDS,
    function: |sample| {
        let TemporalLpips { prediction, truth } = sample.temporal_lpips()?;
        Ok((prediction - truth).abs())
    },
};
