//! Image of a region to look at: a perspective view of a frame towards it, with the region in red.

use glam::{DMat3, DVec2, DVec3, dvec2, dvec3};
use omnilife_schemas::{
    RgbImage,
    camera::{CameraModel, ErpCamera},
    interpolation::Edges,
    rgb::Mask,
};

/// Side of the image, pixels.
const SIDE: usize = 480;
/// Half of its field of view, as a slope: 127 degrees in all.
const REACH: f64 = 2.0;
/// Share of red in the region.
const RED: f32 = 0.45;

/// Draws the view of a panorama towards the middle of a region.
pub(super) fn draw(panorama: &RgbImage, mask: &Mask) -> RgbImage {
    let camera = ErpCamera::new(mask.width as u32, mask.height as u32);
    let view = towards(middle(mask, &camera));
    let slope = |at: usize| ((at as f64 + 0.5) / SIDE as f64 * 2.0 - 1.0) * REACH;
    let pixel = |at: usize| {
        let direction = view * dvec3(slope(at % SIDE), slope(at / SIDE), 1.0);
        let place = camera.project(direction).unwrap_or(DVec2::ZERO);
        let scale = panorama.width as f64 / mask.width as f64;
        let colour = panorama.sample(place * scale, Edges::Around);
        let column = (place.x as usize).min(mask.width - 1);
        let row = (place.y as usize).min(mask.height - 1);
        match mask.data[row * mask.width + column] {
            0 => colour,
            _ => {
                let [red, green, blue] = colour.map(|value| (1.0 - RED) * value);
                [red + RED, green, blue]
            }
        }
    };
    RgbImage::new(SIDE, SIDE, (0..SIDE * SIDE).flat_map(pixel).collect())
}

/// Returns the mean direction of what a mask marks; straight down if it marks nothing.
fn middle(mask: &Mask, camera: &ErpCamera) -> DVec3 {
    let marked = (0..mask.data.len()).filter(|&pixel| mask.data[pixel] != 0);
    let sum: DVec3 = marked
        .map(|pixel| {
            let (column, row) = (pixel % mask.width, pixel / mask.width);
            let direction = camera.unproject(dvec2(column as f64 + 0.5, row as f64 + 0.5));
            direction * camera.pixel_solid_angle(row as u32)
        })
        .sum();
    sum.try_normalize().unwrap_or(DVec3::Y)
}

/// Returns the rotation from a view towards a direction to the camera's frame; the horizon stays level where it can.
fn towards(forward: DVec3) -> DMat3 {
    let right = DVec3::Y.cross(forward).try_normalize();
    let right = right.unwrap_or(DVec3::X);
    DMat3::from_cols(right, forward.cross(right), forward)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_region_is_in_the_middle_and_red() {
        let panorama = RgbImage::new(128, 64, vec![0.2; 128 * 64 * 3]);
        let mut mask = Mask::new(64, 32, vec![0; 64 * 32]);
        // Across the seam, below the horizon.
        for row in 20..28 {
            for column in [62, 63, 0, 1] {
                mask.data[row * 64 + column] = 255;
            }
        }
        let image = draw(&panorama, &mask);
        let at = |x: usize, y: usize| &image.data[3 * (y * SIDE + x)..][..3];
        assert!(at(SIDE / 2, SIDE / 2)[0] > 0.5 && at(SIDE / 2, SIDE / 2)[1] < 0.2);
        assert!(at(2, 2)[0] < 0.3);
        let view = towards(dvec3(0.3, 0.6, -0.5).normalize());
        assert!((view.determinant() - 1.0).abs() < 1e-12);
    }
}
