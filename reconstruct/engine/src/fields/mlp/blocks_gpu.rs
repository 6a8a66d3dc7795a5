//! Blocks of rows on a GPU. Buffers and programs are created for the capacity, and run for the current number
//! of rows.

use crate::device::{Gpu, GpuError, Rows, Uniform, wgsl_struct};
use crate::fields::mlp::product_gpu::SIDE;

/// Minimum rows of a partial sum, and maximum number of partial sums.
const PART_ROWS: usize = 1024;
pub(super) const PARTS: usize = 32;

wgsl_struct! {
    /// Rows that go through a network together.
    pub(crate) struct BlockRows {
        first: u32,
        rows: u32,
        parts: u32,
    }
}

/// Number of rows of a block in one pass of the kernels.
#[derive(Debug)]
pub(crate) struct BlockPass {
    pub(crate) rows: Rows,
    /// Tiles of [`SIDE`] rows that cover them.
    pub(super) squares: Rows,
}

impl BlockPass {
    fn new() -> Self {
        Self {
            rows: Rows::new(0),
            squares: Rows::new(0),
        }
    }

    fn set(&self, rows: usize) {
        self.rows.set(rows);
        self.squares.set(rows.div_ceil(SIDE as usize));
    }
}

/// Rows that go through the layers together.
#[derive(Debug)]
pub(crate) struct Block {
    /// Index of the first row.
    pub(crate) first: usize,
    /// Capacity in rows.
    pub(super) room: usize,
    pub(crate) uniform: Uniform<BlockRows>,
    /// Rows of the forward pass.
    pub(crate) once: BlockPass,
    /// Rows to evaluate again in the backward pass; 0 if the activations are still there.
    pub(crate) again: BlockPass,
    /// Number of partial sums over the rows.
    pub(super) parts: Rows,
    /// 1, or 0 for a block without rows (except the first block).
    pub(super) is_used: Rows,
}

impl Block {
    /// Creates a block without rows.
    pub(crate) fn new(gpu: &Gpu, first: usize, room: usize) -> Result<Self, GpuError> {
        Ok(Self {
            first,
            room,
            uniform: Uniform::of(gpu, "rows of a network", &BlockRows::default())?,
            once: BlockPass::new(),
            again: BlockPass::new(),
            parts: Rows::new(0),
            is_used: Rows::new(0),
        })
    }

    /// Sets its rows for everything that is submitted later. The number of partial sums depends on the rows
    /// alone, so that a device reproduces the same bits at any capacity.
    fn set(&self, gpu: &Gpu, rows: usize, is_alone: bool) {
        let is_used = rows > 0 || self.first == 0;
        let parts = if is_used {
            rows.div_ceil(PART_ROWS).clamp(1, PARTS)
        } else {
            0
        };
        self.set_parts(gpu, rows, parts);
        if is_alone {
            self.again.set(0);
        }
    }

    /// Sets its rows and its number of partial sums.
    pub(crate) fn set_parts(&self, gpu: &Gpu, rows: usize, parts: usize) {
        assert!(rows <= self.room, "a block is full");
        let block = BlockRows {
            first: self.first as u32,
            rows: rows as u32,
            parts: parts as u32,
        };
        self.uniform.write(gpu, &block);
        self.once.set(rows);
        self.again.set(rows);
        self.parts.set(parts);
        self.is_used.set(parts.min(1));
    }
}

/// All rows of a network, block after block.
#[derive(Debug)]
pub(super) struct Blocks(Vec<Block>);

impl Blocks {
    /// Creates blocks of at most `largest` rows for a capacity of `room`, without rows.
    pub(super) fn new(gpu: &Gpu, room: usize, largest: usize) -> Result<Self, GpuError> {
        let firsts = (0..room.max(1)).step_by(largest);
        let block = |first| Block::new(gpu, first, largest.min(room - first));
        firsts.map(block).collect::<Result<_, _>>().map(Self)
    }

    /// Sets the number of rows for everything that is submitted later. `keeps` is true if a single block with rows
    /// keeps its activations for the backward pass.
    pub(super) fn place(&self, gpu: &Gpu, rows: usize, keeps: bool) {
        let in_block = |block: &Block| rows.saturating_sub(block.first).min(block.room);
        let with_rows = self.0.iter().filter(|block| in_block(block) > 0).count();
        let is_alone = keeps && with_rows < 2;
        for block in &self.0 {
            block.set(gpu, in_block(block), is_alone);
        }
    }

    /// Iterates over the blocks in order.
    pub(super) fn iter(&self) -> impl Iterator<Item = &Block> {
        self.0.iter()
    }

    /// Returns the largest capacity of a block.
    pub(super) fn largest(&self) -> usize {
        self.0.iter().map(|block| block.room).max().unwrap_or(0)
    }
}
