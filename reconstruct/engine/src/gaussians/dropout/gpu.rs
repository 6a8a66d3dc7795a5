//! Dropout of Gaussians on a GPU.

use super::Dropout;
use crate::{
    device::{Gpu, GpuError, Program, Rows, Shader, Uniform, kernels, wgsl_struct},
    gaussians::activated_buffers::ActivatedBuffers,
};

wgsl_struct! {
    /// Dropout of a step; `StepDropout` in WGSL.
    pub(crate) struct DeviceDropout {
        len: u32,
        step: u32,
        share: f32,
    }
}

pub(crate) fn shader() -> Shader {
    Shader {
        file: "dropout.wgsl",
        constants: String::new(),
        parts: &[
            include_str!("../../device/common.wgsl"),
            include_str!("../gaussians.wgsl"),
            include_str!("dropout.wgsl"),
        ],
    }
}

kernels! {
    /// Kernels of dropout and its VJP.
    pub(crate) struct DropoutKernels() = shader() => [drop_out, drop_out_vjp];
}

/// Programs for a set of Gaussians.
#[derive(Debug)]
pub(crate) struct DropoutPrograms {
    pub(crate) forward: Program,
    pub(crate) backward: Program,
    dropout: Dropout,
    step: Uniform<DeviceDropout>,
    rows: Rows,
}

impl DropoutKernels {
    pub(crate) fn record(
        &self,
        gpu: &Gpu,
        dropout: Dropout,
        (activated, rows): (&ActivatedBuffers, &Rows),
    ) -> Result<DropoutPrograms, GpuError> {
        let step = Uniform::of(gpu, "dropout", &DeviceDropout::default())?;
        let mut forward = Program::default();
        forward.begin_stage("dropout");
        let gaussians = &activated.gaussians.raw;
        let buffers = [&step.raw, gaussians];
        forward.run(gpu, &self.drop_out, rows, &buffers);
        let mut backward = Program::default();
        backward.begin_stage("dropout backward");
        let buffers = [&step.raw, gaussians, &activated.gaussian_gradients.raw];
        backward.run(gpu, &self.drop_out_vjp, rows, &buffers);
        Ok(DropoutPrograms {
            forward,
            backward,
            dropout,
            step,
            rows: rows.clone(),
        })
    }
}

impl DropoutPrograms {
    /// Sets the step whose dropout applies to everything that is submitted later.
    pub(crate) fn set(&self, gpu: &Gpu, iteration: u64, scheduled: u64) {
        let step = self.dropout.of_step(iteration, scheduled);
        let step = DeviceDropout {
            len: self.rows.get() as u32,
            step: step.step,
            share: step.share,
        };
        self.step.write(gpu, &step);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{device::test_device, gaussians::ActivatedGaussians};

    #[test]
    fn the_gpu_leaves_out_what_the_cpu_does() -> Result<(), GpuError> {
        let Some(gpu) = test_device() else {
            return Ok(());
        };
        let dropout = Dropout {
            last_share: 0.3,
            iterations: 10,
            seed: 11,
        };
        let len = 700;
        let (mut gaussians, mut gradient) =
            (ActivatedGaussians::default(), ActivatedGaussians::default());
        for (table, first) in [(&mut gaussians, 0.1), (&mut gradient, -2.0)] {
            table.reshape(len, 0, 0);
            let opacities = table.opacities.iter_mut().enumerate();
            opacities.for_each(|(entry, opacity)| *opacity = first + 0.001 * entry as f32);
        }
        let buffers = ActivatedBuffers::new(&gpu, len, 0, 0)?;
        let programs =
            DropoutKernels::new(&gpu)?.record(&gpu, dropout, (&buffers, &Rows::new(len)))?;
        for iteration in [1, 2, (1 << 33) + 5] {
            let step = dropout.of_step(iteration, 10);
            let (mut expected, mut by) = (gaussians.clone(), gradient.clone());
            buffers.write(&gpu, &gaussians);
            buffers.write_gradient(&gpu, &gradient);
            programs.set(&gpu, iteration, 10);
            programs.forward.submit(&gpu);
            let mut found = ActivatedGaussians::default();
            buffers.read(&gpu, &mut found)?;
            step.drop_out(&mut expected);
            assert_close(&found.opacities, &expected.opacities);
            programs.backward.submit(&gpu);
            buffers.read(&gpu, &mut found)?;
            step.drop_out_vjp(&mut expected, &mut by);
            assert_close(&found.opacities, &expected.opacities);
            buffers.read_gradient(&gpu, &mut found)?;
            assert_close(&found.opacities, &by.opacities);
        }
        Ok(())
    }

    fn assert_close(found: &[f32], expected: &[f32]) {
        for (entry, (found, expected)) in found.iter().zip(expected).enumerate() {
            // A device may divide with an error of 2.5 units in the last place.
            let close = (found - expected).abs() <= 4.0 * f32::EPSILON * expected.abs();
            assert!(close, "{entry}: {found} {expected}");
        }
    }
}
