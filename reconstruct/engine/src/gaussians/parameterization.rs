//! What a parameterization does on a GPU.

use crate::{
    device::{Gpu, GpuError, Program},
    parameters::device_table::TableBuffers,
    render::buffers::RenderBuffers,
};

/// From the arrays of a table to Gaussians at one instant and back with gradients, on the device.
/// One implementation per parameterization, in its folder beside the WGSL.
pub(crate) trait Parameterization: std::fmt::Debug {
    /// Fills `buffers.gaussians` and `buffers.harmonics`.
    fn instantiate(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        table: &TableBuffers,
        buffers: &RenderBuffers,
    ) -> Result<(), GpuError>;

    /// Fills `table.gradients`.
    fn instantiate_vjp(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        table: &TableBuffers,
        buffers: &RenderBuffers,
    ) -> Result<(), GpuError>;
}
