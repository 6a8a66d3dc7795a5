//! The equirectangular camera: projection, its Jacobian, and the VJP of both.
//!
//! Source: OmniGS `cuda_rasterizer/forward.cu`; the same first-order footprint as
//! ODGS's tangent plane. With `p = (x, y, z)`, `d = |p|`, `rho = hypot(x, z)`, `kx = W / 2pi`,
//! `ky = H / pi`:
//!
//! ```text
//! u = (atan2(x, z) / 2pi + 1/2) W          v = (1/2 - atan2(-y, rho) / pi) H
//! J = [ kx z/rho^2         0            -kx x/rho^2       ]
//!     [ -ky x y/(rho d^2)  ky rho/d^2   -ky y z/(rho d^2) ]
//! ```
//!
//! Everything is evaluated on the unit direction `p / d` and divided by powers of `d` at the end,
//! so that no power of a very small or very large distance is ever formed.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3, vec2, vec3};
use omnilife_schemas::camera::ErpCamera;

use crate::camera::{Projection, horizontal, tangent_frame};

/// Projects a point of the camera frame. `distance` is `|point|` and must be positive and finite.
pub fn project(camera: &ErpCamera, point: Vec3, distance: f32) -> Projection {
    let (width, height) = (camera.width as f32, camera.height as f32);
    let n = point / distance;
    let [east, down] = tangent_frame(n);
    let rho = horizontal(n);
    let longitude = n.x.atan2(n.z);
    let latitude = (-n.y).atan2(rho);
    Projection {
        pixel: vec2(
            (longitude / TAU + 0.5) * width,
            (0.5 - latitude / PI) * height,
        ),
        jacobian_u: east * (width / TAU / (rho * distance)),
        jacobian_v: down * (height / PI / distance),
    }
}

/// VJP of [`project`]: the gradient by the point from gradients by the pixel and by the two rows of
/// the Jacobian. The point is not on the vertical axis.
pub fn project_vjp(
    camera: &ErpCamera,
    point: Vec3,
    distance: f32,
    pixel: Vec2,
    jacobian_u: Vec3,
    jacobian_v: Vec3,
) -> Vec3 {
    let kx = camera.width as f32 / TAU;
    let ky = camera.height as f32 / PI;
    let n = point / distance;
    let [east, down] = tangent_frame(n);
    let (x, y, z, rho) = (n.x, n.y, n.z, horizontal(n));
    let mut gradient = east * (pixel.x * kx / (rho * distance)) + down * (pixel.y * ky / distance);

    // d(J row u)/dp on the unit direction, where d = 1.
    let by_distance_squared = 1.0 / (distance * distance);
    let (rho2, inverse_rho3) = (rho * rho, 1.0 / (rho * rho * rho));
    let du0 = vec3(-2.0 * x * z, 0.0, rho2 - 2.0 * z * z);
    let du2 = vec3(2.0 * x * x - rho2, 0.0, 2.0 * x * z);
    gradient +=
        (du0 * jacobian_u.x + du2 * jacobian_u.z) * (kx * by_distance_squared * inverse_rho3 / rho);
    // d(J row v)/dp on the unit direction.
    let mixed = x * y * z * (2.0 * rho2 + 1.0) * inverse_rho3;
    let level = (1.0 - 2.0 * y * y) / rho;
    let dv0 = vec3(
        -y * (z * z - 2.0 * x * x * rho2) * inverse_rho3,
        -x * level,
        mixed,
    );
    let dv1 = vec3(-x * level, -2.0 * y * rho, -z * level);
    let dv2 = vec3(
        mixed,
        -z * level,
        -y * (x * x - 2.0 * z * z * rho2) * inverse_rho3,
    );
    gradient +=
        (dv0 * jacobian_v.x + dv1 * jacobian_v.y + dv2 * jacobian_v.z) * (ky * by_distance_squared);
    gradient
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, dvec3};
    use omnilife_schemas::camera::CameraModel;

    use super::*;

    const CAMERA: ErpCamera = ErpCamera {
        width: 1024,
        height: 512,
    };

    /// The Jacobian of the f64 definition by central differences.
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
    fn jacobian_is_that_of_the_definition() {
        for p in points() {
            let projection = project(&CAMERA, p.as_vec3(), p.length() as f32);
            for (row, reference) in [projection.jacobian_u, projection.jacobian_v]
                .into_iter()
                .zip(reference_jacobian(p))
            {
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
            // The loss weighs each output so that all of them matter at every distance.
            let loss = |q: DVec3| {
                let pixel = CAMERA.project(q).expect("not the centre");
                let [ju, jv] = reference_jacobian_analytic(q);
                let du = CAMERA.wrapped_column_distance(512.0, pixel.x);
                f64::from(weight_pixel.x) * du
                    + f64::from(weight_pixel.y) * pixel.y
                    + d * (ju.dot(weight_u.as_dvec3()) + jv.dot(weight_v.as_dvec3()))
            };
            let analytic = project_vjp(
                &CAMERA,
                p.as_vec3(),
                d as f32,
                weight_pixel,
                weight_u * d as f32,
                weight_v * d as f32,
            );
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

    /// The Jacobian written out from the module's formula, in f64; `jacobian_is_that_of_the_definition`
    /// holds the f32 one against the definition itself.
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
