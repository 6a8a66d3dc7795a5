//! Binning: for every tile, the splats whose footprint covers one of its pixel centres, near to far.
//!
//! The image is covered by `ceil(W/16) x ceil(H/16)` tiles. Columns of an ERP image wrap at the seam: a
//! footprint that leaves on the right enters on the left. A tile is listed once for a splat, however wide the
//! footprint is. For every row of tiles the columns are those of the footprint within the row's pixel
//! centres, not of its bounding box. They are exact for an ellipse, and bounded by the largest change of `q`
//! over the tile for a cone.
//!
//! Every (splat, tile) pair is an *entry*. An entry has a *place* in the tiles' concatenated lists. Places
//! are kept per splat: the backward pass sums a splat's gradients over its tiles in a fixed order, so that
//! results do not depend on the number of threads.

pub mod cpu;
pub(crate) mod gpu;
pub mod learning;
mod span;

use std::{
    ops::Range,
    sync::atomic::{AtomicU32, Ordering},
};

/// Tile lists of one view.
#[derive(Debug, Default)]
pub struct TileLists {
    /// Tiles per row.
    pub columns: usize,
    /// Rows of tiles.
    pub rows: usize,
    /// Index of each tile's first place; one more value closes the last.
    tile_starts: Vec<u32>,
    /// Splats of all lists, concatenated. Atomic, because several threads fill it at once.
    items: Vec<AtomicU32>,
    /// Splats by distance, in pieces of `chunk_len`.
    chunks: Vec<Chunk>,
    chunk_len: usize,
}

/// Consecutive splats in order of distance.
#[derive(Debug, Default)]
struct Chunk {
    /// Per splat, the index of its first entry in `entries`; one more value closes the last.
    starts: Vec<u32>,
    /// Tile of each entry at first, then its place.
    entries: Vec<u32>,
    /// Entries per tile at first, then the next free place of each tile.
    next: Vec<u32>,
}

impl TileLists {
    /// Returns the number of entries.
    pub fn len(&self) -> usize {
        self.tile_starts.last().map_or(0, |&end| end as usize)
    }

    /// Returns true if no tile has a splat.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the places of a tile's list.
    pub fn tile(&self, tile: usize) -> Range<usize> {
        self.tile_starts[tile] as usize..self.tile_starts[tile + 1] as usize
    }

    /// Returns the splat at a place.
    #[inline(always)]
    pub fn splat(&self, place: usize) -> usize {
        self.items[place].load(Ordering::Relaxed) as usize
    }

    /// Returns the places of the entries of the splat with the given rank in the order of distance.
    pub fn places(&self, rank: u32) -> &[u32] {
        let chunk = &self.chunks[rank as usize / self.chunk_len];
        let at = rank as usize % self.chunk_len;
        &chunk.entries[chunk.starts[at] as usize..chunk.starts[at + 1] as usize]
    }
}
