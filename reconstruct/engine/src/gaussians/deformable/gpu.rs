//! Canonical Gaussians and their network on a GPU.

use std::sync::Arc;

use crate::gaussians::deformable::{
    Deformable, LEAST_QUATERNION_LENGTH, LEAST_SCALE, OUTPUTS, POSITIONS,
    settings::DeformationSettings,
};
use crate::{
    device::{Buffer, Gpu, GpuError, Kernel, Program, Shader, Threads, Uniform, wgsl_struct},
    fields::mlp::{
        blocks_gpu::{Block, BlockPass},
        gpu::{NetworkBuffers, Passes, Recording},
    },
    gaussians::{
        device_twin::{
            CompiledKernels, DeviceEntries, DeviceParameterization, DeviceTwin, NewDevicePart,
            PartBuffers,
        },
        parameterization::Viewpoint,
        static_gaussians::StaticGaussians,
    },
    parameters::device_table::TableBuffers,
};

wgsl_struct! {
    /// Offset of the canonical positions, and the network's unit of length.
    pub(crate) struct Canonical {
        len: u32,
        first: u32,
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
struct DeformationKernels {
    passes: Passes,
    encode_positions: Kernel,
    deform: Kernel,
    deform_vjp: Kernel,
}

impl DeformationKernels {
    fn new(gpu: &Gpu) -> Result<Self, GpuError> {
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

impl DeviceTwin for Deformable {
    fn compile(&self, gpu: &Gpu, kernels: &CompiledKernels) -> Result<(), GpuError> {
        StaticGaussians.compile(gpu, kernels)?;
        kernels.get(gpu, DeformationKernels::new).map(drop)
    }

    fn open(&self, part: &NewDevicePart<'_>) -> Result<Box<dyn DeviceParameterization>, GpuError> {
        Ok(Box::new(DeformablePart::new(self.settings, part)?))
    }

    fn uses_shared(&self, at: &Viewpoint) -> bool {
        self.network_time(at).is_some()
    }
}

/// Canonical Gaussians of a part with the network that deforms them, and the buffers of its passes.
#[derive(Debug)]
struct DeformablePart {
    canonical: Box<dyn DeviceParameterization>,
    kernels: Arc<DeformationKernels>,
    settings: DeformationSettings,
    network: NetworkBuffers,
    uniform: Uniform<Canonical>,
    places: Canonical,
}

impl DeformablePart {
    /// Allocates buffers for the capacity of the table and sets the number of its Gaussians.
    fn new(settings: DeformationSettings, part: &NewDevicePart<'_>) -> Result<Self, GpuError> {
        let NewDevicePart { gpu, table, .. } = *part;
        let model = &settings.model;
        let places = Canonical {
            positions: table.begin(POSITIONS),
            octaves: model.position_octaves as u32,
            length_unit: model.length_unit,
            ..Canonical::default()
        };
        let mut opened = Self {
            canonical: StaticGaussians.open(part)?,
            kernels: part.kernels.get(gpu, DeformationKernels::new)?,
            network: NetworkBuffers::new(gpu, model.network(), table.capacity)?,
            uniform: Uniform::of(gpu, "canonical Gaussians", &places)?,
            places,
            settings,
        };
        opened.place(gpu, part.entries, part.first_alone);
        Ok(opened)
    }

    /// Records a pass of the network over all Gaussians.
    fn pass(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        [table, weights]: [&TableBuffers; 2],
        record: impl FnOnce(&mut Recording<'_>) -> Result<(), GpuError>,
    ) -> Result<(), GpuError> {
        let octaves = self.settings.model.position_octaves;
        let canonical = &self.uniform.raw;
        let encode =
            |program: &mut Program, (block, pass): (&Block, &BlockPass), inputs: &Buffer| {
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
            weights: &weights.values.raw,
            encode: &encode,
        })
    }
}

impl DeviceParameterization for DeformablePart {
    fn activate(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        part: &PartBuffers<'_>,
    ) -> Result<(), GpuError> {
        self.canonical.activate(gpu, program, part)?;
        let Some(weights) = part.shared else {
            return Ok(());
        };
        self.pass(gpu, program, [part.table, weights], |recording| {
            self.kernels.passes.forward(recording, &self.network)
        })?;
        program.run(
            gpu,
            &self.kernels.deform,
            &part.rows.rows,
            &[
                &self.uniform.raw,
                &self.network.outputs.raw,
                &part.activated.gaussians.raw,
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
        let Some(weights) = part.shared else {
            return self.canonical.activate_vjp(gpu, program, part);
        };
        // Activate again: `deform` has overwritten the canonical ones.
        self.canonical.activate(gpu, program, part)?;
        program.run(
            gpu,
            &self.kernels.deform_vjp,
            &part.rows.rows,
            &[
                &self.uniform.raw,
                &self.network.outputs.raw,
                &part.activated.gaussians.raw,
                &part.activated.gaussian_gradients.raw,
                &self.network.upstream.raw,
            ],
        );
        let gradients = &weights.gradients.raw;
        self.pass(gpu, program, [part.table, weights], |recording| {
            self.kernels
                .passes
                .backward(recording, &self.network, gradients, None)
        })?;
        self.canonical.activate_vjp(gpu, program, part)
    }

    fn place(&mut self, gpu: &Gpu, entries: DeviceEntries, first_alone: usize) {
        self.canonical.place(gpu, entries, first_alone);
        self.places.len = entries.len as u32;
        self.places.first = entries.first as u32;
        self.uniform.write(gpu, &self.places);
        self.network.place(gpu, entries.len);
    }

    fn set_moment(&self, gpu: &Gpu, at: &Viewpoint) {
        let time = self.settings.unit_time(at.seconds, at.shift_frames);
        let encoded = self.settings.model.encoded_time(time);
        self.network.shared.write(gpu, 0, &encoded);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        clock::Clock,
        device::{DeviceBuffer, test_device},
        gaussians::{
            deformable::DeformationModel,
            device_twin::DeviceRows,
            static_gaussians::{self, InitialGaussians},
            temporal::TemporalFeatures,
        },
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
        let entries = DeviceEntries { first: 0, len: 400 };
        let part = NewDevicePart {
            gpu: &gpu,
            kernels: &CompiledKernels::default(),
            host: &table,
            table: &on_device,
            rows: &DeviceRows::new(&gpu, &on_device, entries, [0; 2]).expect("fits"),
            entries,
            features: &TemporalFeatures::default(),
            first_alone: 0,
        };
        let settings = DeformationSettings {
            clock: Clock::from_times(&[0.0, 1.0]),
            model,
            warm_up_iterations: 0,
            time_noise: None,
        };
        let gaussians = DeformablePart::new(settings, &part).expect("fits");
        let (first, rows) = (37, 300);
        let width = model.network().row_inputs;
        let inputs: DeviceBuffer<f32> =
            DeviceBuffer::zeros(&gpu, "inputs", rows * width).expect("fits");
        let block = Block::new(&gpu, first, rows).expect("fits");
        block.set_parts(&gpu, rows, 1);
        let mut program = Program::default();
        gaussians
            .pass(&gpu, &mut program, [&on_device, &weights], |recording| {
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
