//! Agreement on a rendered wall with points, under exact poses and under wrong ones.

use omnilife_engine::{
    surfaces::plane::{Ray, hit},
    trajectories::rigid_spline::RigidPose,
};
use omnilife_schemas::camera::PinholeCamera;

use super::*;
use crate::clip::{UnitClock, camera_direction, pixel_centre};

const CAMERA: PinholeCamera = PinholeCamera {
    width: 96,
    height: 72,
    fx: 90.0,
    fy: 90.0,
    cx: 48.0,
    cy: 36.0,
};
const SIDE: f64 = 20.0;

fn wall() -> RigidPose {
    RigidPose {
        centre: DVec3::new(0.0, 0.0, 4.0),
        rotation: DMat3::from_rotation_y(0.4),
    }
}

/// Returns the wall's grey value; without `contrast` it is flat.
fn grey(at: DVec2, contrast: f64) -> f64 {
    0.5 + contrast * ((7.0 * at.x + 2.0 * at.y).sin() + (8.0 * at.y - 3.0 * at.x).cos())
}

fn points() -> Vec<DVec3> {
    let place = |number: i32| {
        let at = |step: f64, side: f64| side * ((f64::from(number) * step).fract() - 0.5);
        let at = DVec2::new(at(0.618_034, 6.0), at(0.754_878, 4.0));
        wall().centre + wall().rotation * at.extend(0.0)
    };
    (0..2500).map(place).collect()
}

/// Renders the wall from a camera that walks, with given poses that are turned by `wrong` degrees in every other frame.
fn clip(wrong: f64, contrast: f64) -> Clip {
    let frame = |number: u32| {
        let truth = RigidPose {
            centre: DVec3::new(0.08 * f64::from(number), 0.0, 0.0),
            rotation: DMat3::IDENTITY,
        };
        let pixels = (0..96 * 72).flat_map(|pixel| {
            let direction = camera_direction(&CAMERA.into(), pixel_centre(pixel, 96));
            let ray = Ray {
                origin: truth.centre,
                direction,
            };
            let hit = hit(&ray, &wall(), DVec2::splat(SIDE));
            let grey = hit.map_or(0.0, |hit| grey((hit.uv - 0.5) * SIDE, contrast));
            [(255.0 * grey).round() as u8; 3]
        });
        let turn = if number.is_multiple_of(2) {
            0.0
        } else {
            wrong.to_radians()
        };
        ClipFrame {
            number,
            time: f64::from(number) / 9.0,
            pose: RigidPose {
                centre: truth.centre,
                rotation: DMat3::from_rotation_y(turn),
            },
            pixels: pixels.collect(),
            masks: Vec::new(),
            ignored: None,
        }
    };
    Clip {
        camera: CAMERA.into(),
        frames: (0..10).map(frame).collect(),
        objects: Vec::new(),
        clock: UnitClock {
            begin_seconds: 0.0,
            length_seconds: 1.0,
        },
        warnings: Vec::new(),
    }
}

#[test]
fn exact_poses_agree_with_points() {
    let found = agreement(&clip(0.0, 0.12), &points()).expect("the points tell");
    assert!(found.agrees() && found.displacement < 0.1, "{found:?}");
    assert_eq!(found.pairs, 9);
}

#[test]
fn wrong_poses_move_points_by_their_error() {
    let found = agreement(&clip(0.8, 0.12), &points()).expect("the points tell");
    let expected = 90.0 * 0.8_f64.to_radians();
    assert!(!found.agrees(), "{found:?}");
    assert!(
        (found.displacement - expected).abs() < 0.3,
        "{found:?} {expected}"
    );
}

#[test]
fn a_flat_wall_and_few_points_do_not_tell() {
    assert_eq!(agreement(&clip(0.0, 0.0), &points()), None);
    assert_eq!(agreement(&clip(0.0, 0.12), &points()[..100]), None);
}

#[test]
fn derivatives_are_central_differences_of_the_light() {
    let clip = clip(0.0, 0.12);
    let pair = Pair {
        clip: &clip,
        frame: &clip.frames[3],
        sightings: &[],
    };
    let own = |number: usize| points()[number] - clip.frames[3].pose.centre;
    let light = |at: DVec3| {
        let place = pair.place(at).expect("in view");
        grey_at(&clip, &clip.frames[3], place)
    };
    let still = Correction {
        rotation: DMat3::IDENTITY,
        shift: DVec3::ZERO,
        gain: 0.0,
        offset: 0.0,
    };
    let in_view = (0..400).filter(|&number| {
        let place = pair.place(own(number));
        place.is_some_and(|at| at.x > 8.0 && at.y > 8.0 && at.x < 88.0 && at.y < 64.0)
    });
    for number in in_view.step_by(17) {
        let at = own(number);
        let one = Sighting { at, grey: 0.0 };
        let equation = pair.equation(&one, &still).expect("in view");
        for (unknown, axis) in DVec3::AXES.into_iter().enumerate() {
            // A motion of a pixel, as wide as the differences of the image.
            let step = at.z / 90.0;
            let by = |step: f64| light(at + step * axis);
            let expected = -(by(step) - by(-step)) / (2.0 * step);
            let found = equation.row[3 + unknown];
            assert!(
                (found - expected).abs() < 0.15,
                "{unknown}: {found} {expected}"
            );
            let turned = |step: f64| light(DMat3::from_axis_angle(axis, step) * at);
            let step = 1.0 / 90.0;
            let expected = -(turned(step) - turned(-step)) / (2.0 * step);
            let found = equation.row[unknown];
            assert!(
                (found - expected).abs() < 0.3,
                "{unknown}: {found} {expected}"
            );
        }
    }
}
