//! The pinhole camera: projection, its Jacobian, and the VJP of both.
//!
//! ```text
//! u = fx x/z + cx       v = fy y/z + cy
//! J = [ fx/z  0     -fx tx/z ]       tx = x/z, ty = y/z, clamped
//!     [ 0     fy/z  -fy ty/z ]
//! ```
//!
//! In the Jacobian alone the slopes `x/z` and `y/z` are clamped to the image widened by 15 % on either side
//! (3DGS `forward.cu`: 1.3 times the half image). Farther outside the linearization explodes. A clamped slope
//! counts as constant in the VJP.

use fearless_simd::{Simd, f32x8, prelude::*};
use glam::{Vec2, Vec3, vec2};
use omnilife_schemas::camera::PinholeCamera;

use crate::camera::{Jacobian, lanes::Vec3x8};

/// Margin added to each side of the range of slopes in the Jacobian, as a share of the image's size.
pub(crate) const SLOPE_MARGIN: f32 = 0.15;

/// A slope in the Jacobian.
struct Slope<S: Simd> {
    clamped: f32x8<S>,
    /// 1 inside the range, 0 where the slope is clamped.
    is_free: f32x8<S>,
}

impl<S: Simd> Slope<S> {
    #[inline(always)]
    fn new(slope: f32x8<S>, size: u32, focal: f64, centre: f64) -> Self {
        let (size, focal, centre) = (size as f32, focal as f32, centre as f32);
        let low = (-SLOPE_MARGIN * size - centre) / focal;
        let high = ((1.0 + SLOPE_MARGIN) * size - centre) / focal;
        let zero = f32x8::splat(slope.simd, 0.0);
        let is_free = slope.simd_gt(low) & slope.simd_lt(high);
        Self {
            clamped: slope.max(low).min(high),
            is_free: is_free.select(f32x8::splat(slope.simd, 1.0), zero),
        }
    }

    /// Returns the slopes `x / z` and `y / z`.
    #[inline(always)]
    fn both(camera: &PinholeCamera, point: Vec3x8<S>, inverse_z: f32x8<S>) -> [Self; 2] {
        [
            Self::new(point.x * inverse_z, camera.width, camera.fx, camera.cx),
            Self::new(point.y * inverse_z, camera.height, camera.fy, camera.cy),
        ]
    }
}

#[inline(always)]
fn inverse_z<S: Simd>(point: Vec3x8<S>) -> f32x8<S> {
    f32x8::splat(point.z.simd, 1.0) / point.z
}

/// Returns the image of a direction with `z > 0`, pixels.
pub fn pixel(camera: &PinholeCamera, n: Vec3) -> Vec2 {
    vec2(
        camera.fx as f32 * (n.x / n.z) + camera.cx as f32,
        camera.fy as f32 * (n.y / n.z) + camera.cy as f32,
    )
}

/// Returns the images of points of the camera frame with `z > 0`, pixels.
#[inline(always)]
pub(crate) fn pixels<S: Simd>(camera: &PinholeCamera, point: Vec3x8<S>) -> [f32x8<S>; 2] {
    let inverse_z = inverse_z(point);
    [
        point.x * inverse_z * camera.fx as f32 + camera.cx as f32,
        point.y * inverse_z * camera.fy as f32 + camera.cy as f32,
    ]
}

/// Returns the Jacobian of the image at points of the camera frame with `z > 0`.
#[inline(always)]
pub(crate) fn jacobian<S: Simd>(camera: &PinholeCamera, point: Vec3x8<S>) -> Jacobian<S> {
    let inverse_z = inverse_z(point);
    let [x, y] = Slope::both(camera, point, inverse_z);
    let zero = f32x8::splat(inverse_z.simd, 0.0);
    let (by_x, by_y) = (inverse_z * camera.fx as f32, inverse_z * camera.fy as f32);
    Jacobian {
        u: Vec3x8 {
            x: by_x,
            y: zero,
            z: -by_x * x.clamped,
        },
        v: Vec3x8 {
            x: zero,
            y: by_y,
            z: -by_y * y.clamped,
        },
    }
}

/// Returns the VJP of [`pixels`] and [`jacobian`]: the gradient by the point from gradients by the pixel and
/// by the two rows of the Jacobian.
#[inline(always)]
pub(crate) fn vjp<S: Simd>(
    camera: &PinholeCamera,
    point: Vec3x8<S>,
    pixel: [f32x8<S>; 2],
    by: &Jacobian<S>,
) -> Vec3x8<S> {
    let inverse_z = inverse_z(point);
    let (fx, fy) = (inverse_z * camera.fx as f32, inverse_z * camera.fy as f32);
    let [x, y] = Slope::both(camera, point, inverse_z);
    let (by_x, by_y) = (pixel[0] * fx, pixel[1] * fy);
    // The slopes themselves: dJ02/dtx = -fx/z, dtx/dx = 1/z, dtx/dz = -x/z^2.
    let by_slope_x = -fx * by.u.z * x.is_free * inverse_z;
    let by_slope_y = -fy * by.v.z * y.is_free * inverse_z;
    let (along_x, along_y) = (by_x + by_slope_x, by_y + by_slope_y);
    let scaled = (by.u.x - by.u.z * x.clamped) * fx + (by.v.y - by.v.z * y.clamped) * fy;
    Vec3x8 {
        x: along_x,
        y: along_y,
        z: -(along_x * point.x + along_y * point.y + scaled) * inverse_z,
    }
}

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};
    use glam::{DVec3, dvec3, vec3};
    use omnilife_schemas::camera::CameraModel;

    use super::*;
    use crate::camera::lanes::LANES;

    fn camera() -> PinholeCamera {
        PinholeCamera {
            fx: 50.0,
            fy: 55.0,
            cx: 30.0,
            cy: 21.0,
            ..PinholeCamera::with_horizontal_field_of_view(64, 48, 1.0)
        }
    }

    /// Inside the image, and outside where slopes are clamped in `u` or in `v`.
    const POINTS: [[f64; 3]; 4] = [
        [0.3, -0.2, 1.0],
        [-0.9, 0.7, 2.4],
        [3.0, 0.1, 1.0],
        [0.2, -4.0, 1.5],
    ];

    fn jacobian(camera: &PinholeCamera, p: DVec3) -> [DVec3; 2] {
        let range = |size: u32, focal: f64, centre: f64| {
            let margin = 0.15 * f64::from(size);
            (
                (-margin - centre) / focal,
                (f64::from(size) + margin - centre) / focal,
            )
        };
        let (low, high) = range(camera.width, camera.fx, camera.cx);
        let x = (p.x / p.z).clamp(low, high);
        let (low, high) = range(camera.height, camera.fy, camera.cy);
        let y = (p.y / p.z).clamp(low, high);
        [
            dvec3(camera.fx, 0.0, -camera.fx * x) / p.z,
            dvec3(0.0, camera.fy, -camera.fy * y) / p.z,
        ]
    }

    #[test]
    fn projection_is_that_of_the_definition() {
        for p in POINTS.map(DVec3::from_array) {
            let expected = camera().project(p).expect("in front");
            let [u, v] = dispatch!(Level::new(), simd => {
                let point = Vec3x8::gather(simd, &[p.as_vec3().to_array(); LANES]);
                pixels(&camera(), point).map(|value| value[1])
            });
            for image in [vec2(u, v), pixel(&camera(), p.as_vec3())] {
                assert!((image.as_dvec2() - expected).length() < 1e-4);
            }
        }
        // An unclamped Jacobian is the derivative.
        let p = dvec3(0.3, -0.2, 1.0);
        let rows = jacobian(&camera(), p);
        for axis in 0..3 {
            let mut step = DVec3::ZERO;
            step[axis] = 1e-6;
            let plus = camera().project(p + step).expect("in front");
            let minus = camera().project(p - step).expect("in front");
            let derivative = (plus - minus) / 2e-6;
            assert!((derivative.x - rows[0][axis]).abs() < 1e-6);
            assert!((derivative.y - rows[1][axis]).abs() < 1e-6);
        }
    }

    #[test]
    fn vjp_is_the_derivative_of_pixel_and_jacobian() {
        let (weight_pixel, weight_u, weight_v) =
            (vec2(0.7, -1.3), vec3(0.9, -0.4, 1.1), vec3(-0.6, 0.8, 0.5));
        for p in POINTS.map(DVec3::from_array) {
            let loss = |q: DVec3| {
                let pixel = camera().project(q).expect("in front");
                let [u, v] = jacobian(&camera(), q);
                pixel.dot(weight_pixel.as_dvec2())
                    + u.dot(weight_u.as_dvec3())
                    + v.dot(weight_v.as_dvec3())
            };
            let gradient = dispatch!(Level::new(), simd => {
                let gather = |vector: Vec3| Vec3x8::gather(simd, &[vector.to_array(); LANES]);
                let pixel = weight_pixel.to_array().map(|value| f32x8::splat(simd, value));
                let by = Jacobian {
                    u: gather(weight_u),
                    v: gather(weight_v),
                };
                vjp(&camera(), gather(p.as_vec3()), pixel, &by).lane(7)
            });
            for axis in 0..3 {
                let mut step = DVec3::ZERO;
                step[axis] = 1e-6;
                let expected = (loss(p + step) - loss(p - step)) / 2e-6;
                let error = (f64::from(gradient[axis]) - expected).abs();
                assert!(error < 1e-4 * expected.abs().max(1.0), "{p} axis {axis}");
            }
        }
    }
}
