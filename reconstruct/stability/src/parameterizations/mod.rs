//! The parameterizations that cases are tried on, and their definitions in f64.
//!
//! * `still`: 3DGS; `moving`: PVG and both readings of Omni4DGS; `deformed`: Deformable-GS.
//!
//! A definition is written from the paper's equations and calls nothing of the code that it judges.

mod deformed;
mod moving;
mod still;

use crate::setup::Setup;
use omnilife_engine::{model::Part, parameters::ParameterTable, render::reference::Gaussian};

pub use deformed::DEFORMABLE;
pub use moving::{OMNI4DGS, OMNI4DGS_PROJECTED, PERIODIC};
pub use still::{STATIC, STATIC_VALUES};

/// What of a parameterization depends on time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InTime {
    /// Nothing.
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
    /// What of it depends on time.
    pub in_time: InTime,
    /// A table of a setup's raw parameters; those of static Gaussians come first.
    pub table: fn(&Setup) -> ParameterTable,
    /// The table with what activates it: what is judged.
    pub part: fn(ParameterTable, &Setup) -> Part,
    /// The definition: a Gaussian of a table, all of its values array by array, at the setup's
    /// instant. What no gradient flows through, and every decision, is taken from the second row: the
    /// Gaussian before a difference moved it.
    pub definition: fn(&[f64], &[f64], &Setup) -> Gaussian,
    /// By how much a parameter behind the static ones, counted from 0, has to change for the image to
    /// change its looks. Given are the Gaussian's row and by how far its centre has to move for that.
    pub unit: fn(&[f64], usize, f64, &Setup) -> f64,
    /// What the method multiplies the derivative by such a parameter with before Adam sees it.
    pub gradient_scale: fn(&[f64], usize, &Setup) -> f64,
}

/// All of them.
pub const PARAMETERIZATIONS: &[Parameterization] =
    &[STATIC, PERIODIC, OMNI4DGS, OMNI4DGS_PROJECTED, DEFORMABLE];
