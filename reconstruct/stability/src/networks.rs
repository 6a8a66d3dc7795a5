//! Cases of networks that Gaussians share.

use omnilife_engine::{
    fields::mlp::{
        encoding,
        passes::{Activations, NetworkGradients},
        reference,
    },
    gaussians::{ActivatedGaussians, deformable::DeformationModel},
};
use omnilife_schemas::records::StabilityMeasures;
use omnilife_training::error::ReconstructError;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::{
    devices::Device,
    largest_or_nan,
    parameterizations::DEFORMABLE,
    setup::{Setup, mild},
    special::{CaseResult, HostOnly, Runs, SpecialCase},
};

pub(super) const CASES: &[SpecialCase] = &[
    SpecialCase {
        id: "network-weights",
        title: "Gaussians and gradients that are not finite, deformed by a network",
        runs: Runs::OnBoth,
        judge: network_weights,
    },
    SpecialCase {
        id: "network-published",
        title: "the published network, eight layers of 256, of places from a millionth to a hundred thousand units away",
        runs: Runs::OnCpu(HostOnly::WithinSteps),
        judge: |_| published_network(),
    },
];

/// Checks that one bad Gaussian does not reach the weights that all Gaussians share.
fn network_weights(device: &Device) -> CaseResult {
    let mut setup = Setup::new(mild());
    let good = setup.gaussians.len();
    for number in 0..4 {
        setup.gaussians.push(setup.gaussians[number]);
    }
    let weights = |setup: &Setup, bad: &[usize]| -> Result<_, ReconstructError> {
        let part = (DEFORMABLE.part)((DEFORMABLE.table)(setup), setup);
        let (_, part) = device.activated_part(part, &setup.viewpoint(), |instant| {
            let mut gradient = ActivatedGaussians::default();
            gradient.clear_to_zero(instant);
            for (index, row) in gradient.positions.iter_mut().enumerate().take(good) {
                *row = [1.0, 0.1 * index as f32, -0.5];
            }
            for &index in bad {
                gradient.positions[index] = [f32::NAN, 1.0, 1.0];
                gradient.scales[index] = [f32::INFINITY; 3];
            }
            gradient
        })?;
        let shared = part.parameterization.shared();
        Ok(shared.map(|weights| weights.array.gradients.clone()))
    };
    let expected = weights(&setup, &[]);
    setup.gaussians[good].position[0] = f64::NAN;
    setup.gaussians[good + 1].position[2] = f64::INFINITY;
    setup.gaussians[good + 2].quaternion[1] = f64::NAN;
    let found = weights(&setup, &[good, good + 1, good + 2, good + 3]);
    let (expected, found) = match (expected, found) {
        (Ok(expected), Ok(found)) => (expected, found),
        (Err(error), _) | (_, Err(error)) => return CaseResult::failed(error),
    };
    let [Some(expected), Some(found)] = [expected, found] else {
        return CaseResult::failed("the weights have no gradient at all");
    };
    let largest = expected.iter().fold(0.0_f32, |most, by| most.max(by.abs()));
    if largest == 0.0 {
        return CaseResult::failed("the weights have no gradient at all");
    }
    let errors = found.iter().zip(&expected);
    let errors = errors.map(|(found, expected)| f64::from((found - expected).abs() / largest));
    CaseResult::of_errors(
        "such a Gaussian takes no part in the gradient by the weights",
        None,
        Some([errors.fold(0.0, largest_or_nan), device.limit(1e-7)]),
    )
}

/// Ten times the measured error, relative to the outputs' and the derivative's sizes.
const PUBLISHED_LIMIT: f64 = 2.5e-5;
/// Number of tried rows of the published network.
const ROWS: usize = 40;

/// Compares outputs with f64, and the derivative along one direction of all weights with a central difference.
fn published_network() -> CaseResult {
    let model = DeformationModel::published(1.0);
    let shape = model.network();
    let mut random = Pcg64Mcg::seed_from_u64(12);
    let mut weights = shape.initial_weights(9);
    let heads = shape.layers()[shape.depth].hidden_weights().start;
    weights[heads..].fill_with(|| random.random_range(-0.05..0.05));
    let places: Vec<[f32; 3]> = (0..ROWS)
        .map(|row| {
            let size = [1e-6, 1e-2, 1.0, 1e2, 1e5][row % 5];
            [0; 3].map(|_| size * random.random_range(-1.0_f32..1.0))
        })
        .collect();
    let mut time = vec![0.0; shape.shared_inputs];
    encoding::encode(&[0.3], model.time_octaves, &mut time);
    let encode = |row: usize, out: &mut [f32]| {
        encoding::encode(&places[row], model.position_octaves, out);
    };
    let mut activations = Activations::new(usize::MAX);
    let mut outputs = vec![0.0; ROWS * shape.outputs];
    shape.forward(&weights, &time, &encode, &mut activations, &mut outputs);
    let upstream: Vec<f32> = (0..outputs.len())
        .map(|_| random.random_range(-1.0..1.0))
        .collect();
    let mut gradient = vec![0.0; weights.len()];
    let by = NetworkGradients::by_weights(&mut gradient);
    shape.backward(&weights, &time, &encode, &activations, &upstream, by);

    let widen = |values: &[f32]| -> Vec<f64> { values.iter().copied().map(f64::from).collect() };
    let shared = reference::encoded(&[f64::from(0.3_f32)], model.time_octaves);
    let all_outputs = |weights: &[f64]| -> Vec<f64> {
        let of = |place: &[f32; 3]| {
            let row = reference::encoded(&widen(place), model.position_octaves);
            reference::outputs(shape, weights, &shared, &row)
        };
        places.iter().flat_map(of).collect()
    };
    let wide = widen(&weights);
    let expected = all_outputs(&wide);
    let size =
        (expected.iter().map(|value| value * value).sum::<f64>() / expected.len() as f64).sqrt();
    let errors = outputs.iter().zip(&expected);
    let forward = errors.map(|(&found, expected)| (f64::from(found) - expected).abs() / size);
    let direction: Vec<f64> = wide
        .iter()
        .map(|_| random.random_range(-1.0..1.0))
        .collect();
    let along = |step: f64| -> f64 {
        let moved: Vec<f64> = wide
            .iter()
            .zip(&direction)
            .map(|(a, b)| a + step * b)
            .collect();
        let outputs = all_outputs(&moved);
        outputs
            .iter()
            .zip(&upstream)
            .map(|(a, &b)| a * f64::from(b))
            .sum()
    };
    // Short enough that almost no rectifier switches.
    let h = 1e-9;
    let by_direction = (along(h) - along(-h)) / (2.0 * h);
    let found: f64 = gradient
        .iter()
        .zip(&direction)
        .map(|(&a, b)| f64::from(a) * b)
        .sum();
    let measures = StabilityMeasures {
        forward_error: Some(forward.fold(0.0, largest_or_nan)),
        forward_share: Some(0.0),
        forward_limit: Some(PUBLISHED_LIMIT),
        gradient_error: Some((found - by_direction).abs() / by_direction.abs()),
        gradient_limit: Some(PUBLISHED_LIMIT),
        is_finite: outputs
            .iter()
            .chain(&gradient)
            .all(|value| value.is_finite()),
        drawn: 0,
        gaussians: ROWS as u64,
    };
    let worst = [measures.forward_error, measures.gradient_error];
    let worst = worst.into_iter().flatten().fold(0.0, largest_or_nan);
    // In this form NaN is a fault.
    let is_right = measures.is_finite && worst <= PUBLISHED_LIMIT;
    CaseResult {
        action: "outputs and the derivative along one direction of all weights, against f64"
            .to_owned(),
        fault: (!is_right).then(|| {
            format!("off by {worst:.1e} of their size, the limit is {PUBLISHED_LIMIT:.0e}")
        }),
        measured: Some(measures),
    }
}
