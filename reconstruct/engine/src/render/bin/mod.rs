//! Binning: for every tile, the splats whose footprint touches one of its pixel centres, near to
//! far.
//!
//! The image is covered by `ceil(W/16) x ceil(H/16)` tiles. Columns of an ERP image wrap at the
//! seam: a footprint that leaves on the right enters on the left. A tile is listed once for a splat,
//! however wide the footprint is. For every row of tiles the columns are those of the footprint
//! within the row's pixel centres, not of its bounding box: exactly for an ellipse, by the largest
//! change of `q` over the tile for a cone.
//!
//! Every (splat, tile) pair is an *entry*. An entry has a *place* in the tiles' lists, which stand
//! one after another; the places of a splat's entries are kept splat by splat, so that the backward
//! pass can sum a splat's gradients over its tiles in a fixed order: results do not depend on the
//! number of threads.

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
    /// Where each tile's list begins; one more entry closes the last.
    tile_starts: Vec<u32>,
    /// Splats of all lists one after another. Atomic, because several threads fill it at once.
    items: Vec<AtomicU32>,
    /// Splats in order of distance, in pieces of `chunk_len`.
    chunks: Vec<Chunk>,
    chunk_len: usize,
}

/// Consecutive splats in order of distance.
#[derive(Debug, Default)]
struct Chunk {
    /// For each splat, where its entries begin in `entries`; one more closes the last.
    starts: Vec<u32>,
    /// The tile of each entry first, then its place.
    entries: Vec<u32>,
    /// Entries per tile first, then the next free place of each tile.
    next: Vec<u32>,
}

impl TileLists {
    /// Number of entries.
    pub fn len(&self) -> usize {
        self.tile_starts.last().map_or(0, |&end| end as usize)
    }

    /// Whether no tile has a splat.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Places of a tile's list.
    pub fn tile(&self, tile: usize) -> Range<usize> {
        self.tile_starts[tile] as usize..self.tile_starts[tile + 1] as usize
    }

    /// The splat at a place.
    #[inline(always)]
    pub fn splat(&self, place: usize) -> usize {
        self.items[place].load(Ordering::Relaxed) as usize
    }

    /// Places of the entries of the splat with the given rank in the order of distance.
    pub fn places(&self, rank: u32) -> &[u32] {
        let chunk = &self.chunks[rank as usize / self.chunk_len];
        let at = rank as usize % self.chunk_len;
        &chunk.entries[chunk.starts[at] as usize..chunk.starts[at + 1] as usize]
    }
}
