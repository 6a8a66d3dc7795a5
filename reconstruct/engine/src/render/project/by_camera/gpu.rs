//! Gradient by a camera's pose on a GPU.

use glam::DVec3;

use super::PoseGradient;
use crate::{
    device::{DeviceBuffer, Gpu, GpuError, Kernel, Program, Shader, WORKGROUP, wgsl_struct},
    render::buffers::{RenderBuffers, RenderShape},
};

wgsl_struct! {
    /// Partial sum of the gradient by a pose; `PoseGradient` in WGSL.
    pub(crate) struct DevicePoseGradient {
        rotation: [f32; 3],
        pad: f32,
        centre: [f32; 3],
        pad_end: f32,
    }
}

pub(crate) fn shader(shape: &RenderShape) -> Shader {
    Shader {
        file: "by_camera.wgsl",
        constants: shape.constants(),
        parts: &[
            include_str!("../../../device/common.wgsl"),
            include_str!("../../../device/arc_tangent.wgsl"),
            include_str!("../../../camera/camera.wgsl"),
            include_str!("../../../camera/erp.wgsl"),
            include_str!("../../../camera/pinhole.wgsl"),
            include_str!("../../../gaussians/gaussians.wgsl"),
            include_str!("../sh.wgsl"),
            include_str!("by_camera.wgsl"),
        ],
    }
}

/// Kernel that sums the gradient by the pose of the drawn view.
#[derive(Debug)]
pub(crate) struct PoseGradients {
    pose_gradient: Kernel,
}

impl PoseGradients {
    pub(crate) fn new(gpu: &Gpu, shape: &RenderShape) -> Result<Self, GpuError> {
        let [pose_gradient] = Kernel::compile(gpu, &shader(shape), ["pose_gradient"])?;
        Ok(Self { pose_gradient })
    }

    /// Records the sums; returns the buffer of the partial sums (see [`sum`]).
    pub(crate) fn record(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        buffers: &RenderBuffers,
    ) -> Result<DeviceBuffer<DevicePoseGradient>, GpuError> {
        let groups = part_count(buffers.shape.gaussians);
        let partials = DeviceBuffer::zeros(gpu, "gradient by the pose", groups)?;
        program.run(
            gpu,
            &self.pose_gradient,
            &buffers.rows,
            &[
                &buffers.view.raw,
                &buffers.activated.gaussians.raw,
                &buffers.activated.harmonics.raw,
                &buffers.activated.gaussian_gradients.raw,
                &buffers.activated.harmonic_gradients.raw,
                &partials.raw,
            ],
        );
        Ok(partials)
    }
}

/// Returns the number of partial sums for `gaussians` Gaussians.
pub(crate) fn part_count(gaussians: usize) -> usize {
    gaussians.div_ceil(WORKGROUP as usize)
}

/// Adds up the partial sums.
pub(crate) fn sum(parts: &[DevicePoseGradient]) -> PoseGradient {
    let wide = |vector: [f32; 3]| DVec3::from_array(vector.map(f64::from));
    let mut sum = PoseGradient::default();
    for part in parts {
        sum.rotation += wide(part.rotation);
        sum.centre += wide(part.centre);
    }
    sum
}
