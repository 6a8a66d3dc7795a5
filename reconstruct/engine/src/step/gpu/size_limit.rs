//! Limit of sizes in training on a GPU.

use crate::{
    device::{Gpu, GpuError, Kernel, Program, Shader},
    render::buffers::{RenderBuffers, RenderShape},
    step::{gpu::device_model::DevicePart, size_limit::CUT_SHARE},
};

pub(crate) fn shader(shape: &RenderShape) -> Shader {
    Shader {
        file: "size_limit.wgsl",
        constants: shape.constants() + &format!("const CUT_SHARE: f32 = {CUT_SHARE:e};\n"),
        parts: &[
            include_str!("../../device/common.wgsl"),
            include_str!("../../device/status.wgsl"),
            include_str!("../../device/arc_tangent.wgsl"),
            include_str!("../../camera/camera.wgsl"),
            include_str!("../../camera/erp.wgsl"),
            include_str!("../../camera/pinhole.wgsl"),
            include_str!("../../gaussians/gaussians.wgsl"),
            include_str!("../../gaussians/static_gaussians/arrays.wgsl"),
            include_str!("../size_limit.wgsl"),
        ],
    }
}

/// Kernel of the limit.
#[derive(Debug)]
pub(super) struct SizeLimits {
    cut_sizes: Kernel,
}

impl SizeLimits {
    pub(super) fn new(gpu: &Gpu, shape: &RenderShape) -> Result<Self, GpuError> {
        let [cut_sizes] = Kernel::compile(gpu, &shader(shape), ["cut_sizes"])?;
        Ok(Self { cut_sizes })
    }

    /// Records the limit of all parts, after their activation for the view of `buffers`.
    pub(super) fn record(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        parts: &[DevicePart],
        buffers: &RenderBuffers,
    ) {
        program.begin_stage("limit sizes");
        for part in parts {
            program.run(
                gpu,
                &self.cut_sizes,
                &part.rows.rows,
                &[
                    &buffers.view.raw,
                    &buffers.activated.gaussians.raw,
                    &part.table.values.raw,
                    &part.table.first_moments.raw,
                    &buffers.status.raw,
                    part.rows.arrays(),
                ],
            );
        }
    }
}
