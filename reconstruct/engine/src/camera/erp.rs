//! The equirectangular camera: projection, its Jacobian, and the VJP of both.
//!
//! Source: OmniGS `cuda_rasterizer/forward.cu`; the same first-order footprint as ODGS's tangent plane. With
//! `p = (x, y, z)`, `d = |p|`, `rho = hypot(x, z)`, `kx = W / 2pi`, `ky = H / pi`:
//!
//! ```text
//! u = (atan2(x, z) / 2pi + 1/2) W          v = (1/2 - atan2(-y, rho) / pi) H
//! J = [ kx z/rho^2         0            -kx x/rho^2       ]
//!     [ -ky x y/(rho d^2)  ky rho/d^2   -ky y z/(rho d^2) ]
//! ```
//!
//! All is evaluated on the unit direction `p / d` and divided by powers of `d` at the end, which avoids
//! powers of extreme distances.

use std::f32::consts::{PI, TAU};

use fearless_simd::{Simd, f32x8, prelude::*};
use glam::{Vec2, Vec3, vec2};
use omnilife_schemas::camera::ErpCamera;

use crate::camera::{
    Jacobian, horizontal,
    lanes::{self, Vec3x8},
};

/// Returns the image of a direction, pixels.
pub fn pixel(camera: &ErpCamera, n: Vec3) -> Vec2 {
    let (longitude, latitude) = (n.x.atan2(n.z), (-n.y).atan2(horizontal(n)));
    vec2(
        (longitude / TAU + 0.5) * camera.width as f32,
        (0.5 - latitude / PI) * camera.height as f32,
    )
}

/// Returns the images of points of the camera frame, pixels.
#[inline(always)]
pub(crate) fn pixels<S: Simd>(camera: &ErpCamera, point: Vec3x8<S>) -> [f32x8<S>; 2] {
    let longitude = lanes::atan2(point.x, point.z);
    let latitude = lanes::atan2(-point.y, lanes::horizontal(point));
    [
        (longitude * (1.0 / TAU) + 0.5) * camera.width as f32,
        (-latitude * (1.0 / PI) + 0.5) * camera.height as f32,
    ]
}

/// Returns the unit direction, its distance from the vertical axis, and the tangents to east and down.
#[inline(always)]
fn frame<S: Simd>(
    point: Vec3x8<S>,
    inverse_distance: f32x8<S>,
) -> (Vec3x8<S>, f32x8<S>, [Vec3x8<S>; 2]) {
    let n = point.times(inverse_distance);
    let rho = lanes::horizontal(n);
    let inverse_rho = f32x8::splat(rho.simd, 1.0) / rho;
    let (sin, cos) = (n.x * inverse_rho, n.z * inverse_rho);
    let east = Vec3x8 {
        x: cos,
        y: f32x8::splat(rho.simd, 0.0),
        z: -sin,
    };
    let down = Vec3x8 {
        x: -n.y * sin,
        y: rho,
        z: -n.y * cos,
    };
    (n, rho, [east, down])
}

/// Returns the Jacobian of the image at points of the camera frame off the vertical axis.
#[inline(always)]
pub(crate) fn jacobian<S: Simd>(
    camera: &ErpCamera,
    point: Vec3x8<S>,
    inverse_distance: f32x8<S>,
) -> Jacobian<S> {
    let (_, rho, [east, down]) = frame(point, inverse_distance);
    Jacobian {
        u: east.times(inverse_distance / rho * (camera.width as f32 / TAU)),
        v: down.times(inverse_distance * (camera.height as f32 / PI)),
    }
}

/// Returns the VJP of [`pixels`] and [`jacobian`]: the gradient by the point from gradients by the pixel and
/// by the two rows of the Jacobian.
#[inline(always)]
pub(crate) fn vjp<S: Simd>(
    camera: &ErpCamera,
    point: Vec3x8<S>,
    inverse_distance: f32x8<S>,
    pixel: [f32x8<S>; 2],
    by: &Jacobian<S>,
) -> Vec3x8<S> {
    let kx = camera.width as f32 / TAU;
    let ky = camera.height as f32 / PI;
    let (n, rho, [east, down]) = frame(point, inverse_distance);
    let Vec3x8 { x, y, z } = n;
    let inverse_rho = f32x8::splat(rho.simd, 1.0) / rho;
    let gradient = east.times(pixel[0] * inverse_rho * inverse_distance * kx);
    let gradient = down.times_plus(pixel[1] * inverse_distance * ky, gradient);

    // d(J row u)/dp on the unit direction, where d = 1.
    let by_distance_squared = inverse_distance * inverse_distance;
    let (rho2, inverse_rho3) = (rho * rho, inverse_rho * inverse_rho * inverse_rho);
    let u0 = by.u.x * (by_distance_squared * inverse_rho3 * inverse_rho * kx);
    let u2 = by.u.z * (by_distance_squared * inverse_rho3 * inverse_rho * kx);
    let xz_twice = x * z * 2.0;
    let gradient = Vec3x8 {
        x: gradient.x + (x * x * 2.0 - rho2) * u2 - xz_twice * u0,
        y: gradient.y,
        z: gradient.z + (rho2 - z * z * 2.0) * u0 + xz_twice * u2,
    };
    // d(J row v)/dp on the unit direction.
    let scale = by_distance_squared * ky;
    let (v0, v1, v2) = (by.v.x * scale, by.v.y * scale, by.v.z * scale);
    let mixed = x * y * z * (rho2 * 2.0 + 1.0) * inverse_rho3;
    let level = (-(y * y) * 2.0 + 1.0) * inverse_rho;
    let across_x = (x * x * rho2 * 2.0 - z * z) * y * inverse_rho3;
    let across_z = (z * z * rho2 * 2.0 - x * x) * y * inverse_rho3;
    Vec3x8 {
        x: gradient.x + across_x * v0 - x * level * v1 + mixed * v2,
        y: gradient.y - x * level * v0 - y * rho * v1 * 2.0 - z * level * v2,
        z: gradient.z + mixed * v0 - z * level * v1 + across_z * v2,
    }
}

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};
    use glam::{DVec3, dvec3, vec3};
    use omnilife_schemas::camera::CameraModel;

    use super::*;

    const CAMERA: ErpCamera = ErpCamera::new(1024, 512);

    /// Returns the Jacobian of the f64 definition by central differences.
    fn reference_jacobian(p: DVec3) -> [DVec3; 2] {
        let h = 1e-6 * p.length();
        let mut rows = [DVec3::ZERO; 2];
        for axis in 0..3 {
            let mut step = DVec3::ZERO;
            step[axis] = h;
            let plus = CAMERA.project(p + step).expect("not the centre");
            let minus = CAMERA.project(p - step).expect("not the centre");
            let du = CAMERA.wrapped_column_distance(minus.x, plus.x);
            rows[0][axis] = du / (2.0 * h);
            rows[1][axis] = (plus.y - minus.y) / (2.0 * h);
        }
        rows
    }

    fn points() -> Vec<DVec3> {
        let mut points = Vec::new();
        for scale in [1e-3, 1.0, 1e4] {
            for (x, y, z) in [
                (0.3, -0.2, 1.0),
                (-1.0, 0.7, -0.4),
                (0.001, 0.3, -1.0),
                (-0.001, 0.3, -1.0),
                (0.03, -1.0, 0.02),
                (-0.05, 1.0, 0.01),
                (2.0, 0.0, 0.0),
            ] {
                points.push(dvec3(x, y, z) * scale);
            }
        }
        points
    }

    #[test]
    fn pixels_are_those_of_the_definition() {
        for p in points() {
            let expected = CAMERA.project(p).expect("not the centre");
            let [u, v] = dispatch!(Level::new(), simd => {
                let point = Vec3x8::gather(simd, &[p.as_vec3().to_array(); lanes::LANES]);
                pixels(&CAMERA, point).map(|value| value[2])
            });
            let one = pixel(&CAMERA, p.normalize().as_vec3());
            for image in [vec2(u, v), one] {
                assert!(
                    (image.as_dvec2() - expected).length() < 2e-4,
                    "{p}: {image} {expected}"
                );
            }
        }
    }

    #[test]
    fn jacobian_is_that_of_the_definition() {
        for p in points() {
            let rows = dispatch!(Level::new(), simd => {
                let point = Vec3x8::gather(simd, &[p.as_vec3().to_array(); lanes::LANES]);
                let inverse = f32x8::splat(simd, 1.0 / p.length() as f32);
                let rows = jacobian(&CAMERA, point, inverse);
                [rows.u.lane(3), rows.v.lane(3)]
            });
            for (row, reference) in rows.into_iter().zip(reference_jacobian(p)) {
                let error = (row.as_dvec3() - reference).length() / reference.length();
                assert!(error < 2e-6, "{p}: {row} against {reference}");
            }
        }
    }

    #[test]
    fn vjp_is_the_derivative_of_pixel_and_jacobian() {
        let (weight_pixel, weight_u, weight_v) =
            (vec2(0.7, -1.3), vec3(0.9, -0.4, 1.1), vec3(-0.6, 0.8, 0.5));
        for p in points() {
            let d = p.length();
            // The loss weights the outputs so that all of them matter at every distance.
            let loss = |q: DVec3| {
                let pixel = CAMERA.project(q).expect("not the centre");
                let [ju, jv] = reference_jacobian_analytic(q);
                let du = CAMERA.wrapped_column_distance(512.0, pixel.x);
                f64::from(weight_pixel.x) * du
                    + f64::from(weight_pixel.y) * pixel.y
                    + d * (ju.dot(weight_u.as_dvec3()) + jv.dot(weight_v.as_dvec3()))
            };
            let analytic = dispatch!(Level::new(), simd => {
                let gather = |vector: Vec3| {
                    Vec3x8::gather(simd, &[vector.to_array(); lanes::LANES])
                };
                let pixel = weight_pixel.to_array().map(|value| f32x8::splat(simd, value));
                let by = Jacobian {
                    u: gather(weight_u * d as f32),
                    v: gather(weight_v * d as f32),
                };
                let inverse = f32x8::splat(simd, 1.0 / d as f32);
                vjp(&CAMERA, gather(p.as_vec3()), inverse, pixel, &by).lane(6)
            });
            let h = 1e-6 * d;
            let mut reference = DVec3::ZERO;
            for axis in 0..3 {
                let mut step = DVec3::ZERO;
                step[axis] = h;
                reference[axis] = (loss(p + step) - loss(p - step)) / (2.0 * h);
            }
            let error = (analytic.as_dvec3() - reference).length() / reference.length();
            assert!(error < 1e-4, "{p}: {analytic} against {reference}");
        }
    }

    /// Returns the Jacobian written out from the module's formula, in f64.
    /// `jacobian_is_that_of_the_definition` checks the f32 one against the definition itself.
    fn reference_jacobian_analytic(p: DVec3) -> [DVec3; 2] {
        let (kx, ky) = (1024.0 / std::f64::consts::TAU, 512.0 / std::f64::consts::PI);
        let (d2, rho) = (p.length_squared(), p.x.hypot(p.z));
        [
            dvec3(kx * p.z / (rho * rho), 0.0, -kx * p.x / (rho * rho)),
            dvec3(
                -ky * p.x * p.y / (rho * d2),
                ky * rho / d2,
                -ky * p.y * p.z / (rho * d2),
            ),
        ]
    }
}
