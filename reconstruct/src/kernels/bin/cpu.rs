//! Binning on the processor: spans, then lists by counting. Splats are walked near to far, so the
//! lists come out sorted.

use std::ops::Range;

use rayon::prelude::*;

use super::{TileItem, TileLists};
use crate::{
    camera::Camera,
    kernels::{TILE, project::Splat},
};

/// Widening of footprints in pixels, against rounding in the extents.
const MARGIN: f32 = 0.01;

/// Splats per parallel piece of the counting pass.
const BATCH: usize = 4096;

/// The tiles of one splat in one row of tiles.
struct Span {
    splat: u32,
    /// Number of the first entry, counted within the batch.
    entry: u32,
    columns: [Range<u32>; 2],
}

/// The spans of some consecutive splats.
struct Batch {
    /// By row of tiles; within a row in order of the splats.
    rows: Vec<Vec<Span>>,
    /// Where each splat's entries begin, counted within the batch.
    entry_starts: Vec<u32>,
    entries: u32,
}

/// Fills `lists` for splats in the given order (near to far).
///
/// Spans are found batch by batch, then every row of tiles gathers its own: both in parallel, and
/// with the same result on any number of threads.
pub fn forward(camera: &Camera, splats: &[Splat], order: &[u32], lists: &mut TileLists) {
    let grid = Grid::new(camera);
    lists.columns = grid.columns;
    lists.rows = grid.rows;
    let batches: Vec<Batch> = order
        .par_chunks(BATCH)
        .map(|order| grid.batch(splats, order))
        .collect();
    let mut first_entries = Vec::with_capacity(batches.len());
    let mut entries = 0;
    lists.entry_starts.clear();
    for batch in &batches {
        first_entries.push(entries);
        let starts = batch.entry_starts.iter().map(|start| entries + start);
        lists.entry_starts.extend(starts);
        entries += batch.entries;
    }
    lists.entry_starts.push(entries);

    let rows: Vec<(Vec<u32>, Vec<TileItem>)> = (0..grid.rows)
        .into_par_iter()
        .map(|row| gather_row(grid.columns, row, &batches, &first_entries))
        .collect();
    lists.tile_starts.clear();
    lists.items.clear();
    for (starts, items) in rows {
        let base = lists.items.len() as u32;
        lists
            .tile_starts
            .extend(starts.iter().map(|start| base + start));
        lists.items.extend(items);
    }
    lists.tile_starts.push(entries);
}

/// The lists of one row of tiles, and where each begins.
fn gather_row(
    columns: usize,
    row: usize,
    batches: &[Batch],
    first_entries: &[u32],
) -> (Vec<u32>, Vec<TileItem>) {
    let mut next = vec![0_u32; columns];
    for span in batches.iter().flat_map(|batch| &batch.rows[row]) {
        for column in span.columns.iter().cloned().flatten() {
            next[column as usize] += 1;
        }
    }
    let mut sum = 0;
    for count in &mut next {
        sum += std::mem::replace(count, sum);
    }
    let starts = next.clone();
    let mut items = vec![TileItem::default(); sum as usize];
    for (batch, first_entry) in batches.iter().zip(first_entries) {
        for span in &batch.rows[row] {
            let entries = first_entry + span.entry..;
            for (column, entry) in span.columns.iter().cloned().flatten().zip(entries) {
                let slot = &mut next[column as usize];
                items[*slot as usize] = TileItem {
                    splat: span.splat,
                    entry,
                };
                *slot += 1;
            }
        }
    }
    (starts, items)
}

struct Grid {
    wraps: bool,
    width: f32,
    height: usize,
    columns: usize,
    rows: usize,
}

impl Grid {
    fn new(camera: &Camera) -> Self {
        let (width, height) = (camera.width() as usize, camera.height() as usize);
        Self {
            wraps: camera.wraps(),
            width: width as f32,
            height,
            columns: width.div_ceil(TILE),
            rows: height.div_ceil(TILE),
        }
    }

    fn batch(&self, splats: &[Splat], order: &[u32]) -> Batch {
        let mut batch = Batch {
            rows: (0..self.rows).map(|_| Vec::new()).collect(),
            entry_starts: Vec::with_capacity(order.len()),
            entries: 0,
        };
        for &splat in order {
            batch.entry_starts.push(batch.entries);
            for row in self.tile_rows(&splats[splat as usize]) {
                let columns = self.tile_columns(&splats[splat as usize], row);
                let tiles: u32 = columns.iter().map(|range| range.end - range.start).sum();
                if tiles > 0 {
                    batch.rows[row as usize].push(Span {
                        splat,
                        entry: batch.entries,
                        columns,
                    });
                    batch.entries += tiles;
                }
            }
        }
        batch
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
        let has_gap = end - begin < self.width;
        if !has_gap {
            return all;
        }
        if begin >= end {
            return [0..0, 0..0];
        }
        let tile = |pixel: f32| pixel as u32 / TILE as u32;
        if !self.wraps {
            let (begin, end) = (begin.max(0.0), end.min(self.width));
            if begin >= end {
                return [0..0, 0..0];
            }
            return [tile(begin)..tile(end - 1.0) + 1, 0..0];
        }
        let begin_wrapped = begin.rem_euclid(self.width);
        let end_wrapped = begin_wrapped + (end - begin);
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
