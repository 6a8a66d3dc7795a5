//! The static parameterization on a GPU.

use crate::gaussians::static_gaussians::{
    LEAST_QUATERNION_LENGTH, LOG_SCALE_RANGE, LOG_SCALES, OPACITY_LOGITS, POSITIONS, QUATERNIONS,
    SH_CONSTANT, SH_REST,
};
use crate::{
    device::{Gpu, GpuError, Kernel, Program, Shader, Uniform, wgsl_struct},
    gaussians::{
        activated_buffers::ActivatedBuffers,
        parameterization::{DeviceEntries, DeviceParameterization},
    },
    parameters::device_table::TableBuffers,
};

wgsl_struct! {
    /// Where the arrays are.
    pub(crate) struct StaticArrays {
        len: u32,
        first: u32,
        rest: u32,
        positions: u32,
        log_scales: u32,
        quaternions: u32,
        opacity_logits: u32,
        sh_constant: u32,
        sh_rest: u32,
    }
}

pub(crate) fn shader() -> Shader {
    let (low, high) = LOG_SCALE_RANGE;
    Shader {
        file: "static_gaussians.wgsl",
        constants: format!(
            "const LOG_SCALE_MIN: f32 = {low:e};\n\
             const LOG_SCALE_MAX: f32 = {high:e};\n\
             const LEAST_QUATERNION_LENGTH: f32 = {LEAST_QUATERNION_LENGTH:e};\n"
        ),
        parts: &[
            include_str!("../../device/common.wgsl"),
            include_str!("../gaussians.wgsl"),
            include_str!("static_gaussians.wgsl"),
        ],
    }
}

/// Activation and its VJP.
#[derive(Debug)]
pub(crate) struct StaticGaussians {
    activate: Kernel,
    activate_vjp: Kernel,
}

impl StaticGaussians {
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [activate, activate_vjp] =
            Kernel::compile(gpu, &shader(), ["activate", "activate_vjp"])?;
        Ok(Self {
            activate,
            activate_vjp,
        })
    }

    fn arrays(
        gpu: &Gpu,
        table: &TableBuffers,
        entries: DeviceEntries,
        buffers: &ActivatedBuffers,
    ) -> Result<Uniform<StaticArrays>, GpuError> {
        let arrays = StaticArrays {
            len: entries.len as u32,
            first: entries.first as u32,
            rest: buffers.harmonics_per_gaussian() as u32 - 1,
            positions: table.begin(POSITIONS),
            log_scales: table.begin(LOG_SCALES),
            quaternions: table.begin(QUATERNIONS),
            opacity_logits: table.begin(OPACITY_LOGITS),
            sh_constant: table.begin(SH_CONSTANT),
            // At the end of the table where there are none.
            sh_rest: table.begin(SH_REST),
        };
        Uniform::of(gpu, "static arrays", &arrays)
    }
}

impl DeviceParameterization for StaticGaussians {
    fn activate(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        table: &TableBuffers,
        entries: DeviceEntries,
        buffers: &ActivatedBuffers,
    ) -> Result<(), GpuError> {
        let arrays = Self::arrays(gpu, table, entries, buffers)?;
        program.run(
            gpu,
            &self.activate,
            entries.len,
            &[
                &arrays.raw,
                &table.values.raw,
                &buffers.gaussians.raw,
                &buffers.harmonics.raw,
            ],
        );
        Ok(())
    }

    fn activate_vjp(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        table: &TableBuffers,
        entries: DeviceEntries,
        buffers: &ActivatedBuffers,
    ) -> Result<(), GpuError> {
        let arrays = Self::arrays(gpu, table, entries, buffers)?;
        program.run(
            gpu,
            &self.activate_vjp,
            entries.len,
            &[
                &arrays.raw,
                &table.values.raw,
                &buffers.gaussians.raw,
                &buffers.gaussian_gradients.raw,
                &buffers.harmonic_gradients.raw,
                &table.gradients.raw,
            ],
        );
        Ok(())
    }
}
