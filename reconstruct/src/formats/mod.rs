//! Files of a model.

pub mod deformation;
pub mod moving_ply;
pub mod ply;
