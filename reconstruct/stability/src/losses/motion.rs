//! Regularization of motion (Omni4DGS Eqs. 10 and 11): tiny differences of directions, and directions that are
//! hardly defined.

use glam::{DVec3, Vec3};
use omnilife_engine::{
    EngineError,
    clock::Clock,
    gaussians::{
        parameterization::Viewpoint,
        periodic::TemporalParameters,
        static_gaussians::{InitialGaussians, POSITIONS},
        temporal::{InitialTimes, LifespanRange, PEAK_TIMES, TimeModel, VELOCITIES, VelocityModel},
        temporal_gaussians::TemporalGaussians,
    },
    losses::motion::of_one,
    model::{Model, Part},
    step::gpu::activation::GpuActivator,
};

use super::compared;
use crate::{
    Limits,
    devices::Device,
    special::{CaseResult, Runs, SpecialCase},
};

/// Ten times the measured errors.
const LIMITS: Limits = Limits {
    forward: 1.5e-6,
    gradient: 1e-4,
};

pub(super) const CASES: &[SpecialCase] = &[
    SpecialCase {
        id: "motion-plain",
        title: "regularization of motion, for comparison",
        runs: Runs::OnBoth,
        judge: |device| judge(device, &PLAIN),
    },
    SpecialCase {
        id: "motion-far",
        title: "regularization of motion at a million times the cameras' radius",
        runs: Runs::OnBoth,
        judge: |device| {
            let moving = MovingGaussian {
                distance: 1e6,
                ..PLAIN
            };
            judge(device, &moving)
        },
    },
    SpecialCase {
        id: "motion-near",
        title: "regularization of motion a hundred-thousandth from the observer",
        runs: Runs::OnBoth,
        judge: |device| {
            let moving = MovingGaussian {
                distance: 1e-5,
                speed: 1e-6,
                ..PLAIN
            };
            judge(device, &moving)
        },
    },
    SpecialCase {
        id: "motion-slow",
        title: "regularization of motion by a hundred-millionth per frame",
        runs: Runs::OnBoth,
        judge: |device| {
            let moving = MovingGaussian {
                speed: 1e-8,
                ..PLAIN
            };
            judge(device, &moving)
        },
    },
    SpecialCase {
        id: "motion-fast",
        title: "regularization of motion by ten thousand radii per frame",
        runs: Runs::OnBoth,
        judge: |device| {
            let moving = MovingGaussian {
                speed: 1e4,
                ..PLAIN
            };
            judge(device, &moving)
        },
    },
    SpecialCase {
        id: "motion-late",
        title: "regularization of motion a hundred thousand frames after the peak",
        runs: Runs::OnBoth,
        judge: |device| {
            let moving = MovingGaussian {
                frame: 1e5 + 0.3,
                ..PLAIN
            };
            judge(device, &moving)
        },
    },
    SpecialCase {
        id: "motion-long-cycle",
        title: "regularization of motion under a cycle of ten thousand frames",
        runs: Runs::OnBoth,
        judge: |device| {
            let moving = MovingGaussian {
                cycle: 1e4,
                ..PLAIN
            };
            judge(device, &moving)
        },
    },
];

struct MovingGaussian {
    distance: f64,
    speed: f64,
    frame: f64,
    cycle: f64,
}

const PLAIN: MovingGaussian = MovingGaussian {
    distance: 3.0,
    speed: 0.1,
    frame: 0.4,
    cycle: 10.0,
};

/// Its direction, motion and peak time.
const DIRECTION: DVec3 = DVec3::new(0.48, -0.6, 0.64);
const HEADING: DVec3 = DVec3::new(0.6, 0.64, 0.48);
const PEAK: f64 = 1.25;
/// Its lifespan, frames.
const LIFESPAN: f32 = 40.0;

/// Value, and gradients by centre, velocity and peak.
type MotionGradients = (f64, Vec3, Vec3, f32);

fn on_cpu(moving: &MovingGaussian, centre: Vec3, velocity: Vec3) -> Option<MotionGradients> {
    let parameters = TemporalParameters {
        peak: PEAK as f32,
        lifespan: LIFESPAN,
        velocity,
    };
    let found = of_one(&parameters, centre, moving.frame, moving.cycle as f32);
    let (value, by_temporal, by_centre) = found?;
    Some((
        f64::from(value),
        by_centre,
        by_temporal.velocity,
        by_temporal.peak,
    ))
}

/// Computes the loss of a Gaussian that is static in any cycle, seen from the origin.
fn on_gpu(
    activator: &GpuActivator,
    moving: &MovingGaussian,
    centre: Vec3,
    velocity: Vec3,
) -> Result<Option<MotionGradients>, EngineError> {
    let time = TimeModel {
        cycle_frames: moving.cycle as f32,
        lifespans: Some(LifespanRange {
            least_frames: 0.25,
            largest_frames: 1e6,
        }),
        velocity: VelocityModel::Free,
        least_marginal: 0.0,
    };
    let initial =
        InitialGaussians::isotropic(vec![centre.to_array()], &[0.1], vec![[0.5; 3]], vec![0.5]);
    let times = InitialTimes {
        peaks: vec![PEAK as f32],
        lifespans: vec![LIFESPAN],
        velocities: vec![velocity.to_array()],
    };
    let gaussians = TemporalGaussians {
        clock: Clock {
            origin_seconds: 0.0,
            frame_seconds: 1.0,
            duration_frames: 1.0,
        },
        time,
        down: [0.0, 1.0, 0.0],
        dynamic_below_staticness: 0.0,
    };
    let at = Viewpoint::of_moment(moving.frame);
    let part = Part::new(gaussians, time.table(&initial, &times, 0));
    let (value, model) = activator.motion(Model::new(vec![part]), &at, 1.0)?;
    let table = &model.parts[0].table;
    let gradients = |name: &str| Some(&table.arrays[table.position(name)?].gradients);
    let (Some(by_velocity), Some(by_peak)) = (gradients(VELOCITIES), gradients(PEAK_TIMES)) else {
        return Ok(None);
    };
    let by_centre = &table.arrays[POSITIONS].gradients;
    let [by_centre, by_velocity] = [by_centre, by_velocity].map(|by| Vec3::from_slice(by));
    Ok(Some((value, by_centre, by_velocity, by_peak[0])))
}

fn judge(device: &Device, moving: &MovingGaussian) -> CaseResult {
    let centre = (moving.distance * DIRECTION).as_vec3();
    let velocity = (moving.speed * HEADING).as_vec3();
    let found = match device.activator() {
        None => Ok(on_cpu(moving, centre, velocity)),
        Some(activator) => on_gpu(activator, moving, centre, velocity),
    };
    let (value, by_centre, by_velocity, by_peak) = match found {
        Ok(Some(found)) => found,
        Ok(None) => return CaseResult::failed("no direction is defined"),
        Err(error) => return CaseResult::failed(error),
    };
    let (expected, (in_centre, in_velocity, in_peak)) = reference(moving, centre, velocity);
    // Each array's gradient is relative to its own size, so that none hides behind another; the value is relative
    // too.
    let relative = |found: Vec3, expected: DVec3| -> [Vec<f64>; 2] {
        let size = expected.length();
        [found.as_dvec3(), expected].map(|vector| (vector / size).to_array().to_vec())
    };
    let [centre, expected_centre] = relative(by_centre, in_centre);
    let [velocity, expected_velocity] = relative(by_velocity, in_velocity);
    let found = [centre, velocity, vec![f64::from(by_peak) / in_peak]].concat();
    let wanted = [expected_centre, expected_velocity, vec![1.0]].concat();
    compared(
        &(value / expected, found),
        &(1.0, wanted),
        Limits {
            forward: device.limit(LIMITS.forward),
            gradient: device.limit(LIMITS.gradient),
        },
    )
}

/// Returns value and gradients by centre, velocity and peak from the definition, in f64: its 16 digits are enough
/// for differences in the eighth.
fn reference(moving: &MovingGaussian, centre: Vec3, velocity: Vec3) -> (f64, (DVec3, DVec3, f64)) {
    let (centre, velocity) = (centre.as_dvec3(), velocity.as_dvec3());
    let turns = |frame: f64| std::f64::consts::TAU * (frame - PEAK) / moving.cycle;
    let radius = moving.cycle / std::f64::consts::TAU;
    let frames = [moving.frame, moving.frame + 1.0];
    let places = frames.map(|frame| centre + radius * turns(frame).sin() * velocity);
    let [before, after] = places.map(DVec3::normalize);
    let change = after - before;
    let across = |direction: DVec3, by: DVec3| by - direction.dot(by) * direction;
    let by_places = [
        across(before, -2.0 * change) / places[0].length(),
        across(after, 2.0 * change) / places[1].length(),
    ];
    let (mut by_velocity, mut by_peak) = (DVec3::ZERO, 0.0);
    for (frame, by_place) in frames.into_iter().zip(by_places) {
        by_velocity += radius * turns(frame).sin() * by_place;
        by_peak -= turns(frame).cos() * velocity.dot(by_place);
    }
    let by_centre = by_places[0] + by_places[1];
    (change.length_squared(), (by_centre, by_velocity, by_peak))
}
