//! Stiff cases over their condition number: how the error grows.

use glam::dvec3;
use omnilife_schemas::records::{StabilityPoint, StabilitySweep};

use super::{
    cases::{in_world, layers, needles},
    devices::Device,
    measure::measure,
    parameterizations::PARAMETERIZATIONS,
    setup::{RawGaussian, Setup, mild},
};
use crate::error::ReconstructError;

/// A family of setups.
#[derive(Debug, Clone, Copy)]
pub struct Sweep {
    /// Id, unique among sweeps.
    pub id: &'static str,
    /// What it is, in words.
    pub title: &'static str,
    /// What the condition number counts.
    pub condition: &'static str,
    conditions: &'static [f64],
    setup: fn(f64) -> Setup,
}

/// All of them.
pub const SWEEPS: &[Sweep] = &[
    Sweep {
        id: "needle",
        title: "Needles",
        condition: "length over thickness",
        conditions: &[1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6],
        setup: needles,
    },
    Sweep {
        id: "pole",
        title: "Towards a pole",
        condition: "one over the angle from the pole, 1/rad",
        conditions: &[1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6, 1e7],
        setup: towards_the_pole,
    },
    Sweep {
        id: "layers",
        title: "Translucent layers",
        condition: "layers in one direction",
        conditions: &[1.0, 10.0, 100.0, 1e3, 1e4],
        setup: |count| layers(count as usize),
    },
    Sweep {
        id: "origin",
        title: "Distance from the world's origin",
        condition: "distance over the size of the scene",
        conditions: &[1.0, 100.0, 1e4, 1e6, 1e8],
        setup: |distance| in_world([distance, -distance, distance], 1.0),
    },
    Sweep {
        id: "opacity",
        title: "Saturating opacity",
        condition: "one over the transmittance of every Gaussian's centre",
        conditions: &[2.0, 10.0, 100.0, 1e3, 1e4, 1e6],
        setup: saturating,
    },
];

impl Sweep {
    /// The record of this sweep, without points.
    pub fn record(&self) -> StabilitySweep {
        StabilitySweep {
            id: self.id.to_owned(),
            title: self.title.to_owned(),
            condition: self.condition.to_owned(),
            points: Vec::new(),
        }
    }

    /// Its points on a device, with static Gaussians.
    ///
    /// # Errors
    /// When the device fails.
    pub fn points(&self, device: &mut Device) -> Result<Vec<StabilityPoint>, ReconstructError> {
        self.conditions
            .iter()
            .map(|&condition| {
                let setup = (self.setup)(condition);
                let measured = measure(&setup, &PARAMETERIZATIONS[0], device, 0, 1e-3)?;
                Ok(StabilityPoint {
                    backend: device.kind().id().to_owned(),
                    condition,
                    measured: measured.measures,
                })
            })
            .collect()
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
