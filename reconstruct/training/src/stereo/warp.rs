//! Sampling of ERP images: bilinear samples that wrap, and rotated images.

use std::f32::consts::{PI, TAU};

use glam::{Mat3, Vec3, vec3};
use omnilife_schemas::{RgbImage, camera::ErpCamera};
use rayon::prelude::*;

use omnilife_engine::camera::{Camera, rays::Rays};

/// The unit rays of an ERP camera's pixels.
#[derive(Debug)]
pub struct ErpRays(Rays);

impl ErpRays {
    /// Returns the rays of an image of this size.
    pub fn new(width: usize, height: usize) -> Self {
        Self(Rays::new(Camera::Erp(ErpCamera::new(
            width as u32,
            height as u32,
        ))))
    }

    /// Returns the ray through the centre of a pixel, camera frame.
    pub fn ray(&self, column: usize, row: usize) -> Vec3 {
        let rays = &self.0;
        vec3(
            rays.scale[row] * rays.x[column],
            rays.y[row],
            rays.scale[row] * rays.z[column],
        )
    }
}

/// Returns the position of a direction of the camera frame (not zero) in an ERP image, pixels.
pub fn erp_pixel(direction: Vec3, width: f32, height: f32) -> [f32; 2] {
    let rho = (direction.x * direction.x + direction.z * direction.z).sqrt();
    let longitude = direction.x.atan2(direction.z);
    let latitude = (-direction.y).atan2(rho);
    [
        (longitude / TAU + 0.5) * width,
        (0.5 - latitude / PI) * height,
    ]
}

/// Returns the four pixels around a position in an ERP image with their weights: columns wrap, rows end at the
/// poles.
pub fn bilinear(width: usize, height: usize, [u, v]: [f32; 2]) -> [(usize, f32); 4] {
    let (x, y) = (u - 0.5, v - 0.5);
    let (left, top) = (x.floor(), y.floor());
    let (fx, fy) = (x - left, y - top);
    let column = |step: i64| (left as i64 + step).rem_euclid(width as i64) as usize;
    let row = |step: i64| (top as i64 + step).clamp(0, height as i64 - 1) as usize;
    let (left, right, top, bottom) = (column(0), column(1), row(0), row(1));
    [
        (top * width + left, (1.0 - fx) * (1.0 - fy)),
        (top * width + right, fx * (1.0 - fy)),
        (bottom * width + left, (1.0 - fx) * fy),
        (bottom * width + right, fx * fy),
    ]
}

/// Returns the colour at a position, bilinear.
pub fn sample(image: &RgbImage, place: [f32; 2]) -> [f32; 3] {
    let mut colour = [0.0; 3];
    for (pixel, weight) in bilinear(image.width, image.height, place) {
        for (sum, value) in colour.iter_mut().zip(&image.data[pixel * 3..pixel * 3 + 3]) {
            *sum += weight * value;
        }
    }
    colour
}

/// Returns an image of the same size in another orientation: `turn` leads from the new camera frame to the
/// image's.
pub fn turned(image: &RgbImage, turn: Mat3) -> RgbImage {
    let (width, height) = (image.width, image.height);
    let rays = ErpRays::new(width, height);
    let mut out = RgbImage::black(width, height);
    out.data
        .par_chunks_mut(width * 3)
        .enumerate()
        .for_each(|(row, pixels)| {
            for (column, pixel) in pixels.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                let direction = turn * rays.ray(column, row);
                *pixel = sample(image, erp_pixel(direction, width as f32, height as f32));
            }
        });
    out
}

/// Returns `(1 - share) first + share second` of two images of one size.
pub fn mixed(first: &RgbImage, second: &RgbImage, share: f32) -> RgbImage {
    RgbImage {
        width: first.width,
        height: first.height,
        data: first
            .data
            .iter()
            .zip(&second.data)
            .map(|(a, b)| a + share * (b - a))
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    /// Returns a smooth function of the direction, as an image.
    fn image(turn: DQuat) -> RgbImage {
        let (width, height) = (64, 32);
        let rays = ErpRays::new(width, height);
        let mut image = RgbImage::black(width, height);
        for row in 0..height {
            for column in 0..width {
                let world = turn.as_quat() * rays.ray(column, row);
                let at = (row * width + column) * 3;
                image.data[at..at + 3].copy_from_slice(&(0.5 + 0.4 * world).to_array());
            }
        }
        image
    }

    #[test]
    fn a_turned_image_is_the_view_from_the_turned_camera() {
        let to_world = DQuat::from_euler(glam::EulerRot::YXZ, 2.5, 0.8, -0.3);
        let straight = image(DQuat::IDENTITY);
        let expected = image(to_world);
        let found = turned(&straight, Mat3::from_quat(to_world.as_quat()));
        let largest = found
            .data
            .iter()
            .zip(&expected.data)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f32::max);
        // A pixel spans 0.1 rad; bilinear samples of a function of slope 0.4 are off by less than
        // 0.4 times an eighth of its square. Beyond the last row there is half a pixel.
        assert!(largest < 0.4 * 0.1, "{largest}");
    }

    #[test]
    fn columns_wrap_and_rows_end() {
        let near_seam = bilinear(8, 4, [0.25, 1.5]);
        let columns: Vec<usize> = near_seam.iter().map(|(pixel, _)| pixel % 8).collect();
        assert_eq!(columns, [7, 0, 7, 0]);
        let above = bilinear(8, 4, [3.5, 0.0]);
        assert!(above.iter().all(|(pixel, _)| pixel / 8 == 0));
        for places in [near_seam, above] {
            let sum: f32 = places.iter().map(|(_, weight)| weight).sum();
            assert!((sum - 1.0).abs() < 1e-6);
        }
    }
}
