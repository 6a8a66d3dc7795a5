//! The static parameterization on a GPU.

use crate::gaussians::static_gaussians::{
    LEAST_QUATERNION_LENGTH, LOG_SCALE_RANGE, LOG_SCALES, OPACITY_LOGITS, POSITIONS, QUATERNIONS,
    SH_CONSTANT, SH_REST,
};
use crate::{
    device::{Gpu, GpuError, Kernel, Program, Rows, Shader, Uniform, wgsl_struct},
    gaussians::{
        activated_buffers::ActivatedBuffers,
        parameterization::{DeviceEntries, DeviceParameterization},
    },
    parameters::device_table::TableBuffers,
};

wgsl_struct! {
    /// Offsets of the arrays.
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

/// Kernels of the activation and its VJP.
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
}

/// Gaussians of a table on a device, in their current number.
#[derive(Debug)]
pub(crate) struct DeviceRows {
    pub(crate) rows: Rows,
    uniform: Uniform<StaticArrays>,
    arrays: StaticArrays,
}

impl DeviceRows {
    /// Uploads the offsets of a table whose Gaussians are these entries of all activated ones, with harmonics
    /// of this degree.
    pub(crate) fn new(
        gpu: &Gpu,
        table: &TableBuffers,
        entries: DeviceEntries,
        sh_degree: usize,
    ) -> Result<Self, GpuError> {
        let arrays = StaticArrays {
            len: entries.len as u32,
            first: entries.first as u32,
            rest: ((sh_degree + 1) * (sh_degree + 1) - 1) as u32,
            positions: table.begin(POSITIONS),
            log_scales: table.begin(LOG_SCALES),
            quaternions: table.begin(QUATERNIONS),
            opacity_logits: table.begin(OPACITY_LOGITS),
            sh_constant: table.begin(SH_CONSTANT),
            // At the end of the table if it stores none.
            sh_rest: table.begin(SH_REST),
        };
        Ok(Self {
            rows: Rows::new(entries.len),
            uniform: Uniform::of(gpu, "static arrays", &arrays)?,
            arrays,
        })
    }

    /// Changes the entries, for everything that is submitted later.
    pub(crate) fn place(&mut self, gpu: &Gpu, entries: DeviceEntries) {
        self.rows.set(entries.len);
        self.arrays.len = entries.len as u32;
        self.arrays.first = entries.first as u32;
        self.uniform.write(gpu, &self.arrays);
    }
}

impl DeviceParameterization for StaticGaussians {
    fn activate(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        (table, rows): (&TableBuffers, &DeviceRows),
        buffers: &ActivatedBuffers,
    ) -> Result<(), GpuError> {
        program.run(
            gpu,
            &self.activate,
            &rows.rows,
            &[
                &rows.uniform.raw,
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
        (table, rows): (&TableBuffers, &DeviceRows),
        buffers: &ActivatedBuffers,
    ) -> Result<(), GpuError> {
        program.run(
            gpu,
            &self.activate_vjp,
            &rows.rows,
            &[
                &rows.uniform.raw,
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
