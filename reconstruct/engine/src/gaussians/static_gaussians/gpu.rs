//! The static parameterization on a GPU.

use std::sync::Arc;

use crate::gaussians::static_gaussians::{
    LEAST_QUATERNION_LENGTH, LOG_SCALE_RANGE, LOG_SCALES, OPACITY_LOGITS, POSITIONS, QUATERNIONS,
    SH_CONSTANT, SH_REST, StaticGaussians,
};
use crate::{
    device::{Buffer, Gpu, GpuError, Program, Rows, Shader, Uniform, kernels, wgsl_struct},
    gaussians::{
        device_twin::{
            CompiledKernels, DeviceEntries, DeviceParameterization, DeviceTwin, NewDevicePart,
            PartBuffers,
        },
        sh_rest_count,
    },
    parameters::device_table::TableBuffers,
};

wgsl_struct! {
    pub(crate) struct StaticArrays {
        len: u32,
        first: u32,
        rest: u32,
        stored_rest: u32,
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
            include_str!("arrays.wgsl"),
            include_str!("static_gaussians.wgsl"),
        ],
    }
}

kernels! {
    /// Kernels of the activation and its VJP.
    struct StaticKernels() = shader() => [activate, activate_vjp];
}

/// Gaussians of a table on a device, in their current number, and the offsets of the arrays of static Gaussians.
#[derive(Debug)]
pub struct DeviceRows {
    /// Their number, for running a kernel with a thread for each.
    pub rows: Rows,
    uniform: Uniform<StaticArrays>,
    arrays: StaticArrays,
}

impl DeviceRows {
    /// Uploads the offsets of a table whose Gaussians are these entries of all activated ones. Harmonics are
    /// activated up to the first degree, and the table stores those up to the second, which is the same or 0.
    pub(crate) fn new(
        gpu: &Gpu,
        table: &TableBuffers,
        entries: DeviceEntries,
        [sh_degree, stored]: [usize; 2],
    ) -> Result<Self, GpuError> {
        let arrays = StaticArrays {
            len: entries.len as u32,
            first: entries.first as u32,
            rest: sh_rest_count(sh_degree) as u32,
            stored_rest: sh_rest_count(stored) as u32,
            positions: table.begin(POSITIONS),
            log_scales: table.begin(LOG_SCALES),
            quaternions: table.begin(QUATERNIONS),
            opacity_logits: table.begin(OPACITY_LOGITS),
            sh_constant: table.begin(SH_CONSTANT),
            // The end of the static arrays if it stores none.
            sh_rest: table.begin(SH_REST),
        };
        Ok(Self {
            rows: Rows::new(entries.len),
            uniform: Uniform::of(gpu, "static arrays", &arrays)?,
            arrays,
        })
    }

    /// Returns the uniform with the offsets of the arrays.
    pub(crate) fn arrays(&self) -> &Buffer {
        &self.uniform.raw
    }

    /// Changes the entries, for everything that is submitted later.
    pub(crate) fn place(&mut self, gpu: &Gpu, entries: DeviceEntries) {
        self.rows.set(entries.len);
        self.arrays.len = entries.len as u32;
        self.arrays.first = entries.first as u32;
        self.uniform.write(gpu, &self.arrays);
    }
}

impl DeviceTwin for StaticGaussians {
    fn compile(&self, gpu: &Gpu, kernels: &CompiledKernels) -> Result<(), GpuError> {
        kernels.get(gpu, StaticKernels::new).map(drop)
    }

    fn open(&self, part: &NewDevicePart<'_>) -> Result<Box<dyn DeviceParameterization>, GpuError> {
        let kernels = part.kernels.get(part.gpu, StaticKernels::new)?;
        Ok(Box::new(StaticPart(kernels)))
    }
}

/// Static Gaussians of a part, all of whose uniforms are those of its rows.
#[derive(Debug)]
struct StaticPart(Arc<StaticKernels>);

impl DeviceParameterization for StaticPart {
    fn activate(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        part: &PartBuffers<'_>,
    ) -> Result<(), GpuError> {
        program.run(
            gpu,
            &self.0.activate,
            &part.rows.rows,
            &[
                &part.rows.uniform.raw,
                &part.table.values.raw,
                &part.activated.gaussians.raw,
                &part.activated.harmonics.raw,
            ],
        );
        Ok(())
    }

    fn activate_vjp(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        part: &PartBuffers<'_>,
    ) -> Result<(), GpuError> {
        program.run(
            gpu,
            &self.0.activate_vjp,
            &part.rows.rows,
            &[
                &part.rows.uniform.raw,
                &part.table.values.raw,
                &part.activated.gaussians.raw,
                &part.activated.gaussian_gradients.raw,
                &part.activated.harmonic_gradients.raw,
                &part.table.gradients.raw,
            ],
        );
        Ok(())
    }
}
