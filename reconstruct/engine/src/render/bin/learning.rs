//! The entries of some consecutive Gaussians: those that learn from a view that all are drawn in.

use std::ops::Range;

use rayon::prelude::*;

use super::TileLists;

/// Which entries of the tiles' lists are those of a range of Gaussians. Gradients are kept of these alone, one
/// after another in the order of the lists.
#[derive(Debug, Default)]
pub struct LearningEntries {
    gaussians: Range<usize>,
    /// Where each tile's begin among them; one more entry closes the last.
    tile_starts: Vec<u32>,
    /// Of every place in the lists, the place among these entries; arbitrary for those of other Gaussians,
    /// empty where all learn.
    places: Vec<u32>,
}

impl LearningEntries {
    /// Finds those of `gaussians`, of all that are in `lists`.
    pub fn find(&mut self, lists: &TileLists, gaussians: Range<usize>, all: Range<usize>) {
        let are_all = gaussians == all;
        self.gaussians = gaussians;
        self.tile_starts.clear();
        self.places.clear();
        if are_all {
            self.tile_starts.extend_from_slice(&lists.tile_starts);
            return;
        }
        let tiles = lists.columns * lists.rows;
        let of_tile = |tile: usize| {
            lists
                .tile(tile)
                .filter(|&place| self.learns(lists.splat(place)))
        };
        let counts: Vec<u32> = (0..tiles)
            .into_par_iter()
            .map(|tile| of_tile(tile).count() as u32)
            .collect();
        let mut total = 0;
        let starts = counts.iter().map(|count| {
            total += count;
            total
        });
        self.tile_starts = std::iter::once(0).chain(starts).collect();
        self.places.resize(lists.len(), 0);
        let mut rest = &mut self.places[..];
        let mut of_tiles = Vec::with_capacity(tiles);
        for tile in 0..tiles {
            let (own, others) = std::mem::take(&mut rest).split_at_mut(lists.tile(tile).len());
            of_tiles.push(own);
            rest = others;
        }
        let (gaussians, tile_starts) = (&self.gaussians, &self.tile_starts);
        of_tiles
            .into_par_iter()
            .enumerate()
            .for_each(|(tile, own)| {
                let mut next = tile_starts[tile];
                for (to, place) in own.iter_mut().zip(lists.tile(tile)) {
                    if gaussians.contains(&lists.splat(place)) {
                        *to = next;
                        next += 1;
                    }
                }
            });
    }

    /// The Gaussians that learn.
    pub fn gaussians(&self) -> Range<usize> {
        self.gaussians.clone()
    }

    /// Number of entries.
    pub fn len(&self) -> usize {
        self.tile_starts.last().map_or(0, |&end| end as usize)
    }

    /// Whether no tile shows any of the Gaussians.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A tile's entries among these.
    pub fn tile(&self, tile: usize) -> Range<usize> {
        self.tile_starts[tile] as usize..self.tile_starts[tile + 1] as usize
    }

    /// Whether a Gaussian learns.
    #[inline(always)]
    pub fn learns(&self, gaussian: usize) -> bool {
        self.gaussians.contains(&gaussian)
    }

    /// The place among these of an entry of a Gaussian that learns, from its place in the lists.
    #[inline(always)]
    pub fn place(&self, place: u32) -> usize {
        self.places.get(place as usize).map_or(place, |&own| own) as usize
    }
}
