//! Geometry of 8 points at once. Lanes are independent: the result for a point does not depend on its
//! neighbours.

use std::f32::consts::{FRAC_PI_2, PI};

use fearless_simd::{Simd, f32x8, prelude::*};
use glam::{Mat3, Vec3, vec3};

/// Points processed at once.
pub(crate) const LANES: usize = 8;

/// Eight vectors.
#[derive(Clone, Copy)]
pub(crate) struct Vec3x8<S: Simd> {
    pub(crate) x: f32x8<S>,
    pub(crate) y: f32x8<S>,
    pub(crate) z: f32x8<S>,
}

impl<S: Simd> Vec3x8<S> {
    /// Gathers one vector per lane.
    #[inline(always)]
    pub(crate) fn gather(simd: S, rows: &[[f32; 3]; LANES]) -> Self {
        let axis = |axis: usize| f32x8::simd_from(simd, rows.map(|row| row[axis]));
        Self {
            x: axis(0),
            y: axis(1),
            z: axis(2),
        }
    }

    /// Returns the vectors, one per lane.
    #[inline(always)]
    pub(crate) fn scatter(self) -> [[f32; 3]; LANES] {
        let [x, y, z]: [[f32; LANES]; 3] = [self.x.into(), self.y.into(), self.z.into()];
        std::array::from_fn(|lane| [x[lane], y[lane], z[lane]])
    }

    pub(crate) fn lane(&self, lane: usize) -> Vec3 {
        vec3(self.x[lane], self.y[lane], self.z[lane])
    }

    #[inline(always)]
    pub(crate) fn plus(self, other: Self) -> Self {
        Self {
            x: self.x + other.x,
            y: self.y + other.y,
            z: self.z + other.z,
        }
    }

    #[inline(always)]
    pub(crate) fn times(self, factor: f32x8<S>) -> Self {
        Self {
            x: self.x * factor,
            y: self.y * factor,
            z: self.z * factor,
        }
    }

    /// Returns `self factor + other`.
    #[inline(always)]
    pub(crate) fn times_plus(self, factor: f32x8<S>, other: Self) -> Self {
        Self {
            x: self.x.mul_add(factor, other.x),
            y: self.y.mul_add(factor, other.y),
            z: self.z.mul_add(factor, other.z),
        }
    }

    #[inline(always)]
    pub(crate) fn dot(self, other: Self) -> f32x8<S> {
        let xy = self.x.mul_add(other.x, self.y * other.y);
        self.z.mul_add(other.z, xy)
    }

    #[inline(always)]
    pub(crate) fn length_squared(self) -> f32x8<S> {
        self.dot(self)
    }

    #[inline(always)]
    pub(crate) fn cross(self, other: Self) -> Self {
        Self {
            x: self.y * other.z - self.z * other.y,
            y: self.z * other.x - self.x * other.z,
            z: self.x * other.y - self.y * other.x,
        }
    }

    /// Returns `matrix self`.
    #[inline(always)]
    pub(crate) fn transformed(self, matrix: &Mat3) -> Self {
        let row = |row: Vec3| {
            let xy = self.x.mul_add(row.x, self.y * row.y);
            self.z.mul_add(row.z, xy)
        };
        Self {
            x: row(matrix.row(0)),
            y: row(matrix.row(1)),
            z: row(matrix.row(2)),
        }
    }
}

/// Returns the distance from the vertical axis, as [`crate::camera::horizontal`].
#[inline(always)]
pub(crate) fn horizontal<S: Simd>(point: Vec3x8<S>) -> f32x8<S> {
    point.x.mul_add(point.x, point.z * point.z).sqrt()
}

/// Returns the angle of `(x, y)` from the first axis, in [-pi, pi], to 2 units in the last place of pi; 0
/// where both are 0.
#[inline(always)]
pub(crate) fn atan2<S: Simd>(y: f32x8<S>, x: f32x8<S>) -> f32x8<S> {
    const TAN_EIGHTH: f32 = 0.414_213_56;
    let simd = y.simd;
    let zero = f32x8::splat(simd, 0.0);
    let (ax, ay) = (x.abs(), y.abs());
    let (small, large) = (ax.min(ay), ax.max(ay));
    let t = large.simd_gt(0.0).select(small / large, zero);
    // Above pi / 8: atan t = pi / 4 + atan((t - 1) / (t + 1)).
    let is_beyond = t.simd_gt(TAN_EIGHTH);
    let t = is_beyond.select((t - 1.0) / (t + 1.0), t);
    let square = t * t;
    // Odd minimax polynomial of degree 9 on [0, tan(pi / 8)] (Cephes, `atanf`).
    let coefficient = |value: f32| f32x8::splat(simd, value);
    let p = coefficient(8.053_744_5e-2)
        .mul_add(square, coefficient(-0.138_776_86))
        .mul_add(square, coefficient(0.199_777_11))
        .mul_add(square, coefficient(-0.333_329_5));
    let angle = (p * square).mul_add(t, t);
    let angle = is_beyond.select(angle + 0.5 * FRAC_PI_2, angle);
    let angle = ay.simd_gt(ax).select(-angle + FRAC_PI_2, angle);
    let angle = x.simd_lt(0.0).select(-angle + PI, angle);
    angle.copysign(y)
}

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};

    use super::*;

    #[test]
    fn atan2_is_that_of_the_standard_library() {
        for step in 0..4000 {
            let (sin, cos) = (f64::from(step) * std::f64::consts::TAU / 4000.0 + 1e-4).sin_cos();
            let length = 10_f64.powi(step % 9 - 4);
            let (y, x) = ((sin * length) as f32, (cos * length) as f32);
            let fast: f32 = dispatch!(Level::new(), simd => {
                atan2(f32x8::splat(simd, y), f32x8::splat(simd, x))[5]
            });
            let exact = f64::from(y).atan2(f64::from(x));
            assert!(
                (f64::from(fast) - exact).abs() < 4e-7,
                "{y} {x}: {fast} {exact}"
            );
        }
        let origin: f32 = dispatch!(Level::new(), simd => {
            atan2(f32x8::splat(simd, 0.0), f32x8::splat(simd, 0.0))[0]
        });
        assert_eq!(origin, 0.0);
    }
}
