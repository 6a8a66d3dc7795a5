//! A whole pixel against golden values, and gradients against central differences.

use glam::{DMat3, DQuat, DVec2, DVec3};
use omnilife_engine::{
    fields::{
        grid_field::{GridField, GridFieldShape},
        hash_grid::{HashGridShape, UpperEdge},
    },
    surfaces::{
        compose::{compose, compose_vjp},
        texture::Texture,
    },
    trajectories::rigid_spline::{RigidPose, RigidSpline},
};
use omnilife_schemas::camera::PinholeCamera;
use serde_json::Value;

use super::{
    clip::UnitClock,
    graph::{Footage, Graph},
    node::{Fields, Node, Surface},
    published,
    render::{Moment, Rays},
    shade::{Detail, ShadeGradient},
};

fn golden() -> Value {
    let text = include_str!("../../engine/tests/golden/neural_atlas.json");
    serde_json::from_str::<Value>(text).expect("JSON")["pixel"].clone()
}

fn numbers(value: &Value) -> Vec<f64> {
    let values = value.as_array().expect("a list").iter();
    values
        .map(|value| value.as_f64().expect("a number"))
        .collect()
}

/// Returns parameters as `scripts/golden/neural_atlas.py` makes them.
fn wave(count: usize, phase: f64, size: f64) -> Vec<f32> {
    (0..count)
        .map(|at| (size * (1.3 * at as f64 + phase).sin()) as f32)
        .collect()
}

pub(super) fn field(dimensions: usize, outputs: usize, phase: f64) -> GridField {
    field_of_sizes(dimensions, outputs, phase, [0.1, 0.7])
}

/// Returns a field with features and weights of some sizes.
pub(super) fn field_of_sizes(
    dimensions: usize,
    outputs: usize,
    phase: f64,
    [features, factors]: [f64; 2],
) -> GridField {
    let shape = GridFieldShape {
        grid: HashGridShape {
            upper_edge: UpperEdge::Aliased,
            ..HashGridShape::new(dimensions, 4, 8)
        },
        hidden_layers: 2,
        width: 8,
        outputs,
    };
    let weights = shape.network().weight_count();
    let table = shape.parameter_count() - weights;
    GridField::with_parameters(
        shape,
        wave(table, phase, features),
        wave(weights, phase + 0.5, factors),
    )
}

pub(super) fn texture<const C: usize>(phase: f64, size: f64) -> Texture<C> {
    let values: Vec<f32> = wave(5 * 6 * C, phase, size)
        .iter()
        .map(|v| 0.5 + v)
        .collect();
    Texture {
        width: 6,
        height: 5,
        texels: values.as_chunks::<C>().0.to_vec(),
    }
}

fn node(phase: f64, pose: [[f64; 3]; 2], size: [f64; 2], is_background: bool) -> Node {
    Node {
        id: format!("{phase}"),
        surface: Surface::Plane {
            size: DVec2::from_array(size),
            trajectory: RigidSpline {
                positions: vec![DVec3::from_array(pose[0])],
                rotations: vec![DQuat::from_scaled_axis(DVec3::from_array(pose[1]))],
            },
        },
        colour: texture(phase + 4.0, 0.3),
        opacity: (!is_background).then(|| texture(phase + 5.0, 0.4)),
        fields: Fields {
            colour: Some(field(2, 3, phase)),
            opacity: (!is_background).then(|| field(2, 1, phase + 2.0)),
            flow: Some(field(2, 10, phase + 1.0)),
            view: Some(field(4, if is_background { 3 } else { 4 }, phase + 3.0)),
        },
        offsets: None,
        times: [f64::MIN, f64::MAX],
        delay: 0.0,
        overlay: None,
    }
}

/// Returns the golden scene: three nodes and one ray.
pub(super) fn scene() -> (Graph, Rays) {
    let nodes = vec![
        node(
            0.1,
            [[0.1, -0.1, 2.0], [0.1, -0.2, 0.05]],
            [1.2, 1.0],
            false,
        ),
        node(
            0.6,
            [[-0.1, 0.05, 2.4], [-0.1, 0.15, 0.0]],
            [1.5, 1.4],
            false,
        ),
        node(1.7, [[0.0, 0.0, 5.0], [0.0; 3]], [9.0, 7.0], true),
    ];
    let graph = Graph {
        nodes,
        camera: None,
        clock: UnitClock {
            begin_seconds: 0.0,
            length_seconds: 1.0,
        },
        footage: Footage {
            camera: PinholeCamera::with_horizontal_field_of_view(4, 4, 1.0).into(),
            frames: Vec::new(),
        },
    };
    let rays = Rays {
        moments: vec![Moment {
            time: 0.37,
            given: RigidPose {
                centre: DVec3::new(0.02, -0.01, 0.0),
                rotation: DMat3::IDENTITY,
            },
        }],
        moment_of: vec![0],
        directions: vec![DVec3::new(0.05, -0.03, 1.0).normalize()],
    };
    (graph, rays)
}

#[test]
fn a_pixel_of_three_nodes_is_golden() {
    let (mut graph, rays) = scene();
    let golden = golden();
    let seen = graph.see(&rays, &Detail::FULL, true, &|_| true);
    let (layers, links) = seen.layers(0);
    assert_eq!(layers.len(), 3);
    let expected = golden["layers"].as_array().expect("layers");
    for ((layer, (node, sample)), expected) in layers.iter().zip(&links).zip(expected) {
        assert_eq!(Some(layer.surface as u64), expected["node"].as_u64());
        let close = |found: f64, name: &str| {
            let expected = expected[name].as_f64().expect("a number");
            assert!(
                (found - expected).abs() < 2e-6,
                "{name}: {found} {expected}"
            );
        };
        close(layer.distance, "distance");
        close(layer.opacity, "opacity");
        let shade = &seen.shaded[*node].shades[*sample];
        let query = DVec2::from_slice(&numbers(&expected["query"]));
        assert!((shade.query.truncate() - query).length() < 2e-6);
        let colour = DVec3::from_slice(&numbers(&expected["colour"]));
        assert!((layer.colour - colour).length() < 2e-6);
    }
    let colour = DVec3::from_slice(&numbers(&golden["colour"]));
    assert!((compose(&layers) - colour).length() < 2e-6);
}

#[test]
fn gradients_by_poses_are_golden() {
    let (mut graph, rays) = scene();
    let golden = golden();
    let seen = graph.see(&rays, &Detail::FULL, true, &|_| true);
    let (layers, links) = seen.layers(0);
    let mut gradients = Vec::new();
    compose_vjp(&layers, DVec3::new(0.3, -0.5, 0.8), &mut gradients);
    let mut upstream = vec![vec![ShadeGradient::default()]; 3];
    for ((node, sample), gradient) in links.into_iter().zip(gradients) {
        upstream[node][sample] = ShadeGradient {
            colour: gradient.colour,
            opacity: gradient.opacity,
        };
    }
    let (by_poses, _) = graph.backward(&rays, &seen, &upstream, None);
    for node in [0, 1] {
        let by_pose = &by_poses[node][0];
        let close = |found: f64, expected: f64| {
            assert!(
                (found - expected).abs() < 3e-5,
                "{node}: {found} {expected}"
            );
        };
        let centre = numbers(&golden[format!("centre_{node}")]);
        for (found, expected) in by_pose.centre.to_array().into_iter().zip(centre) {
            close(found, expected);
        }
        let turn = [[0.1, -0.2, 0.05], [-0.1, 0.15, 0.0]][node];
        for (axis, expected) in numbers(&golden[format!("turn_{node}")])
            .into_iter()
            .enumerate()
        {
            let matrix = |step: f64| {
                let turn = DVec3::from_array(turn) + step * DVec3::AXES[axis];
                DMat3::from_quat(DQuat::from_scaled_axis(turn))
            };
            let by_axis = (matrix(1e-6) - matrix(-1e-6)) * (1.0 / 2e-6);
            let found: f64 = (0..3)
                .map(|column| by_axis.col(column).dot(by_pose.rotation.col(column)))
                .sum();
            close(found, expected);
        }
    }
}

/// Checks that layers over black, one behind the other, are the image bit for bit, and that leaving out a node
/// without a hit changes nothing.
#[test]
fn layers_make_the_image() {
    let (mut graph, rays) = scene();
    let mut away = node(3.0, [[0.0, 0.0, -3.0], [0.0; 3]], [1.0, 1.0], false);
    away.id = "away".to_owned();
    graph.nodes.insert(0, away);
    let seen = graph.see(&rays, &Detail::FULL, false, &|_| true);
    let without = graph.see(&rays, &Detail::FULL, false, &|node| node != 0);
    let (layers, _) = seen.layers(0);
    assert_eq!(layers, without.layers(0).0);
    let mut alone = Vec::new();
    for node in 1..4 {
        let seen = graph.see(&rays, &Detail::FULL, false, &|other| other == node);
        alone.extend(seen.layers(0).0);
    }
    omnilife_engine::surfaces::compose::sort(&mut alone);
    assert_eq!(compose(&alone), compose(&layers));
}

/// Checks the scales of gradients: one ray hits both objects and the background, another the farther object and the background.
#[test]
fn published_gradients_are_scaled_by_hits_and_transmittance() {
    let (mut graph, mut rays) = scene();
    rays.moment_of.push(0);
    rays.directions.push(DVec3::new(0.0, 0.6, 2.4).normalize());
    let seen = graph.see(&rays, &Detail::FULL, false, &|_| true);
    let hits: Vec<usize> = seen.samples.iter().map(Vec::len).collect();
    assert_eq!(hits, [1, 2, 2]);
    // One over the hits, 1 and 1/2, by their mean.
    let scales = published::scales_of_gradients(&graph, &seen, false);
    let expected = [vec![4.0 / 3.0], vec![2.0 / 3.0; 2], vec![1.0; 2]];
    for (found, expected) in scales.iter().flatten().zip(expected.iter().flatten()) {
        assert!((found - expected).abs() < 1e-12);
    }
    let by_transmittance = published::scales_of_gradients(&graph, &seen, true);
    let nearest = seen.shaded[0].shades[0].opacity;
    let ratio = |node: usize, sample: usize| by_transmittance[node][sample] / scales[node][sample];
    assert_eq!(ratio(0, 0), 1.0);
    assert!((ratio(1, 0) - 1.0 / (1.0 - nearest)).abs() < 1e-12);
    assert_eq!(ratio(1, 1), 1.0);
    assert!(ratio(2, 1) > 1.0);
    // Only what goes through the distance of hits is scaled: poses' gradients change, others do not.
    let upstream: Vec<Vec<ShadeGradient>> = seen
        .samples
        .iter()
        .map(|samples| {
            let one = ShadeGradient {
                colour: DVec3::ONE,
                opacity: 0.3,
            };
            vec![one; samples.len()]
        })
        .collect();
    let seen = graph.see(&rays, &Detail::FULL, true, &|_| true);
    let (own, of_camera) = graph.backward(&rays, &seen, &upstream, None);
    let seen = graph.see(&rays, &Detail::FULL, true, &|_| true);
    let (scaled, scaled_of_camera) = graph.backward(&rays, &seen, &upstream, Some(&scales));
    assert_ne!(own[0], scaled[0]);
    assert_eq!(of_camera, scaled_of_camera);
}
