//! One kernel from the gradients by splats to Adam's step, for static Gaussians (Faster-GS). It stands for three,
//! between which the gradients pass through memory. Tables keep no gradients then.

use crate::{
    EngineError,
    device::{Gpu, GpuError, Kernel, Program, Shader},
    gaussians::{
        parameterization::Parameterization,
        static_gaussians::{
            LEAST_QUATERNION_LENGTH, LOG_SCALES, OPACITY_LOGITS, POSITIONS, QUATERNIONS,
            SH_CONSTANT, SH_REST, StaticGaussians,
        },
    },
    model::Model,
    parameters::adam,
    render::buffers::{RenderBuffers, RenderShape},
    step::{gpu::device_model::DevicePart, settings::TrainSettings},
};

pub(crate) fn shader(shape: &RenderShape) -> Shader {
    let of_arrays = format!(
        "const LEAST_QUATERNION_LENGTH: f32 = {LEAST_QUATERNION_LENGTH:e};\n\
         const POSITIONS: u32 = {POSITIONS}u;\n\
         const LOG_SCALES: u32 = {LOG_SCALES}u;\n\
         const QUATERNIONS: u32 = {QUATERNIONS}u;\n\
         const OPACITY_LOGITS: u32 = {OPACITY_LOGITS}u;\n\
         const SH_CONSTANT: u32 = {SH_CONSTANT}u;\n\
         const SH_REST: u32 = {SH_REST}u;\n"
    );
    Shader {
        file: "fused_adam.wgsl",
        constants: shape.constants() + &adam::gpu::constants() + &of_arrays,
        parts: &[
            include_str!("../../device/common.wgsl"),
            include_str!("../../device/status.wgsl"),
            include_str!("../../device/arc_tangent.wgsl"),
            include_str!("../../camera/camera.wgsl"),
            include_str!("../../camera/erp.wgsl"),
            include_str!("../../camera/pinhole.wgsl"),
            include_str!("../../gaussians/gaussians.wgsl"),
            include_str!("../../render/project/sh.wgsl"),
            include_str!("../../render/project/splat.wgsl"),
            include_str!("../../render/project/ellipse.wgsl"),
            include_str!("../../render/project/cone.wgsl"),
            include_str!("../../render/project/project.wgsl"),
            include_str!("../../gaussians/static_gaussians/arrays.wgsl"),
            include_str!("../../parameters/adam/value.wgsl"),
            include_str!("../fused_adam.wgsl"),
        ],
    }
}

/// Refuses models and settings for which other kernels come between the gradients by splats and Adam.
///
/// # Errors
/// If the model has more than one part of static Gaussians, or the settings add dropout, refined poses or the
/// losses of dynamic methods.
pub(super) fn check(model: &Model, settings: &TrainSettings) -> Result<(), EngineError> {
    let is_static =
        |number: usize| model.parts[number].parameterization.id() == StaticGaussians.id();
    let what = match model.parts.len() {
        1 if !is_static(0) => model.parts[0].parameterization.id(),
        1 if settings.dropout.is_some() => "dropout",
        1 if settings.pose_refinement.is_some() => "refined poses",
        1 if settings.dynamics.is_some() => "losses of dynamic methods",
        1 => return Ok(()),
        _ => "several parts",
    };
    Err(EngineError::Backend {
        reason: format!(
            "the fused kernel of Adam must have one part of static Gaussians, without dropout, refined poses and \
             dynamic losses; this model has {what}: set OMNILIFE_GPU_ADAM to separate"
        ),
    })
}

#[derive(Debug)]
pub(super) struct FusedAdam {
    update_gaussians: Kernel,
}

impl FusedAdam {
    /// Compiles the kernel for renders with as many channels as a shape has.
    pub(super) fn new(gpu: &Gpu, shape: &RenderShape) -> Result<Self, GpuError> {
        let [update_gaussians] = Kernel::compile(gpu, &shader(shape), ["update_gaussians"])?;
        Ok(Self { update_gaussians })
    }

    /// Records the step of a part that is the whole model, after the gradients by its splats and the judgement of
    /// the loss. It writes the gradients by the images of the centres too.
    pub(super) fn record(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        part: &DevicePart,
        buffers: &RenderBuffers,
    ) {
        program.run(
            gpu,
            &self.update_gaussians,
            &buffers.rows,
            &[
                &buffers.view.raw,
                &buffers.activated.gaussians.raw,
                &buffers.activated.harmonics.raw,
                &buffers.channels.raw,
                &buffers.splat_gradients.raw,
                &part.table.values.raw,
                &part.table.first_moments.raw,
                &part.table.second_moments.raw,
                &buffers.status.raw,
                part.rows.arrays(),
                part.next_step.settings(),
            ],
        );
    }
}
