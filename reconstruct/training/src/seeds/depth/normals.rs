//! Normals of the surfaces in a distance image.

use std::f64::consts::PI;

use glam::{DMat3, DVec3, Vec3};
use omnilife_engine::camera::{Camera, rays::Rays};
use omnilife_schemas::{
    distances::{DistanceImage, EDGE_RATIO},
    statistics,
};
use rayon::prelude::*;

/// Half widths of the windows, pixels.
const HALF_WIDTHS: [usize; 5] = [1, 2, 3, 5, 8];
/// Maximum error of the slope in a window, radians; the smallest such window is used.
const LARGEST_SLOPE_ERROR: f64 = 0.05;
/// Minimum number of points for a plane, besides the pixel's own.
const LEAST_NEIGHBOURS: usize = 4;
/// Minimum ratio of the second largest variance to the largest; points below it lie on a line.
const LEAST_FLATNESS: f64 = 1e-3;
/// Standard deviation of a normal distribution over its median of absolute values.
const MEDIAN_TO_DEVIATION: f64 = 1.4826;

/// The points of a view, in its camera's frame; `None` where the distance is unknown.
#[derive(Debug)]
pub struct Points<'a> {
    distances: &'a DistanceImage,
    rays: Rays,
}

impl<'a> Points<'a> {
    /// Returns the points of a distance image of the camera's size.
    pub fn new(camera: Camera, distances: &'a DistanceImage) -> Self {
        Self {
            distances,
            rays: Rays::new(camera),
        }
    }

    /// Returns the unit ray through the centre of a pixel.
    pub fn ray(&self, column: usize, row: usize) -> DVec3 {
        let ray = self.rays.ray(column, row).as_dvec3();
        // Those of a panorama have length 1.
        if self.distances.wraps {
            ray
        } else {
            ray.normalize()
        }
    }

    /// Returns the distance of a pixel, 0 where it is unknown.
    pub fn distance(&self, column: usize, row: usize) -> f32 {
        self.distances.values[row * self.distances.width + column]
    }

    /// Returns the pixel so many columns and rows away; columns wrap in a panorama.
    pub fn neighbour(
        &self,
        [column, row]: [usize; 2],
        [right, down]: [i64; 2],
    ) -> Option<[usize; 2]> {
        let width = self.distances.width as i64;
        let row = usize::try_from(row as i64 + down).ok()?;
        let column = column as i64 + right;
        let column = if self.distances.wraps {
            column.rem_euclid(width)
        } else {
            column
        };
        let column = usize::try_from(column).ok()?;
        (row < self.distances.height && column < self.distances.width).then_some([column, row])
    }

    /// Returns true if two distances can be of one surface.
    pub fn are_close(a: f32, b: f32) -> bool {
        a > 0.0 && b > 0.0 && a.max(b) < EDGE_RATIO * a.min(b)
    }
}

/// Returns the relative noise of the distances: from the median of second differences of inverse distances, which
/// vanish on planes.
pub fn relative_noise(distances: &DistanceImage) -> f64 {
    let DistanceImage { width, height, .. } = *distances;
    if width < 3 {
        return 0.0;
    }
    // A few ten thousand pixels are enough for a median.
    let rows = (0..height).step_by((height / 64).max(1));
    let found: Vec<f64> = rows
        .flat_map(|row| {
            let row = &distances.values[row * width..(row + 1) * width];
            row.windows(3).filter_map(|three| {
                let [a, b, c] = [0, 1, 2].map(|at| f64::from(three[at]));
                let is_known = three.iter().all(|&distance| distance > 0.0);
                is_known.then(|| (b / a - 2.0 + b / c).abs())
            })
        })
        .collect();
    let median = statistics::median(&found).unwrap_or(0.0);
    MEDIAN_TO_DEVIATION * median / 6.0_f64.sqrt()
}

/// Returns the half width of the smallest window in which noise rotates a fitted plane by less than a twentieth
/// of a radian. The slope's deviation is `noise / (pitch sqrt(S))` with `S = (2k + 1)^2 k (k + 1) / 3`, the sum
/// of the squared steps, and `pitch` the angle of a pixel.
pub fn window(relative_noise: f64, rows: usize) -> usize {
    let pitch = PI / rows.max(1) as f64;
    let error = |k: usize| {
        let k = k as f64;
        let sum = (2.0 * k + 1.0).powi(2) * k * (k + 1.0) / 3.0;
        relative_noise / (pitch * sum.sqrt())
    };
    let is_enough = |k: &usize| error(*k) <= LARGEST_SLOPE_ERROR;
    let largest = HALF_WIDTHS[HALF_WIDTHS.len() - 1];
    HALF_WIDTHS.into_iter().find(is_enough).unwrap_or(largest)
}

/// Returns unit normals in the camera's frame, towards the camera. `None` without a plane: fewer than four
/// neighbours of the same surface, or all on a line.
///
/// The window is `2 half_width + 1` pixels wide and high. Near the poles of a panorama, where columns crowd, it
/// has a stride of columns, so that it is as wide as high on the sphere.
pub fn normals(points: &Points<'_>, half_width: usize) -> Vec<Option<Vec3>> {
    let (width, height) = (points.distances.width, points.distances.height);
    let mut normals = vec![None; width * height];
    normals
        .par_chunks_mut(width.max(1))
        .enumerate()
        .for_each(|(row, normals)| {
            let stride = column_stride(points, row);
            for (column, normal) in normals.iter_mut().enumerate() {
                *normal = at_pixel(points, [column, row], half_width as i64, stride);
            }
        });
    normals
}

/// Returns the columns of a row of a panorama that are as wide as a row is high.
fn column_stride(points: &Points<'_>, row: usize) -> i64 {
    let width = points.distances.width;
    if !points.distances.wraps {
        return 1;
    }
    let cosine = f64::from(points.rays.scale[row]).max(1e-6);
    ((1.0 / cosine).round() as i64).clamp(1, (width as i64 / 8).max(1))
}

fn at_pixel(points: &Points<'_>, pixel: [usize; 2], k: i64, stride: i64) -> Option<Vec3> {
    let own = points.distance(pixel[0], pixel[1]);
    if own <= 0.0 {
        return None;
    }
    let ray = points.ray(pixel[0], pixel[1]);
    let centre = ray * f64::from(own);
    let (mut count, mut sum, mut squares) = (0_usize, DVec3::ZERO, [0.0; 6]);
    for down in -k..=k {
        for right in -k..=k {
            let Some([column, row]) = points.neighbour(pixel, [right * stride, down]) else {
                continue;
            };
            let distance = points.distance(column, row);
            if !Points::are_close(own, distance) {
                continue;
            }
            // About the centre and in its unit: nothing cancels, and no scale overflows.
            let place = points.ray(column, row) * f64::from(distance);
            let d = (place - centre) / f64::from(own);
            count += 1;
            sum += d;
            let products = [
                d.x * d.x,
                d.x * d.y,
                d.x * d.z,
                d.y * d.y,
                d.y * d.z,
                d.z * d.z,
            ];
            for (square, product) in squares.iter_mut().zip(products) {
                *square += product;
            }
        }
    }
    if count <= LEAST_NEIGHBOURS {
        return None;
    }
    let mean = sum / count as f64;
    let [xx, xy, xz, yy, yz, zz] = squares.map(|square| square / count as f64);
    let covariance = DMat3::from_cols(
        DVec3::new(xx, xy, xz) - mean * mean.x,
        DVec3::new(xy, yy, yz) - mean * mean.y,
        DVec3::new(xz, yz, zz) - mean * mean.z,
    );
    let normal = thinnest_direction(covariance)?;
    let towards = if normal.dot(ray) > 0.0 {
        -normal
    } else {
        normal
    };
    Some(towards.as_vec3())
}

/// Returns the unit eigenvector of the smallest eigenvalue of a symmetric matrix of covariances, in closed form;
/// `None` where the second largest is nearly 0 beside the largest.
fn thinnest_direction(covariance: DMat3) -> Option<DVec3> {
    let [largest, middle, least] = eigenvalues(covariance)?;
    if middle < LEAST_FLATNESS * largest {
        return None;
    }
    // The rows of A - least I are orthogonal to the eigenvector: two of them span its complement.
    let rows = covariance - DMat3::from_diagonal(DVec3::splat(least));
    let [a, b, c] = [rows.x_axis, rows.y_axis, rows.z_axis];
    let candidates = [a.cross(b), b.cross(c), c.cross(a)];
    let longer = |x: &DVec3, y: &DVec3| x.length_squared().total_cmp(&y.length_squared());
    candidates.into_iter().max_by(longer)?.try_normalize()
}

/// Returns the eigenvalues of a symmetric matrix, largest first (Smith 1961); `None` for a matrix that is zero or
/// not finite.
fn eigenvalues(matrix: DMat3) -> Option<[f64; 3]> {
    let [a, b, c] = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    let mean = (a.x + b.y + c.z) / 3.0;
    let off = a.y * a.y + a.z * a.z + b.z * b.z;
    let spread = (a.x - mean).powi(2) + (b.y - mean).powi(2) + (c.z - mean).powi(2) + 2.0 * off;
    let p = (spread / 6.0).sqrt();
    if !(p.is_finite() && mean > 0.0) {
        return None;
    }
    if p == 0.0 {
        return Some([mean; 3]);
    }
    let normalized = (matrix - DMat3::from_diagonal(DVec3::splat(mean))) * (1.0 / p);
    let angle = (normalized.determinant() / 2.0).clamp(-1.0, 1.0).acos() / 3.0;
    let largest = mean + 2.0 * p * angle.cos();
    let least = mean + 2.0 * p * (angle + 2.0 * PI / 3.0).cos();
    Some([largest, 3.0 * mean - largest - least, least])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenvalues_and_the_thinnest_direction_are_those_of_the_matrix() {
        let turn = DMat3::from_euler(glam::EulerRot::XYZ, 0.3, -1.1, 2.0);
        for values in [[3.0, 2.0, 1e-9], [3.0, 3.0, 1.0], [1.0, 0.5, 0.5 - 1e-3]] {
            let matrix = turn * DMat3::from_diagonal(DVec3::from_array(values)) * turn.transpose();
            let found = eigenvalues(matrix).expect("finite");
            for (found, expected) in found.iter().zip(values) {
                assert!((found - expected).abs() < 1e-12 * 3.0, "{found} {expected}");
            }
            let direction = thinnest_direction(matrix).expect("flat");
            assert!(direction.dot(turn.z_axis).abs() > 1.0 - 1e-9, "{direction}");
        }
        let line = DMat3::from_diagonal(DVec3::new(1.0, 1e-6, 1e-6));
        assert_eq!(thinnest_direction(line), None);
        assert_eq!(thinnest_direction(DMat3::ZERO), None);
        assert_eq!(
            thinnest_direction(DMat3::from_cols_array(&[f64::NAN; 9])),
            None
        );
    }

    #[test]
    fn windows_grow_with_the_noise() {
        // Standard deviations of the slope at 512 rows: 0.133, 0.046 and 0.023 for 0.2 %.
        for (noise, expected) in [(0.0, 1), (1e-3 * 0.5, 1), (2e-3, 2), (1e-2, 5), (1.0, 8)] {
            assert_eq!(window(noise, 512), expected, "{noise}");
        }
    }

    #[test]
    fn the_noise_is_found_and_a_plane_has_none() {
        let (width, height) = (256, 128);
        let mut seed = 7_u64;
        let mut noise = || {
            let mut sum = 0.0;
            for _ in 0..12 {
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                sum += (seed >> 40) as f32 / (1 << 24) as f32;
            }
            sum - 6.0
        };
        let wall = |at: usize| {
            let longitude = ((at % width) as f32 + 0.5) / width as f32 * std::f32::consts::TAU;
            2.0 / longitude.cos().abs().max(longitude.sin().abs())
        };
        let image = |values: Vec<f32>| DistanceImage {
            width,
            height,
            wraps: true,
            values,
        };
        let clean = image((0..width * height).map(wall).collect());
        // A plane is not linear in angles: the difference is the square of a pixel's angle.
        assert!(relative_noise(&clean) < 5e-4);
        let noisy = |at| wall(at) * (1.0 + 0.01 * noise());
        let noisy = image((0..width * height).map(noisy).collect());
        let found = relative_noise(&noisy);
        assert!((found - 0.01).abs() < 1e-3, "{found}");
    }
}
