//! The projection on a GPU.

use crate::{
    device::{Gpu, Program, Shader, kernels},
    render::buffers::{RenderBuffers, RenderShape},
};

pub(crate) fn shader(shape: &RenderShape) -> Shader {
    Shader {
        file: "project.wgsl",
        constants: shape.constants(),
        parts: &[
            include_str!("../../device/common.wgsl"),
            include_str!("../../device/arc_tangent.wgsl"),
            include_str!("../../camera/camera.wgsl"),
            include_str!("../../camera/erp.wgsl"),
            include_str!("../../camera/pinhole.wgsl"),
            include_str!("../../gaussians/gaussians.wgsl"),
            include_str!("sh.wgsl"),
            include_str!("splat.wgsl"),
            include_str!("ellipse.wgsl"),
            include_str!("cone.wgsl"),
            include_str!("project.wgsl"),
        ],
    }
}

kernels! {
    /// Kernels from Gaussians to splats, and their VJP.
    pub(crate) struct Projection(shape: &RenderShape) = shader(shape) => [
        project_gaussians,
        project_gaussians_vjp,
    ];
}

impl Projection {
    pub(crate) fn forward(&self, gpu: &Gpu, program: &mut Program, buffers: &RenderBuffers) {
        program.run(
            gpu,
            &self.project_gaussians,
            &buffers.rows,
            &[
                &buffers.view.raw,
                &buffers.activated.gaussians.raw,
                &buffers.activated.harmonics.raw,
                &buffers.activated.features.raw,
                &buffers.splats.raw,
                &buffers.channels.raw,
                &buffers.by_distance.keys.raw,
                &buffers.by_distance.items.raw,
            ],
        );
    }

    pub(crate) fn backward(&self, gpu: &Gpu, program: &mut Program, buffers: &RenderBuffers) {
        program.run(
            gpu,
            &self.project_gaussians_vjp,
            &buffers.rows,
            &[
                &buffers.view.raw,
                &buffers.activated.gaussians.raw,
                &buffers.activated.harmonics.raw,
                &buffers.channels.raw,
                &buffers.splat_gradients.raw,
                &buffers.activated.gaussian_gradients.raw,
                &buffers.activated.harmonic_gradients.raw,
                &buffers.activated.feature_gradients.raw,
            ],
        );
    }
}
