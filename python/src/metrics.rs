//! Metrics of scoring, on arrays.

use std::collections::BTreeMap;

use omnilife_bench::{
    DepthPair, METRICS, Metric, Need, Sample, ViewPair,
    lpips::{Backbone, Lpips},
};
use omnilife_schemas::{names, npy, progress::Progress, records::Direction, rgb::Mask};
use pyo3::{prelude::*, types::PyBytes};

use crate::{background, errors::Failure};

/// Properties of a metric.
#[derive(IntoPyObject)]
pub(crate) struct About {
    id: &'static str,
    title: &'static str,
    unit: &'static str,
    /// `higher-is-better`, `lower-is-better`, or `None`.
    direction: Option<&'static str>,
    range: [f64; 2],
    source: &'static str,
    /// Kinds, each with a name or an empty text.
    needs: Vec<(&'static str, &'static str)>,
}

/// Score, or the reason why it is missing.
#[derive(IntoPyObject)]
pub(crate) enum Outcome {
    Value(f64),
    Undefined(&'static str),
}

/// Inputs beside prediction and ground truth, of the same size: masks of one byte per pixel, 0 for outside; distances
/// as f32.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct MetricInputs {
    /// Mask of the ignored region.
    ignored: Option<Vec<u8>>,
    dynamic: Option<Vec<u8>>,
    classes: BTreeMap<String, Vec<u8>>,
    objects: BTreeMap<String, Vec<u8>>,
    /// Predicted and true distances.
    depth: Option<(Vec<u8>, Vec<u8>)>,
    /// Prediction and ground truth of the previous view.
    previous: Option<(Vec<u8>, Vec<u8>)>,
}

/// Returns all metrics, in their order.
#[pyfunction]
pub(crate) fn metrics() -> Vec<About> {
    METRICS.iter().map(about).collect()
}

fn about(metric: &Metric) -> About {
    About {
        id: metric.id,
        title: metric.title,
        unit: metric.unit,
        direction: metric.direction.map(|direction| match direction {
            Direction::HigherIsBetter => "higher-is-better",
            Direction::LowerIsBetter => "lower-is-better",
        }),
        range: metric.range,
        source: metric.source,
        needs: metric.needs.iter().map(need).collect(),
    }
}

fn need(need: &Need) -> (&'static str, &'static str) {
    match need {
        Need::Network(backbone) => ("network", backbone.weights()),
        Need::Sphere => ("sphere", ""),
        Need::DynamicMask => ("dynamic-mask", ""),
        Need::ClassMask(class) => ("class-mask", class),
        Need::ObjectMasks => ("object-masks", ""),
        Need::Depth => ("depth", ""),
        Need::PreviousView => ("previous-view", ""),
    }
}

/// Returns the scored bytes of values in [0, 1], f64 of this shape.
#[pyfunction]
pub(crate) fn scored_bytes<'py>(
    py: Python<'py>,
    values: &[u8],
    shape: [u32; 3],
) -> PyResult<Bound<'py, PyBytes>> {
    let array = npy::Array {
        shape: shape.map(|length| length as usize).to_vec(),
        values: values
            .as_chunks()
            .0
            .iter()
            .copied()
            .map(f64::from_ne_bytes)
            .collect(),
    };
    let bytes = background::run(py, move |_| {
        let [height, width, _] = shape;
        omnilife_bench::scored_bytes(&array, width, height)
            .map_err(|reason| Failure::of_input(format!("the image {reason}")))
    })?;
    Ok(PyBytes::new(py, &bytes))
}

/// Computes metrics, in the requested order. `size` is (width, height) of all images; `prediction` and `truth` are
/// (height, width, 3) u8.
#[pyfunction]
pub(crate) fn compute(
    py: Python<'_>,
    ids: Vec<String>,
    size: [usize; 2],
    prediction: &[u8],
    truth: &[u8],
    given: MetricInputs,
) -> PyResult<Vec<Outcome>> {
    let (prediction, truth) = (prediction.to_vec(), truth.to_vec());
    background::run(py, move |link| {
        let metrics = found(&ids)?;
        let [width, height] = size;
        let mask = |data: Vec<u8>| masked(width, height, data);
        let ignored = given.ignored.map(mask).transpose()?;
        let pair = view_pair(size, (prediction, truth), ignored.as_ref())?;
        let of_names = |masks: BTreeMap<String, Vec<u8>>| {
            let masks = masks.into_iter();
            masks
                .map(|(name, data)| Ok((name, mask(data)?)))
                .collect::<Result<BTreeMap<_, _>, Failure>>()
        };
        let dynamic = given.dynamic.map(mask).transpose()?;
        let (classes, objects) = (of_names(given.classes)?, of_names(given.objects)?);
        let previous = given.previous;
        let previous = previous.map(|images| view_pair(size, images, ignored.as_ref()));
        let previous = previous.transpose()?;
        let depth = given.depth.map(depth_pair);
        if depth.as_ref().is_some_and(|depth| {
            [&depth.prediction, &depth.truth].map(Vec::len) != [width * height; 2]
        }) {
            return Err(Failure::of_input("depth and images differ in size"));
        }
        let mut sample = Sample::new(&pair);
        sample.dynamic = dynamic.as_ref();
        sample.classes = classes
            .iter()
            .map(|(name, mask)| (name.as_str(), mask))
            .collect();
        sample.objects = objects
            .iter()
            .map(|(name, mask)| (name.as_str(), mask))
            .collect();
        sample.previous = previous.as_ref();
        sample.depth = depth.as_ref();
        // As wide as the whole sphere.
        sample.is_panorama = width == 2 * height;
        let mut outcomes = Vec::with_capacity(metrics.len());
        for metric in metrics {
            if link.is_interrupted() {
                break;
            }
            outcomes.push(match (metric.function)(&sample) {
                Ok(value) => Outcome::Value(value),
                Err(undefined) => Outcome::Undefined(undefined.0),
            });
        }
        Ok(outcomes)
    })
}

/// Returns the metrics of these ids, with the weights that they need.
fn found(ids: &[String]) -> Result<Vec<&'static Metric>, Failure> {
    let mut metrics = Vec::with_capacity(ids.len());
    for id in ids {
        let metric = names::find("metric", id, METRICS, |metric| metric.id)
            .map_err(|unknown| Failure::of_input(unknown.to_string()))?;
        let networks = metric.needs.iter().filter_map(network);
        networks
            .map(Lpips::published)
            .collect::<Result<Vec<_>, _>>()?;
        metrics.push(metric);
    }
    Ok(metrics)
}

fn network(need: &Need) -> Option<Backbone> {
    match need {
        Need::Network(backbone) => Some(*backbone),
        _ => None,
    }
}

fn view_pair(
    [width, height]: [usize; 2],
    (prediction, truth): (Vec<u8>, Vec<u8>),
    ignored: Option<&Mask>,
) -> Result<ViewPair, Failure> {
    let pair = ViewPair::new(width, height, prediction, truth).ok_or_else(|| {
        Failure::of_input("prediction and truth differ in size or have no pixels")
    })?;
    match ignored {
        Some(mask) => (pair.ignoring(mask))
            .ok_or_else(|| Failure::of_input("every pixel is ignored, nothing is left to score")),
        None => Ok(pair),
    }
}

fn masked(width: usize, height: usize, data: Vec<u8>) -> Result<Mask, Failure> {
    if data.len() != width * height {
        return Err(Failure::of_input("a mask and the images differ in size"));
    }
    Ok(Mask::new(width, height, data))
}

fn depth_pair((prediction, truth): (Vec<u8>, Vec<u8>)) -> DepthPair {
    let values = |bytes: Vec<u8>| {
        bytes
            .as_chunks()
            .0
            .iter()
            .copied()
            .map(f32::from_ne_bytes)
            .collect()
    };
    DepthPair {
        prediction: values(prediction),
        truth: values(truth),
    }
}
