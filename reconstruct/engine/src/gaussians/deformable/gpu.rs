//! Canonical Gaussians and their network on a GPU.

use crate::gaussians::deformable::{
    DeformationModel, LEAST_QUATERNION_LENGTH, LEAST_SCALE, OUTPUTS, POSITIONS,
};
use crate::{
    device::{Gpu, GpuError, Kernel, Program, Shader, Threads, Uniform, wgsl_struct},
    fields::mlp::{
        blocks_gpu::{Block, BlockPass},
        gpu::{NetworkBuffers, Passes, Recording},
    },
    gaussians::{
        activated_buffers::ActivatedBuffers,
        parameterization::DeviceParameterization,
        static_gaussians::gpu::{DeviceRows, StaticGaussians},
    },
    parameters::device_table::TableBuffers,
};

wgsl_struct! {
    /// Offset of the canonical positions, and the network's unit of length.
    pub(crate) struct Canonical {
        len: u32,
        positions: u32,
        octaves: u32,
        length_unit: f32,
    }
}

pub(crate) fn shader() -> Shader {
    Shader {
        file: "deformable.wgsl",
        constants: format!(
            "const OUTPUTS: u32 = {OUTPUTS}u;\n\
             const LEAST_SCALE: f32 = {LEAST_SCALE:e};\n\
             const LEAST_QUATERNION_LENGTH: f32 = {LEAST_QUATERNION_LENGTH:e};\n"
        ),
        parts: &[
            include_str!("../../device/common.wgsl"),
            include_str!("../gaussians.wgsl"),
            include_str!("../../device/sin_cos.wgsl"),
            include_str!("../../fields/mlp/block.wgsl"),
            include_str!("deformable.wgsl"),
        ],
    }
}

/// Kernels of the deformation, which do not depend on the number of Gaussians.
#[derive(Debug)]
pub(crate) struct DeformationKernels {
    passes: Passes,
    encode_positions: Kernel,
    deform: Kernel,
    deform_vjp: Kernel,
}

impl DeformationKernels {
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [encode_positions, deform, deform_vjp] =
            Kernel::compile(gpu, &shader(), ["encode_positions", "deform", "deform_vjp"])?;
        Ok(Self {
            passes: Passes::new(gpu)?,
            encode_positions,
            deform,
            deform_vjp,
        })
    }
}

/// The network's weights on the device, and the buffers of its passes.
#[derive(Debug)]
pub(crate) struct DeformationBuffers {
    model: DeformationModel,
    /// The weights as a table of one array.
    pub(crate) weights: TableBuffers,
    network: NetworkBuffers,
    uniform: Uniform<Canonical>,
    canonical: Canonical,
}

impl DeformationBuffers {
    /// Allocates buffers for the capacity of a table and sets the number of its Gaussians.
    pub(crate) fn new(
        gpu: &Gpu,
        model: DeformationModel,
        weights: TableBuffers,
        (table, gaussians): (&TableBuffers, usize),
    ) -> Result<Self, GpuError> {
        let canonical = Canonical {
            positions: table.begin(POSITIONS),
            octaves: model.position_octaves as u32,
            length_unit: model.length_unit,
            ..Canonical::default()
        };
        let mut buffers = Self {
            network: NetworkBuffers::new(gpu, model.network(), table.capacity)?,
            uniform: Uniform::of(gpu, "canonical Gaussians", &canonical)?,
            canonical,
            model,
            weights,
        };
        buffers.place(gpu, gaussians);
        Ok(buffers)
    }

    /// Sets the number of Gaussians for everything that is submitted later.
    pub(crate) fn place(&mut self, gpu: &Gpu, gaussians: usize) {
        self.canonical.len = gaussians as u32;
        self.uniform.write(gpu, &self.canonical);
        self.network.place(gpu, gaussians);
    }

    /// Sets the time in [0, 1] for everything that is submitted later.
    pub(crate) fn set_time(&self, gpu: &Gpu, time: f32) {
        let encoded = self.model.encoded_time(time);
        self.network.shared.write(gpu, 0, &encoded);
    }
}

/// Canonical Gaussians with the network that deforms them.
#[derive(Debug)]
pub(crate) struct DeformableGaussians<'a> {
    pub(crate) canonical: &'a StaticGaussians,
    pub(crate) kernels: &'a DeformationKernels,
    pub(crate) buffers: &'a DeformationBuffers,
}

impl DeformableGaussians<'_> {
    /// Records a pass of the network over all Gaussians.
    fn pass(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        table: &TableBuffers,
        record: impl FnOnce(&mut Recording<'_>) -> Result<(), GpuError>,
    ) -> Result<(), GpuError> {
        let octaves = self.buffers.model.position_octaves;
        let canonical = &self.buffers.uniform.raw;
        let encode =
            |program: &mut Program, (block, pass): (&Block, &BlockPass), inputs: &wgpu::Buffer| {
                program.run(
                    gpu,
                    &self.kernels.encode_positions,
                    Threads::ForRows(&pass.rows, octaves + 1),
                    &[canonical, &table.values.raw, inputs, &block.uniform.raw],
                );
                Ok(())
            };
        record(&mut Recording {
            gpu,
            program,
            weights: &self.buffers.weights.values.raw,
            encode: &encode,
        })
    }
}

impl DeviceParameterization for DeformableGaussians<'_> {
    fn activate(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        (table, rows): (&TableBuffers, &DeviceRows),
        buffers: &ActivatedBuffers,
    ) -> Result<(), GpuError> {
        self.canonical
            .activate(gpu, program, (table, rows), buffers)?;
        let network = &self.buffers.network;
        self.pass(gpu, program, table, |recording| {
            self.kernels.passes.forward(recording, network)
        })?;
        program.run(
            gpu,
            &self.kernels.deform,
            &rows.rows,
            &[
                &self.buffers.uniform.raw,
                &network.outputs.raw,
                &buffers.gaussians.raw,
            ],
        );
        Ok(())
    }

    /// Computes the VJP and, in addition, the gradients by the weights.
    fn activate_vjp(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        (table, rows): (&TableBuffers, &DeviceRows),
        buffers: &ActivatedBuffers,
    ) -> Result<(), GpuError> {
        // Activate again: `deform` has overwritten the canonical ones.
        self.canonical
            .activate(gpu, program, (table, rows), buffers)?;
        let network = &self.buffers.network;
        program.run(
            gpu,
            &self.kernels.deform_vjp,
            &rows.rows,
            &[
                &self.buffers.uniform.raw,
                &network.outputs.raw,
                &buffers.gaussians.raw,
                &buffers.gaussian_gradients.raw,
                &network.upstream.raw,
            ],
        );
        let gradients = &self.buffers.weights.gradients.raw;
        self.pass(gpu, program, table, |recording| {
            self.kernels.passes.backward(recording, network, gradients)
        })?;
        self.canonical
            .activate_vjp(gpu, program, (table, rows), buffers)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        device::{DeviceBuffer, test_device},
        gaussians::static_gaussians::{self, InitialGaussians},
        parameters::SharedParameters,
    };

    /// Built-in sines would miss by a multiple of this tolerance.
    #[test]
    fn encodings_are_right_far_away_and_in_the_highest_octaves() {
        let Some(gpu) = test_device() else { return };
        let model = DeformationModel::published(0.5);
        let initial = InitialGaussians {
            positions: (0..400)
                .map(|index| {
                    let index = index as f32;
                    [0.1 * index, -0.037 * index, 1e-4 * (index - 200.0)]
                })
                .collect(),
            scales: vec![[1.0; 3]; 400],
            rotations: vec![static_gaussians::NO_ROTATION; 400],
            colours: vec![[0.5; 3]; 400],
            opacities: vec![0.5; 400],
        };
        let table = static_gaussians::table(&initial, 0);
        let on_device = TableBuffers::new(&gpu, &table.arrays, [400; 2]).expect("fits");
        let weights = SharedParameters::new(
            crate::gaussians::deformable::DEFORMATION_WEIGHTS,
            vec![0.0; model.network().weight_count()],
        );
        let array = std::slice::from_ref(&weights.array);
        let weights = TableBuffers::new(&gpu, array, [1; 2]).expect("fits");
        let buffers =
            DeformationBuffers::new(&gpu, model, weights, (&on_device, 400)).expect("fits");
        let gaussians = DeformableGaussians {
            canonical: &StaticGaussians::new(&gpu).expect("compiles"),
            kernels: &DeformationKernels::new(&gpu).expect("compiles"),
            buffers: &buffers,
        };
        let (first, rows) = (37, 300);
        let width = model.network().row_inputs;
        let inputs: DeviceBuffer<f32> =
            DeviceBuffer::zeros(&gpu, "inputs", rows * width).expect("fits");
        let block = Block::new(&gpu, first, rows).expect("fits");
        block.set_parts(&gpu, rows, 1);
        let mut program = Program::default();
        gaussians
            .pass(&gpu, &mut program, &on_device, |recording| {
                (recording.encode)(recording.program, (&block, &block.once), &inputs.raw)
            })
            .expect("records");
        program.submit(&gpu);
        let found = inputs.read(&gpu).expect("reads");
        let mut expected = vec![0.0; width];
        for (row, found) in found.chunks_exact(width).enumerate() {
            model.encode_position(&initial.positions, first + row, &mut expected);
            for (found, expected) in found.iter().zip(&expected) {
                let error = (found - expected).abs();
                assert!(
                    error < 2e-6 * expected.abs().max(1.0),
                    "{row}: {found} {expected}"
                );
            }
        }
    }
}
