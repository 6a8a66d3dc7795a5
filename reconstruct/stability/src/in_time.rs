//! Cases of time: lifespans too short and too long, clips too long, motion too fast, undefined directions.

use glam::dvec3;

use crate::{
    cases::{Case, Expectation, PLAIN},
    parameterizations::TimeDependence,
    setup::{Motion, RawGaussian, Setup, TIME_SECONDS, Timing, mild},
};
use omnilife_engine::clock::Clock;

/// Case of peak times, lifespans and velocities.
const OF_MOTION: Case = Case {
    about: &[TimeDependence::Moving],
    ..PLAIN
};

pub(super) const CASES: &[Case] = &[
    Case {
        id: "lifespan-0",
        title: "lifespans of a nanosecond, at and beside their moment",
        action: "held at a quarter of a frame, where they get no gradient",
        setup: || timed(TIME_SECONDS, 1e-9, 0.05),
        ..OF_MOTION
    },
    Case {
        id: "lifespan-floor",
        title: "lifespans of a quarter of a frame, up to three of them beside their moment",
        setup: at_the_floor,
        ..OF_MOTION
    },
    Case {
        id: "lifespan-endless",
        title: "lifespans of a million seconds",
        action: "held at a million frames, where they get no gradient",
        setup: || timed(0.4, 1e6, 0.05),
        ..OF_MOTION
    },
    Case {
        id: "time-outside",
        title: "moments 1e5 seconds before and after the clip, lifespans as long",
        action: "whole cycles are taken off before the sine",
        // Away from half a cycle, where velocities would have no effect.
        setup: || timed(1e5 + 0.137, 1e5, 0.05),
        ..OF_MOTION
    },
    Case {
        id: "gone",
        title: "moments three to forty lifespans before and after the view",
        action: "not drawn where the opacity has fallen below 1/255, or to PVG's 5 %",
        setup: gone,
        ..OF_MOTION
    },
    Case {
        id: "cycle-short",
        title: "a cycle of a thousandth of a frame",
        action: "whole cycles are taken off before the sine",
        setup: || Setup::new(mild()).with_cycle(1e-3),
        ..OF_MOTION
    },
    Case {
        id: "cycle-long",
        title: "a cycle of a million frames",
        setup: || Setup::new(mild()).with_cycle(1e6),
        ..OF_MOTION
    },
    Case {
        id: "fast",
        title: "1,000 units per second",
        setup: || timed(TIME_SECONDS, 0.5, 1e3),
        ..OF_MOTION
    },
    Case {
        id: "still",
        title: "velocities of zero",
        setup: || timed(0.4, 1.0, 0.0),
        ..OF_MOTION
    },
    Case {
        id: "smoothed",
        title: "the state of a frame and a half before, moved on",
        setup: smoothed,
        ..OF_MOTION
    },
    Case {
        id: "clip-10000",
        title: "near the last frame of 10,000, eleven days into the recording",
        action: "differences of times in f64, then rounded to f32",
        about: &[TimeDependence::Deformed, TimeDependence::Moving],
        setup: last_frame,
        ..PLAIN
    },
    Case {
        id: "latitude-poles",
        title: "moving fast over both poles, 1e-7 to 0.1 rad beside them",
        action: "cosines of latitudes held at 1e-3; no gradient for less weight than that",
        setup: || beside_the_poles(&[0.0, 1e-7, 1e-5, 1e-4, 1.3e-3, 2e-3, 1e-2, 0.1]),
        ..OF_MOTION
    },
    Case {
        id: "direction-undefined",
        title: "1e-30 to 1e-5 units from the origin of directions",
        action: "nearer than 1e-6 they count as being on the equator",
        setup: at_the_origin,
        ..OF_MOTION
    },
    Case {
        id: "non-finite-motion",
        title: "peak times, lifespans and velocities that are NaN or infinite",
        action: "left out; their own gradients are refused by Adam",
        setup: non_finite,
        expectation: Expectation::LeavesOut { degenerate: 5 },
        ..OF_MOTION
    },
];

/// Returns Gaussians, half of them at their peak, half of them half a lifespan away from it.
fn timed(peak_seconds: f64, lifespan_seconds: f64, speed: f64) -> Setup {
    let mut gaussians = mild();
    for (index, gaussian) in gaussians.iter_mut().enumerate() {
        let beside = 0.5 * lifespan_seconds * (index % 2) as f64;
        let sign = if index % 3 == 0 { -1.0 } else { 1.0 };
        gaussian.motion = Motion {
            peak_seconds: peak_seconds + sign * beside,
            lifespan_seconds,
            velocity: [speed, -0.4 * speed, 0.6 * speed],
        };
    }
    Setup::new(gaussians)
}

fn at_the_floor() -> Setup {
    let frame = Timing::MILD.clock.frame_seconds;
    let mut gaussians = mild();
    for (index, gaussian) in gaussians.iter_mut().enumerate() {
        gaussian.motion.lifespan_seconds = 0.25 * frame;
        gaussian.motion.peak_seconds = TIME_SECONDS + frame * (index as f64 - 4.5) / 6.0;
    }
    Setup::new(gaussians)
}

fn gone() -> Setup {
    let mut gaussians = mild();
    let lifespans = [3.0, -3.2, 3.4, -5.0, 10.0, -20.0, 40.0];
    for (gaussian, lifespans) in gaussians.iter_mut().zip(lifespans) {
        gaussian.motion.lifespan_seconds = 0.1;
        gaussian.motion.peak_seconds = TIME_SECONDS + 0.1 * lifespans;
    }
    Setup::new(gaussians)
}

fn smoothed() -> Setup {
    let mut setup = timed(0.4, 1.0, 0.3);
    setup.timing.shift_frames = 1.5;
    setup
}

/// Returns a clip of thirty frames per second; every Gaussian is visible around the last frame.
fn last_frame() -> Setup {
    let clock = Clock {
        origin_seconds: 1e6,
        frame_seconds: 1.0 / 30.0,
        duration_frames: 10_000.0,
    };
    // Not a frame number that f32 represents.
    let last = 1e6 + 4_999.863 * clock.frame_seconds;
    let mut setup = timed(last, 1.0, 0.3);
    for (index, gaussian) in setup.gaussians.iter_mut().enumerate() {
        if index % 4 == 1 {
            gaussian.motion.lifespan_seconds = 0.25 * clock.frame_seconds;
            gaussian.motion.peak_seconds = last + 0.3 * clock.frame_seconds;
        }
    }
    setup.at(last, clock)
}

/// Returns Gaussians at these angles from the poles, which a few tenths of a second move far; rad.
pub(super) fn beside_the_poles(angles: &[f64]) -> Setup {
    let mut gaussians = mild();
    for (index, angle) in angles.iter().enumerate() {
        let (sin, cos) = angle.sin_cos();
        let pole = if index % 2 == 0 { -cos } else { cos };
        let direction = dvec3(0.6 * sin, pole, 0.8 * sin);
        let mut gaussian = RawGaussian::new(direction, 2.0, [0.2, 0.1, 0.3], 0.6, index);
        gaussian.motion.velocity = [3.0, -1.0, 2.0];
        gaussians.push(gaussian);
    }
    Setup::straight(gaussians)
}

/// Returns Gaussians at the origin; the camera stands beside it to see them.
fn at_the_origin() -> Setup {
    let mut gaussians = mild();
    for (index, distance) in [1e-30, 1e-9, 0.9e-6, 1.1e-6, 1e-5].into_iter().enumerate() {
        let direction = dvec3(0.6, -0.7, 0.4);
        let mut gaussian = RawGaussian::new(direction, distance, [0.02; 3], 0.3, index);
        // Each moves differently: where depths are equal, the order is undefined.
        gaussian.motion.velocity = [0.5, -0.2, 0.3].map(|v| v * (1 + index) as f64);
        gaussians.push(gaussian);
    }
    let turn = glam::DQuat::from_rotation_y(0.4);
    Setup::seen(gaussians, turn, dvec3(0.3, -0.2, 0.4), 48)
}

fn non_finite() -> Setup {
    let mut gaussians = mild();
    let good = gaussians.len();
    let degenerate = RawGaussian::new(dvec3(0.2, 0.1, 1.0), 2.0, [0.3; 3], 0.5, 1);
    gaussians.extend([degenerate; 5]);
    gaussians[good].motion.peak_seconds = f64::NAN;
    gaussians[good + 1].motion.peak_seconds = f64::NEG_INFINITY;
    gaussians[good + 2].motion.lifespan_seconds = f64::NAN;
    gaussians[good + 3].motion.velocity[1] = f64::NAN;
    gaussians[good + 4].motion.velocity = [f64::INFINITY; 3];
    Setup::new(gaussians)
}
