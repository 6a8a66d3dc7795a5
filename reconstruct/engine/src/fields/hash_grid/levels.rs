//! Sizes of the levels of a hash grid, and the location of their entries.

use serde::{Deserialize, Serialize};

/// Features per entry.
pub const FEATURES: usize = 4;
/// Maximum dimensions of a position.
pub const MAX_DIMENSIONS: usize = 4;
/// Factors of the hash, one per dimension (tiny-cuda-nn `common_device.h`).
pub(super) const PRIMES: [u32; MAX_DIMENSIONS] = [1, 2_654_435_761, 805_459_861, 3_674_653_429];

/// Entry read by a corner beyond a level's last cell.
///
/// A position reaches `scale + 1/2`. If the scale has a fractional part of 0 or of at least 1/2, the upper
/// corners of the last cells are one beyond the resolution.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum UpperEdge {
    /// The entry at the computed index, which is the start of the next row (tiny-cuda-nn).
    Aliased,
    /// An entry of its own: the level has one more row and column of cells.
    Own,
}

/// Sizes of a hash grid.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct HashGridShape {
    /// Dimensions of a position, 2 to 4.
    pub dimensions: usize,
    /// Number of levels, 1 or more.
    pub levels: usize,
    /// Binary logarithm of the maximum number of entries of a level.
    pub log2_entries: u32,
    /// Cells across the coarsest level.
    pub base: f64,
    /// Ratio of the cells across a level to those across the previous one.
    pub growth: f64,
    /// Entry read by corners beyond the last cells.
    pub upper_edge: UpperEdge,
}

impl HashGridShape {
    /// Creates a shape with the published base and growth (`config/encoding_config.py` of Neural Atlas
    /// Graphs) and [`UpperEdge::Own`].
    pub const fn new(dimensions: usize, levels: usize, log2_entries: u32) -> Self {
        Self {
            dimensions,
            levels,
            log2_entries,
            base: 4.0,
            growth: 1.61,
            upper_edge: UpperEdge::Own,
        }
    }
}

/// One level of a hash grid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level {
    /// Cells per unit.
    pub scale: f32,
    /// Corners across the unit.
    pub resolution: u32,
    /// Corners from one row of the table to the next.
    pub(super) stride: u32,
    /// Entries of the level.
    pub entries: u32,
    /// True if several corners share an entry.
    pub is_hashed: bool,
    /// Number of entries of all coarser levels.
    pub first_entry: usize,
}

impl Level {
    /// Returns the entry of a corner, relative to the level's first.
    #[inline]
    pub fn entry<const D: usize>(&self, corner: [u32; D]) -> u32 {
        if self.is_hashed {
            let hash = corner
                .iter()
                .zip(PRIMES)
                .fold(0_u32, |hash, (&cell, prime)| {
                    hash ^ cell.wrapping_mul(prime)
                });
            // Hashed levels have a power of two of entries.
            return hash & (self.entries - 1);
        }
        let mut index = 0_u32;
        for &cell in corner.iter().rev() {
            index = index.wrapping_mul(self.stride).wrapping_add(cell);
        }
        if index < self.entries {
            index
        } else {
            index % self.entries
        }
    }
}

/// A hash grid with its levels.
#[derive(Debug, Clone, PartialEq)]
pub struct HashGrid {
    /// Sizes.
    pub shape: HashGridShape,
    /// Levels, coarse to fine.
    pub levels: Vec<Level>,
}

impl HashGrid {
    /// Computes the levels.
    ///
    /// # Panics
    /// If there are no levels, or dimensions other than 2 to 4.
    pub fn new(shape: HashGridShape) -> Self {
        assert!(
            (2..=MAX_DIMENSIONS).contains(&shape.dimensions) && shape.levels > 0,
            "{shape:?}"
        );
        let mut first_entry = 0;
        let levels = (0..shape.levels)
            .map(|level| {
                let scale = shape.base * shape.growth.powi(level as i32) - 1.0;
                let resolution = scale.ceil() as u32 + 1;
                let stride = match shape.upper_edge {
                    UpperEdge::Aliased => resolution,
                    UpperEdge::Own => resolution + 1,
                };
                let all = f64::from(stride).powi(shape.dimensions as i32);
                let padded = (all / 8.0).ceil() * 8.0;
                let most = f64::from(1_u32 << shape.log2_entries);
                let level = Level {
                    scale: scale as f32,
                    resolution,
                    stride,
                    entries: padded.min(most) as u32,
                    is_hashed: all > padded.min(most),
                    first_entry,
                };
                first_entry += level.entries as usize;
                level
            })
            .collect();
        Self { shape, levels }
    }

    /// Returns the number of features of a position.
    pub fn features(&self) -> usize {
        FEATURES * self.levels.len()
    }

    /// Returns the number of values of the table: [`FEATURES`] for each entry, level by level.
    pub fn parameter_count(&self) -> usize {
        let entries = self.levels.last();
        FEATURES * entries.map_or(0, |level| level.first_entry + level.entries as usize)
    }

    /// Returns the number of levels for a texture of `texels` along its longer side: the finest level has
    /// about as many cells. At least 1, at most `most`.
    pub fn levels_for(texels: f64, most: usize) -> usize {
        let shape = HashGridShape::new(2, 1, 1);
        let levels = 1.0 + (texels.max(shape.base) / shape.base).ln() / shape.growth.ln();
        (levels.floor() as usize).clamp(1, most)
    }
}
