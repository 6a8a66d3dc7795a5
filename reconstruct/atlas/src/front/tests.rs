//! A disc that passes behind a bar without a mask, before a wall.

use glam::{DMat3, DQuat};
use omnilife_schemas::camera::PinholeCamera;

use super::*;
use crate::clip::UnitClock;

const WIDTH: usize = 120;
const HEIGHT: usize = 80;
const FRAMES: usize = 13;
const RADIUS: f64 = 0.3;
/// Columns of the bar.
const BAR: [usize; 2] = [54, 66];

fn still(centre: DVec3) -> RigidPose {
    RigidPose {
        centre,
        rotation: DMat3::IDENTITY,
    }
}

/// Returns the place of the disc, before a camera at the origin.
fn disc(time: f64) -> DVec3 {
    DVec3::new(-0.7 + 1.4 * time, 0.0, 2.0)
}

fn node(id: &str, positions: Vec<DVec3>, size: f64, opacity: Option<Texture<1>>) -> Node {
    Node {
        id: id.to_owned(),
        surface: Surface::Plane {
            size: DVec2::splat(size),
            trajectory: RigidSpline {
                rotations: vec![DQuat::IDENTITY; positions.len()],
                positions,
            },
        },
        colour: Texture::constant(160, 160, [0.5; 3]),
        opacity,
        fields: Fields::default(),
        offsets: None,
        times: [f64::MIN, f64::MAX],
        delay: 0.0,
        overlay: None,
    }
}

fn scene(has_bar: bool, speed: f64) -> (Clip, Graph) {
    let camera = PinholeCamera {
        width: WIDTH as u32,
        height: HEIGHT as u32,
        fx: 100.0,
        fy: 100.0,
        cx: 60.0,
        cy: 40.0,
    };
    let frame = |number: usize| {
        let time = number as f64 / (FRAMES - 1) as f64;
        let is_bar = |pixel: usize| has_bar && (BAR[0]..BAR[1]).contains(&(pixel % WIDTH));
        let is_disc = |pixel: usize| {
            let at = (pixel_centre(pixel, WIDTH) - DVec2::new(60.0, 40.0)) * 0.02;
            at.distance(disc(time).truncate()) < RADIUS
        };
        let pixels = (0..WIDTH * HEIGHT).flat_map(|pixel| {
            let grey = match (is_bar(pixel), is_disc(pixel)) {
                (true, _) => 20,
                (false, true) => 200,
                (false, false) => 90,
            };
            [grey; 3]
        });
        let mask = (0..WIDTH * HEIGHT).map(|pixel| {
            if is_disc(pixel) && !is_bar(pixel) {
                255
            } else {
                0
            }
        });
        ClipFrame {
            number: number as u32,
            time,
            pose: still(DVec3::new(speed * time, 0.0, 0.0)),
            pixels: pixels.collect(),
            masks: vec![Some(mask.collect())],
            ignored: None,
        }
    };
    let clip = Clip {
        camera: camera.into(),
        frames: (0..FRAMES).map(frame).collect(),
        objects: vec!["disc".to_owned()],
        clock: UnitClock {
            begin_seconds: 0.0,
            length_seconds: 1.0,
        },
        warnings: Vec::new(),
    };
    let side = 61;
    let texels = (0..side * side).map(|texel| {
        let at = DVec2::new((texel % side) as f64, (texel / side) as f64) - 30.0;
        [if at.length() < 30.0 { 0.9 } else { 0.1 }]
    });
    let opacity = Texture {
        width: side,
        height: side,
        texels: texels.collect(),
    };
    let graph = Graph {
        nodes: vec![
            node(
                "disc",
                vec![disc(0.0), disc(1.0)],
                2.0 * RADIUS,
                Some(opacity),
            ),
            node("background", vec![4.0 * DVec3::Z], 6.0, None),
        ],
        camera: None,
        clock: clip.clock,
        footage: clip.footage(),
    };
    (clip, graph)
}

#[test]
fn a_bar_before_a_disc_is_found_where_it_is() {
    let (mut clip, mut graph) = scene(true, 0.0);
    let front = find(&clip, &graph).expect("the disc passes behind the bar");
    for mask in &front.masks {
        for pixel in (0..WIDTH * HEIGHT).filter(|&pixel| mask[pixel] > 0) {
            // A cell of the grid is 1.9 pixels wide: two of them beside the bar.
            let column = pixel % WIDTH;
            assert!((BAR[0] - 4..BAR[1] + 4).contains(&column), "{column}");
        }
    }
    let middle = FRAMES / 2;
    let centre = HEIGHT / 2 * WIDTH + WIDTH / 2;
    assert_eq!(front.masks[middle][centre], 255);
    // The plane shows the bar where it is: before the disc, on the same rays.
    let ray = Ray {
        origin: DVec3::ZERO,
        direction: camera_direction(&clip.camera, pixel_centre(centre, WIDTH)),
    };
    let pose = front.node.given_pose(0.5);
    let Surface::Plane { size, .. } = &front.node.surface else {
        panic!("a sphere");
    };
    let found = hit(&ray, &pose, *size).expect("it is in view");
    let opacity = front.node.opacity.as_ref().expect("it is an object");
    assert!(opacity.sample(found.uv, TextureEdge::Border).value[0] > 0.5);
    assert!(found.distance < disc(0.5).z);
    add(&mut clip, &mut graph, front);
    let names: Vec<&str> = graph.nodes.iter().map(|node| node.id.as_str()).collect();
    assert_eq!(names, ["disc", FRONT, "background"]);
    assert!(clip.frames.iter().all(|frame| frame.masks.len() == 2));
}

#[test]
fn without_a_bar_or_with_a_camera_that_walks_there_is_no_front() {
    let (clip, graph) = scene(false, 0.0);
    assert!(find(&clip, &graph).is_err());
    let (clip, graph) = scene(true, 1.0);
    assert!(find(&clip, &graph).is_err_and(|reason| reason.contains("pixels")));
}

#[test]
fn no_thing_is_before_an_object_that_passes_the_cameras() {
    let (clip, mut graph) = scene(true, 0.0);
    graph.nodes[0] = node("disc", vec![disc(0.0), -disc(1.0)], 2.0 * RADIUS, None);
    let background = graph.nodes[1].given_pose(0.0);
    let refused = nearness(&clip, &graph.nodes[..1], &background);
    assert!(refused.is_err_and(|reason| reason.contains("behind the cameras")));
}

#[test]
fn an_object_is_hidden_by_the_masks_of_others_alone() {
    let (mut clip, mut graph) = scene(true, 0.0);
    let half = |is_left: bool| -> Vec<u8> {
        let is_in = |pixel: usize| (pixel % WIDTH < WIDTH / 2) == is_left;
        let masks = (0..WIDTH * HEIGHT).map(|pixel| if is_in(pixel) { 200 } else { 100 });
        masks.collect()
    };
    let last = graph.nodes.len() - 1;
    graph
        .nodes
        .insert(last, node("other", vec![DVec3::Z], 1.0, None));
    clip.frames[0].masks = vec![Some(half(true)), Some(half(false))];
    let frame = FrameObjects::new(&clip, &clip.frames[0], &graph.nodes[..2]);
    for (pixel, hidden) in [(0, [false, true]), (WIDTH - 1, [true, false])] {
        assert_eq!([0, 1].map(|object| frame.is_hidden(object, pixel)), hidden);
    }
}

#[test]
fn holes_have_to_stay_and_to_look_the_same() {
    let votes = |holes: u32, shown: u32, greys: [f64; 2]| Votes {
        holes,
        shown,
        sums: [
            0.5 * f64::from(holes) * (greys[0] + greys[1]),
            0.5 * f64::from(holes) * (greys[0].powi(2) + greys[1].powi(2)),
        ],
    };
    assert!(votes(6, 2, [0.3, 0.32]).is_front());
    assert!(!votes(2, 0, [0.3, 0.3]).is_front());
    assert!(!votes(5, 2, [0.3, 0.3]).is_front());
    assert!(!votes(6, 0, [0.1, 0.5]).is_front());
    assert!(!Votes::default().is_front());
}
