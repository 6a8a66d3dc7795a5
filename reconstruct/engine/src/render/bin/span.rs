//! Tiles that a footprint touches.

use std::ops::Range;

use glam::Vec3;

use crate::{
    camera::rays::Rays,
    render::{
        project::{Cone, Ellipse, Shape, Splat, largest_q},
        settings::TILE,
    },
};

/// Widening of footprints, pixels, against rounding in the extents.
const MARGIN: f32 = 0.01;

/// The tiles of an image.
#[derive(Debug)]
pub(super) struct Grid {
    wraps: bool,
    width: f32,
    height: usize,
    pub(super) columns: usize,
    pub(super) rows: usize,
    /// Ray at the centre of each tile, and largest distance of its pixels' rays from it.
    middles: Vec<(Vec3, f32)>,
}

impl Grid {
    pub(super) fn new(rays: &Rays) -> Self {
        let camera = &rays.camera;
        let (width, height) = (camera.width() as usize, camera.height() as usize);
        let (columns, rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
        let mut middles = Vec::with_capacity(columns * rows);
        for row in 0..rows {
            let (top, bottom) = (row * TILE, ((row + 1) * TILE).min(height) - 1);
            for column in 0..columns {
                let (left, right) = (column * TILE, ((column + 1) * TILE).min(width) - 1);
                let middle = rays.ray(usize::midpoint(left, right), usize::midpoint(top, bottom));
                // The farthest pixel of a tile is a corner, unless the tile spans a third of the sphere.
                let is_narrow = (right - left) * 3 < width || !camera.wraps();
                let radius = if is_narrow {
                    [(left, top), (right, top), (left, bottom), (right, bottom)]
                        .map(|(column, row)| rays.ray(column, row).distance(middle))
                        .into_iter()
                        .fold(0.0, f32::max)
                } else {
                    2.0
                };
                middles.push((middle, radius * 1.001 + 1e-6));
            }
        }
        Self {
            wraps: camera.wraps(),
            width: width as f32,
            height,
            columns,
            rows,
            middles,
        }
    }

    /// Calls `visit` with every tile that the footprint touches; `cone` is read for a splat of that shape
    /// only.
    #[inline(always)]
    pub(super) fn for_each_tile<'a>(
        &self,
        splat: &Splat,
        cone: impl FnOnce() -> &'a Cone,
        mut visit: impl FnMut(u32),
    ) {
        match &splat.shape {
            Shape::Ellipse(ellipse) => {
                let q_max = largest_q(splat.log2_opacity);
                for row in self.tile_rows(splat) {
                    let first = row * self.columns as u32;
                    let [left, right] = self.row_of_ellipse(splat, ellipse, q_max, row);
                    for column in left.chain(right) {
                        visit(first + column);
                    }
                }
            }
            Shape::Cone => {
                let cone = cone();
                let reach = Reach::new(cone, largest_q(splat.log2_opacity));
                let [left, right] =
                    self.tile_columns(splat.centre[0], -splat.extent[0], splat.extent[0]);
                for row in self.tile_rows(splat) {
                    let first = row * self.columns as u32;
                    for column in left.clone().chain(right.clone()) {
                        let tile = first + column;
                        if reach.touches(cone, &self.middles[tile as usize]) {
                            visit(tile);
                        }
                    }
                }
            }
        }
    }

    /// Returns the rows of tiles with a pixel centre inside the footprint's height.
    #[inline(always)]
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

    #[inline(always)]
    fn row_of_ellipse(
        &self,
        splat: &Splat,
        ellipse: &Ellipse,
        q_max: f32,
        tile_row: u32,
    ) -> [Range<u32>; 2] {
        let top = (tile_row as usize * TILE) as f32 + 0.5 - splat.centre[1];
        let bottom_row = ((tile_row as usize + 1) * TILE).min(self.height);
        let bottom = bottom_row as f32 - 0.5 - splat.centre[1];
        let (left, right) = ellipse_columns(splat.extent, ellipse, q_max, top, bottom);
        self.tile_columns(splat.centre[0], left, right)
    }

    /// Returns the columns of tiles with a pixel centre between two offsets from a centre, as up to two
    /// disjoint ranges.
    #[inline(always)]
    fn tile_columns(&self, centre: f32, left: f32, right: f32) -> [Range<u32>; 2] {
        let all = [0..self.columns as u32, 0..0];
        let begin = (centre + left - MARGIN - 0.5).ceil();
        let end = (centre + right + MARGIN - 0.5).floor() + 1.0;
        let tile = |pixel: f32| pixel as u32 / TILE as u32;
        if !self.wraps {
            let (begin, end) = (begin.max(0.0), end.min(self.width));
            if begin >= end {
                return [0..0, 0..0];
            }
            return [tile(begin)..tile(end - 1.0) + 1, 0..0];
        }
        // NaN fails the comparison and takes the safe side.
        let has_gap = end - begin < self.width;
        if !has_gap {
            return all;
        }
        if begin >= end {
            return [0..0, 0..0];
        }
        // The range is narrower than the image, and its centre is inside: it wraps at most once.
        let begin_wrapped = if begin < 0.0 {
            begin + self.width
        } else if begin >= self.width {
            begin - self.width
        } else {
            begin
        };
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

/// Returns the leftmost and rightmost offset from the centre of the ellipse `q <= q_max` between the row
/// offsets `top` and `bottom`.
///
/// At row offset `y` the ellipse spans `slope y +- sqrt(variance (q_max - y^2 / C))` (the conditional
/// Gaussian of a row); each side is concave in `y`.
#[inline(always)]
fn ellipse_columns(
    extent: [f32; 2],
    ellipse: &Ellipse,
    q_max: f32,
    top: f32,
    bottom: f32,
) -> (f32, f32) {
    let [extent_u, extent_v] = extent;
    let row = ellipse.inverse_row_variance;
    let side = |y: f32, sign: f32| {
        let y = y.clamp(-extent_v, extent_v);
        let rest = (q_max - y * y * row).max(0.0);
        ellipse.slope * y + sign * (ellipse.variance * rest).sqrt()
    };
    // Row offset of the rightmost point of the whole ellipse, B/A extent_u, with B = slope C and A =
    // extent_u^2 / q_max; the leftmost is its mirror image.
    let y_right = ellipse.slope * q_max / (row * extent_u);
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

/// Reach of a cone: its footprint is where `sqrt(N) - root l <= 0`, and that changes by no more than
/// `steepness` per unit of the ray.
struct Reach {
    /// `sqrt(q')`; negative if the footprint is everywhere.
    root: f32,
    steepness: f32,
}

impl Reach {
    fn new(cone: &Cone, q_max: f32) -> Self {
        let root = cone.largest_ratio(q_max).map_or(-1.0, f32::sqrt);
        let [f1, f2] = cone.across;
        Self {
            root,
            steepness: (f1.length_squared() + f2.length_squared()).sqrt()
                + root * cone.along.length(),
        }
    }

    fn touches(&self, cone: &Cone, (middle, radius): &(Vec3, f32)) -> bool {
        if self.root < 0.0 {
            return true;
        }
        let [w1, w2] = cone.across.map(|f| f.dot(*middle));
        let excess = (w1 * w1 + w2 * w2).sqrt() - self.root * cone.along.dot(*middle);
        excess <= self.steepness * radius
    }
}
