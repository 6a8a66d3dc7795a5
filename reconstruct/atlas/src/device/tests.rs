//! A step on a GPU compared with that of the CPU in f64.

use omnilife_engine::device::GpuError;

use super::*;
use crate::{
    node::{Fields, Node, Surface},
    tests::{field, field_of_sizes, scene, texture},
};

const RAYS_OF_TEST: usize = 300;
const RATES: StepRates = StepRates {
    poses: 0.0,
    tables: 0.0,
    networks: 0.0,
    mask_weight: 0.05,
    rescales_gradients: false,
};

/// Returns a sphere around the scene, with a flow that turns directions by up to tens of degrees.
fn sphere() -> Node {
    Node {
        id: "sphere".to_owned(),
        surface: Surface::Sphere {
            centre: DVec3::new(0.1, 0.0, -0.2),
            radius: 6.0,
        },
        colour: texture(0.7, 0.3),
        opacity: None,
        fields: Fields {
            colour: Some(field(3, 3, 0.4)),
            flow: Some(field_of_sizes(3, 12, 0.9, [0.7, 1.4])),
            ..Fields::default()
        },
        offsets: None,
        times: [f64::MIN, f64::MAX],
        delay: 0.0,
        overlay: None,
    }
}

/// Returns two planes before a third one, or before a sphere, and rays with targets.
fn case(has_sphere: bool) -> (Graph, Rays, Targets) {
    let (mut graph, mut rays) = scene();
    if has_sphere {
        graph.nodes[2] = sphere();
    }
    rays.moment_of = vec![0; RAYS_OF_TEST];
    rays.directions = (0..RAYS_OF_TEST)
        .map(|ray| {
            let at = ray as f64;
            DVec3::new(0.3 * (1.3 * at).sin(), 0.25 * (0.7 * at).cos(), 1.0).normalize()
        })
        .collect();
    let share = |at: usize| 0.5 + 0.5 * (2.1 * at as f64).sin();
    let targets = Targets {
        colours: (0..RAYS_OF_TEST)
            .map(|ray| DVec3::new(share(ray), share(ray + 1), share(ray + 2)))
            .collect(),
        covered: (0..2 * RAYS_OF_TEST)
            .map(|at| (at % 5 > 0).then(|| share(3 * at)))
            .collect(),
    };
    (graph, rays, targets)
}

fn device() -> Option<AtlasDevice> {
    match AtlasDevice::open([RAYS_OF_TEST + 20, 1]) {
        Ok(device) => Some(device),
        Err(EngineError::Gpu(GpuError::NoAdapter)) => {
            omnilife_schemas::testing::skip(GpuError::NoAdapter);
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// Asserts that the largest difference is within a hundredth of the largest value.
fn assert_close(found: &[f64], expected: &[f64], what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let largest = expected.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    assert!(largest > 0.0, "{what} is 0 everywhere");
    for (index, (found, expected)) in found.iter().zip(expected).enumerate() {
        let error = (found - expected).abs();
        assert!(error < 1e-2 * largest, "{what} {index}: {found} {expected}");
    }
}

/// Returns the values of gradients by poses, one after another.
fn values((by_nodes, by_camera): &PoseGradients) -> Vec<f64> {
    let all = by_nodes.iter().flatten().chain(by_camera);
    all.flat_map(|by| {
        let rotation = by.rotation.to_cols_array();
        by.centre.to_array().into_iter().chain(rotation)
    })
    .collect()
}

#[test]
fn a_step_has_the_loss_and_the_gradients_of_the_cpu() {
    let Some(mut device) = device() else { return };
    for has_sphere in [false, true] {
        device.forget();
        let (mut on_cpu, rays, targets) = case(has_sphere);
        let seen = on_cpu.see(&rays, &Detail::FULL, true, &|_| true);
        let (outcome, upstream) = on_cpu.loss(&seen, &targets, RATES.mask_weight);
        let expected = on_cpu.backward(&rays, &seen, &upstream, None);

        let (mut graph, ..) = case(has_sphere);
        let batch = Batch::new(&graph, &rays, &seen, &Detail::FULL);
        let steps = next_steps(&mut graph, &seen, &Detail::FULL, &RATES);
        let surfaces = device.surfaces(&graph).expect("uploads");
        let colours: Vec<[f32; 3]> = targets
            .colours
            .iter()
            .map(|colour| colour.as_vec3().to_array())
            .collect();
        let covered: Vec<f32> = targets
            .covered
            .iter()
            .map(|covered| covered.map_or(-1.0, |covered| covered as f32))
            .collect();
        let aimed = RayTargets {
            colours: &colours,
            covered: &covered,
            mask_weight: RATES.mask_weight,
        };
        let made = surfaces.step(&batch.borrowed(), &aimed, &steps);
        let made = made.expect("steps");
        let found = by_poses(&graph, &rays, &seen, &made);
        assert_close(&values(&found), &values(&expected), "gradients by poses");

        device.is_newer = true;
        device.download(&mut graph).expect("downloads");
        for (found, expected) in graph.nodes.iter().zip(&on_cpu.nodes) {
            for kind in FieldKind::ALL {
                let pair = found.fields.get(kind).zip(expected.fields.get(kind));
                let Some((found, expected)) = pair else {
                    continue;
                };
                for (found, expected) in found.arrays().into_iter().zip(expected.arrays()) {
                    // After one step of Adam, first moments are a tenth of the gradients.
                    let moments = found.first_moments.iter();
                    let moments: Vec<f64> = moments.map(|&m| 10.0 * f64::from(m)).collect();
                    let gradients = expected.gradients.iter();
                    let gradients: Vec<f64> = gradients.map(|&g| f64::from(g)).collect();
                    assert_close(&moments, &gradients, found.name);
                }
            }
        }

        // A whole step on a graph of its own.
        let (mut graph, ..) = case(has_sphere);
        device.forget();
        let stepped = device.step(&mut graph, (&rays, &targets), &Detail::FULL, &RATES);
        let stepped = stepped.expect("steps");
        assert!((stepped.loss - outcome.loss).abs() < 1e-5 * outcome.loss);
        let apart = (stepped.squared_error - outcome.squared_error).abs();
        assert!(apart < 1e-5 * outcome.squared_error);
        assert_eq!(stepped.samples, outcome.samples);
        assert_eq!(stepped.missed, outcome.missed);
        assert_eq!(device.take_refused().expect("reads"), [0; 4]);
    }
}

#[test]
fn fields_that_are_not_trained_yet_have_no_part() {
    let Some(mut device) = device() else { return };
    let detail = Detail {
        kinds: [true, true, false, false],
        active_share: 0.5,
    };
    let (mut on_cpu, rays, targets) = case(false);
    let expected = on_cpu.step(&rays, &targets, &detail, &RATES);
    let (mut graph, ..) = case(false);
    let found = device.step(&mut graph, (&rays, &targets), &detail, &RATES);
    let found = found.expect("steps");
    assert!((found.loss - expected.loss).abs() < 1e-5 * expected.loss);
    device.download(&mut graph).expect("downloads");
    let before = case(false).0;
    for (found, before) in graph.nodes.iter().zip(&before.nodes) {
        for kind in [FieldKind::Flow, FieldKind::View] {
            let arrays = |node: &Node| {
                let field = node.fields.get(kind).expect("a field");
                field.arrays().map(|array| array.first_moments.clone())
            };
            assert_eq!(arrays(found), arrays(before));
        }
        let colour = found.fields.get(FieldKind::Colour).expect("a field");
        assert_eq!((colour.table.steps, colour.weights.steps), (1, 1));
        assert!(colour.weights.array.first_moments.iter().any(|&m| m != 0.0));
    }
}

#[test]
fn memory_is_counted_without_allocating_it() {
    let Some(device) = device() else { return };
    let (graph, ..) = case(true);
    let plan = device.plan(&graph).expect("counts");
    let values: usize = graph.parameter_counts().iter().sum();
    assert!(plan.buffers.bytes > 16 * values as u64);
    assert!(plan.refusal.is_none() && plan.gaussians.is_none());
}
