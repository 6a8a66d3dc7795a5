//! First planes of atlases on clips with known truth, and components that must not make masks' insides worse: a car
//! that turns on tilted ground under a camera that moves, with exact poses and points.

use glam::{DMat3, DVec2, DVec3};
use omnilife_engine::{
    camera::{Camera, View},
    surfaces::plane::{Ray, hit},
    trajectories::rigid_spline::RigidPose,
};
use omnilife_reconstruct::{
    methods::{
        self,
        neural_atlas::{
            AtlasStart, begin,
            clip::{Clip, ClipFrame, UnitClock, camera_direction, pixel_centre},
            graph::{Graph, Visibility},
        },
    },
    options::Options,
    request::MethodRequest,
};
use omnilife_schemas::camera::PinholeCamera;

use crate::neural_atlas;

const WIDTH: usize = 128;
const HEIGHT: usize = 96;
const FRAMES: usize = 16;
const GROUND: f64 = 14.0;
/// Length and width of the car.
const CAR: DVec2 = DVec2::new(1.2, 0.6);

fn camera() -> Camera {
    PinholeCamera {
        width: WIDTH as u32,
        height: HEIGHT as u32,
        fx: 120.0,
        fy: 120.0,
        cx: 64.0,
        cy: 48.0,
    }
    .into()
}

fn time(frame: usize) -> f64 {
    frame as f64 / (FRAMES - 1) as f64
}

fn ground() -> RigidPose {
    RigidPose {
        centre: DVec3::new(0.0, 0.0, 4.0),
        rotation: DMat3::from_rotation_x(0.45),
    }
}

/// Returns the heading of the car, radians: it turns by 90 degrees.
fn heading(time: f64) -> f64 {
    1.57 * time
}

/// Returns the pose of the car, a little above the ground and parallel to the image.
fn car(time: f64) -> RigidPose {
    RigidPose {
        centre: DVec3::new(-0.6 + 1.2 * time, 0.1 + 0.2 * time, 3.4),
        rotation: DMat3::from_rotation_z(heading(time)),
    }
}

fn camera_pose(time: f64) -> RigidPose {
    RigidPose {
        centre: DVec3::new(0.5 * time - 0.25, 0.1 * time, 0.0),
        rotation: DMat3::from_rotation_y(0.05 * time),
    }
}

fn pattern(at: DVec2, frequency: f64) -> DVec3 {
    let wave = |a: f64, b: f64, c: f64| {
        0.45 + 0.15 * (frequency * (a * at.x + b * at.y) + c).sin()
            + 0.15 * (frequency * (b * at.x - a * at.y) + 2.0 * c).cos()
    };
    DVec3::new(
        wave(1.0, 0.4, 0.0),
        wave(0.3, 1.1, 1.0),
        wave(-0.8, 0.7, 2.0),
    )
}

/// Returns the colour of a ray, and true if it meets the car.
fn draw(ray: &Ray, time: f64) -> (DVec3, bool) {
    if let Some(hit) = hit(ray, &car(time), CAR) {
        let at = (hit.uv - 0.5) * CAR;
        // A stripe from bumper to bumper.
        let stripe = if at.y.abs() < 0.12 { 0.2 } else { 0.0 };
        return (
            pattern(at, 9.0) + stripe * DVec3::new(1.0, -0.5, -0.5),
            true,
        );
    }
    let side = DVec2::splat(GROUND);
    let found = hit(ray, &ground(), side);
    let colour = found.map_or(DVec3::ZERO, |hit| pattern((hit.uv - 0.5) * side, 5.0));
    (colour, false)
}

fn turning_car() -> Clip {
    let frame = |number: usize| {
        let pose = camera_pose(time(number));
        let drawn: Vec<(DVec3, bool)> = (0..WIDTH * HEIGHT)
            .map(|pixel| {
                let direction = camera_direction(&camera(), pixel_centre(pixel, WIDTH));
                let ray = Ray {
                    origin: pose.centre,
                    direction: pose.rotation * direction,
                };
                draw(&ray, time(number))
            })
            .collect();
        let bytes = drawn.iter().flat_map(|(colour, _)| {
            colour
                .to_array()
                .map(|value| (255.0 * value.clamp(0.0, 1.0)).round() as u8)
        });
        let mask = drawn
            .iter()
            .map(|&(_, is_car)| if is_car { 255 } else { 0 });
        ClipFrame {
            number: number as u32,
            time: time(number),
            pose,
            pixels: bytes.collect(),
            masks: vec![Some(mask.collect())],
            ignored: None,
        }
    };
    Clip {
        camera: camera(),
        frames: (0..FRAMES).map(frame).collect(),
        objects: vec!["car".to_owned()],
        clock: UnitClock {
            begin_seconds: 0.0,
            length_seconds: 1.0,
        },
        warnings: Vec::new(),
    }
}

fn ground_points() -> Vec<DVec3> {
    let place = |number: i32| {
        let at = |step: f64, side: f64| side * ((f64::from(number) * step).fract() - 0.5);
        let at = DVec2::new(at(0.618_034, 6.0), at(0.754_878, 6.0));
        ground().centre + ground().rotation * at.extend(0.0)
    };
    (0..2000).map(place).collect()
}

fn view(frame: &ClipFrame, camera: Camera) -> View {
    View {
        camera,
        rotation: frame.pose.rotation.transpose().as_mat3(),
        centre: frame.pose.centre.as_vec3(),
        time_seconds: frame.time,
    }
}

/// Returns the mean over frames and objects of the overlap of mattes and masks, and the PSNR inside of the masks.
fn judged(graph: &mut Graph, clip: &Clip) -> (f64, f64) {
    let (mut overlaps, mut count) = (0.0, 0.0);
    let (mut squares, mut pixels) = (0.0, 0.0);
    for frame in &clip.frames {
        let view = view(frame, clip.camera);
        let (image, _) = graph.image(&view, &Visibility::All);
        for (object, name) in clip.objects.iter().enumerate() {
            let (matte, _) = graph.image(&view, &Visibility::Matte(name.clone()));
            let (mut both, mut either) = (0.0, 0.0);
            for pixel in 0..clip.pixel_count() {
                let is_masked = frame.covered(object, pixel) >= 0.5;
                let is_opaque = matte.data[3 * pixel] > 0.5;
                both += f64::from(u8::from(is_masked && is_opaque));
                either += f64::from(u8::from(is_masked || is_opaque));
                if is_masked {
                    let found = &image.data[3 * pixel..3 * pixel + 3];
                    let errors = found.iter().zip(frame.colour(pixel));
                    squares += errors
                        .map(|(&found, truth)| (f64::from(found) - truth).powi(2))
                        .sum::<f64>();
                    pixels += 3.0;
                }
            }
            if frame.masks[object].is_some() {
                overlaps += both / f64::max(either, 1.0);
                count += 1.0;
            }
        }
    }
    (overlaps / count, -10.0 * (squares / pixels).log10())
}

#[test]
fn a_stripe_turns_with_its_car() {
    let clip = turning_car();
    let AtlasStart {
        mut learner, plan, ..
    } = begin(clip.clone(), &ground_points(), &MethodRequest::new(10, 1)).unwrap();
    for line in &plan {
        println!("{}: {} ({})", line.component, line.used, line.reason);
    }
    let camera = plan.iter().find(|line| line.component == "camera-offsets");
    assert!(camera.is_some_and(|line| !line.used), "{camera:?}");
    let graph = learner.graph().unwrap();
    let node = &graph.nodes[graph.find("car").unwrap()];
    let along = |time: f64| {
        let axis = node.pose(time).rotation.col(0);
        axis.y.atan2(axis.x)
    };
    for frame in 0..FRAMES {
        let turned = DVec2::from_angle(along(time(frame)) - along(0.0)).to_angle();
        let apart = (turned - heading(time(frame))).abs().to_degrees();
        assert!(apart < 10.0, "{frame}: {apart}");
    }
    let (overlap, _) = judged(graph, &clip);
    assert!(overlap >= 0.85, "{overlap}");
}

const STEPS: u64 = 80;

/// Trains for a few steps and returns the outcome, and the components that were used.
fn trained(clip: &Clip, points: &[DVec3], without: &[String]) -> ((f64, f64), Vec<String>) {
    let method = methods::find("nag").unwrap();
    let request = MethodRequest {
        options: Options::parse("nag", method.options, &["rays=3072".to_owned()]).unwrap(),
        without: without.to_vec(),
        ..MethodRequest::new(STEPS, 1)
    };
    let begun = begin(clip.clone(), points, &request).unwrap();
    let mut learner = begun.learner;
    neural_atlas::learn(&mut learner, 0..STEPS, STEPS);
    let mut used: Vec<String> = begun
        .plan
        .iter()
        .filter(|line| line.used)
        .filter_map(|line| {
            let name = line.component.split(':').next()?;
            method.components.contains(&name).then(|| name.to_owned())
        })
        .collect();
    used.sort();
    used.dedup();
    (judged(learner.graph().unwrap(), clip), used)
}

/// Checks every component that the evidence of a clip asks for: with it, neither overlap nor PSNR inside of the masks
/// is lower than without it, within what a short run tells.
#[test]
fn no_component_makes_the_inside_of_masks_worse() {
    let scenes = [
        (turning_car(), ground_points()),
        (neural_atlas::clip(), Vec::new()),
    ];
    for (clip, points) in &scenes {
        let ((overlap, psnr), used) = trained(clip, points, &[]);
        for component in used {
            let ((other_overlap, other_psnr), _) =
                trained(clip, points, std::slice::from_ref(&component));
            println!(
                "{component}: {psnr:.2} dB, {overlap:.3}; without {other_psnr:.2} dB, {other_overlap:.3}"
            );
            assert!(overlap >= other_overlap - 0.02, "{component}");
            assert!(psnr >= other_psnr - 0.5, "{component}");
        }
    }
}
