//! Nearest-pixel lookup of world points in a view: fast, for millions of points, not differentiable.

use std::f32::consts::{PI, TAU};

use super::{Camera, View, horizontal};
use glam::{Mat3, Vec3};

/// Camera prepared for projecting many points.
#[derive(Debug, Clone, Copy)]
pub struct Projector {
    camera: Camera,
    rotation: Mat3,
    centre: Vec3,
}

impl Projector {
    /// Creates the projector of a view.
    pub fn new(view: &View) -> Self {
        Self {
            camera: view.camera,
            rotation: view.rotation,
            centre: view.centre,
        }
    }

    /// Returns the pixel that shows a world point (row-major index) and the point's distance from the camera.
    /// `None` at the camera centre and outside the image.
    pub fn pixel(&self, place: Vec3) -> Option<(usize, f32)> {
        let (image, distance) = self.image(place)?;
        Some((self.pixel_at(image), distance))
    }

    /// Returns the row-major index of the pixel at an image position in pixels.
    pub fn pixel_at(&self, [u, v]: [f32; 2]) -> usize {
        let [width, height] = self.camera.size();
        // On the far edges, the last column of a panorama wraps to the first, and the last row is clamped.
        (v as usize).min(height - 1) * width + u as usize % width
    }

    /// Returns the image of a world point, pixels, and its distance from the camera. `None` at the camera
    /// centre and outside the image.
    pub fn image(&self, place: Vec3) -> Option<([f32; 2], f32)> {
        let point = self.rotation * (place - self.centre);
        let distance = point.length();
        if !(distance > 0.0 && distance.is_finite()) {
            return None;
        }
        let (width, height) = (self.camera.width() as f32, self.camera.height() as f32);
        let image = match &self.camera {
            Camera::Erp(_) => {
                let across = point.x.atan2(point.z) / TAU + 0.5;
                let down = 0.5 + point.y.atan2(horizontal(point)) / PI;
                [across * width, down * height]
            }
            Camera::Pinhole(camera) => {
                if point.z <= 0.0 {
                    return None;
                }
                let u = camera.fx as f32 * point.x / point.z + camera.cx as f32;
                let v = camera.fy as f32 * point.y / point.z + camera.cy as f32;
                if !(u >= 0.0 && v >= 0.0 && u < width && v < height) {
                    return None;
                }
                [u, v]
            }
        };
        Some((image, distance))
    }
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::camera::{ErpCamera, PinholeCamera};

    use super::*;
    use crate::camera::rays::Rays;

    #[test]
    fn what_a_pixel_shows_is_seen_in_that_pixel() {
        let erp = ErpCamera::new(40, 20);
        let pinhole = PinholeCamera::with_horizontal_field_of_view(30, 20, 1.4);
        for camera in [Camera::from(erp), Camera::from(pinhole)] {
            let view = View {
                camera,
                rotation: Mat3::from_euler(glam::EulerRot::XYZ, 0.4, 2.0, -1.0),
                centre: Vec3::new(1.0, -2.0, 0.5),
                time_seconds: 0.0,
            };
            let (projector, rays) = (Projector::new(&view), Rays::new(camera));
            let width = camera.width() as usize;
            for pixel in 0..width * camera.height() as usize {
                let ray = rays.ray(pixel % width, pixel / width).normalize();
                let place = view.centre + view.rotation.transpose() * (ray * 3.0);
                let (found, distance) = projector.pixel(place).expect("seen");
                assert_eq!(found, pixel);
                assert!((distance - 3.0).abs() < 1e-5);
            }
            assert_eq!(projector.pixel(view.centre), None);
        }
    }
}
