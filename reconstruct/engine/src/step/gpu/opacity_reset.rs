//! Opacity reset on a GPU, without reading back.

use crate::{
    density::RESET_OPACITY,
    device::{Gpu, GpuError, Kernel, Program, Shader, Uniform, wgsl_struct},
    gaussians::static_gaussians::{OPACITY_LOGITS, logit},
    step::gpu::device_model::DevicePart,
};

wgsl_struct! {
    /// Range of the logits, and their upper bound.
    pub(crate) struct OpacityReset {
        begin: u32,
        len: u32,
        largest: f32,
    }
}

pub(crate) fn shader() -> Shader {
    Shader {
        file: "opacity_reset.wgsl",
        constants: String::new(),
        parts: &[
            include_str!("../../device/common.wgsl"),
            include_str!("../opacity_reset.wgsl"),
        ],
    }
}

#[derive(Debug)]
pub(super) struct OpacityResets {
    reset_opacities: Kernel,
}

impl OpacityResets {
    pub(super) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [reset_opacities] = Kernel::compile(gpu, &shader(), ["reset_opacities"])?;
        Ok(Self { reset_opacities })
    }

    /// Records the reset of all parts of a model. It also covers the unused capacity, which is harmless.
    pub(super) fn record(&self, gpu: &Gpu, parts: &[DevicePart]) -> Result<Program, GpuError> {
        let mut program = Program::default();
        for DevicePart { table, .. } in parts {
            let reset = OpacityReset {
                begin: table.begin(OPACITY_LOGITS),
                len: table.capacity as u32,
                largest: logit(RESET_OPACITY),
            };
            let reset = Uniform::of(gpu, "opacity reset", &reset)?;
            program.run(
                gpu,
                &self.reset_opacities,
                table.capacity,
                &[
                    &reset.raw,
                    &table.values.raw,
                    &table.first_moments.raw,
                    &table.second_moments.raw,
                ],
            );
        }
        Ok(program)
    }
}
