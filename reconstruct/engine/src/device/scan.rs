//! Prefix sums on the device, for stages with outputs of variable length.

use crate::device::{
    buffer::{DeviceBuffer, Uniform},
    device::Gpu,
    error::GpuError,
    program::{Program, kernels},
    shader::{Shader, wgsl_struct},
};

/// Values that one workgroup scans.
const BLOCK: usize = 1024;

wgsl_struct! {
    pub(crate) struct ScanLevel {
        /// Number of values.
        len: u32,
    }
}

pub(crate) fn shader() -> Shader {
    Shader {
        file: "scan.wgsl",
        constants: String::new(),
        parts: &[include_str!("common.wgsl"), include_str!("scan.wgsl")],
    }
}

kernels! {
    /// Exclusive prefix sums that saturate at `u32::MAX`.
    pub(crate) struct Scan() = shader() => [scan_blocks, add_totals];
}

impl Scan {
    /// Replaces every value by the sum of those before it. Append one value to find the total in it.
    pub(crate) fn record(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        values: &DeviceBuffer<u32>,
    ) -> Result<(), GpuError> {
        let len = u32::try_from(values.len()).map_err(|_| gpu.failed("too many values to sum"))?;
        let level = Uniform::of(gpu, "scan level", &ScanLevel { len })?;
        let blocks = values.len().div_ceil(BLOCK);
        let totals = DeviceBuffer::zeros(gpu, "scan totals", blocks)?;
        let buffers = [&level.raw, &values.raw, &totals.raw];
        program.run_workgroups(gpu, &self.scan_blocks, blocks, &buffers);
        if blocks > 1 {
            self.record(gpu, program, &totals)?;
            program.run(gpu, &self.add_totals, values.len(), &buffers);
        }
        Ok(())
    }
}
