//! A tile of the image and its working memory.

use std::ops::Range;

use crate::{
    camera::rays::Rays,
    render::{
        bin::TileLists,
        project::{Splat, Splats},
        settings::TILE,
    },
};

/// One value per pixel of a tile, row-major. Aligned so that no vector crosses a cache line.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(super) struct Plane(pub(super) [f32; TILE * TILE]);

impl Plane {
    /// Creates a plane with the same value everywhere.
    pub(super) const fn filled(value: f32) -> Self {
        Self([value; TILE * TILE])
    }
}

/// Widening of footprints, pixels, against rounding in the extents.
pub(super) const MARGIN: f32 = 0.01;

/// Inputs shared by all tiles of a view.
#[derive(Clone, Copy)]
pub(super) struct Scene<'a> {
    pub(super) splats: &'a Splats,
    /// Features of all Gaussians, `feature_count` for each.
    pub(super) features: &'a [f32],
    pub(super) feature_count: usize,
    pub(super) lists: &'a TileLists,
    pub(super) rays: &'a Rays,
    pub(super) background: [f32; 3],
}

impl Scene<'_> {
    pub(super) fn width(&self) -> usize {
        self.rays.camera.width() as usize
    }

    pub(super) fn height(&self) -> usize {
        self.rays.camera.height() as usize
    }

    pub(super) fn features_of(&self, splat: usize) -> &[f32] {
        &self.features[splat * self.feature_count..(splat + 1) * self.feature_count]
    }
}

/// Position of a tile in the image.
#[derive(Clone, Copy)]
pub(super) struct Tile {
    pub(super) index: usize,
    /// First column of pixels.
    pub(super) left: usize,
    /// First row of pixels.
    pub(super) top: usize,
    /// Columns inside the image.
    pub(super) columns: usize,
    /// Rows inside the image.
    pub(super) rows: usize,
    /// Pixels around the sphere; 0 if columns do not wrap.
    period: f32,
}

impl Tile {
    pub(super) fn new(scene: &Scene<'_>, index: usize) -> Self {
        let left = index % scene.lists.columns * TILE;
        let top = index / scene.lists.columns * TILE;
        Self {
            index,
            left,
            top,
            columns: TILE.min(scene.width() - left),
            rows: TILE.min(scene.height() - top),
            period: if scene.rays.camera.wraps() {
                scene.width() as f32
            } else {
                0.0
            },
        }
    }

    /// Returns the offset of an image column from the centre of the tile's first column, by the shorter way
    /// around the seam from the tile's centre.
    #[inline(always)]
    pub(super) fn column(&self, u: f32) -> f32 {
        let column = u - self.left as f32 - 0.5;
        let from_middle = column - 0.5 * TILE as f32;
        if from_middle > 0.5 * self.period {
            column - self.period
        } else if from_middle < -0.5 * self.period {
            column + self.period
        } else {
            column
        }
    }

    /// Returns true if a footprint of this half width can enter the tile from both sides.
    #[inline(always)]
    pub(super) fn is_surrounded(&self, half_width: f32) -> bool {
        self.period > 0.0 && half_width + TILE as f32 >= 0.5 * self.period
    }

    /// Returns the initial plane of transmittances: 1, and -1 (stopped) outside the image.
    pub(super) fn full_transmittance(&self) -> Plane {
        let mut plane = Plane::filled(-1.0);
        for row in plane.0.chunks_exact_mut(TILE).take(self.rows) {
            row[..self.columns].fill(1.0);
        }
        plane
    }
}

/// Returns the rows of the tile with pixel centres in a splat's rectangle.
#[inline(always)]
pub(super) fn rows_of(tile: &Tile, splat: &Splat) -> Range<usize> {
    // Row centres are at row + 1/2.
    let reach = splat.extent[1] + MARGIN;
    let centre = splat.centre[1] - tile.top as f32 - 0.5;
    let first = (centre - reach).ceil().max(0.0) as usize;
    let end = ((centre + reach).floor() + 1.0).max(0.0) as usize;
    first..end.min(tile.rows)
}

/// Returns true if every pixel has stopped.
pub(super) fn has_stopped(transmittance: &Plane) -> bool {
    transmittance.0.iter().all(|&value| value < 0.0)
}

/// Splats that are copied together before they are drawn, so that their cache misses overlap. Between two
/// batches the tile is checked for having stopped.
const BATCH: usize = 16;

/// A batch of consecutive splats of a tile's list.
pub(super) struct Batch {
    splats: [Splat; BATCH],
    indices: [u32; BATCH],
    len: usize,
}

impl Batch {
    pub(super) fn new() -> Self {
        Self {
            splats: [Splat::default(); BATCH],
            indices: [0; BATCH],
            len: 0,
        }
    }

    /// Takes the next splats from the front of `places`.
    #[inline(always)]
    pub(super) fn fill(&mut self, scene: &Scene<'_>, places: &mut Range<usize>) {
        self.len = places.len().min(BATCH);
        for (index, place) in self.indices.iter_mut().zip(places.by_ref().take(self.len)) {
            *index = scene.lists.splat(place) as u32;
        }
        for (splat, &index) in self.splats[..self.len].iter_mut().zip(&self.indices) {
            *splat = scene.splats.all[index as usize];
        }
    }

    /// Iterates over the splats with their indices.
    #[inline(always)]
    pub(super) fn iter(&self) -> impl Iterator<Item = (usize, &Splat)> {
        self.indices[..self.len]
            .iter()
            .zip(&self.splats)
            .map(|(&index, splat)| (index as usize, splat))
    }
}
