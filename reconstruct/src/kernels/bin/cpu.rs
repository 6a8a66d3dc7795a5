//! Binning on the processor: count, prefix sums, scatter. Splats are walked near to far, so the
//! lists come out sorted.

use std::ops::Range;

use omnilife_schemas::camera::ErpCamera;

use super::{TileItem, TileLists};
use crate::kernels::{TILE, project::Splat};

/// Widening of footprints in pixels, against rounding in the extents.
const MARGIN: f32 = 0.01;

/// Fills `lists` for splats in the given order (near to far).
pub fn forward(camera: &ErpCamera, splats: &[Splat], order: &[u32], lists: &mut TileLists) {
    let grid = Grid::new(camera);
    lists.columns = grid.columns;
    lists.rows = grid.rows;
    let mut counts = vec![0_u32; grid.columns * grid.rows];
    // The spans of every splat are found once and kept for the scatter.
    let mut spans: Vec<(u32, [Range<u32>; 2])> = Vec::with_capacity(2 * order.len());
    let mut span_starts = Vec::with_capacity(order.len() + 1);
    lists.entry_starts.clear();
    let mut entries = 0;
    for &position in order {
        span_starts.push(spans.len());
        lists.entry_starts.push(entries);
        let splat = &splats[position as usize];
        for row in grid.tile_rows(splat) {
            let columns = grid.tile_columns(splat, row);
            for column in columns.iter().cloned().flatten() {
                counts[row as usize * grid.columns + column as usize] += 1;
                entries += 1;
            }
            spans.push((row, columns));
        }
    }
    span_starts.push(spans.len());
    lists.entry_starts.push(entries);

    lists.tile_starts.clear();
    let mut sum = 0;
    for count in &mut counts {
        lists.tile_starts.push(sum);
        sum += std::mem::replace(count, sum);
    }
    lists.tile_starts.push(sum);
    lists.items.clear();
    lists.items.resize(sum as usize, TileItem::default());
    let mut entry = 0;
    for (rank, &splat) in order.iter().enumerate() {
        for (row, columns) in &spans[span_starts[rank]..span_starts[rank + 1]] {
            for column in columns.iter().cloned().flatten() {
                let slot = &mut counts[*row as usize * grid.columns + column as usize];
                lists.items[*slot as usize] = TileItem { splat, entry };
                *slot += 1;
                entry += 1;
            }
        }
    }
}

struct Grid {
    width: f32,
    height: usize,
    columns: usize,
    rows: usize,
}

impl Grid {
    fn new(camera: &ErpCamera) -> Self {
        let (width, height) = (camera.width as usize, camera.height as usize);
        Self {
            width: width as f32,
            height,
            columns: width.div_ceil(TILE),
            rows: height.div_ceil(TILE),
        }
    }

    /// Rows of tiles with a pixel centre inside the footprint's height.
    fn tile_rows(&self, splat: &Splat) -> Range<u32> {
        let extent = splat.extent[1] + MARGIN;
        let first = (splat.centre[1] - extent - 0.5).ceil().max(0.0) as usize;
        let last = (splat.centre[1] + extent - 0.5).floor();
        if last < 0.0 || first >= self.height {
            return 0..0;
        }
        let last = (last as usize).min(self.height - 1);
        if first > last {
            return 0..0;
        }
        (first / TILE) as u32..(last / TILE + 1) as u32
    }

    /// Columns of tiles of one row of tiles, as up to two disjoint ranges.
    fn tile_columns(&self, splat: &Splat, tile_row: u32) -> [Range<u32>; 2] {
        let all = [0..self.columns as u32, 0..0];
        let top = (tile_row as usize * TILE) as f32 + 0.5 - splat.centre[1];
        let bottom_row = ((tile_row as usize + 1) * TILE).min(self.height);
        let bottom = bottom_row as f32 - 0.5 - splat.centre[1];
        let (left, right) = ellipse_columns(splat, top, bottom);
        let begin = (splat.centre[0] + left - MARGIN - 0.5).ceil();
        let end = (splat.centre[0] + right + MARGIN - 0.5).floor() + 1.0;
        // Written so that a NaN takes the safe side.
        if !(end - begin < self.width) {
            return all;
        }
        if begin >= end {
            return [0..0, 0..0];
        }
        let begin_wrapped = begin.rem_euclid(self.width);
        let end_wrapped = begin_wrapped + (end - begin);
        let tile = |pixel: f32| pixel as u32 / TILE as u32;
        if end_wrapped <= self.width {
            return [tile(begin_wrapped)..tile(end_wrapped - 1.0) + 1, 0..0];
        }
        let first = tile(begin_wrapped)..self.columns as u32;
        let second = 0..tile(end_wrapped - self.width - 1.0) + 1;
        if second.end >= first.start {
            return all;
        }
        [first, second]
    }
}

/// Leftmost and rightmost offset from the centre of the ellipse `q <= q_max` between the row
/// offsets `top` and `bottom`.
///
/// At row offset `y` the ellipse spans `b/c y +- sqrt(det/c (q_max - y^2/c))` with the covariance
/// `[[a, b], [b, c]]` (the conditional Gaussian of a row); each side is concave in `y`.
fn ellipse_columns(splat: &Splat, top: f32, bottom: f32) -> (f32, f32) {
    let [a, b, c] = splat.covariance;
    let [extent_u, extent_v] = splat.extent;
    let slope = b / c;
    // det / c = 1 / conic.a
    let variance = 1.0 / splat.conic[0];
    let side = |y: f32, sign: f32| {
        let y = y.clamp(-extent_v, extent_v);
        slope * y + sign * (variance * (splat.q_max - y * y / c).max(0.0)).sqrt()
    };
    // The row offset of the rightmost point of the whole ellipse; the leftmost is its mirror image.
    let y_right = b / a * extent_u;
    let right = if (top..=bottom).contains(&y_right) {
        extent_u
    } else {
        side(top, 1.0).max(side(bottom, 1.0))
    };
    let left = if (top..=bottom).contains(&-y_right) {
        -extent_u
    } else {
        side(top, -1.0).min(side(bottom, -1.0))
    };
    (left, right)
}
