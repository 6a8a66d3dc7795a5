//! Where the rows of an elliptic footprint have pixels in a tile: found for 8 rows at once, because
//! finding it row by row takes longer than drawing the row.

use fearless_simd::{Simd, f32x8, i32x8, prelude::*};

use crate::render::raster::{
    lanes::{LANES, steps},
    shapes::LOG2_PER_Q,
    tile::{MARGIN, STRIDE, Tile, rows_of},
};
use crate::render::{
    project::{Ellipse, Splat, largest_q},
    settings::TILE,
};

/// Spans of a tile: a row needs two at most, and one is written before it is known to count.
const MOST: usize = 2 * TILE + 1;

const _: () = assert!(TILE <= 2 * LANES, "two spans do not reach across a tile");

/// At most [`LANES`] neighbouring pixels of a row.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Span {
    /// Offset of the first pixel from the middle of the ellipse's row, pixels.
    pub(super) x: f32,
    /// The first pixel's entry in a plane.
    pub(super) at: u16,
    /// The pixels' row in the tile.
    pub(super) row: u8,
}

/// The spans of one footprint in one tile, row by row.
#[derive(Debug)]
pub(super) struct Spans {
    pub(super) all: [Span; MOST],
    pub(super) len: usize,
    /// Offset from the footprint's centre by row of the tile; only rows with spans are filled in.
    pub(super) y: [f32; TILE],
    /// `log2 alpha` in the middle of the row; only rows with spans are filled in.
    pub(super) log2: [f32; TILE],
}

impl Spans {
    pub(super) fn new() -> Self {
        Self {
            all: [Span::default(); MOST],
            len: 0,
            y: [0.0; TILE],
            log2: [0.0; TILE],
        }
    }

    /// Finds the spans of a footprint.
    #[inline(always)]
    pub(super) fn find<S: Simd>(&mut self, simd: S, tile: &Tile, ellipse: &Ellipse, splat: &Splat) {
        let centre_column = tile.column(splat.centre[0]);
        let centre_row = splat.centre[1] - tile.top as f32 - 0.5;
        let q_max = f32x8::splat(simd, largest_q(splat.log2_opacity));
        let rows = rows_of(tile, splat);
        let mut len = 0;
        for half in 0..TILE / LANES {
            let first_row = half * LANES;
            let half_rows = rows.start.max(first_row)..rows.end.min(first_row + LANES);
            if half_rows.is_empty() {
                continue;
            }
            let y = steps(simd) + (first_row as f32 - centre_row);
            let row_q = y * y * ellipse.inverse_row_variance;
            let reach = ((q_max - row_q).max(0.0) * ellipse.variance).sqrt();
            let middle = y * ellipse.slope + centre_column;
            // Pixel centres are whole numbers here: offsets from the centre of the first column.
            let left = (middle - reach - MARGIN).ceil().max(0.0);
            let end = ((middle + reach + MARGIN).floor() + 1.0).min(tile.columns as f32);
            let x = (left - middle).to_array();
            let first = left.to_int::<i32x8<S>>().to_array();
            // Negative, or what a NaN becomes, where there is nothing.
            let count = (end - left).to_int::<i32x8<S>>().to_array();
            y.store_slice(&mut self.y[first_row..first_row + LANES]);
            (row_q * LOG2_PER_Q + splat.log2_opacity)
                .store_slice(&mut self.log2[first_row..first_row + LANES]);
            for row in half_rows {
                let lane = row % LANES;
                let at = ((row * STRIDE) as u16).wrapping_add(first[lane] as u16);
                // Written before it is known to count: no branch that could be mispredicted.
                self.all[len] = Span {
                    x: x[lane],
                    at,
                    row: row as u8,
                };
                len += usize::from(count[lane] > 0);
                self.all[len] = Span {
                    x: x[lane] + LANES as f32,
                    at: at.wrapping_add(LANES as u16),
                    row: row as u8,
                };
                len += usize::from(count[lane] > LANES as i32);
            }
        }
        self.len = len;
    }
}
