//! Gaussians that appear around a moment and vibrate about a centre: PVG, and Omni4DGS with its velocity
//! of two parts in both of its readings.
//!
//! The definition (PVG; Omni4DGS Eqs. 1 to 3), in frames: `t` is the instant, `tau` the peak time, `beta` the
//! lifespan, `l` the cycle, and `s` the shift of temporal smoothing:
//!
//! ```text
//! d = t - s - tau          mu(t) = mu + v l/(2 pi) sin(2 pi d / l) + s v exp(-beta/(2 l))
//! o(t) = o exp(-(d/beta)^2 / 2), not drawn at or below PVG's 0.05 of the peak's
//! w_t = cos(latitude of mu)^gamma, at least (1e-3)^gamma           v = (1 - w_t) v_r + w_t v_t
//! projected: v = n n^T v_r + (I - n n^T) v_t; w_r and w_t scale the gradients alone
//! ```

use std::f64::consts::TAU;

use glam::DVec3;

use crate::{
    parameterizations::{Parameterization, TimeDependence, still},
    setup::Setup,
};
use omnilife_engine::{
    gaussians::{
        omni4dgs::{Decomposition, DirectionOrigin, VelocityForm},
        temporal::{
            LOG_LIFESPANS, LifespanRange, PEAK_TIMES, RADIAL_VELOCITIES, TANGENTIAL_VELOCITIES,
            TimeModel, VelocityModel,
        },
        temporal_gaussians::TemporalGaussians,
    },
    model::Part,
    parameters::ParameterTable,
    render::reference::Gaussian,
};

/// PVG: one free velocity; faint Gaussians are left out.
pub const PERIODIC: Parameterization = Parameterization {
    id: "periodic",
    in_time: TimeDependence::Moving,
    table: |setup| table(setup, &pvg(setup)),
    part: |table, setup| part(table, setup, pvg(setup)),
    definition: |row, frozen, setup| definition(row, frozen, setup, None, 0.05),
    unit: |row, parameter, size, setup| unit(row, parameter, size, setup, None),
    gradient_scale: |_, _, _| 1.0,
};

/// Omni4DGS, Eq. 3 as written, seen from the world's origin.
pub const OMNI4DGS: Parameterization = Parameterization {
    id: "omni4dgs",
    in_time: TimeDependence::Moving,
    table: |setup| table(setup, &literal(setup)),
    part: |table, setup| part(table, setup, literal(setup)),
    definition: |row, frozen, setup| {
        definition(row, frozen, setup, Some(VelocityForm::Literal), 0.0)
    },
    unit: |row, parameter, size, setup| {
        unit(row, parameter, size, setup, Some(VelocityForm::Literal))
    },
    gradient_scale: |row, parameter, setup| scale(row, parameter, setup, VelocityForm::Literal),
};

/// Omni4DGS, the velocities projected on the line of sight of the camera and across it.
pub const OMNI4DGS_PROJECTED: Parameterization = Parameterization {
    id: "omni4dgs-projected",
    in_time: TimeDependence::Moving,
    table: |setup| table(setup, &projected(setup)),
    part: |table, setup| part(table, setup, projected(setup)),
    definition: |row, frozen, setup| {
        definition(row, frozen, setup, Some(VelocityForm::Projected), 0.0)
    },
    unit: |row, parameter, size, setup| {
        unit(row, parameter, size, setup, Some(VelocityForm::Projected))
    },
    gradient_scale: |row, parameter, setup| scale(row, parameter, setup, VelocityForm::Projected),
};

const GAMMA: f64 = 0.5;
/// Bounds of lifespans, frames.
const LIFESPANS: [f32; 2] = [0.25, 1e6];

fn model(setup: &Setup, velocity: VelocityModel, least_marginal: f32) -> TimeModel {
    TimeModel {
        cycle_frames: setup.timing.cycle_frames,
        lifespans: Some(LifespanRange {
            least_frames: LIFESPANS[0],
            largest_frames: LIFESPANS[1],
        }),
        velocity,
        least_marginal,
    }
}

fn pvg(setup: &Setup) -> TimeModel {
    model(setup, VelocityModel::Free, 0.05)
}

fn decomposed(setup: &Setup, form: VelocityForm, origin: DirectionOrigin) -> TimeModel {
    let decomposition = Decomposition {
        gamma: GAMMA as f32,
        form,
        origin,
    };
    model(setup, VelocityModel::Decomposed(decomposition), 0.0)
}

fn literal(setup: &Setup) -> TimeModel {
    decomposed(setup, VelocityForm::Literal, DirectionOrigin::World)
}

fn projected(setup: &Setup) -> TimeModel {
    decomposed(setup, VelocityForm::Projected, DirectionOrigin::Camera)
}

/// Returns the static arrays, then those of the model. Lifespans may lie outside their bounds: training would
/// restore them, and reading has to accept them.
fn table(setup: &Setup, model: &TimeModel) -> ParameterTable {
    let mut table = still::table(&setup.gaussians);
    let clock = setup.timing.clock;
    for shape in model.shapes() {
        let values = setup
            .gaussians
            .iter()
            .flat_map(|gaussian| {
                let motion = gaussian.motion;
                let [x, y, z] = motion.velocity.map(|v| (v * clock.frame_seconds) as f32);
                match shape.name {
                    PEAK_TIMES => vec![clock.frame(motion.peak_seconds) as f32],
                    LOG_LIFESPANS => {
                        vec![(motion.lifespan_seconds / clock.frame_seconds).ln() as f32]
                    }
                    // Two different parts.
                    RADIAL_VELOCITIES => vec![y, z, -x],
                    TANGENTIAL_VELOCITIES => vec![x, -y, z],
                    _ => vec![x, y, z],
                }
            })
            .collect();
        table.add(shape.name, shape.width, values, 0.0);
    }
    table
}

fn part(table: ParameterTable, setup: &Setup, time: TimeModel) -> Part {
    let temporal = TemporalGaussians {
        clock: setup.timing.clock,
        time,
        down: [0.0, 1.0, 0.0],
        dynamic_below_staticness: 1.0,
    };
    Part::new(temporal, table)
}

/// The temporal values of a Gaussian.
struct Temporal {
    /// `d`, frames.
    distance: f64,
    /// `beta`, frames.
    lifespan: f64,
    velocity: DVec3,
}

/// Reads the temporal values from a row; bounds and directions are those of the row `frozen`.
fn temporal(row: &[f64], frozen: &[f64], setup: &Setup, form: Option<VelocityForm>) -> Temporal {
    let at = still::STATIC_VALUES;
    let timing = &setup.timing;
    let clock = timing.clock;
    let frame = (setup.view.time_seconds - clock.origin_seconds) / clock.frame_seconds;
    let [low, high] = LIFESPANS.map(|frames| f64::from(frames.ln()));
    let log_lifespan = if (low..=high).contains(&frozen[at + 1]) {
        row[at + 1]
    } else {
        frozen[at + 1].clamp(low, high)
    };
    let three = |from: usize| DVec3::from_slice(&row[from..from + 3]);
    let velocity = match form {
        None => three(at + 2),
        Some(form) => {
            let (radial, tangential) = (three(at + 2), three(at + 5));
            let sight = Sight::of(frozen, setup, form);
            match form {
                VelocityForm::Literal => {
                    radial * (1.0 - sight.tangential) + tangential * sight.tangential
                }
                VelocityForm::Projected => {
                    let n = sight.direction;
                    n * n.dot(radial) + (tangential - n * n.dot(tangential))
                }
            }
        }
    };
    Temporal {
        distance: frame - f64::from(timing.shift_frames) - row[at],
        lifespan: log_lifespan.exp(),
        velocity,
    }
}

/// The view of a Gaussian from the centre of the velocity decomposition.
struct Sight {
    /// Unit; zero where it is undefined.
    direction: DVec3,
    /// `w_t`.
    tangential: f64,
}

impl Sight {
    fn of(row: &[f64], setup: &Setup, form: VelocityForm) -> Self {
        let (centre, down) = match form {
            VelocityForm::Literal => (DVec3::ZERO, DVec3::Y),
            VelocityForm::Projected => {
                let to_world = setup.exact.rotation.transpose();
                (setup.exact.centre, to_world * DVec3::Y)
            }
        };
        let offset = DVec3::from_slice(&row[..3]) - centre;
        let direction = if offset.length() > 1e-6 {
            offset.normalize()
        } else {
            DVec3::ZERO
        };
        let cosine = if direction == DVec3::ZERO {
            1.0
        } else {
            direction.cross(down).length()
        };
        Self {
            direction,
            tangential: cosine.max(1e-3).powf(GAMMA),
        }
    }
}

fn definition(
    row: &[f64],
    frozen: &[f64],
    setup: &Setup,
    form: Option<VelocityForm>,
    least_marginal: f64,
) -> Gaussian {
    let marginal =
        |temporal: &Temporal| (-0.5 * (temporal.distance / temporal.lifespan).powi(2)).exp();
    let is_drawn = marginal(&temporal(frozen, frozen, setup, form)) > least_marginal;
    let now = temporal(row, frozen, setup, form);
    let cycle = f64::from(setup.timing.cycle_frames);
    let shift = f64::from(setup.timing.shift_frames);
    let vibration = cycle / TAU * (TAU * now.distance / cycle).sin();
    let moved = now.velocity * (vibration + shift * (-0.5 * now.lifespan / cycle).exp());
    let still = still::definition(row);
    Gaussian {
        position: (DVec3::from_array(still.position) + moved).to_array(),
        opacity: if is_drawn {
            still.opacity * marginal(&now)
        } else {
            0.0
        },
        ..still
    }
}

/// Returns the unit of a parameter. Peak times: the shortest of lifespan, part of the cycle and the time in which
/// the velocity moves by `size`. Velocities: the one that moves the Gaussian by `size`.
fn unit(
    row: &[f64],
    parameter: usize,
    size: f64,
    setup: &Setup,
    form: Option<VelocityForm>,
) -> f64 {
    let now = temporal(row, row, setup, form);
    let cycle = f64::from(setup.timing.cycle_frames);
    match parameter {
        0 => {
            let speed = now.velocity.length().max(1e-12);
            now.lifespan.min(cycle / TAU).min(size / speed)
        }
        1 => 1.0,
        _ => {
            let reach = now.distance.abs().min(cycle / TAU);
            size / reach.max(f64::from(setup.timing.shift_frames)).max(1e-6)
        }
    }
}

/// Returns `w_r` and `w_t` in the projected form; 0 for a velocity whose weight is below 1e-3, which gets no
/// gradient.
fn scale(row: &[f64], parameter: usize, setup: &Setup, form: VelocityForm) -> f64 {
    let tangential = Sight::of(row, setup, form).tangential;
    let weight = match parameter {
        2..5 => 1.0 - tangential,
        5..8 => tangential,
        _ => return 1.0,
    };
    match form {
        _ if weight < 1e-3 => 0.0,
        VelocityForm::Literal => 1.0,
        VelocityForm::Projected => weight,
    }
}
