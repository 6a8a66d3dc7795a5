//! Entries of a range of Gaussians that are trained, in a view that draws all Gaussians.

use std::ops::Range;

use rayon::prelude::*;

use super::TileLists;

/// Entries of the tiles' lists that belong to a range of Gaussians. Only these have gradients, stored in the
/// order of the lists.
#[derive(Debug, Default)]
pub struct LearningEntries {
    gaussians: Range<usize>,
    /// Index of each tile's first entry among them; one more value closes the last.
    tile_starts: Vec<u32>,
    /// Per place in the lists, its index among these entries. Arbitrary for other Gaussians, empty if all are
    /// trained.
    places: Vec<u32>,
}

impl LearningEntries {
    /// Finds the entries of `gaussians`, a subrange of `all` Gaussians in `lists`.
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

    /// Returns the range of trained Gaussians.
    pub fn gaussians(&self) -> Range<usize> {
        self.gaussians.clone()
    }

    /// Returns the number of entries.
    pub fn len(&self) -> usize {
        self.tile_starts.last().map_or(0, |&end| end as usize)
    }

    /// Returns true if no tile shows any of the Gaussians.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the range of a tile's entries among these.
    pub fn tile(&self, tile: usize) -> Range<usize> {
        self.tile_starts[tile] as usize..self.tile_starts[tile + 1] as usize
    }

    /// Returns true if a Gaussian is trained.
    #[inline(always)]
    pub fn learns(&self, gaussian: usize) -> bool {
        self.gaussians.contains(&gaussian)
    }

    /// Returns the index among these of a trained Gaussian's entry, from its place in the lists.
    #[inline(always)]
    pub fn place(&self, place: u32) -> usize {
        self.places.get(place as usize).map_or(place, |&own| own) as usize
    }
}
