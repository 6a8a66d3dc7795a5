//! The two shapes of a footprint on a tile: where they have pixels, `log2 alpha` there, and the
//! sums that become the gradient of the shape.

use std::ops::Range;

use fearless_simd::{Simd, f32x8, prelude::*};

use crate::render::raster::{
    lanes::{LANES, load, steps},
    spans::Spans,
    tile::{MARGIN, STRIDE, Tile, rows_of},
};
use crate::{
    camera::rays::Rays,
    render::{
        project::{Cone, Ellipse, Splat, largest_q},
        settings::TILE,
    },
};

/// `log2(exp(-q/2)) / q`.
pub(super) const LOG2_PER_Q: f32 = -0.5 * std::f32::consts::LOG2_E;

/// Eight pixels of a footprint, and where their plane entries begin.
#[derive(Clone, Copy)]
pub(super) struct Block<S: Simd, G> {
    pub(super) at: usize,
    /// `log2 alpha`, not clamped.
    pub(super) log2_alpha: f32x8<S>,
    pub(super) geometry: G,
}

/// A shape as the rasterizer walks it. The order of blocks is the same in every pass.
pub(super) trait Walk<S: Simd> {
    /// What the gradient needs of a block.
    type Geometry: Copy;
    /// Sums over blocks, per lane.
    type Sums;

    /// Calls `visit` with the blocks that may hold pixels of the footprint. `spans` is memory to
    /// work in.
    fn walk(
        &self,
        simd: S,
        tile: &Tile,
        rays: &Rays,
        splat: &Splat,
        spans: &mut Spans,
        visit: impl FnMut(Block<S, Self::Geometry>),
    );

    fn zero(simd: S) -> Self::Sums;

    /// Adds `dL/d(ln alpha)` of a block.
    fn add(&self, sums: &mut Self::Sums, geometry: &Self::Geometry, by_log: f32x8<S>);

    /// The gradient by the shape ([`crate::render::project::SplatGradient::shape`]).
    fn gradient(&self, sums: &Self::Sums) -> [f32; 10];
}

/// Columns of the tile with centres between two offsets.
#[inline(always)]
fn columns_of(tile: &Tile, left: f32, right: f32) -> Range<usize> {
    let first = (left - MARGIN).ceil().max(0.0) as usize;
    let end = ((right + MARGIN).floor() + 1.0).max(0.0) as usize;
    first..end.min(tile.columns)
}

/// Offset along the row from the row's middle, and offset in rows from the centre.
#[derive(Clone, Copy)]
pub(super) struct EllipsePixels<S: Simd> {
    x: f32x8<S>,
    y: f32,
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
        spans: &mut Spans,
        mut visit: impl FnMut(Block<S, Self::Geometry>),
    ) {
        spans.find(simd, tile, self, splat);
        let steps = steps(simd);
        let per_square = f32x8::splat(simd, self.inverse_variance * LOG2_PER_Q);
        for span in &spans.all[..spans.len] {
            let row = usize::from(span.row) % TILE;
            let row_log2 = f32x8::splat(simd, spans.log2[row]);
            let x = steps + span.x;
            visit(Block {
                // Never more than that; written out, the compiler leaves out checks of bounds.
                at: usize::from(span.at).min(TILE * STRIDE - LANES),
                log2_alpha: (x * x).mul_add(per_square, row_log2),
                geometry: EllipsePixels { x, y: spans.y[row] },
            });
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

    /// `ln alpha = const - q/2`, `q = x^2 a + y^2 c` with `x = dx - slope dy`, `y = dy`.
    #[inline(always)]
    fn gradient(&self, sums: &Self::Sums) -> [f32; 10] {
        let (a, c) = (self.inverse_variance, self.inverse_row_variance);
        let (x, y) = (a * sums.x.reduce_sum(), c * sums.y.reduce_sum());
        let mut gradient = [0.0; 10];
        gradient[..5].copy_from_slice(&[
            x,
            y - self.slope * x,
            -0.5 * sums.xx.reduce_sum(),
            a * sums.xy.reduce_sum(),
            -0.5 * sums.yy.reduce_sum(),
        ]);
        gradient
    }
}

/// The rays of a block and what `q` is made of there.
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
        _spans: &mut Spans,
        mut visit: impl FnMut(Block<S, Self::Geometry>),
    ) {
        let columns = if tile.is_surrounded(splat.extent[0]) {
            0..tile.columns
        } else {
            let centre = tile.column(splat.centre[0]);
            columns_of(tile, centre - splat.extent[0], centre + splat.extent[0])
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
            let mut column = columns.start;
            while column < columns.end {
                let x = load(simd, &rays.x, tile.left + column);
                let z = load(simd, &rays.z, tile.left + column);
                let dot =
                    |(fx, fy, fz): (f32x8<S>, f32x8<S>, f32x8<S>)| x.mul_add(fx, z.mul_add(fz, fy));
                let across = [dot(forms[0]), dot(forms[1])];
                let along = dot(forms[2]).max(0.0);
                let n = across[0].mul_add(across[0], across[1] * across[1]);
                let denominator = n.mul_add(splat_value(self.depth_variance), along * along);
                if n.simd_le(denominator * q_max).any_true() {
                    visit(Block {
                        at: row * STRIDE + column,
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
                column += LANES;
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

    /// With `D = l^2 + eps N`: `dq/dN = l^2 / D^2`, `dq/dl = -2 l N / D^2`, `dq/deps = -N^2 / D^2`.
    #[inline(always)]
    fn add(&self, sums: &mut Self::Sums, pixels: &Self::Geometry, by_log: f32x8<S>) {
        let square = pixels.denominator * pixels.denominator;
        // Outside of the footprint the denominator may vanish; nothing counts there.
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

    #[inline(always)]
    fn gradient(&self, sums: &Self::Sums) -> [f32; 10] {
        let mut gradient = [0.0; 10];
        for (vector, sums) in gradient.chunks_exact_mut(3).zip(&sums.vectors) {
            for (value, sum) in vector.iter_mut().zip(sums) {
                *value = sum.reduce_sum();
            }
        }
        gradient[9] = sums.depth_variance.reduce_sum();
        gradient
    }
}
