//! Binning on the CPU: each piece of the order counts its entries per tile, the counts give the places, and
//! each piece fills in its own. Splats are visited near to far, so that the lists are sorted.

use std::sync::atomic::{AtomicU32, Ordering};

use fearless_simd::{Level, Simd, dispatch};
use rayon::prelude::*;

use crate::render::bin::{Chunk, TileLists, span::Grid};
use crate::{
    camera::rays::Rays,
    render::project::{Splat, Splats},
};

/// Number of pieces of the order, independent of the number of threads.
const CHUNKS: usize = 32;
/// Minimum number of splats in a piece.
const CHUNK_MIN: usize = 1024;
/// Splats that are copied before they are used, so that their cache misses overlap.
const GATHER: usize = 16;

/// Finds the tiles of splats for one camera.
#[derive(Debug)]
pub struct Binner {
    grid: Grid,
}

impl Binner {
    /// Creates a binner for the camera of `rays`.
    pub fn new(rays: &Rays) -> Self {
        Self {
            grid: Grid::new(rays),
        }
    }

    /// Fills `lists` for the splats in `order` (near to far).
    pub fn forward(&self, splats: &Splats, order: &[u32], lists: &mut TileLists) {
        let tiles = self.grid.columns * self.grid.rows;
        lists.columns = self.grid.columns;
        lists.rows = self.grid.rows;
        lists.chunk_len = order.len().div_ceil(CHUNKS).max(CHUNK_MIN);
        let count = order.len().div_ceil(lists.chunk_len);
        lists.chunks.resize_with(count, Chunk::default);
        let level = Level::new();
        lists
            .chunks
            .par_iter_mut()
            .zip(order.par_chunks(lists.chunk_len))
            .with_max_len(1)
            .for_each(|(chunk, order)| {
                dispatch!(level, simd => self.count(simd, splats, order, tiles, chunk));
            });

        lists.tile_starts.clear();
        let mut total = 0;
        for tile in 0..tiles {
            lists.tile_starts.push(total);
            for chunk in &mut lists.chunks {
                total += std::mem::replace(&mut chunk.next[tile], total);
            }
        }
        lists.tile_starts.push(total);

        if lists.items.len() < total as usize {
            lists
                .items
                .resize_with(total as usize, || AtomicU32::new(0));
        }
        let items = &lists.items;
        lists
            .chunks
            .par_iter_mut()
            .zip(order.par_chunks(lists.chunk_len))
            .with_max_len(1)
            .for_each(|(chunk, order)| fill(order, items, chunk));
    }

    /// Counts each tile's entries. The instruction set affects only the speed of rounding.
    #[inline(always)]
    fn count<S: Simd>(
        &self,
        _: S,
        splats: &Splats,
        order: &[u32],
        tiles: usize,
        chunk: &mut Chunk,
    ) {
        chunk.starts.clear();
        chunk.entries.clear();
        chunk.next.clear();
        chunk.next.resize(tiles, 0);
        let mut copies = [Splat::default(); GATHER];
        for order in order.chunks(GATHER) {
            for (copy, &splat) in copies.iter_mut().zip(order) {
                *copy = splats.all[splat as usize];
            }
            for (splat, &index) in copies.iter().zip(order) {
                chunk.starts.push(chunk.entries.len() as u32);
                let cone = || &splats.cones[index as usize];
                self.grid.for_each_tile(splat, cone, |tile| {
                    chunk.entries.push(tile);
                    chunk.next[tile as usize] += 1;
                });
            }
        }
        chunk.starts.push(chunk.entries.len() as u32);
    }
}

fn fill(order: &[u32], items: &[AtomicU32], chunk: &mut Chunk) {
    for (&splat, range) in order.iter().zip(chunk.starts.windows(2)) {
        for entry in &mut chunk.entries[range[0] as usize..range[1] as usize] {
            let next = &mut chunk.next[*entry as usize];
            *entry = *next;
            items[*next as usize].store(splat, Ordering::Relaxed);
            *next += 1;
        }
    }
}
