//! The field and its loss on a GPU.

use std::sync::Arc;

use glam::IVec3;

use super::{BLOCK_SIDE, BLOCK_VOXELS, HUBER_VOXELS, Scaffold};
use crate::{
    device::{DeviceBuffer, Gpu, GpuError, Kernel, Program, Rows, Shader, Uniform, wgsl_struct},
    gaussians::static_gaussians::{OPACITY_LOGITS, POSITIONS},
    parameters::device_table::TableBuffers,
};

/// Distance at a voxel that no view observed.
const UNKNOWN: f32 = 1e30;
/// Factors of a block's coordinates in its hash (Teschner et al., 2003).
const HASH: [u32; 3] = [73_856_093, 19_349_663, 83_492_791];

wgsl_struct! {
    /// The loss on the centres of a table.
    pub(crate) struct ScaffoldLoss {
        origin: [f32; 3],
        voxel: f32,
        len: u32,
        positions: u32,
        last_slot: u32,
        opacities: u32,
        takes_part: u32,
        pad_a: u32,
        pad_b: u32,
        pad_c: u32,
    }
}

pub(crate) fn shader() -> Shader {
    let [x, y, z] = HASH;
    Shader {
        file: "scaffold.wgsl",
        constants: format!(
            "const BLOCK_SIDE: i32 = {BLOCK_SIDE};\n\
             const BLOCK_BITS: u32 = {}u;\n\
             const UNKNOWN: f32 = {UNKNOWN:e};\n\
             const HUBER_VOXELS: f32 = {HUBER_VOXELS:e};\n\
             const HASH_X: u32 = {x}u;\n\
             const HASH_Y: u32 = {y}u;\n\
             const HASH_Z: u32 = {z}u;\n",
            BLOCK_SIDE.trailing_zeros()
        ),
        parts: &[
            include_str!("../../device/common.wgsl"),
            include_str!("scaffold.wgsl"),
        ],
    }
}

/// A field in GPU memory, half as large as in the host's, and the kernel of its loss.
#[derive(Debug)]
pub struct DeviceScaffold {
    add_scaffold: Kernel,
    blocks: DeviceBuffer<[i32; 4]>,
    distances: DeviceBuffer<f32>,
    field: ScaffoldLoss,
}

/// Returns the slot in which the search for a block begins; `last_slot` is one less than a power of two.
fn first_slot(block: IVec3, last_slot: usize) -> usize {
    let parts = block.to_array().into_iter().zip(HASH);
    let hash = parts.fold(0, |hash, (part, factor)| {
        hash ^ (part as u32).wrapping_mul(factor)
    });
    hash as usize & last_slot
}

impl DeviceScaffold {
    /// Uploads a field.
    ///
    /// # Errors
    /// If the device fails, or the field is larger than its memory or its largest buffer.
    pub fn new(gpu: &Gpu, scaffold: &Scaffold) -> Result<Self, GpuError> {
        // At most half full, so that searches are short.
        let last_slot = (2 * scaffold.blocks.len()).next_power_of_two().max(2) - 1;
        let mut slots = vec![[0, 0, 0, -1]; last_slot + 1];
        let mut distances = Vec::with_capacity(scaffold.blocks.len() * BLOCK_VOXELS);
        for (number, (block, voxels)) in scaffold.blocks.iter().enumerate() {
            let mut slot = first_slot(*block, last_slot);
            while slots[slot][3] >= 0 {
                slot = (slot + 1) & last_slot;
            }
            slots[slot] = [block.x, block.y, block.z, number as i32];
            let of_block = voxels
                .iter()
                .map(|voxel| voxel.distance(scaffold.truncation));
            distances.extend(of_block.map(|distance| distance.unwrap_or(UNKNOWN)));
        }
        let [add_scaffold] = Kernel::compile(gpu, &shader(), ["add_scaffold"])?;
        Ok(Self {
            add_scaffold,
            blocks: DeviceBuffer::of(gpu, "blocks of the scaffold", &slots)?,
            distances: DeviceBuffer::of(gpu, "distances of the scaffold", &distances)?,
            field: ScaffoldLoss {
                origin: scaffold.origin.to_array(),
                voxel: scaffold.voxel,
                last_slot: last_slot as u32,
                ..ScaffoldLoss::default()
            },
        })
    }
}

/// The loss on the centres of one table.
#[derive(Debug)]
pub struct DeviceScaffoldLoss {
    scaffold: Arc<DeviceScaffold>,
    uniform: Uniform<ScaffoldLoss>,
    /// Weight of each centre, per scene unit.
    weights: DeviceBuffer<f32>,
    loss: ScaffoldLoss,
}

/// Centres that the loss acts on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ScaffoldCentres {
    /// No centre.
    None,
    /// All centres.
    All,
    /// Centres of Gaussians with a gradient by their opacity: those that the view's image has.
    Seen,
}

impl DeviceScaffoldLoss {
    /// Creates the loss on the static Gaussians of a table, which acts on no centre until it is set. `weights` has
    /// the weight of each centre, per scene unit.
    ///
    /// # Errors
    /// If the device runs out of memory.
    pub fn new(
        gpu: &Gpu,
        scaffold: Arc<DeviceScaffold>,
        table: &TableBuffers,
        weights: &[f32],
    ) -> Result<Self, GpuError> {
        let loss = ScaffoldLoss {
            positions: table.begin(POSITIONS),
            opacities: table.begin(OPACITY_LOGITS),
            ..scaffold.field
        };
        Ok(Self {
            uniform: Uniform::of(gpu, "loss on the scaffold", &loss)?,
            weights: DeviceBuffer::of(gpu, "weights of the scaffold", weights)?,
            scaffold,
            loss,
        })
    }

    /// Sets the number of Gaussians and the centres that the loss acts on, for everything that is submitted later.
    pub fn set(&self, gpu: &Gpu, rows: usize, centres: ScaffoldCentres) {
        let loss = ScaffoldLoss {
            len: rows as u32,
            takes_part: centres as u32,
            ..self.loss
        };
        self.uniform.write(gpu, &loss);
    }

    /// Records the addition of its gradient to that of the table; the twin of [`Scaffold::loss`].
    pub fn record(&self, gpu: &Gpu, program: &mut Program, table: &TableBuffers, rows: &Rows) {
        program.run(
            gpu,
            &self.scaffold.add_scaffold,
            rows,
            &[
                &self.uniform.raw,
                &table.values.raw,
                &self.scaffold.blocks.raw,
                &self.scaffold.distances.raw,
                &table.gradients.raw,
                &self.weights.raw,
            ],
        );
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use glam::{Vec3, ivec3};
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::{
        device::test_device,
        gaussians::static_gaussians::{self, InitialGaussians},
        losses::scaffold::{Block, STEPS, Voxel},
    };

    /// Returns blocks of random voxels around the origin, with gaps: blocks, and every eleventh voxel.
    fn scaffold(random: &mut Pcg64Mcg) -> Scaffold {
        let mut blocks = HashMap::new();
        for index in 0..64 {
            let block = ivec3(index % 4, index / 4 % 4, index / 16) - 2;
            if index % 5 == 4 {
                continue;
            }
            let mut voxels: Block = Box::new([Voxel::default(); BLOCK_VOXELS]);
            for (number, voxel) in voxels.iter_mut().enumerate() {
                if !number.is_multiple_of(41) {
                    let weight = random.random_range(1..1000_u32);
                    let mean: f32 = random.random_range(-1.0..1.0);
                    *voxel = Voxel {
                        sum: (STEPS * weight as f32 * mean) as i32,
                        weight,
                    };
                }
            }
            blocks.insert(block, voxels);
        }
        Scaffold {
            voxel: 0.1,
            truncation: 0.4,
            origin: Vec3::new(0.03, -0.02, 0.01),
            blocks,
        }
    }

    #[test]
    fn gradients_are_those_of_the_cpu() {
        let Some(gpu) = test_device() else { return };
        let mut random = Pcg64Mcg::seed_from_u64(5);
        let scaffold = scaffold(&mut random);
        let mut initial = InitialGaussians::default();
        for _ in 0..3_000 {
            let position = [0; 3].map(|_| random.random_range(-1.9..1.9));
            initial.push_isotropic(position, 0.1, [0.5; 3], 0.5);
        }
        for far in [1e9, -1e9, f32::INFINITY, f32::NAN] {
            initial.push_isotropic([0.0, far, 0.0], 0.1, [0.5; 3], 0.5);
        }
        let len = initial.len();
        let table = static_gaussians::table(&initial, 0);
        let on_device = TableBuffers::new(&gpu, &table.arrays, [len, len + 7]).expect("fits");
        let field = Arc::new(DeviceScaffold::new(&gpu, &scaffold).expect("fits"));
        let weights: Vec<f32> = (0..len).map(|number| 0.05 + 1e-4 * number as f32).collect();
        let loss = DeviceScaffoldLoss::new(&gpu, field, &on_device, &weights).expect("fits");
        let mut program = Program::default();
        loss.record(&gpu, &mut program, &on_device, &Rows::new(len));
        // What the loss finds there is added to.
        let before = vec![0.25; 3 * len];
        on_device.gradients.write(&gpu, 0, &before);
        let found = || on_device.gradients.read_range(&gpu, 0..3 * len);
        loss.set(&gpu, len, ScaffoldCentres::None);
        program.submit(&gpu);
        assert!(found().expect("reads") == before);
        // Every third Gaussian has a gradient by its opacity.
        let by_opacities: Vec<f32> = (0..len).map(|number| f32::from(number % 3 == 0)).collect();
        on_device.gradients.write(
            &gpu,
            on_device.begin(OPACITY_LOGITS) as usize,
            &by_opacities,
        );
        loss.set(&gpu, len, ScaffoldCentres::Seen);
        program.submit(&gpu);
        let of_seen = found().expect("reads");
        on_device.gradients.write(&gpu, 0, &before);
        loss.set(&gpu, len, ScaffoldCentres::All);
        program.submit(&gpu);
        for (number, (seen, all)) in of_seen
            .chunks(3)
            .zip(found().expect("reads").chunks(3))
            .enumerate()
        {
            let expected = if number % 3 == 0 { all } else { &[0.25; 3] };
            assert_eq!(seen, expected, "centre {number}");
        }
        let mut expected = vec![[0.25; 3]; len];
        let centres = &initial.positions[..len - 1];
        // A NaN centre has no loss on the device, and a gradient that Adam refuses on the CPU.
        scaffold.loss(centres, |number| weights[number], &mut expected[..len - 1]);
        let (mut moved, mut apart) = (0, 0);
        for (index, (found, expected)) in found()
            .expect("reads")
            .iter()
            .zip(expected.as_flattened())
            .enumerate()
        {
            let error = (found - expected).abs();
            if error > 1e-4 {
                println!("{index}: {found} against {expected}");
                apart += 1;
            }
            moved += usize::from((expected - 0.25).abs() > 1e-3);
        }
        assert!(moved > len / 2, "{moved} values of {len} centres");
        // The last bit of a quotient decides on which side of a voxel's centre a Gaussian is.
        assert!(apart <= 6, "{apart} values");
    }
}
