//! Sharp samples of an ERP image: cubic convolution on the sphere (R. G. Keys, Cubic Convolution Interpolation for
//! Digital Image Processing, IEEE TASSP 1981, a = -1/2).
//!
//! A splat is a blur of its view. Colours that are looked up in the view itself keep its detail.

use omnilife_schemas::RgbImage;

/// Returns the colour at a position in pixels, cubic. Columns wrap; beyond a pole a row continues on the other side
/// of the sphere, half a turn away. Colours overshoot at edges, beyond [0, 1] too.
pub(super) fn sample(image: &RgbImage, [u, v]: [f32; 2]) -> [f32; 3] {
    let (x, y) = (u - 0.5, v - 0.5);
    let (left, top) = (x.floor(), y.floor());
    let width = image.width;
    let columns = [-1, 0, 1, 2].map(|step| (left as i64 + step).rem_euclid(width as i64) as usize);
    let across = weights(x - left);
    let mut colour = [0.0; 3];
    for (down, step) in weights(y - top).into_iter().zip(-1..) {
        let (row, turn) = row_and_turn(image, top as i64 + step);
        for (across, column) in across.into_iter().zip(columns) {
            let column = column + turn;
            let column = if column < width {
                column
            } else {
                column - width
            };
            let first = 3 * (row * width + column);
            for (sum, value) in colour.iter_mut().zip(&image.data[first..first + 3]) {
                *sum += across * down * value;
            }
        }
    }
    colour
}

/// Returns the weights of the pixels at -1, 0, 1 and 2 for a position in [0, 1]; their sum is 1.
fn weights(t: f32) -> [f32; 4] {
    let (square, cube) = (t * t, t * t * t);
    [
        -0.5 * cube + square - 0.5 * t,
        1.5 * cube - 2.5 * square + 1.0,
        -1.5 * cube + 2.0 * square + 0.5 * t,
        0.5 * cube - 0.5 * square,
    ]
}

/// Returns the row that continues the image at a row number beyond a pole, and its turn in columns.
fn row_and_turn(image: &RgbImage, row: i64) -> (usize, usize) {
    let height = image.height as i64;
    let (row, turn) = if row < 0 {
        (-1 - row, image.width / 2)
    } else if row >= height {
        (2 * height - 1 - row, image.width / 2)
    } else {
        (row, 0)
    };
    (row.clamp(0, height - 1) as usize, turn)
}

#[cfg(test)]
mod tests {
    use glam::{Mat3, Vec3, vec3};
    use omnilife_training::stereo::warp::{ErpRays, erp_pixel, sample as bilinear};

    use super::*;

    const SIZE: (usize, usize) = (64, 32);

    /// Returns a smooth function of the direction.
    fn painted(direction: Vec3) -> [f32; 3] {
        let waves = vec3(
            (5.0 * direction.x).sin(),
            (4.0 * direction.y + 2.0 * direction.z).sin(),
            (5.0 * direction.z).cos(),
        );
        (0.5 + 0.4 * waves).to_array()
    }

    fn image() -> RgbImage {
        let (width, height) = SIZE;
        let rays = ErpRays::new(width, height);
        let mut image = RgbImage::black(width, height);
        for row in 0..height {
            for column in 0..width {
                let at = (row * width + column) * 3;
                image.data[at..at + 3].copy_from_slice(&painted(rays.ray(column, row)));
            }
        }
        image
    }

    /// Returns the root mean square error of samples in the directions of a turned grid that `counts` accepts.
    fn error(
        look: impl Fn(&RgbImage, [f32; 2]) -> [f32; 3],
        counts: impl Fn([f32; 2]) -> bool,
    ) -> f32 {
        let (width, height) = SIZE;
        let image = image();
        let rays = ErpRays::new(width, height);
        let turn = Mat3::from_rotation_y(0.37) * Mat3::from_rotation_x(0.81);
        let (mut sum, mut number) = (0.0, 0.0);
        for row in 0..height {
            for column in 0..width {
                let direction = turn * rays.ray(column, row);
                let place = erp_pixel(direction, width as f32, height as f32);
                if !counts(place) {
                    continue;
                }
                for (found, known) in look(&image, place).into_iter().zip(painted(direction)) {
                    sum += (found - known).powi(2);
                    number += 1.0;
                }
            }
        }
        assert!(number > 0.0);
        (sum / number).sqrt()
    }

    #[test]
    fn samples_are_sharper_than_bilinear_ones_at_the_seam_and_at_the_poles() {
        let (width, height) = (SIZE.0 as f32, SIZE.1 as f32);
        let at_seam = |[u, _]: [f32; 2]| u < 2.0 || u > width - 2.0;
        let at_pole = |[_, v]: [f32; 2]| v < 2.0 || v > height - 2.0;
        let regions: [&dyn Fn([f32; 2]) -> bool; 3] = [&|_| true, &at_seam, &at_pole];
        for (region, counts) in regions.into_iter().enumerate() {
            let [cubic, linear] = [error(sample, counts), error(bilinear, counts)];
            println!("region {region}: {cubic:.5} against {linear:.5}");
            assert!(cubic < 0.5 * linear, "{region}: {cubic} against {linear}");
        }
    }

    #[test]
    fn rows_continue_beyond_the_poles() {
        let image = RgbImage::black(8, 4);
        let found = [-2, -1, 0, 3, 4, 5].map(|row| row_and_turn(&image, row));
        assert_eq!(found, [(1, 4), (0, 4), (0, 0), (3, 0), (3, 4), (2, 4)]);
    }

    #[test]
    fn weights_reproduce_parabolas() {
        for t in [0.0, 0.25, 0.6, 1.0] {
            let sums = [0, 1, 2].map(|power| {
                let terms = weights(t).into_iter().zip([-1.0_f32, 0.0, 1.0, 2.0]);
                terms.map(|(w, x)| w * x.powi(power)).sum::<f32>()
            });
            for (found, known) in sums.into_iter().zip([1.0, t, t * t]) {
                assert!((found - known).abs() < 1e-6, "{found} against {known}");
            }
        }
    }
}
