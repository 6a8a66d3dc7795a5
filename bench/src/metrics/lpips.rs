//! `lpips-vgg`, `lpips-alex` and the two that are published under the same name: perceptual distance.

use omnilife_schemas::records::Direction;

use super::{Metric, Need, Sample, Undefined, ViewPair, view_pair::PairFeatures};
use crate::lpips::{Backbone, ImageFeatures, InputRange, Lpips};

pub(super) const VGG: Metric = Metric {
    id: "lpips-vgg",
    title: "LPIPS (VGG)",
    needs: &[Need::Network(Backbone::Vgg)],
    source: "Zhang et al. 2018, version 0.1, VGG of 16 layers, 8-bit images brought to [-1, 1] as \
             the authors' lpips package expects (normalize=True; PanSplat, Splatter-360, OmniSplat \
             src/evaluation/metrics.py); undefined below 16x16 pixels",
    function: |sample| distance(sample, Backbone::Vgg, InputRange::Signed),
    ..PROTOTYPE
};

pub(super) const ALEX: Metric = Metric {
    id: "lpips-alex",
    title: "LPIPS (AlexNet)",
    needs: &[Need::Network(Backbone::Alex)],
    source: "Zhang et al. 2018, version 0.1, AlexNet, 8-bit images brought to [-1, 1] as the \
             authors' lpips package expects; undefined below 31x31 pixels",
    function: |sample| distance(sample, Backbone::Alex, InputRange::Signed),
    ..PROTOTYPE
};

pub(super) const VGG_UNSCALED: Metric = Metric {
    id: "lpips-vgg-unscaled",
    title: "LPIPS (VGG, [0, 1])",
    needs: &[Need::Network(Backbone::Vgg)],
    source: "lpips-vgg with images left in [0, 1], for which the network's constants are not made: \
             what 3DGS publishes (metrics.py, lpipsPyTorch, net_type vgg; its issue 1239); \
             undefined below 16x16 pixels",
    function: |sample| distance(sample, Backbone::Vgg, InputRange::Unsigned),
    ..PROTOTYPE
};

pub(super) const ALEX_UNSCALED: Metric = Metric {
    id: "lpips-alex-unscaled",
    title: "LPIPS (AlexNet, [0, 1])",
    needs: &[Need::Network(Backbone::Alex)],
    source: "lpips-alex with images left in [0, 1], for which the network's constants are not \
             made: what ODGS publishes (metrics.py, lpipsPyTorch, net_type alex); undefined below \
             31x31 pixels",
    function: |sample| distance(sample, Backbone::Alex, InputRange::Unsigned),
    ..PROTOTYPE
};

const PROTOTYPE: Metric = Metric {
    id: "",
    title: "",
    unit: "",
    direction: Some(Direction::LowerIsBetter),
    range: [0.0, f64::MAX],
    source: "",
    needs: &[],
    function: |_| Err(Undefined("")),
};

fn distance(sample: &Sample<'_>, backbone: Backbone, range: InputRange) -> Result<f64, Undefined> {
    let pair = sample.pair;
    // Pixels that do not count are equal in both images.
    let over_counted = |distance: f64| distance / pair.counted_share();
    if (backbone, range) == (Backbone::Alex, InputRange::Signed) {
        let PairFeatures { prediction, truth } = features(pair)?;
        return of_features([prediction, truth]).map(over_counted);
    }
    network(backbone)?
        .distance(pair.size(), [pair.prediction(), pair.truth()], range)
        .map(over_counted)
        .ok_or(TOO_SMALL)
}

/// Returns the features of both images in [-1, 1] by `AlexNet`.
pub(super) fn features(pair: &ViewPair) -> Result<&PairFeatures, Undefined> {
    network(Backbone::Alex)?;
    pair.alex_features().ok_or(TOO_SMALL)
}

/// Returns `lpips-alex` of two images with known features.
pub(super) fn of_features(images: [&ImageFeatures; 2]) -> Result<f64, Undefined> {
    Ok(network(Backbone::Alex)?.distance_of_features(images))
}

const TOO_SMALL: Undefined = Undefined("the image is too small for the network");

/// Returns a network; metrics with missing weights are not computed at all.
fn network(backbone: Backbone) -> Result<&'static Lpips, Undefined> {
    Lpips::published(backbone).map_err(|_| Undefined("the weights of the network are missing"))
}
