//! The graphics backend: the kernels on a wgpu device.
//!
//! * [`Gpu`]: an open device; its errors are [`GpuError`], never a panic.
//! * `buffer`, `shader`, `program`: typed buffers, WGSL modules, and recorded chains of kernels.
//! * `scan`: prefix sums.
//! * [`GpuRenderer`]: the chain of kernels that renders a view and takes its gradient back.
//! * `device_model`: a model's arrays on the device and the programs of a step on them.
//! * [`GpuStepper`]: whole training steps that stay on the device.
//!
//! A stage's WGSL lies beside its twin for the processor, `kernels/<stage>/cpu.rs`, with the same
//! names in the same order; `kernels/<stage>/gpu.rs` binds its buffers. No kernel needs an optional
//! feature of the device: everything keeps within the limits that every WebGPU adapter has, but
//! buffers may be as large as the adapter allows.

mod buffer;
mod device;
pub(crate) mod device_model;
mod error;
mod program;
mod render_buffers;
mod renderer;
mod scan;
pub(crate) mod shader;
mod table;
mod trainer;

pub(crate) use buffer::{DeviceBuffer, Uniform};
pub use device::Gpu;
pub(crate) use device::WORKGROUP;
pub(crate) use device_model::Parameterization;
pub use error::GpuError;
pub(crate) use program::{Kernel, Program};
#[cfg(test)]
pub(crate) use render_buffers::DeviceStatus;
pub(crate) use render_buffers::{RenderBuffers, RenderShape};
pub use renderer::GpuRenderer;
pub(crate) use scan::Scan;
pub(crate) use shader::{Shader, wgsl_struct};
pub(crate) use table::TableBuffers;
pub use trainer::GpuStepper;

/// A device for a test, or nothing and a line why on a machine without any adapter.
#[cfg(test)]
pub(crate) fn test_device() -> Option<Gpu> {
    match Gpu::open() {
        Ok(gpu) => Some(gpu),
        Err(GpuError::NoAdapter) => {
            println!("skipped: {}", GpuError::NoAdapter);
            None
        }
        Err(error) => panic!("{error}"),
    }
}
