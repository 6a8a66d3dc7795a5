//! Gradients of all canonical parameters and weights, compared with finite differences of the definition in
//! f64. Identity with static Gaussians.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::fields::mlp::reference::{encoded, outputs};
use crate::gaussians::deformable::*;
use crate::gaussians::static_gaussians::{
    InitialGaussians, LOG_SCALES, OPACITY_LOGITS, QUATERNIONS, SH_CONSTANT,
};

const MODEL: DeformationModel = DeformationModel {
    position_octaves: 2,
    time_octaves: 3,
    depth: 3,
    width: 6,
    skip_after: 0,
    length_unit: 4.0,
};
const TIME: f32 = 0.37;
const LEN: usize = 7;

fn random(len: usize, seed: u64, low: f32, high: f32) -> Vec<f32> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    (0..len).map(|_| random.random_range(low..high)).collect()
}

fn table() -> ParameterTable {
    let initial = InitialGaussians::isotropic(
        random(3 * LEN, 1, -4.0, 4.0).as_chunks::<3>().0.to_vec(),
        &random(LEN, 2, 0.1, 0.5),
        vec![[0.4, 0.5, 0.6]; LEN],
        random(LEN, 3, 0.2, 0.8),
    );
    let mut table = static_gaussians::table(&initial, 0);
    table.arrays[QUATERNIONS].values = random(4 * LEN, 4, -1.0, 1.0);
    table
}

/// Weights with a non-zero output layer.
fn weights() -> SharedParameters {
    let network = MODEL.network();
    let mut values = network.initial_weights(5);
    let heads = network.layers()[MODEL.depth].hidden_weights().start;
    let count = values.len() - heads;
    values[heads..].copy_from_slice(&random(count, 6, -0.05, 0.05));
    SharedParameters::new(DEFORMATION_WEIGHTS, values)
}

/// Returns the network's outputs in f64.
fn network(weights: &[f64], position: [f64; 3]) -> Vec<f64> {
    let unit = f64::from(MODEL.length_unit);
    let row = encoded(&position.map(|value| value / unit), MODEL.position_octaves);
    let shared = encoded(&[f64::from(TIME)], MODEL.time_octaves);
    outputs(MODEL.network(), weights, &shared, &row)
}

/// Returns an activated Gaussian: 3 of position, 3 of scale, 4 of rotation, opacity, 3 of colour.
/// `encoded_at` is the position that the network encodes, which has no gradient.
fn definition(weights: &[f64], raw: &[Vec<f64>], encoded_at: [f64; 3]) -> Vec<f64> {
    let unit = f64::from(MODEL.length_unit);
    let output = network(weights, encoded_at);
    let length = |q: &[f64]| q.iter().map(|value| value * value).sum::<f64>().sqrt();
    let mut seen: Vec<f64> = (0..3)
        .map(|axis| raw[POSITIONS][axis] + unit * output[axis])
        .collect();
    seen.extend((0..3).map(|axis| raw[LOG_SCALES][axis].exp() + unit * output[7 + axis]));
    let q = &raw[QUATERNIONS];
    let sum: Vec<f64> = (0..4)
        .map(|axis| q[axis] / length(q) + output[3 + axis])
        .collect();
    seen.extend(sum.iter().map(|value| value / length(&sum)));
    seen.push(1.0 / (1.0 + (-raw[OPACITY_LOGITS][0]).exp()));
    seen.extend(&raw[SH_CONSTANT]);
    seen
}

fn raw(table: &ParameterTable, index: usize) -> Vec<Vec<f64>> {
    let arrays = 0..table.arrays.len();
    arrays
        .map(|array| {
            table
                .row(array, index)
                .iter()
                .map(|&v| f64::from(v))
                .collect()
        })
        .collect()
}

fn centre(table: &ParameterTable, index: usize) -> [f64; 3] {
    let row = table.row(POSITIONS, index);
    [0, 1, 2].map(|axis| f64::from(row[axis]))
}

/// Gradients of every value that [`definition`] lists, for every Gaussian.
fn upstream(like: &ActivatedGaussians) -> (ActivatedGaussians, Vec<Vec<f64>>) {
    let mut gradient = ActivatedGaussians::default();
    gradient.clear_to_zero(like);
    let values = random(14 * LEN, 7, -1.0, 1.0);
    for (index, row) in values.chunks_exact(14).enumerate() {
        gradient.positions[index].copy_from_slice(&row[..3]);
        gradient.scales[index].copy_from_slice(&row[3..6]);
        gradient.rotations[index].copy_from_slice(&row[6..10]);
        gradient.opacities[index] = row[10];
        gradient.sh_constant[index].copy_from_slice(&row[11..]);
    }
    let rows = values.chunks_exact(14);
    (
        gradient,
        rows.map(|row| row.iter().map(|&v| f64::from(v)).collect())
            .collect(),
    )
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[test]
fn gradients_of_every_parameter_are_those_of_the_definition() {
    let (mut table, mut weights) = (table(), weights());
    let mut deformation = Deformation::default();
    let mut instant = ActivatedGaussians::default();
    deformation.activate(&MODEL, &weights.array.values, &table, TIME, &mut instant);
    let wide: Vec<f64> = weights.array.values.iter().map(|&w| f64::from(w)).collect();
    for index in 0..LEN {
        let expected = definition(&wide, &raw(&table, index), centre(&table, index));
        let found = [
            &instant.positions[index][..],
            &instant.scales[index],
            &instant.rotations[index],
            &[instant.opacities[index]],
            &instant.sh_constant[index],
        ]
        .concat();
        for (found, expected) in found.iter().zip(expected) {
            assert!(
                (f64::from(*found) - expected).abs() < 1e-5,
                "{found} {expected}"
            );
        }
    }
    let (mut gradient, by_seen) = upstream(&instant);
    deformation.activate_vjp(
        &MODEL,
        &mut weights.array,
        &mut table,
        TIME,
        (&mut instant, &mut gradient),
    );
    let close = |found: f32, expected: f64| {
        (f64::from(found) - expected).abs() < 2e-4 * (1.0 + expected.abs())
    };
    for (index, by_seen) in by_seen.iter().enumerate() {
        let raw = raw(&table, index);
        for (array, values) in raw.iter().enumerate() {
            for column in 0..values.len() {
                let shifted = |step: f64| {
                    let mut raw = raw.clone();
                    raw[array][column] += step;
                    dot(&definition(&wide, &raw, centre(&table, index)), by_seen)
                };
                let expected = (shifted(1e-5) - shifted(-1e-5)) / 2e-5;
                let array = &table.arrays[array];
                let found = array.gradients[index * array.width + column];
                assert!(
                    close(found, expected),
                    "{} {index}: {found} {expected}",
                    array.name
                );
            }
        }
    }
    for weight in 0..wide.len() {
        let shifted = |step: f64| {
            let mut wide = wide.clone();
            wide[weight] += step;
            let one = |index: usize| {
                dot(
                    &definition(&wide, &raw(&table, index), centre(&table, index)),
                    &by_seen[index],
                )
            };
            (0..LEN).map(one).sum::<f64>()
        };
        let expected = (shifted(1e-6) - shifted(-1e-6)) / 2e-6;
        let found = weights.array.gradients[weight];
        assert!(
            close(found, expected),
            "weight {weight}: {found} {expected}"
        );
    }
}

#[test]
fn with_an_output_layer_of_zeros_gaussians_are_static_ones() {
    let mut table = table();
    let mut weights =
        SharedParameters::new(DEFORMATION_WEIGHTS, MODEL.network().initial_weights(8));
    let mut deformation = Deformation::default();
    let (mut instant, mut expected) =
        (ActivatedGaussians::default(), ActivatedGaussians::default());
    deformation.activate(&MODEL, &weights.array.values, &table, TIME, &mut instant);
    static_gaussians::activate(&table, &mut expected);
    let rotations = instant.rotations.as_flattened().iter();
    for (a, b) in rotations.zip(expected.rotations.as_flattened()) {
        assert!((a - b).abs() < 1e-6, "{a} {b}");
    }
    assert_eq!(instant.positions, expected.positions);
    assert_eq!(instant.scales, expected.scales);
    assert_eq!(instant.opacities, expected.opacities);

    let (mut gradient, _) = upstream(&instant);
    let mut twin = table.clone();
    static_gaussians::activate_vjp(&mut twin, &expected, &gradient);
    deformation.activate_vjp(
        &MODEL,
        &mut weights.array,
        &mut table,
        TIME,
        (&mut instant, &mut gradient),
    );
    for (a, b) in table.arrays.iter().zip(&twin.arrays) {
        for (a, b) in a.gradients.iter().zip(&b.gradients) {
            assert!((a - b).abs() < 1e-5 * (1.0 + b.abs()), "{a} {b}");
        }
    }
    // The output layer nevertheless has a gradient, so that the network can be trained.
    let heads = MODEL.network().layers()[MODEL.depth];
    let of_heads = &weights.array.gradients[heads.hidden_weights()];
    assert!(of_heads.iter().any(|&g| g != 0.0));
}

#[test]
fn extremes_stay_finite_and_a_bad_gradient_stays_where_it_is() {
    let (mut table, mut weights) = (table(), weights());
    let heads = MODEL.network().layers()[MODEL.depth];
    // All scales become negative, and the first quaternion is cancelled.
    for value in &mut weights.array.values[heads.biases()][7..] {
        *value = -100.0;
    }
    table.arrays[POSITIONS].values[3..6].fill(1e6);
    table.arrays[QUATERNIONS].values[..4].fill(0.0);
    for time in [-3.0, 0.0, 1.0, 50.0] {
        let mut deformation = Deformation::default();
        deformation.keep_activations(false);
        let mut instant = ActivatedGaussians::default();
        deformation.activate(&MODEL, &weights.array.values, &table, time, &mut instant);
        let finite = |values: &[f32]| values.iter().all(|value| value.is_finite());
        assert!(
            finite(instant.positions.as_flattened()) && finite(instant.rotations.as_flattened())
        );
        assert!(
            instant
                .scales
                .as_flattened()
                .iter()
                .all(|&scale| scale > 0.0)
        );
        let (mut gradient, _) = upstream(&instant);
        gradient.positions[2][0] = f32::NAN;
        deformation.activate_vjp(
            &MODEL,
            &mut weights.array,
            &mut table,
            time,
            (&mut instant, &mut gradient),
        );
        assert!(finite(&weights.array.gradients));
        let positions = &table.arrays[POSITIONS].gradients;
        assert!(positions[6].is_nan() && finite(&positions[..6]) && finite(&positions[7..]));
    }
}

#[test]
fn sizes_that_no_network_has_are_refused() {
    assert_eq!(MODEL.check(), Ok(()));
    assert_eq!(DeformationModel::published(1.0).check(), Ok(()));
    for model in [
        DeformationModel { width: 0, ..MODEL },
        DeformationModel {
            width: u32::MAX as usize,
            ..MODEL
        },
        DeformationModel { depth: 0, ..MODEL },
        DeformationModel {
            depth: 1 << 40,
            ..MODEL
        },
        DeformationModel {
            position_octaves: usize::MAX,
            ..MODEL
        },
        DeformationModel {
            length_unit: 0.0,
            ..MODEL
        },
    ] {
        assert!(model.check().is_err(), "{model:?}");
    }
}
