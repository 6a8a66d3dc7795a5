//! Growth of the error of stiff cases over their condition number.

use glam::dvec3;
use omnilife_schemas::records::{StabilityPoint, StabilitySweep};

use crate::{
    Limits,
    case_setups::{in_world, layers, needles},
    cases::{Expectation, LAYERED, PLAIN_LIMITS},
    devices::Device,
    fault,
    in_time::beside_the_poles,
    measure::measure,
    parameterizations::{DEFORMABLE, OMNI4DGS, PERIODIC, Parameterization, STATIC},
    setup::{RawGaussian, Setup, TIME_SECONDS, Timing, mild},
};
use omnilife_engine::clock::Clock;
use omnilife_training::error::ReconstructError;

/// A family of setups.
#[derive(Debug, Clone, Copy)]
pub struct Sweep {
    /// Id, unique among sweeps.
    pub id: &'static str,
    /// Title in words.
    pub title: &'static str,
    /// Quantity of the condition number.
    pub condition: &'static str,
    /// Parameterization of the Gaussians.
    pub parameterization: Parameterization,
    conditions: &'static [f64],
    setup: fn(f64) -> Setup,
    /// Limits of the errors at low condition numbers.
    limits: Limits,
    /// Limit of the gradient's error for each unit of the condition number, where that is more.
    gradient_slope: f64,
}

/// All sweeps.
pub const SWEEPS: &[Sweep] = &[
    Sweep {
        id: "needle",
        title: "Needles",
        condition: "length over thickness",
        parameterization: STATIC,
        conditions: &[1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6],
        setup: needles,
        limits: PLAIN_LIMITS,
        gradient_slope: 0.0,
    },
    Sweep {
        id: "pole",
        title: "Towards a pole",
        condition: "one over the angle from the pole, 1/rad",
        parameterization: STATIC,
        conditions: &[1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6, 1e7],
        setup: towards_the_pole,
        limits: PLAIN_LIMITS,
        gradient_slope: 0.0,
    },
    Sweep {
        id: "layers",
        title: "Translucent layers",
        condition: "layers in one direction",
        parameterization: STATIC,
        conditions: &[1.0, 10.0, 100.0, 1e3, 1e4],
        setup: |count| layers(count as usize),
        limits: LAYERED,
        gradient_slope: 0.0,
    },
    Sweep {
        id: "origin",
        title: "Distance from the world's origin",
        condition: "distance over the size of the scene",
        parameterization: STATIC,
        conditions: &[1.0, 100.0, 1e4, 1e6, 1e8],
        setup: |distance| in_world([distance, -distance, distance], 1.0),
        limits: PLAIN_LIMITS,
        gradient_slope: 0.0,
    },
    Sweep {
        id: "opacity",
        title: "Saturating opacity",
        condition: "one over the transmittance of every Gaussian's centre",
        parameterization: STATIC,
        conditions: &[2.0, 10.0, 100.0, 1e3, 1e4, 1e6],
        setup: saturating,
        limits: PLAIN_LIMITS,
        gradient_slope: 2e-7,
    },
    Sweep {
        id: "lifespan",
        title: "Short lives in long clips (periodic)",
        condition: "frames from the middle of the clip over the lifespan",
        parameterization: PERIODIC,
        conditions: &[1.0, 10.0, 100.0, 1e3, 1e4, 2e4, 1e5],
        setup: short_lives,
        limits: PLAIN_LIMITS,
        gradient_slope: 0.0,
    },
    Sweep {
        id: "speed",
        title: "Fast motion (periodic)",
        condition: "way in a frame over the size of the Gaussian",
        parameterization: PERIODIC,
        conditions: &[1.0, 10.0, 100.0, 1e3, 1e4, 1e5],
        setup: moving_fast,
        limits: PLAIN_LIMITS,
        gradient_slope: 0.0,
    },
    Sweep {
        id: "cycle",
        title: "Short cycles (periodic)",
        condition: "frames from the peak over the cycle",
        parameterization: PERIODIC,
        conditions: &[1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6],
        setup: |cycles| Setup::new(mild()).with_cycle(0.97 / cycles),
        limits: PLAIN_LIMITS,
        gradient_slope: 3.5e-7,
    },
    Sweep {
        id: "latitude",
        title: "Velocity weights towards a pole (omni4dgs)",
        condition: "one over the angle from the pole, 1/rad",
        parameterization: OMNI4DGS,
        conditions: &[1.0, 10.0, 100.0, 300.0, 900.0, 1e4, 1e5, 1e6, 1e7],
        setup: |condition| beside_the_poles(&[1.0 / condition; 2]),
        limits: PLAIN_LIMITS,
        gradient_slope: 0.0,
    },
    Sweep {
        id: "encoding",
        title: "Positions far from what a network's encoding is made for (deformable)",
        condition: "distance over a unit",
        parameterization: DEFORMABLE,
        conditions: &[1.0, 10.0, 100.0, 1e3, 1e4, 1e5],
        setup: far_ellipsoids,
        limits: Limits {
            forward: 2e-4,
            gradient: 3e-3,
        },
        gradient_slope: 0.0,
    },
];

impl Sweep {
    /// Returns the record of this sweep, without points.
    pub fn record(&self) -> StabilitySweep {
        StabilitySweep {
            id: self.id.to_owned(),
            title: self.title.to_owned(),
            condition: self.condition.to_owned(),
            limits: self.limits_in_words(),
            points: Vec::new(),
        }
    }

    /// Returns its points on a device.
    ///
    /// # Errors
    /// When the device fails.
    pub fn points(&self, device: &mut Device) -> Result<Vec<StabilityPoint>, ReconstructError> {
        self.conditions
            .iter()
            .map(|&condition| {
                let setup = (self.setup)(condition);
                let limits = self.limits_at(condition);
                let measured = measure(&setup, &self.parameterization, device, 0, limits)?;
                Ok(StabilityPoint {
                    backend: device.kind().id().to_owned(),
                    condition,
                    fault: fault(Expectation::Agrees, &measured.measures, &limits),
                    measured: measured.measures,
                })
            })
            .collect()
    }
}

impl Sweep {
    fn limits_at(&self, condition: f64) -> Limits {
        Limits {
            gradient: self.limits.gradient.max(self.gradient_slope * condition),
            ..self.limits
        }
    }

    fn limits_in_words(&self) -> String {
        let Limits { forward, gradient } = self.limits;
        let mut text = format!("image within {forward:.0e}, gradient within {gradient:.0e}");
        if self.gradient_slope > 0.0 {
            text += &format!(" or {:.1e} of the condition number", self.gradient_slope);
        }
        text
    }
}

fn towards_the_pole(condition: f64) -> Setup {
    let (sin, cos) = (1.0 / condition).sin_cos();
    let mut gaussians = mild();
    gaussians.extend([
        RawGaussian::new(dvec3(sin, -cos, 0.0), 2.0, [0.2, 0.1, 0.3], 0.6, 1),
        RawGaussian::new(
            dvec3(-0.6 * sin, cos, 0.8 * sin),
            1.5,
            [0.1, 0.2, 0.15],
            0.5,
            2,
        ),
    ]);
    Setup::straight(gaussians)
}

fn saturating(condition: f64) -> Setup {
    let mut gaussians = mild();
    for gaussian in &mut gaussians {
        // o = 1 - 1/c, and the logit ln(o / (1 - o)) = ln(c - 1).
        gaussian.opacity_logit = (condition - 1.0).ln();
    }
    Setup::new(gaussians)
}

/// Returns a setup one frame before the end of a clip, where times are farthest from its middle; lifespans are
/// the shortest allowed, or shorter with the clip.
fn short_lives(condition: f64) -> Setup {
    let lifespan = 0.25_f64.max(1.0 / condition);
    let clock = Clock {
        origin_seconds: 100.0,
        frame_seconds: 0.1,
        duration_frames: (2.0 * condition * lifespan) as f32,
    };
    // Not a frame number that f32 represents.
    let seconds = 100.0 + 0.1 * (condition * lifespan - 0.137);
    let mut gaussians = mild();
    for (index, gaussian) in gaussians.iter_mut().enumerate() {
        gaussian.motion.lifespan_seconds = 0.1 * lifespan;
        gaussian.motion.peak_seconds = seconds + 0.1 * lifespan * (index as f64 - 4.5) / 3.0;
    }
    Setup::new(gaussians).at(seconds, clock)
}

fn moving_fast(condition: f64) -> Setup {
    let frame = Timing::MILD.clock.frame_seconds;
    let mut gaussians = mild();
    for gaussian in &mut gaussians {
        let speed = 0.2 * condition / frame;
        gaussian.motion.velocity = [0.8 * speed, -0.4 * speed, 0.45 * speed];
        // Away from its peak by the time that brings it past the camera.
        gaussian.motion.peak_seconds = TIME_SECONDS - frame / condition;
    }
    Setup::new(gaussians)
}

/// Returns ellipsoids whose scales and rotations are visible at any distance.
fn far_ellipsoids(distance: f64) -> Setup {
    let mut gaussians = mild();
    for (index, direction) in [dvec3(-1.0, 0.2, 0.7), dvec3(0.4, -0.7, 0.3)]
        .into_iter()
        .enumerate()
    {
        let scale = [0.3, 0.1, 0.04].map(|share| share * distance);
        gaussians.push(RawGaussian::new(direction, distance, scale, 0.6, index));
    }
    Setup::straight(gaussians)
}
