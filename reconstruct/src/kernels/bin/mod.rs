//! Binning: for every tile, the splats whose footprint touches one of its pixel centres, near to
//! far.
//!
//! The image is covered by `ceil(W/16) x ceil(H/16)` tiles. Columns wrap at the seam: a footprint
//! that leaves on the right enters on the left. A tile is listed once for a splat, however wide the
//! footprint is. For every row of tiles the columns are those of the ellipse `q <= q_max` within
//! the row's pixel centres, not of its bounding box.
//!
//! Every (splat, tile) pair is an *entry*. Entries are numbered splat by splat, so that the
//! backward pass can sum a splat's gradients over its tiles in a fixed order: results do not depend
//! on the number of threads.

pub mod cpu;

/// Tile lists of one view.
#[derive(Debug, Default)]
pub struct TileLists {
    /// Tiles per row.
    pub columns: usize,
    /// Rows of tiles.
    pub rows: usize,
    /// Where each tile's list begins in `items`; one more entry closes the last.
    pub tile_starts: Vec<u32>,
    /// All lists one after another.
    pub items: Vec<TileItem>,
    /// For each splat, in order of distance, where its entries begin; one more closes the last.
    pub entry_starts: Vec<u32>,
}

/// A splat in a tile's list.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TileItem {
    /// Position of the splat in the projection's output.
    pub splat: u32,
    /// Number of the (splat, tile) pair.
    pub entry: u32,
}
