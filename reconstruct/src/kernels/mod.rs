//! The stages of rendering and optimization, one folder each: the contract in `mod.rs`, the
//! processor's implementation in `cpu.rs`.
//!
//! ```text
//! forward   project -> sort -> bin -> raster -> loss
//! backward  loss -> raster -> project            then adam
//! ```
//!
//! What a render is, without tiles and tricks, is written down as plain f64 loops in
//! `tests/support/reference.rs`; the kernels are judged by it.

pub mod adam;
pub mod bin;
pub mod loss;
pub mod project;
pub mod raster;
pub mod sort;

/// Opacities of a pixel below this do not contribute (3DGS `forward.cu`).
pub const ALPHA_MIN: f32 = 1.0 / 255.0;
/// Opacity of one Gaussian in one pixel is clamped here (3DGS `forward.cu`).
pub const ALPHA_MAX: f32 = 0.99;
/// Compositing stops before the transmittance falls below this (3DGS `forward.cu`).
pub const TRANSMITTANCE_MIN: f32 = 1e-4;
/// Added to the diagonal of the projected covariance, square pixels (3DGS `forward.cu`).
pub const LOW_PASS: f32 = 0.3;
/// Side of a tile in pixels.
pub const TILE: usize = 16;
