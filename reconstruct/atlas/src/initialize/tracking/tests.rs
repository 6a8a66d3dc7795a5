//! Tracking against rendered truth: textured discs on planes that move, turn and are hidden.

use glam::{DMat3, DVec3};
use omnilife_engine::{
    camera::Camera,
    surfaces::plane::{Ray, hit},
    trajectories::rigid_spline::RigidPose,
};
use omnilife_schemas::camera::{ErpCamera, PinholeCamera};

use super::{super::in_frames, super::silhouettes, *};
use crate::clip::{ClipFrame, UnitClock, camera_direction, pixel_centre};

const PINHOLE: PinholeCamera = PinholeCamera {
    width: 120,
    height: 90,
    fx: 100.0,
    fy: 100.0,
    cx: 60.0,
    cy: 45.0,
};
const ERP: ErpCamera = ErpCamera {
    width: 360,
    height: 180,
};
const RADIUS: f64 = 0.5;

/// Returns the texture of the disc: a stripe over a soft pattern.
fn texture(at: DVec2) -> f64 {
    let pattern =
        0.45 + 0.12 * (9.0 * at.x + 4.0 * at.y).sin() + 0.12 * (11.0 * at.y - 3.0 * at.x).cos();
    if at.y.abs() < 0.1 {
        pattern + 0.3
    } else {
        pattern
    }
}

/// Renders the disc at some poses, one for each frame. `hides` marks pixels in front of it that no mask has.
fn rendered(camera: Camera, poses: &[RigidPose], hides: &dyn Fn(usize, DVec2) -> bool) -> Clip {
    let [width, height] = [camera.width() as usize, camera.height() as usize];
    let frame = |number: usize| {
        let (mut pixels, mut mask) = (Vec::new(), Vec::new());
        for pixel in 0..width * height {
            let at = pixel_centre(pixel, width);
            let ray = Ray {
                origin: DVec3::ZERO,
                direction: camera_direction(&camera, at),
            };
            let side = DVec2::splat(2.0 * RADIUS);
            let own = hit(&ray, &poses[number], side).map(|hit| (hit.uv - 0.5) * side);
            let own = own.filter(|own| own.length() < RADIUS);
            let grey = match own {
                _ if hides(number, at) => 0.15,
                Some(own) => texture(own),
                None => 0.6 + 0.1 * (0.2 * at.x).sin(),
            };
            pixels.extend([(255.0 * grey).round() as u8; 3]);
            let is_seen = own.is_some() && !hides(number, at);
            mask.push(if is_seen { 255 } else { 0 });
        }
        ClipFrame {
            number: number as u32,
            time: number as f64 / (poses.len().max(2) - 1) as f64,
            pose: RigidPose {
                centre: DVec3::ZERO,
                rotation: DMat3::IDENTITY,
            },
            pixels,
            masks: vec![Some(mask)],
            ignored: None,
        }
    };
    Clip {
        camera,
        frames: (0..poses.len()).map(frame).collect(),
        objects: vec!["disc".to_owned()],
        clock: UnitClock {
            begin_seconds: 0.0,
            length_seconds: 1.0,
        },
        warnings: Vec::new(),
    }
}

fn no_one(_: usize, _: DVec2) -> bool {
    false
}

/// Returns poses of a disc that goes away while it turns by 90 degrees in its plane, with its depths and turns.
fn turning(count: usize) -> Vec<(RigidPose, f64, f64)> {
    let pose = |number: usize| {
        let share = number as f64 / (count - 1) as f64;
        let (depth, turn) = (2.0 + 0.8 * share, 1.6 * share);
        let pose = RigidPose {
            centre: DVec3::new(-0.3 + 0.6 * share, 0.2 - 0.3 * share, depth),
            rotation: DMat3::from_rotation_z(turn),
        };
        (pose, depth, turn)
    };
    (0..count).map(pose).collect()
}

fn bare(truth: &[(RigidPose, f64, f64)]) -> Vec<RigidPose> {
    truth.iter().map(|(pose, ..)| *pose).collect()
}

/// Checks motions against depths and turns: scale within 3 %, stripes within 5 degrees.
fn check(tracked: &Tracked, truth: &[(RigidPose, f64, f64)]) {
    let (_, depth, turn) = truth[0];
    for (number, (motion, (_, at, turned))) in tracked.motions.iter().zip(truth).enumerate() {
        let motion = motion.expect("it is in view");
        let scale = motion.scale() * at / depth;
        assert!((scale - 1.0).abs() < 0.03, "{number}: {scale}");
        let apart = DVec2::from_angle(motion.angle() - (turned - turn)).to_angle();
        assert!(apart.abs() < 5_f64.to_radians(), "{number}: {apart}");
    }
    assert_eq!(tracked.motions.len(), truth.len());
}

#[test]
fn a_stripe_turns_with_its_disc() {
    let truth = turning(20);
    let clip = rendered(PINHOLE.into(), &bare(&truth), &no_one);
    let seen = silhouettes::of_object(&clip, 0);
    check(&tracked(&clip, 0, &seen, 0), &truth);
}

/// Checks that bars without a mask before 40 % of the disc do not move it away, as its area says.
#[test]
fn a_disc_behind_bars_does_not_shrink() {
    let truth = turning(20);
    let bars = |number: usize, at: DVec2| number > 5 && at.x.rem_euclid(15.0) < 6.0;
    let clip = rendered(PINHOLE.into(), &bare(&truth), &bars);
    let seen = silhouettes::of_object(&clip, 0);
    let found = in_frames::of(&clip, 0, &seen);
    let reference = silhouettes::reference(&seen).expect("it is in view").frame;
    for (number, (frame, (_, depth, _))) in found.frames.iter().zip(&truth).enumerate() {
        let relative = frame.relative_depth * truth[reference].1 / depth;
        assert!((relative - 1.0).abs() < 0.03, "{number}: {relative}");
    }
}

/// Checks discs that face a panorama's camera around a place, across the seam and beside a pole too.
#[test]
fn tangent_planes_have_neither_seam_nor_pole() {
    let directions = [
        [0.0, 0.0, 1.0],
        [0.02, 0.1, -1.0],
        [0.3, -1.0, 0.2],
        [0.2, 1.0, -0.3],
    ];
    for direction in directions.map(DVec3::from_array) {
        let truth: Vec<(RigidPose, f64, f64)> = (0..7)
            .map(|number| {
                let share = f64::from(number) / 6.0;
                let towards = DMat3::from_rotation_y(0.1 * share) * direction.normalize();
                let (depth, turn) = (2.0 + 0.4 * share, 0.6 * share);
                let axes = plane_axes(&ERP.into(), towards);
                let pose = RigidPose {
                    centre: depth * towards,
                    rotation: axes * DMat3::from_rotation_z(turn),
                };
                (pose, depth, turn)
            })
            .collect();
        let clip = rendered(ERP.into(), &bare(&truth), &no_one);
        let seen = silhouettes::of_object(&clip, 0);
        let found = tracked(&clip, 0, &seen, 0);
        check(&found, &truth);
        for (one, motion) in seen.iter().zip(&found.motions) {
            let axes = plane_axes(&clip.camera, one.direction);
            for at in [DVec2::new(0.3, -0.2), DVec2::new(-1.5, 0.7), DVec2::ZERO] {
                let back = tangent(&axes, axes * at.extend(1.0)).expect("before the camera");
                assert!(back.distance(at) < 1e-12);
            }
            assert_eq!(tangent(&axes, -one.direction), None);
            // The disc is whole on its tangent plane: its area is that of the disc at its depth.
            let patch = Patch::of(&clip, 0, one, 0.01).expect("it is small");
            let area = patch.cover.iter().sum::<f64>() * patch.step * patch.step;
            let scale = motion.expect("it is in view").scale();
            let expected = std::f64::consts::PI * (0.5 * RADIUS * scale).powi(2);
            assert!((area / expected - 1.0).abs() < 0.08, "{area} {expected}");
        }
    }
}
