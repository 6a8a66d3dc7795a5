//! Rasterization on a GPU.

use crate::{
    device::{DeviceBuffer, Gpu, GpuError, Kernel, Program, Shader},
    render::buffers::{RenderBuffers, RenderShape},
};

pub(crate) fn shader(shape: &RenderShape) -> Shader {
    Shader {
        file: "raster.wgsl",
        constants: shape.constants(),
        parts: &[
            include_str!("../../device/common.wgsl"),
            include_str!("../../camera/camera.wgsl"),
            include_str!("../../camera/erp.wgsl"),
            include_str!("../../camera/pinhole.wgsl"),
            include_str!("../../camera/rays.wgsl"),
            include_str!("../project/splat.wgsl"),
            include_str!("raster.wgsl"),
        ],
    }
}

/// From tile lists to an image, and back with gradients.
#[derive(Debug)]
pub(crate) struct Rasterization {
    composite: Kernel,
    composite_vjp: Kernel,
    sum_entries: Kernel,
}

impl Rasterization {
    pub(crate) fn new(gpu: &Gpu, shape: &RenderShape) -> Result<Self, GpuError> {
        let [composite, composite_vjp, sum_entries] = Kernel::compile(
            gpu,
            &shader(shape),
            ["composite", "composite_vjp", "sum_entries"],
        )?;
        Ok(Self {
            composite,
            composite_vjp,
            sum_entries,
        })
    }

    pub(crate) fn forward(&self, gpu: &Gpu, program: &mut Program, buffers: &RenderBuffers) {
        program.run_workgroups(
            gpu,
            &self.composite,
            buffers.shape.tiles(),
            &[
                &buffers.view.raw,
                &buffers.tile_ranges.raw,
                &buffers.items.raw,
                &buffers.rays.raw,
                &buffers.splats.raw,
                &buffers.channels.raw,
                &buffers.image.raw,
            ],
        );
    }

    /// Gradients by the splats from the gradient by the image, which is laid out like the image.
    pub(crate) fn backward(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        buffers: &RenderBuffers,
        upstream: &DeviceBuffer<f32>,
    ) {
        // Tiles do not walk their lists beyond the last pixel that takes splats.
        program.clear(&buffers.entry_sums.raw);
        program.run_workgroups(
            gpu,
            &self.composite_vjp,
            buffers.shape.tiles(),
            &[
                &buffers.view.raw,
                &buffers.tile_ranges.raw,
                &buffers.items.raw,
                &buffers.rays.raw,
                &buffers.splats.raw,
                &buffers.channels.raw,
                &buffers.image.raw,
                &upstream.raw,
                &buffers.entry_sums.raw,
            ],
        );
        let by_rank = buffers.by_rank();
        program.run(
            gpu,
            &self.sum_entries,
            buffers.shape.gaussians,
            &[
                &buffers.view.raw,
                &by_rank.keys.raw,
                &by_rank.items.raw,
                &buffers.entry_starts.raw,
                &buffers.splats.raw,
                &buffers.entry_sums.raw,
                &buffers.splat_gradients.raw,
            ],
        );
    }
}
