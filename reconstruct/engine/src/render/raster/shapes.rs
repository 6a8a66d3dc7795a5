//! The two shapes of a footprint on a tile: `log2 alpha` in its pixels, and the sums for the gradient of the
//! shape.
//!
//! A row of a tile is two vectors. Those of the left half are visited before those of the right; a half
//! outside the footprint's rectangle is skipped.

use std::ops::Range;

use fearless_simd::{Simd, f32x8, prelude::*};

use crate::render::raster::{
    lanes::{LANES, load, steps, store, transposed_sums},
    tile::{MARGIN, Tile, rows_of},
};
use crate::{
    camera::rays::Rays,
    render::{
        project::{Cone, ConeGradient, Ellipse, Splat, SplatGradient, largest_q},
        settings::TILE,
    },
};

/// `log2(exp(-q/2)) / q`.
const LOG2_PER_Q: f32 = -0.5 * std::f32::consts::LOG2_E;

const _: () = assert!(TILE == 2 * LANES, "a row of a tile is two vectors");

/// Eight pixels of a footprint, and the index of their plane entries.
#[derive(Clone, Copy)]
pub(super) struct Block<S: Simd, G> {
    pub(super) at: usize,
    /// `log2 alpha`, not clamped.
    pub(super) log2_alpha: f32x8<S>,
    pub(super) geometry: G,
}

/// Iteration of the rasterizer over a shape. The order of blocks is the same in every pass.
pub(super) trait Walk<S: Simd> {
    /// Values of a block that the gradient needs.
    type Geometry: Copy;
    /// Sums over blocks, per lane.
    type Sums;

    /// Calls `visit` with the blocks that may hold pixels of the footprint.
    fn walk(
        &self,
        simd: S,
        tile: &Tile,
        rays: &Rays,
        splat: &Splat,
        visit: impl FnMut(Block<S, Self::Geometry>),
    );

    fn zero(simd: S) -> Self::Sums;

    /// Adds `dL/d(ln alpha)` of a block to the sums.
    fn add(&self, sums: &mut Self::Sums, geometry: &Self::Geometry, by_log: f32x8<S>);
}

/// Sums over the blocks of a footprint, per lane.
pub(super) struct EntrySums<S: Simd, T> {
    pub(super) shape: T,
    pub(super) by_log: f32x8<S>,
    pub(super) colour: [f32x8<S>; 3],
}

/// Returns the halves of the tile with a pixel centre between two offsets from the first column's.
#[inline(always)]
fn halves(tile: &Tile, left: f32, right: f32) -> Range<usize> {
    let last = (tile.columns - 1) as f32;
    let (left, right) = (left - MARGIN, right + MARGIN);
    // NaN bounds fail the comparison, and both halves are drawn.
    if right < 0.0 || left > last {
        return 0..0;
    }
    let first = usize::from(left > (LANES - 1) as f32);
    let is_in_left_half = right < LANES as f32 || tile.columns <= LANES;
    first..2 - usize::from(is_in_left_half)
}

/// Returns the index in a plane at which a half of a row begins. The remainders have no effect, but allow the
/// compiler to remove bounds checks.
#[inline(always)]
fn entry(row: usize, half: usize) -> usize {
    row % TILE * TILE + half % 2 * LANES
}

/// Offset along the row from the row's mean, and offset in rows from the centre.
#[derive(Clone, Copy)]
pub(super) struct EllipsePixels<S: Simd> {
    x: f32x8<S>,
    y: f32,
}

/// Values shared by the pixels of a row of an ellipse, for all rows of a tile.
struct RowTable {
    /// Offset from the centre, rows.
    y: [f32; TILE],
    /// Offset of the row's mean from the centre, columns.
    shift: [f32; TILE],
    /// `log2 alpha` at the row's mean.
    log2: [f32; TILE],
}

impl RowTable {
    #[inline(always)]
    fn new<S: Simd>(simd: S, tile: &Tile, ellipse: &Ellipse, splat: &Splat) -> Self {
        let centre_row = splat.centre[1] - tile.top as f32 - 0.5;
        let mut table = Self {
            y: [0.0; TILE],
            shift: [0.0; TILE],
            log2: [0.0; TILE],
        };
        let log2_opacity = f32x8::splat(simd, splat.log2_opacity);
        for first in (0..TILE).step_by(LANES) {
            let y = steps(simd) + (first as f32 - centre_row);
            store(y, &mut table.y, first);
            store(y * ellipse.slope, &mut table.shift, first);
            let per_square = ellipse.inverse_row_variance * LOG2_PER_Q;
            store(
                (y * y).mul_add(per_square, log2_opacity),
                &mut table.log2,
                first,
            );
        }
        table
    }
}

/// Moments of `dL/d(ln alpha)`.
pub(super) struct EllipseSums<S: Simd> {
    x: f32x8<S>,
    xx: f32x8<S>,
    xy: f32x8<S>,
    y: f32x8<S>,
    yy: f32x8<S>,
}

impl<S: Simd> Walk<S> for Ellipse {
    type Geometry = EllipsePixels<S>;
    type Sums = EllipseSums<S>;

    #[inline(always)]
    fn walk(
        &self,
        simd: S,
        tile: &Tile,
        _rays: &Rays,
        splat: &Splat,
        mut visit: impl FnMut(Block<S, Self::Geometry>),
    ) {
        let centre_column = tile.column(splat.centre[0]);
        let table = RowTable::new(simd, tile, self, splat);
        let per_square = f32x8::splat(simd, self.inverse_variance * LOG2_PER_Q);
        let rows = rows_of(tile, splat);
        let half_width = splat.extent[0];
        for half in halves(tile, centre_column - half_width, centre_column + half_width) {
            let columns = steps(simd) + ((half * LANES) as f32 - centre_column);
            for row in rows.clone() {
                let in_table = row % TILE;
                let x = columns - table.shift[in_table];
                let row_log2 = f32x8::splat(simd, table.log2[in_table]);
                visit(Block {
                    at: entry(row, half),
                    log2_alpha: (x * x).mul_add(per_square, row_log2),
                    geometry: EllipsePixels {
                        x,
                        y: table.y[in_table],
                    },
                });
            }
        }
    }

    #[inline(always)]
    fn zero(simd: S) -> Self::Sums {
        let zero = f32x8::splat(simd, 0.0);
        EllipseSums {
            x: zero,
            xx: zero,
            xy: zero,
            y: zero,
            yy: zero,
        }
    }

    #[inline(always)]
    fn add(&self, sums: &mut Self::Sums, pixels: &Self::Geometry, by_log: f32x8<S>) {
        let by_log_x = by_log * pixels.x;
        let by_log_y = by_log * pixels.y;
        sums.x += by_log_x;
        sums.y += by_log_y;
        sums.xx = by_log_x.mul_add(pixels.x, sums.xx);
        sums.xy = by_log_y.mul_add(pixels.x, sums.xy);
        sums.yy = by_log_y.mul_add(pixels.y, sums.yy);
    }
}

impl Ellipse {
    /// Returns the gradient of an entry.
    ///
    /// `ln alpha = const - q/2`, `q = x^2 a + y^2 c` with `x = dx - slope dy`, `y = dy`.
    #[inline(always)]
    pub(super) fn gradient<S: Simd>(&self, sums: EntrySums<S, EllipseSums<S>>) -> SplatGradient {
        let EllipseSums { x, xx, xy, y, yy } = sums.shape;
        let [red, green, blue] = sums.colour;
        let [x, xx, xy, y, yy, red, green, blue] =
            transposed_sums([x, xx, xy, y, yy, red, green, blue]);
        let (x, y) = (self.inverse_variance * x, self.inverse_row_variance * y);
        SplatGradient {
            ellipse: [
                x,
                y - self.slope * x,
                -0.5 * xx,
                self.inverse_variance * xy,
                -0.5 * yy,
            ],
            log_opacity: sums.by_log.reduce_sum(),
            colour: [red, green, blue],
        }
    }
}

/// Rays of a block, and the terms of `q` there.
#[derive(Clone, Copy)]
pub(super) struct ConePixels<S: Simd> {
    x: f32x8<S>,
    z: f32x8<S>,
    scale: f32,
    y: f32,
    across: [f32x8<S>; 2],
    along: f32x8<S>,
    n: f32x8<S>,
    /// `l^2 + eps N`.
    denominator: f32x8<S>,
}

/// Sums of `dL/d(ln alpha)` times derivatives of `-q/2`, times the ray.
pub(super) struct ConeSums<S: Simd> {
    vectors: [[f32x8<S>; 3]; 3],
    depth_variance: f32x8<S>,
}

impl<S: Simd> Walk<S> for Cone {
    type Geometry = ConePixels<S>;
    type Sums = ConeSums<S>;

    #[inline(always)]
    fn walk(
        &self,
        simd: S,
        tile: &Tile,
        rays: &Rays,
        splat: &Splat,
        mut visit: impl FnMut(Block<S, Self::Geometry>),
    ) {
        let halves = if tile.is_surrounded(splat.extent[0]) {
            0..2
        } else {
            let centre = tile.column(splat.centre[0]);
            halves(tile, centre - splat.extent[0], centre + splat.extent[0])
        };
        let splat_value = |value: f32| f32x8::splat(simd, value);
        let q_max = splat_value(largest_q(splat.log2_opacity) * (1.0 + 1e-4));
        let log2_opacity = splat_value(splat.log2_opacity);
        let per_q = splat_value(LOG2_PER_Q);
        for row in rows_of(tile, splat) {
            let (scale, y) = (rays.scale[tile.top + row], rays.y[tile.top + row]);
            let row_form = |f: glam::Vec3| {
                (
                    splat_value(scale * f.x),
                    splat_value(y * f.y),
                    splat_value(scale * f.z),
                )
            };
            let forms = [
                row_form(self.across[0]),
                row_form(self.across[1]),
                row_form(self.along),
            ];
            for half in halves.clone() {
                let column = tile.left + half * LANES;
                let x = load(simd, &rays.x, column);
                let z = load(simd, &rays.z, column);
                let dot =
                    |(fx, fy, fz): (f32x8<S>, f32x8<S>, f32x8<S>)| x.mul_add(fx, z.mul_add(fz, fy));
                let across = [dot(forms[0]), dot(forms[1])];
                let along = dot(forms[2]).max(0.0);
                let n = across[0].mul_add(across[0], across[1] * across[1]);
                let denominator = n.mul_add(splat_value(self.depth_variance), along * along);
                if n.simd_le(denominator * q_max).any_true() {
                    visit(Block {
                        at: entry(row, half),
                        log2_alpha: (n / denominator).mul_add(per_q, log2_opacity),
                        geometry: ConePixels {
                            x,
                            z,
                            scale,
                            y,
                            across,
                            along,
                            n,
                            denominator,
                        },
                    });
                }
            }
        }
    }

    #[inline(always)]
    fn zero(simd: S) -> Self::Sums {
        let zero = f32x8::splat(simd, 0.0);
        ConeSums {
            vectors: [[zero; 3]; 3],
            depth_variance: zero,
        }
    }

    /// Adds derivatives; with `D = l^2 + eps N`: `dq/dN = l^2 / D^2`, `dq/dl = -2 l N / D^2`,
    /// `dq/deps = -N^2 / D^2`.
    #[inline(always)]
    fn add(&self, sums: &mut Self::Sums, pixels: &Self::Geometry, by_log: f32x8<S>) {
        let square = pixels.denominator * pixels.denominator;
        // Outside of the footprint the denominator may vanish; the gradient is 0 there.
        let is_nothing = by_log.simd_eq(0.0);
        let by_square = is_nothing.select(by_log, by_log / square);
        let by_ln = by_square * pixels.n * pixels.along;
        let by_n_twice = by_square * pixels.along * pixels.along;
        let factors = [
            -(by_n_twice * pixels.across[0]),
            -(by_n_twice * pixels.across[1]),
            by_ln,
        ];
        for (sums, factor) in sums.vectors.iter_mut().zip(factors) {
            let scaled = factor * pixels.scale;
            sums[0] = scaled.mul_add(pixels.x, sums[0]);
            sums[1] += factor * pixels.y;
            sums[2] = scaled.mul_add(pixels.z, sums[2]);
        }
        sums.depth_variance += by_square * pixels.n * pixels.n * 0.5;
    }
}

/// Returns the gradients of an entry: by opacity and colour, and by the cone.
#[inline(always)]
pub(super) fn cone_gradients<S: Simd>(
    sums: EntrySums<S, ConeSums<S>>,
) -> (SplatGradient, ConeGradient) {
    let [first, second, along] = sums.shape.vectors;
    let [red, green, blue] = sums.colour;
    let (depth, by_log) = (sums.shape.depth_variance, sums.by_log);
    let zero = f32x8::splat(depth.simd, 0.0);
    let across = transposed_sums([
        first[0], first[1], first[2], second[0], second[1], second[2], along[0], along[1],
    ]);
    let [along, depth, log_opacity, red, green, blue, ..] =
        transposed_sums([along[2], depth, by_log, red, green, blue, zero, zero]);
    let mut by_cone = [0.0; 10];
    by_cone[..8].copy_from_slice(&across);
    by_cone[8..].copy_from_slice(&[along, depth]);
    let splat = SplatGradient {
        ellipse: [0.0; 5],
        log_opacity,
        colour: [red, green, blue],
    };
    (splat, by_cone)
}
