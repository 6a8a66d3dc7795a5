//! Blocks of rows on a GPU. Buffers and programs are made for as many rows as there is room for, and run for as
//! many as there are at the moment.

use crate::device::{Gpu, GpuError, Rows, Uniform, wgsl_struct};
use crate::fields::mlp::product_gpu::SIDE;

/// Rows of a part of a sum over rows, at least, and how many parts there are, at most.
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

/// How many rows of a block kernels go over, each time that they do.
#[derive(Debug)]
pub(crate) struct BlockPass {
    /// The rows.
    pub(crate) rows: Rows,
    /// Squares of a product, one below the other, that the rows take.
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
    /// Number of the first.
    pub(crate) first: usize,
    /// The most rows.
    pub(super) room: usize,
    /// What kernels see of it.
    pub(crate) uniform: Uniform<BlockRows>,
    /// All rows, once.
    pub(crate) once: BlockPass,
    /// The same for the way back, or none where what the layers put out is still there.
    pub(crate) again: BlockPass,
    /// Parts of a sum over the rows.
    pub(super) parts: Rows,
    /// 1, or 0 where the block has no rows and another one has.
    pub(super) is_used: Rows,
}

impl Block {
    /// Without rows yet.
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

    /// Its rows, for everything that is submitted later. Sums over them are made in parts whose number depends
    /// on the rows alone: a device gives the same bits again, whatever there is room for.
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

    /// The same with so many parts.
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
    /// With room for so many rows, none of which are there yet, in blocks of at most `largest`.
    pub(super) fn new(gpu: &Gpu, room: usize, largest: usize) -> Result<Self, GpuError> {
        let firsts = (0..room.max(1)).step_by(largest);
        let block = |first| Block::new(gpu, first, largest.min(room - first));
        firsts.map(block).collect::<Result<_, _>>().map(Self)
    }

    /// Makes so many rows of the room, for everything that is submitted later.
    pub(super) fn place(&self, gpu: &Gpu, rows: usize) {
        let in_block = |block: &Block| rows.saturating_sub(block.first).min(block.room);
        let is_alone = self.0.iter().filter(|block| in_block(block) > 0).count() < 2;
        for block in &self.0 {
            block.set(gpu, in_block(block), is_alone);
        }
    }

    /// In order.
    pub(super) fn iter(&self) -> impl Iterator<Item = &Block> {
        self.0.iter()
    }

    /// The most rows of a block.
    pub(super) fn largest(&self) -> usize {
        self.0.iter().map(|block| block.room).max().unwrap_or(0)
    }
}
