//! Hash grids on a GPU; the twin of `passes.rs`.
//!
//! Many rows read one entry, and kernels cannot add floats of several threads in a fixed order. Gradients by the
//! table are therefore sums of 64-bit integers, whose bits do not depend on the order. Their unit is `2^-40` of
//! the power of two above the largest gradient by a feature, so that no sum of fewer than `2^23` rows overflows.
//! Levels are summed in groups, which bounds the memory of the sums.

use super::levels::{FEATURES, HashGrid, MAX_DIMENSIONS, PRIMES};
use crate::{
    device::{
        Buffer, DeviceBuffer, Gpu, GpuError, Program, Rows, Shader, Threads, Uniform, kernels,
        wgsl_struct,
    },
    fields::mlp::blocks_gpu::{Block, BlockPass},
};

/// Binary logarithm of the largest summand.
const SUM_BITS: u32 = 40;
/// Words of an entry's sums: two for each feature, and one for refused features.
const SUM_WORDS: usize = 2 * FEATURES + 1;
/// Most entries of a group of several levels: 18 MiB of sums.
const GROUP_ENTRIES: u32 = 1 << 19;

wgsl_struct! {
    pub(crate) struct GridLevel {
        scale: f32,
        stride: u32,
        entries: u32,
        is_hashed: u32,
        first_entry: u32,
    }

    /// Positions of a grid, and the destination of gradients by them.
    pub(crate) struct GridRows {
        rows: u32,
        dimensions: u32,
        levels: u32,
        used: u32,
        places: [u32; 4],
        scales: [f32; 4],
        width: u32,
        pad: [u32; 3],
    }

    /// Consecutive levels whose gradients are summed at once.
    pub(crate) struct LevelGroup {
        first: u32,
        levels: u32,
        first_entry: u32,
        entries: u32,
    }
}

pub(crate) fn shader() -> Shader {
    let primes = PRIMES.map(|prime| format!("{prime}u")).join(", ");
    Shader {
        file: "hash_grid.wgsl",
        constants: format!(
            "const FEATURES: u32 = {FEATURES}u;\n\
             const PRIMES = vec4<u32>({primes});\n\
             const SUM_BITS: i32 = {SUM_BITS};\n\
             const SUM_WORDS: u32 = {SUM_WORDS}u;\n"
        ),
        parts: &[
            include_str!("../../device/common.wgsl"),
            include_str!("../mlp/block.wgsl"),
            include_str!("hash_grid.wgsl"),
        ],
    }
}

kernels! {
    /// Kernels of all grids.
    pub(crate) struct GridKernels() = shader() => [
        encode,
        find_largest,
        add_by_table,
        finish_by_table,
        add_by_positions,
    ];
}

/// Buffers of a backward pass, which grids use one after another.
#[derive(Debug)]
pub(crate) struct GridScratch {
    /// Gradients by the features of all rows.
    pub(crate) by_features: DeviceBuffer<f32>,
    largest: DeviceBuffer<u32>,
    sums: DeviceBuffer<u32>,
}

impl GridScratch {
    /// Allocates buffers for the largest of these grids and `room` rows.
    pub(crate) fn new(gpu: &Gpu, grids: &[&HashGrid], room: usize) -> Result<Self, GpuError> {
        let levels = grids.iter().map(|grid| grid.levels.len()).max();
        let features = FEATURES * levels.unwrap_or(0);
        let groups = grids.iter().flat_map(|grid| groups(grid));
        let entries = groups.map(|group| group.entries as usize).max();
        let sums = SUM_WORDS * entries.unwrap_or(0);
        Ok(Self {
            by_features: DeviceBuffer::zeros(gpu, "gradients by features", room * features)?,
            largest: DeviceBuffer::zeros(gpu, "largest gradient by a feature", 1)?,
            sums: DeviceBuffer::zeros(gpu, "sums by entries of a hash grid", sums)?,
        })
    }
}

#[cfg(test)]
impl GridScratch {
    /// Copies the sums back.
    pub(crate) fn sums_of_test(&self, gpu: &Gpu) -> Vec<u32> {
        self.sums.read(gpu).expect("reads")
    }
}

/// Divides the levels of a grid into groups.
fn groups(grid: &HashGrid) -> Vec<LevelGroup> {
    let mut groups: Vec<LevelGroup> = Vec::new();
    for (number, level) in grid.levels.iter().enumerate() {
        match groups.last_mut() {
            Some(group) if group.entries + level.entries <= GROUP_ENTRIES => {
                group.levels += 1;
                group.entries += level.entries;
            }
            _ => groups.push(LevelGroup {
                first: number as u32,
                levels: 1,
                first_entry: level.first_entry as u32,
                entries: level.entries,
            }),
        }
    }
    groups
}

/// Destination of gradients by positions in rows of another buffer, to which they are added.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PositionGradients {
    /// Values of a row.
    pub(crate) width: usize,
    /// Value of the row along each dimension.
    pub(crate) places: [u32; MAX_DIMENSIONS],
    /// Factor along each dimension.
    pub(crate) scales: [f32; MAX_DIMENSIONS],
}

/// Levels of a grid, and the current number of its positions.
#[derive(Debug)]
pub(crate) struct DeviceGrid {
    levels: DeviceBuffer<GridLevel>,
    groups: Vec<(LevelGroup, Uniform<LevelGroup>)>,
    uniform: Uniform<GridRows>,
    rows: GridRows,
    count: Rows,
    /// 1, or 0 without rows.
    is_used: Rows,
}

impl DeviceGrid {
    /// Uploads the levels, without positions.
    pub(crate) fn new(
        gpu: &Gpu,
        grid: &HashGrid,
        by_positions: &PositionGradients,
    ) -> Result<Self, GpuError> {
        let levels: Vec<GridLevel> = grid
            .levels
            .iter()
            .map(|level| GridLevel {
                scale: level.scale,
                stride: level.stride,
                entries: level.entries,
                is_hashed: level.is_hashed.into(),
                first_entry: level.first_entry as u32,
            })
            .collect();
        let rows = GridRows {
            dimensions: grid.shape.dimensions as u32,
            levels: levels.len() as u32,
            places: by_positions.places,
            scales: by_positions.scales,
            width: by_positions.width as u32,
            ..GridRows::default()
        };
        let with_uniform = |group: LevelGroup| -> Result<_, GpuError> {
            Ok((group, Uniform::of(gpu, "levels of a hash grid", &group)?))
        };
        Ok(Self {
            levels: DeviceBuffer::of(gpu, "levels of a hash grid", &levels)?,
            groups: groups(grid)
                .into_iter()
                .map(with_uniform)
                .collect::<Result<_, GpuError>>()?,
            uniform: Uniform::of(gpu, "rows of a hash grid", &rows)?,
            rows,
            count: Rows::new(0),
            is_used: Rows::new(0),
        })
    }

    /// Sets the number of positions, and that of the features in use, for everything that is submitted later.
    pub(crate) fn place(&mut self, gpu: &Gpu, rows: usize, used: usize) {
        self.rows.rows = rows as u32;
        self.rows.used = used.min(FEATURES * self.rows.levels as usize) as u32;
        self.uniform.write(gpu, &self.rows);
        self.count.set(rows);
        self.is_used.set(rows.min(1));
    }

    /// Records the features of a block's positions.
    pub(crate) fn encode(
        &self,
        (gpu, kernels): (&Gpu, &GridKernels),
        program: &mut Program,
        (block, pass): (&Block, &BlockPass),
        [positions, table, features]: [&Buffer; 3],
    ) {
        program.run(
            gpu,
            &kernels.encode,
            Threads::ForRows(&pass.rows, self.rows.levels as usize),
            &[
                &self.uniform.raw,
                &self.levels.raw,
                positions,
                table,
                features,
                &block.uniform.raw,
            ],
        );
    }

    /// Records the gradients by the table, which overwrite `gradients`, from those by the features in `scratch`.
    pub(crate) fn backward_table(
        &self,
        (gpu, kernels): (&Gpu, &GridKernels),
        program: &mut Program,
        scratch: &GridScratch,
        [positions, gradients]: [&Buffer; 2],
    ) {
        let by_features = &scratch.by_features.raw;
        let (largest, sums) = (&scratch.largest.raw, &scratch.sums.raw);
        program.clear(largest);
        program.run(
            gpu,
            &kernels.find_largest,
            Threads::ForRows(&self.count, self.rows.levels as usize),
            &[&self.uniform.raw, by_features, largest],
        );
        for (group, uniform) in &self.groups {
            program.run(
                gpu,
                &kernels.add_by_table,
                Threads::ForRows(&self.count, group.levels as usize),
                &[
                    &self.uniform.raw,
                    &self.levels.raw,
                    positions,
                    by_features,
                    largest,
                    sums,
                    &uniform.raw,
                ],
            );
            program.run(
                gpu,
                &kernels.finish_by_table,
                Threads::ForRows(&self.is_used, group.entries as usize),
                &[&uniform.raw, largest, sums, gradients],
            );
        }
    }

    /// Records the gradients by the positions, which are added to `by_positions`, from those by the features in
    /// `scratch`.
    pub(crate) fn backward_positions(
        &self,
        (gpu, kernels): (&Gpu, &GridKernels),
        program: &mut Program,
        scratch: &GridScratch,
        [positions, table, by_positions]: [&Buffer; 3],
    ) {
        program.run(
            gpu,
            &kernels.add_by_positions,
            &self.count,
            &[
                &self.uniform.raw,
                &self.levels.raw,
                positions,
                table,
                &scratch.by_features.raw,
                by_positions,
            ],
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{device::test_device, fields::hash_grid::HashGridShape};

    #[test]
    fn groups_hold_every_level_once_and_bound_the_sums() {
        for log2_entries in [12, 17, 19] {
            let grid = HashGrid::new(HashGridShape::new(2, 16, log2_entries));
            let groups = groups(&grid);
            let mut level = 0;
            for group in &groups {
                assert_eq!(group.first as usize, level);
                let levels = &grid.levels[level..level + group.levels as usize];
                let entries: u32 = levels.iter().map(|level| level.entries).sum();
                assert_eq!(group.entries, entries);
                assert_eq!(group.first_entry as usize, levels[0].first_entry);
                assert!(entries <= GROUP_ENTRIES);
                level += levels.len();
            }
            assert_eq!(level, grid.levels.len());
        }
    }

    #[test]
    fn a_million_rows_in_one_cell_sum_as_in_f64() {
        let Some(gpu) = test_device() else { return };
        const ROWS: usize = 1_000_000;
        let grid = HashGrid::new(HashGridShape::new(2, 1, 6));
        let plain = PositionGradients {
            width: 2,
            places: [0, 1, 2, 3],
            scales: [1.0; MAX_DIMENSIONS],
        };
        let kernels = GridKernels::new(&gpu).expect("compiles");
        let mut on_device = DeviceGrid::new(&gpu, &grid, &plain).expect("fits");
        let scratch = GridScratch::new(&gpu, &[&grid], ROWS).expect("fits");
        let positions = [0.3_f32, 0.6].repeat(ROWS);
        let positions = DeviceBuffer::of(&gpu, "positions", &positions).expect("fits");
        let gradients: DeviceBuffer<f32> =
            DeviceBuffer::zeros(&gpu, "gradients", grid.parameter_count()).expect("fits");
        let upstream: Vec<f32> = (0..ROWS * FEATURES)
            .map(|at| 1e-3 + (at % 7) as f32 * 1e-4)
            .collect();
        scratch.by_features.write(&gpu, 0, &upstream);
        on_device.place(&gpu, ROWS, usize::MAX);
        let mut program = Program::default();
        let buffers = [&positions.raw, &gradients.raw];
        on_device.backward_table((&gpu, &kernels), &mut program, &scratch, buffers);
        program.submit(&gpu);
        let found = gradients.read(&gpu).expect("reads");
        let found: f64 = found.iter().map(|&value| f64::from(value)).sum();
        let expected: f64 = upstream.iter().map(|&value| f64::from(value)).sum();
        assert!((found / expected - 1.0).abs() < 1e-6, "{found} {expected}");
    }
}
