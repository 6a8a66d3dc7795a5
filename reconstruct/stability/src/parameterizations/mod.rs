//! Parameterizations under test, and their definitions in f64.
//!
//! * `still`: 3DGS; `moving`: PVG and both readings of Omni4DGS; `deformed`: Deformable-GS.
//!
//! A definition is written from the paper's equations and calls none of the code that it judges.

mod deformed;
mod moving;
mod still;

use crate::setup::Setup;
use omnilife_engine::{model::Part, parameters::ParameterTable, render::reference::Gaussian};

pub use deformed::DEFORMABLE;
pub use moving::{OMNI4DGS, OMNI4DGS_PROJECTED, PERIODIC};
pub use still::{STATIC, STATIC_VALUES};

/// Dependence of a parameterization on time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TimeDependence {
    /// Independent of time.
    Still,
    /// The Gaussians, through a network that all of them share.
    Deformed,
    /// The Gaussians, each by a peak time, a lifespan and a velocity of its own.
    Moving,
}

/// A parameterization of Gaussians with its definition.
#[derive(Debug, Clone, Copy)]
pub struct Parameterization {
    /// Id.
    pub id: &'static str,
    /// Dependence on time.
    pub in_time: TimeDependence,
    /// Makes a table of a setup's raw parameters; those of static Gaussians come first.
    pub table: fn(&Setup) -> ParameterTable,
    /// Returns the table with its activation, which is judged.
    pub part: fn(ParameterTable, &Setup) -> Part,
    /// Returns the definition: a Gaussian of a table, all of its values array by array, at the setup's instant.
    /// Decisions, and values without a gradient, come from the second row: the Gaussian before a difference moved
    /// it.
    pub definition: fn(&[f64], &[f64], &Setup) -> Gaussian,
    /// Returns the change of a parameter behind the static ones, counted from 0, that visibly changes the image.
    /// Inputs are the Gaussian's row and the distance that its centre has to move for that.
    pub unit: fn(&[f64], usize, f64, &Setup) -> f64,
    /// Returns the method's factor on the derivative by such a parameter, applied before Adam sees it.
    pub gradient_scale: fn(&[f64], usize, &Setup) -> f64,
}

/// All parameterizations.
pub const PARAMETERIZATIONS: &[Parameterization] =
    &[STATIC, PERIODIC, OMNI4DGS, OMNI4DGS_PROJECTED, DEFORMABLE];
