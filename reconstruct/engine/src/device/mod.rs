//! GPU access through wgpu, shared by all kernels.
//!
//! * [`Gpu`]: an open device; its errors are [`GpuError`], never a panic. [`adapters`]: list of adapters.
//! * [`DeviceBuffer`], [`Uniform`]: typed buffers. [`Shader`], [`Kernel`]: WGSL modules and their entry points.
//!   [`Program`]: recorded chains of kernels.
//! * `scan`: prefix sums. [`timer`]: cost of stages.
//!
//! A stage's WGSL lies beside its CPU twin `cpu.rs`, with the same names in the same order; `gpu.rs` there
//! binds its buffers. No kernel needs an optional feature of the device: all keep within the limits of every
//! WebGPU adapter, but buffers may be as large as the adapter allows. Timestamps are optional, and every
//! kernel with subgroups has a twin without them. [`KernelChoices`]: kernels that stand for others;
//! [`PixelSums`]: the forms of sums over pixels.

pub mod adapters;
mod buffer;
mod choices;
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

pub use buffer::{DeviceBuffer, Uniform};
pub use choices::{KernelChoices, PixelSums};
pub(crate) use device::WORKGROUP;
pub use device::{BufferDemand, Gpu};
pub use error::GpuError;
pub use program::{Kernel, Program, Rows, Threads};
pub(crate) use program::{Workgroups, kernels};
pub(crate) use scan::Scan;
pub(crate) use shader::wgsl_struct;
pub use shader::{COMMON_WGSL, STATUS_WGSL, Shader};
pub use wgpu::Buffer;

/// Opens a device for a test; on a machine without any adapter returns `None` and prints the reason.
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
