//! The rays through the pixel centres, as the rasterizer reads them.

use std::f64::consts::{PI, TAU};

use glam::{Vec3, vec3};

use crate::camera::Camera;

/// Padding entries after the last column, so that whole vectors can be loaded from any column.
pub const PADDING: usize = 16;

/// Rays through the centres of all pixels, separated into columns and rows: the ray of pixel
/// `(i, j)` in the camera frame is `(s_j x_i, y_j, s_j z_i)`. For an ERP camera it has length 1
/// (`s = cos(lat)`), for a pinhole `z = 1` (`s = 1`).
#[derive(Debug, Clone, PartialEq)]
pub struct Rays {
    /// Camera of the rays.
    pub camera: Camera,
    /// `x_i`, one per column, and [`PADDING`] more.
    pub x: Vec<f32>,
    /// `z_i`, one per column, and [`PADDING`] more.
    pub z: Vec<f32>,
    /// `s_j`, one per row.
    pub scale: Vec<f32>,
    /// `y_j`, one per row.
    pub y: Vec<f32>,
}

impl Rays {
    /// Computes the rays of a camera.
    pub fn new(camera: Camera) -> Self {
        let columns = (0..camera.width() as usize + PADDING).map(|column| column as f64 + 0.5);
        let rows = (0..camera.height()).map(|row| f64::from(row) + 0.5);
        let (x, z) = columns
            .map(|u| match &camera {
                Camera::Erp(erp) => {
                    let (sin, cos) = ((u / f64::from(erp.width) - 0.5) * TAU).sin_cos();
                    (sin as f32, cos as f32)
                }
                Camera::Pinhole(pinhole) => (((u - pinhole.cx) / pinhole.fx) as f32, 1.0),
            })
            .unzip();
        let (scale, y) = rows
            .map(|v| match &camera {
                Camera::Erp(erp) => {
                    let (sin, cos) = ((v / f64::from(erp.height) - 0.5) * PI).sin_cos();
                    (cos as f32, sin as f32)
                }
                Camera::Pinhole(pinhole) => (1.0, ((v - pinhole.cy) / pinhole.fy) as f32),
            })
            .unzip();
        Self {
            camera,
            x,
            z,
            scale,
            y,
        }
    }

    /// Returns the ray through the centre of one pixel.
    pub fn ray(&self, column: usize, row: usize) -> Vec3 {
        let scale = self.scale[row];
        vec3(scale * self.x[column], self.y[row], scale * self.z[column])
    }
}

#[cfg(test)]
mod tests {
    use glam::dvec2;
    use omnilife_schemas::camera::{CameraModel, ErpCamera, PinholeCamera};

    use super::*;

    #[test]
    fn rays_are_those_of_the_definition() {
        let erp = ErpCamera::new(40, 20);
        let pinhole = PinholeCamera::with_horizontal_field_of_view(30, 20, 1.4);
        let (erp_rays, pinhole_rays) = (Rays::new(erp.into()), Rays::new(pinhole.into()));
        for (column, row) in [(0, 0), (29, 19), (7, 11), (20, 3)] {
            let pixel = dvec2(column as f64 + 0.5, row as f64 + 0.5);
            let expected = erp.unproject(pixel).as_vec3();
            assert!((erp_rays.ray(column, row) - expected).length() < 1e-6);
            let expected = pinhole.unproject(pixel).as_vec3();
            let ray = pinhole_rays.ray(column, row).normalize();
            assert!((ray - expected).length() < 1e-6);
        }
    }
}
