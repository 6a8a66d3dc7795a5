//! The pinhole camera: projection, its Jacobian, and the VJP of both.
//!
//! ```text
//! u = fx x/z + cx       v = fy y/z + cy
//! J = [ fx/z  0     -fx tx/z ]       tx = x/z, ty = y/z, clamped
//!     [ 0     fy/z  -fy ty/z ]
//! ```
//!
//! In the Jacobian alone the slopes `x/z` and `y/z` are clamped to the image widened by 15 % on
//! either side, because the linearization of what stands far outside the image explodes (3DGS
//! `forward.cu`: 1.3 times the half image). A clamped slope counts as constant in the VJP.

use glam::{Vec2, Vec3, vec2, vec3};
use omnilife_schemas::camera::PinholeCamera;

use crate::camera::Projection;

/// Share of the image's size by which the range of slopes in the Jacobian is widened on each side.
pub(crate) const SLOPE_MARGIN: f32 = 0.15;

struct Slopes {
    fx: f32,
    fy: f32,
    x: f32,
    y: f32,
    /// Whether each is inside its range.
    x_is_free: bool,
    y_is_free: bool,
}

impl Slopes {
    fn new(camera: &PinholeCamera, point: Vec3) -> Self {
        let (fx, fy) = (camera.fx as f32, camera.fy as f32);
        let clamp = |slope: f32, size: u32, focal: f32, centre: f64| {
            let (size, centre) = (size as f32, centre as f32);
            let low = (-SLOPE_MARGIN * size - centre) / focal;
            let high = ((1.0 + SLOPE_MARGIN) * size - centre) / focal;
            (slope.clamp(low, high), slope > low && slope < high)
        };
        let (x, x_is_free) = clamp(point.x / point.z, camera.width, fx, camera.cx);
        let (y, y_is_free) = clamp(point.y / point.z, camera.height, fy, camera.cy);
        Self {
            fx,
            fy,
            x,
            y,
            x_is_free,
            y_is_free,
        }
    }
}

/// Projects a point of the camera frame with `z > 0`.
pub fn project(camera: &PinholeCamera, point: Vec3) -> Projection {
    let slopes = Slopes::new(camera, point);
    let (fx, fy) = (slopes.fx, slopes.fy);
    let inverse_z = 1.0 / point.z;
    Projection {
        pixel: vec2(
            fx * point.x * inverse_z + camera.cx as f32,
            fy * point.y * inverse_z + camera.cy as f32,
        ),
        jacobian_u: vec3(fx, 0.0, -fx * slopes.x) * inverse_z,
        jacobian_v: vec3(0.0, fy, -fy * slopes.y) * inverse_z,
    }
}

/// VJP of [`project`]: the gradient by the point from gradients by the pixel and by the two rows of
/// the Jacobian.
pub fn project_vjp(
    camera: &PinholeCamera,
    point: Vec3,
    pixel: Vec2,
    jacobian_u: Vec3,
    jacobian_v: Vec3,
) -> Vec3 {
    let slopes = Slopes::new(camera, point);
    let (fx, fy) = (slopes.fx, slopes.fy);
    let inverse_z = 1.0 / point.z;
    let inverse_z2 = inverse_z * inverse_z;
    let by_x = pixel.x * fx * inverse_z;
    let by_y = pixel.y * fy * inverse_z;
    let mut gradient = vec3(by_x, by_y, -(by_x * point.x + by_y * point.y) * inverse_z);
    gradient.z -= (jacobian_u.x * fx + jacobian_v.y * fy) * inverse_z2;
    gradient.z += (jacobian_u.z * fx * slopes.x + jacobian_v.z * fy * slopes.y) * inverse_z2;
    // The slopes themselves: dJ02/dtx = -fx/z, dtx/dx = 1/z, dtx/dz = -x/z^2.
    if slopes.x_is_free {
        let by_slope = -fx * inverse_z * jacobian_u.z;
        gradient.x += by_slope * inverse_z;
        gradient.z -= by_slope * point.x * inverse_z2;
    }
    if slopes.y_is_free {
        let by_slope = -fy * inverse_z * jacobian_v.z;
        gradient.y += by_slope * inverse_z;
        gradient.z -= by_slope * point.y * inverse_z2;
    }
    gradient
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, dvec3};
    use omnilife_schemas::camera::CameraModel;

    use super::*;

    fn camera() -> PinholeCamera {
        PinholeCamera {
            fx: 50.0,
            fy: 55.0,
            cx: 30.0,
            cy: 21.0,
            ..PinholeCamera::with_horizontal_field_of_view(64, 48, 1.0)
        }
    }

    /// Inside the image, and beside it where slopes are clamped in `u`, in `v`.
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
            let projection = project(&camera(), p.as_vec3());
            let pixel = camera().project(p).expect("in front");
            assert!((projection.pixel.as_dvec2() - pixel).length() < 1e-4);
        }
        // Where nothing is clamped the Jacobian is the derivative.
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
            let gradient = project_vjp(&camera(), p.as_vec3(), weight_pixel, weight_u, weight_v);
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
