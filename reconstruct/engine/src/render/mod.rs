//! Stages of rendering, one folder each: the contract in `mod.rs`, the CPU implementation in `cpu.rs`, and
//! its GPU twin in a `.wgsl` file, bound in `gpu.rs`. Twins have the same names in the same order.
//!
//! ```text
//! forward   project -> sort -> bin -> raster        then the losses
//! backward  raster -> project                       then Adam
//! ```
//!
//! [`cpu::Renderer`] and [`gpu::GpuRenderer`] chain them. The definition of a render, without tiles and
//! optimizations, is [`mod@reference`] in plain f64 loops, with which tests compare the stages. [`published`]
//! is the renderer of ODGS with its defects.

pub mod bin;
pub(crate) mod buffers;
pub mod cpu;
pub mod gpu;
pub mod project;
pub mod published;
pub mod raster;
pub mod reference;
pub mod settings;
pub mod sort;

/// A Gaussian that was drawn in the view rendered last.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Visible {
    /// Index of the Gaussian.
    pub gaussian: usize,
    /// Gradient of the loss by the image of its centre, with the shape of the footprint fixed, per pixel
    /// along columns and rows.
    pub centre_gradient: [f32; 2],
}
