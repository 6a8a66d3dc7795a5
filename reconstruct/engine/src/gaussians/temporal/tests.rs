//! Gradients of all raw parameters, compared with finite differences of the definition in f64. Identity with
//! static Gaussians.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::gaussians::temporal::*;
use crate::gaussians::{
    omni4dgs::{DirectionOrigin, VelocityForm},
    static_gaussians::{LOG_SCALES, QUATERNIONS, SH_CONSTANT, SH_REST},
};

const FEATURES: TemporalFeatures = TemporalFeatures {
    velocity_unit: Some(0.1),
    lifespan: Some(LifespanFeature {
        unit_frames: 50.0,
        largest_frames: 20.0,
    }),
};
const LOOK: ViewContext = ViewContext {
    frame_time: FrameTime {
        frame: 2.0,
        shift: 0.7,
    },
    observer: Observer {
        centre: Vec3::new(0.1, 0.2, -0.3),
        down: Vec3::Y,
    },
};
const DECOMPOSITION: Decomposition = Decomposition {
    gamma: 0.5,
    form: VelocityForm::Literal,
    origin: DirectionOrigin::World,
};
const VELOCITY_MODELS: [VelocityModel; 3] = [
    VelocityModel::None,
    VelocityModel::Free,
    VelocityModel::Decomposed(DECOMPOSITION),
];

fn model(velocity: VelocityModel, fades: bool) -> TimeModel {
    TimeModel {
        cycle_frames: 10.0,
        lifespans: fades.then_some(LifespanRange {
            least_frames: 0.25,
            largest_frames: 1e6,
        }),
        velocity,
        least_marginal: 0.0,
    }
}

/// Returns random Gaussians around the observer, with harmonics of degree 1.
fn table(model: &TimeModel, len: usize) -> ParameterTable {
    let mut random = Pcg64Mcg::seed_from_u64(5);
    let mut three = |low: f32, high: f32| [0; 3].map(|_| random.random_range(low..high));
    let positions = (0..len).map(|_| three(-4.0, 4.0)).collect();
    let scales: Vec<f32> = (0..len).map(|_| three(0.1, 0.5)[0]).collect();
    let colours = (0..len).map(|_| three(0.0, 1.0)).collect();
    let opacities = (0..len).map(|_| three(0.2, 0.8)[0]).collect();
    let initial = InitialGaussians::isotropic(positions, &scales, colours, opacities);
    let times = InitialTimes {
        peaks: (0..len).map(|_| three(-4.0, 4.0)[0]).collect(),
        lifespans: (0..len).map(|_| three(2.0, 30.0)[0]).collect(),
        velocities: (0..len).map(|_| three(-0.3, 0.3)).collect(),
    };
    let mut table = model.table(&initial, &times, 1);
    for array in [RADIAL_VELOCITIES, QUATERNIONS_NAME] {
        if let Some(array) = table.position(array) {
            for value in &mut table.arrays[array].values {
                *value += random.random_range(-0.2..0.2);
            }
        }
    }
    table
}

const QUATERNIONS_NAME: &str = "quaternions";

/// Returns the weighted sum of all activated values of Gaussian `index`, from its raw parameters in f64.
/// `weights` are those of position, scale, rotation, opacity, colour, harmonics, features.
fn loss(
    model: &TimeModel,
    raw: &dyn Fn(&str) -> Vec<f64>,
    weights: &[Vec<f64>; 7],
    w_t: f64,
) -> f64 {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let three = |name: &str| {
        let values = raw(name);
        [0, 1, 2].map(|axis| values.get(axis).copied().unwrap_or(0.0))
    };
    let v = match model.velocity {
        VelocityModel::None => [0.0; 3],
        VelocityModel::Free => three(VELOCITIES),
        VelocityModel::Decomposed(_) => {
            let (r, t) = (three(RADIAL_VELOCITIES), three(TANGENTIAL_VELOCITIES));
            [0, 1, 2].map(|axis| (1.0 - w_t) * r[axis] + w_t * t[axis])
        }
    };
    let (l, s) = (
        f64::from(model.cycle_frames),
        f64::from(LOOK.frame_time.shift),
    );
    let peak = raw(PEAK_TIMES).first().copied().unwrap_or(0.0);
    let d = LOOK.frame_time.frame - s - peak;
    let beta = match model.lifespans {
        Some(_) => raw(LOG_LIFESPANS)[0].exp(),
        None => f64::INFINITY,
    };
    let tau = std::f64::consts::TAU;
    let mean = v.map(|v| v * (-0.5 * beta / l).exp());
    let alpha = l / tau * (tau * d / l).sin();
    let position = three("positions");
    let position = [0, 1, 2].map(|axis| position[axis] + alpha * v[axis] + s * mean[axis]);
    let scale: Vec<f64> = raw("log_scales").iter().map(|raw| raw.exp()).collect();
    let q = raw("quaternions");
    let length = dot(&q, &q).sqrt();
    let rotation: Vec<f64> = q.iter().map(|q| q / length).collect();
    let opacity = (-0.5 * (d / beta).powi(2)).exp() / (1.0 + (-raw("opacity_logits")[0]).exp());
    let features = [
        mean[0] / 0.1,
        mean[1] / 0.1,
        mean[2] / 0.1,
        beta.min(20.0) / 50.0,
    ];
    dot(&position, &weights[0])
        + dot(&scale, &weights[1])
        + dot(&rotation, &weights[2])
        + opacity * weights[3][0]
        + dot(&raw("sh_constant"), &weights[4])
        + dot(&raw("sh_rest"), &weights[5])
        + dot(&features, &weights[6])
}

#[test]
fn gradients_of_every_parameter_are_those_of_the_definition() {
    const FIRST: usize = 2;
    let mut random = Pcg64Mcg::seed_from_u64(6);
    for velocity in VELOCITY_MODELS {
        for fades in [true, false] {
            let model = model(velocity, fades);
            let mut table = table(&model, 12);
            let mut instant = ActivatedGaussians::default();
            instant.reshape(FIRST + table.len(), 1, FEATURES.count());
            model.activate_from(&table, &LOOK, &FEATURES, FIRST, &mut instant);
            let mut gradient = ActivatedGaussians::default();
            gradient.clear_to_zero(&instant);
            let mut fill = |values: &mut [f32]| {
                values.fill_with(|| random.random_range(-1.0..1.0));
            };
            fill(gradient.positions.as_flattened_mut());
            fill(gradient.scales.as_flattened_mut());
            fill(gradient.rotations.as_flattened_mut());
            fill(&mut gradient.opacities);
            fill(gradient.sh_constant.as_flattened_mut());
            fill(gradient.sh_rest.as_flattened_mut());
            fill(&mut gradient.features);
            model.activate_from_vjp(&mut table, &LOOK, &FEATURES, FIRST, &instant, &gradient);
            for index in 0..table.len() {
                let entry = FIRST + index;
                let wide =
                    |values: &[f32]| values.iter().map(|&v| f64::from(v)).collect::<Vec<_>>();
                let weights = [
                    wide(&gradient.positions[entry]),
                    wide(&gradient.scales[entry]),
                    wide(&gradient.rotations[entry]),
                    wide(&gradient.opacities[entry..=entry]),
                    wide(&gradient.sh_constant[entry]),
                    wide(gradient.sh_rest[3 * entry..3 * entry + 3].as_flattened()),
                    wide(&gradient.features[4 * entry..4 * entry + 4]),
                ];
                // No gradient flows through the weight, which is a constant of the definition.
                let centre = Vec3::from_slice(table.row(POSITIONS, index));
                let w_t = f64::from(DECOMPOSITION.at(&LOOK.observer, centre).tangential);
                for (number, array) in table.arrays.iter().enumerate() {
                    for column in 0..array.width {
                        let h = 1e-5;
                        let shifted = |step: f64| {
                            let raw = |name: &str| {
                                let Some(at) = table.position(name) else {
                                    return Vec::new();
                                };
                                let mut values = wide(table.row(at, index));
                                if at == number {
                                    values[column] += step;
                                }
                                values
                            };
                            loss(&model, &raw, &weights, w_t)
                        };
                        let expected = (shifted(h) - shifted(-h)) / (2.0 * h);
                        let found = f64::from(array.gradients[index * array.width + column]);
                        assert!(
                            (found - expected).abs() < 2e-4 * (1.0 + expected.abs()),
                            "{} {column} of {index} ({velocity:?}, fades {fades}): {found} {expected}",
                            array.name
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn long_lifespans_without_velocity_are_static_gaussians() {
    let look = |frame| ViewContext {
        frame_time: FrameTime::at(frame),
        ..LOOK
    };
    for velocity in VELOCITY_MODELS {
        for fades in [true, false] {
            let model = model(velocity, fades);
            let mut still = table(&model, 20);
            for name in [VELOCITIES, RADIAL_VELOCITIES, TANGENTIAL_VELOCITIES] {
                if let Some(array) = still.position(name) {
                    still.arrays[array].values.fill(0.0);
                }
            }
            if let Some(array) = still.position(LOG_LIFESPANS) {
                still.arrays[array].values.fill(f32::MAX);
            }
            let mut expected = ActivatedGaussians::default();
            static_gaussians::activate(&still, &mut expected);
            for frame in [-5e3, 0.0, 31.7, 5e3] {
                let mut instant = expected.clone();
                model.activate_from(
                    &still,
                    &look(frame),
                    &TemporalFeatures::default(),
                    0,
                    &mut instant,
                );
                let nearly = |a: f32, b: f32| (a - b).abs() < 2e-5;
                assert_eq!(instant.positions, expected.positions);
                assert!(
                    instant
                        .opacities
                        .iter()
                        .zip(&expected.opacities)
                        .all(|(&a, &b)| nearly(a, b)),
                    "{frame}"
                );
                assert_eq!(
                    (instant.scales, instant.sh_rest),
                    (expected.scales.clone(), expected.sh_rest.clone())
                );
            }
        }
    }
}

#[test]
fn a_model_without_time_has_the_table_of_static_gaussians() {
    let model = model(VelocityModel::None, false);
    assert!(model.shapes().is_empty());
    let table = table(&model, 3);
    assert_eq!(table.arrays.len(), SH_REST + 1);
    for (array, name) in [
        (LOG_SCALES, "log_scales"),
        (QUATERNIONS, QUATERNIONS_NAME),
        (SH_CONSTANT, "sh_constant"),
    ] {
        assert_eq!(table.arrays[array].name, name);
    }
}

#[test]
fn lifespans_stay_within_their_bounds() {
    let model = model(VelocityModel::Free, true);
    let mut table = table(&model, 3);
    let array = table.position(LOG_LIFESPANS).expect("fades");
    table.arrays[array].values = vec![-80.0, 1.0, 80.0];
    model.keep_within_bounds(&mut table);
    let lifespans: Vec<f32> = table.arrays[array]
        .values
        .iter()
        .map(|raw| raw.exp())
        .collect();
    assert!((lifespans[0] - 0.25).abs() < 1e-6 && (lifespans[2] / 1e6 - 1.0).abs() < 1e-5);
    assert_eq!(table.arrays[array].values[1], 1.0);
}

#[test]
fn a_faded_gaussian_is_not_drawn_and_gets_no_gradient() {
    let model = TimeModel {
        least_marginal: 0.05,
        ..model(VelocityModel::Free, true)
    };
    let mut table = table(&model, 1);
    let array = table.position(LOG_LIFESPANS).expect("fades");
    table.arrays[array].values = vec![0.0];
    let peak = table.position(PEAK_TIMES).expect("fades");
    // exp(-2.5^2 / 2) = 0.044
    table.arrays[peak].values = vec![-1.2];
    let mut instant = ActivatedGaussians::default();
    instant.reshape(1, 1, 0);
    let none = TemporalFeatures::default();
    model.activate_from(&table, &LOOK, &none, 0, &mut instant);
    assert_eq!(instant.opacities, [0.0]);
    let mut gradient = ActivatedGaussians::default();
    gradient.clear_to_zero(&instant);
    gradient.opacities[0] = 1.0;
    model.activate_from_vjp(&mut table, &LOOK, &none, 0, &instant, &gradient);
    for array in &table.arrays {
        assert!(
            array.gradients.iter().all(|&gradient| gradient == 0.0),
            "{}",
            array.name
        );
    }
}

#[test]
fn bounds_that_no_lifespan_lies_between_are_refused() {
    let sound = model(VelocityModel::Free, true);
    assert_eq!(sound.check(), Ok(()));
    for (least_frames, largest_frames) in [
        (0.25, 0.0),
        (0.0, 10.0),
        (f32::NAN, 10.0),
        (0.25, f32::INFINITY),
    ] {
        let model = TimeModel {
            lifespans: Some(LifespanRange {
                least_frames,
                largest_frames,
            }),
            ..sound
        };
        assert!(model.check().is_err(), "{least_frames} to {largest_frames}");
    }
    let still = TimeModel {
        cycle_frames: 0.0,
        ..sound
    };
    assert!(still.check().is_err());
}
