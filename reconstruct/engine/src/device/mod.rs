//! A GPU through wgpu: what every kernel is written with.
//!
//! * [`Gpu`]: an open device; its errors are [`GpuError`], never a panic. [`adapters`]: what there is.
//! * `buffer`, `shader`, `program`: typed buffers, WGSL modules, and recorded chains of kernels.
//! * `scan`: prefix sums. [`timer`]: what stages cost.
//!
//! A stage's WGSL lies beside its CPU twin `cpu.rs`, with the same names in the same order; `gpu.rs`
//! there binds its buffers. No kernel needs an optional feature of the device: everything keeps within
//! the limits that every WebGPU adapter has, but buffers may be as large as the adapter allows. Clocks
//! are used where there are any, and subgroups by kernels that have a twin without.

pub mod adapters;
mod buffer;
#[expect(
    clippy::module_inception,
    reason = "the device itself, in the room of its name"
)]
mod device;
mod error;
mod program;
pub(crate) mod scan;
pub(crate) mod shader;
pub mod timer;

pub(crate) use buffer::{DeviceBuffer, Uniform};
pub use device::Gpu;
pub(crate) use device::WORKGROUP;
pub use error::GpuError;
pub(crate) use program::{Kernel, Program, Rows, Threads, Workgroups};
pub(crate) use scan::Scan;
pub(crate) use shader::{Shader, wgsl_struct};

/// A device for a test, or nothing and a line why on a machine without any adapter.
#[cfg(test)]
pub(crate) fn test_device() -> Option<Gpu> {
    match Gpu::open() {
        Ok(gpu) => Some(gpu),
        Err(GpuError::NoAdapter) => {
            omnilife_schemas::testing::skip(GpuError::NoAdapter);
            None
        }
        Err(error) => panic!("{error}"),
    }
}
