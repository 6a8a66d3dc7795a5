//! Motion regularization on a GPU.

use crate::{
    device::{
        DeviceBuffer, Gpu, GpuError, Kernel, Program, Shader, Uniform, WORKGROUP, wgsl_struct,
    },
    gaussians::temporal::gpu::{DeviceTime, table_constants},
    parameters::device_table::TableBuffers,
};

wgsl_struct! {
    pub(crate) struct MotionWeight {
        weight: f32,
        seen_alone: u32,
    }
}

pub(crate) fn shader() -> Shader {
    Shader {
        file: "motion.wgsl",
        constants: table_constants(),
        parts: &[
            include_str!("../../device/common.wgsl"),
            include_str!("../../device/workgroup_sum.wgsl"),
            include_str!("../../device/sin_cos.wgsl"),
            include_str!("../../gaussians/temporal/temporal_table.wgsl"),
            include_str!("motion.wgsl"),
        ],
    }
}

/// Kernels that add the gradients of `L_m` to those of a table.
#[derive(Debug)]
pub(crate) struct Motion {
    count_static: Kernel,
    regularize_motion: Kernel,
    settings: Uniform<MotionWeight>,
}

impl Motion {
    /// Compiles the kernels. `weight` is that of one Gaussian if only seen ones count, else that of all of them, whose
    /// number the device counts.
    pub(crate) fn new(gpu: &Gpu, weight: f32, seen_alone: bool) -> Result<Self, GpuError> {
        let settings = MotionWeight {
            weight,
            seen_alone: u32::from(seen_alone),
        };
        let [count_static, regularize_motion] =
            Kernel::compile(gpu, &shader(), ["count_static", "regularize_motion"])?;
        Ok(Self {
            count_static,
            regularize_motion,
            settings: Uniform::of(gpu, "motion loss", &settings)?,
        })
    }

    /// Records gradients by raw parameters and centres; returns the buffer of the weighted value's partial
    /// sums.
    pub(crate) fn record(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        view: &DeviceTime,
        table: &TableBuffers,
    ) -> Result<DeviceBuffer<f32>, GpuError> {
        let count = DeviceBuffer::<u32>::zeros(gpu, "count of static Gaussians", 1)?;
        let groups = table.capacity.div_ceil(WORKGROUP as usize);
        let partials = DeviceBuffer::zeros(gpu, "sums of the motion loss", groups)?;
        program.clear(&count.raw);
        let table_and_view = [&view.uniform.raw, &table.values.raw];
        let [uniform, values] = table_and_view;
        program.run(
            gpu,
            &self.count_static,
            &view.rows,
            &[uniform, values, &count.raw],
        );
        program.run(
            gpu,
            &self.regularize_motion,
            // All partial sums must be written.
            table.capacity,
            &[
                uniform,
                values,
                &count.raw,
                &table.gradients.raw,
                &partials.raw,
                &self.settings.raw,
            ],
        );
        Ok(partials)
    }
}
