//! Distance images: the distance of the surface in each pixel of a panorama or photograph.
//!
//! Inverse distances are interpolated between pixels: on a plane they are linear along every great circle to second
//! order, distances are not. Across a depth edge the nearest pixel's distance is taken, because a mean of both sides
//! would hang in the air.

use std::path::Path;

use glam::dvec2;

use crate::{
    camera::CameraModel,
    image_file::ImageFile,
    npy,
    records::{DistanceConvention, DistanceGrid},
    store::StoreError,
};

/// Distances of neighbours that differ by more than this factor belong to different surfaces.
pub const EDGE_RATIO: f32 = 1.1;

/// Distance for every pixel, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct DistanceImage {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// True where the first column follows the last, as in a panorama.
    pub wraps: bool,
    /// Distances, positive; 0 where the distance is not known.
    pub values: Vec<f32>,
}

impl DistanceImage {
    /// Reads a 16-bit grey PNG or a `.npy` of f32 or f64 (rows, columns); a step of 1 means `unit`. The values 0 and
    /// infinity mean that the distance is not known.
    ///
    /// # Errors
    /// When the file is missing or damaged, a value is negative or NaN, or no distance is known; names
    /// the file and the pixel.
    pub fn read(path: &Path, unit: f64, wraps: bool) -> Result<Self, StoreError> {
        let image = Self::read_if_any(path, unit, wraps)?;
        if image.known() == 0 {
            return Err(StoreError::malformed(path, "no distance in it is known"));
        }
        Ok(image)
    }

    /// Reads a file as [`Self::read`] does, but accepts one without any known distance.
    ///
    /// # Errors
    /// The other errors of [`Self::read`].
    pub fn read_if_any(path: &Path, unit: f64, wraps: bool) -> Result<Self, StoreError> {
        let malformed = |reason: String| StoreError::malformed(path, reason);
        let is_array = path
            .extension()
            .is_some_and(|extension| extension.eq_ignore_ascii_case("npy"));
        let (width, height, raw): (usize, usize, Vec<f64>) = if is_array {
            let array = npy::read(path)?;
            let &[height, width] = &array.shape[..] else {
                let reason = format!(
                    "is of shape {:?}, expected (rows, columns) of distances",
                    array.shape
                );
                return Err(malformed(reason));
            };
            (width, height, array.values)
        } else {
            let file = ImageFile::open(path)?;
            let [width, height] = file.size();
            let values = file.decode_grey16()?;
            (width, height, values.into_iter().map(f64::from).collect())
        };
        if let Some(at) = raw.iter().position(|value| value.is_nan() || *value < 0.0) {
            let (row, column) = (at / width.max(1), at % width.max(1));
            let value = raw[at];
            return Err(malformed(format!(
                "the distance at row {row}, column {column} is {value}"
            )));
        }
        let known = |value: f64| {
            let distance = (value * unit) as f32;
            if distance.is_normal() { distance } else { 0.0 }
        };
        Ok(Self {
            width,
            height,
            wraps,
            values: raw.into_iter().map(known).collect(),
        })
    }

    /// Returns the number of known distances.
    pub fn known(&self) -> usize {
        self.values.iter().filter(|&&value| value > 0.0).count()
    }

    /// Returns the distance at a position in the image, pixels (the centre of the first pixel is at 1/2, 1/2); 0
    /// where it is not known.
    pub fn sample(&self, u: f64, v: f64) -> f32 {
        let (x, y) = (u - 0.5, v - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let (fx, fy) = ((x - left) as f32, (y - top) as f32);
        let (left, top) = (left as i64, top as i64);
        let weighted = [
            (self.at(left, top), (1.0 - fx) * (1.0 - fy)),
            (self.at(left + 1, top), fx * (1.0 - fy)),
            (self.at(left, top + 1), (1.0 - fx) * fy),
            (self.at(left + 1, top + 1), fx * fy),
        ];
        let least = weighted.iter().map(|w| w.0).fold(f32::INFINITY, f32::min);
        let most = weighted.iter().map(|w| w.0).fold(0.0, f32::max);
        if least > 0.0 && most < EDGE_RATIO * least {
            return 1.0 / weighted.iter().map(|(d, w)| w / d).sum::<f32>();
        }
        let nearest = |a: &(f32, f32), b: &(f32, f32)| a.1.total_cmp(&b.1);
        weighted.into_iter().max_by(nearest).map_or(0.0, |w| w.0)
    }

    /// Returns the value of a pixel. Columns wrap around a panorama; otherwise the outermost ones repeat, as rows do.
    fn at(&self, column: i64, row: i64) -> f32 {
        let (width, height) = (self.width as i64, self.height as i64);
        let column = if self.wraps {
            column.rem_euclid(width)
        } else {
            column.clamp(0, width - 1)
        };
        let row = row.clamp(0, height - 1);
        self.values[(row * width + column) as usize]
    }

    /// Returns the same distances on another grid.
    #[must_use]
    pub fn resampled(&self, width: usize, height: usize) -> Self {
        if [width, height] == [self.width, self.height] {
            return self.clone();
        }
        let (to_u, to_v) = (
            self.width as f64 / width as f64,
            self.height as f64 / height as f64,
        );
        self.gathered(width, height, |column, row| {
            self.sample((column + 0.5) * to_u, (row + 0.5) * to_v)
        })
    }

    fn gathered(&self, width: usize, height: usize, value: impl Fn(f64, f64) -> f32) -> Self {
        let pixels = (0..width * height).map(|at| value((at % width) as f64, (at / width) as f64));
        Self {
            width,
            height,
            wraps: self.wraps,
            values: pixels.collect(),
        }
    }

    /// Returns the image on the project's grid, in which pixel (i, j) has its centre at (i + 1/2, j + 1/2), from
    /// another grid of the whole sphere.
    #[must_use]
    pub fn brought_from(self, grid: DistanceGrid) -> Self {
        match grid {
            DistanceGrid::HalfPixel => self,
            DistanceGrid::Endpoint => self.brought_from_endpoints(),
        }
    }

    /// Converts from the grid of PanoGS, Eq. 4: `theta = 2 pi u / (W - 1) - pi`, `phi = pi / 2 - pi v / (H - 1)`.
    /// Columns 0 and W - 1 are one direction, of which the first is kept; a turn is W - 1 columns.
    ///
    /// Its camera frame (x forward, y down, z right; Eq. 5) is a mirror image of a right-handed one, but
    /// its pixels are not: `p = (z, y, x)` there has its right on the right of the image, as here.
    fn brought_from_endpoints(self) -> Self {
        let (width, height) = (self.width, self.height);
        let turn = width.saturating_sub(1).max(1);
        let rows = self.values.chunks_exact(width.max(1));
        let without_last = Self {
            width: turn,
            height,
            wraps: true,
            values: rows.flat_map(|row| &row[..turn]).copied().collect(),
        };
        let (columns, last_row) = (turn as f64, height.saturating_sub(1) as f64);
        without_last.gathered(width, height, |column, row| {
            let u = (column + 0.5) / width as f64 * columns;
            let v = (row + 0.5) / height as f64 * last_row;
            without_last.sample(u + 0.5, v + 0.5)
        })
    }

    /// Converts values of another convention to distances along the rays. `camera` must have this image's size.
    #[must_use]
    pub fn along_rays(mut self, convention: DistanceConvention, camera: &impl CameraModel) -> Self {
        if convention == DistanceConvention::Ray {
            return self;
        }
        let width = self.width;
        for (at, value) in self.values.iter_mut().enumerate() {
            let pixel = dvec2((at % width) as f64 + 0.5, (at / width) as f64 + 0.5);
            let ray = camera.unproject(pixel).normalize();
            // A panorama has no z: it is that of the cube face of the pixel.
            let along = if self.wraps {
                ray.abs().max_element()
            } else {
                ray.z
            };
            *value = (f64::from(*value) / along) as f32;
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, dvec3};

    use super::*;
    use crate::camera::ErpCamera;

    /// Returns distances of the walls of a room from a position off its middle.
    fn distance(ray: DVec3) -> f64 {
        let wall = |direction: f64, low: f64, high: f64| {
            (if direction > 0.0 { high } else { low } / direction).abs()
        };
        wall(ray.x, -2.0, 3.0)
            .min(wall(ray.y, -1.4, 1.6))
            .min(wall(ray.z, -4.0, 2.5))
    }

    fn image(width: usize, height: usize, ray: impl Fn(f64, f64) -> DVec3) -> DistanceImage {
        let values = (0..width * height)
            .map(|at| distance(ray((at % width) as f64, (at / width) as f64)) as f32);
        DistanceImage {
            width,
            height,
            wraps: true,
            values: values.collect(),
        }
    }

    fn half_pixel(width: usize, height: usize) -> DistanceImage {
        let camera = ErpCamera::new(width as u32, height as u32);
        image(width, height, |column, row| {
            camera.unproject(dvec2(column + 0.5, row + 0.5))
        })
    }

    /// Returns an image on the grid of PanoGS, Eqs. 4 and 5, with its `(forward, down, right)` as
    /// `(right, down, forward)`.
    fn endpoint(width: usize, height: usize) -> DistanceImage {
        image(width, height, |column, row| {
            let theta = column / (width as f64 - 1.0) * std::f64::consts::TAU;
            let theta = theta - std::f64::consts::PI;
            let phi = (0.5 - row / (height as f64 - 1.0)) * std::f64::consts::PI;
            dvec3(phi.cos() * theta.sin(), -phi.sin(), phi.cos() * theta.cos())
        })
    }

    /// Returns relative differences, sorted.
    fn differences(a: &DistanceImage, b: &DistanceImage) -> Vec<f32> {
        let pairs = a.values.iter().zip(&b.values);
        let mut found: Vec<f32> = pairs.map(|(a, b)| (a - b).abs() / b).collect();
        found.sort_by(f32::total_cmp);
        found
    }

    #[test]
    fn inverse_distances_are_interpolated_across_faces() {
        let found = differences(
            &half_pixel(512, 256).resampled(256, 128),
            &half_pixel(256, 128),
        );
        let at = |share: f64| found[(share * found.len() as f64) as usize];
        assert!(
            at(0.5) < 3e-5 && at(0.95) < 3e-4,
            "{} {}",
            at(0.5),
            at(0.95)
        );
    }

    #[test]
    fn the_grid_with_ends_is_brought_to_ours() {
        let ours = half_pixel(512, 256);
        let brought = endpoint(512, 256).brought_from(DistanceGrid::Endpoint);
        let untouched = endpoint(512, 256);
        let median = |image: &DistanceImage| differences(image, &ours)[512 * 128];
        assert!(median(&brought) < 5e-5, "{}", median(&brought));
        assert!(median(&untouched) > 5e-4, "{}", median(&untouched));
    }

    #[test]
    fn edges_are_not_averaged_and_unknown_is_nothing() {
        let image = DistanceImage {
            width: 4,
            height: 1,
            wraps: true,
            values: vec![1.0, 1.0, 5.0, 0.0],
        };
        for (u, expected) in [(1.0, 1.0), (1.9, 1.0), (2.1, 5.0), (3.4, 0.0), (3.9, 0.0)] {
            assert_eq!(image.sample(u, 0.5), expected, "{u}");
        }
    }

    #[test]
    fn z_is_brought_to_the_ray() {
        let camera = ErpCamera::new(64, 32);
        let rays = half_pixel(64, 32);
        let mut faces = rays.clone();
        for (at, value) in faces.values.iter_mut().enumerate() {
            let pixel = dvec2((at % 64) as f64 + 0.5, (at / 64) as f64 + 0.5);
            *value *= camera.unproject(pixel).abs().max_element() as f32;
        }
        let brought = faces.along_rays(DistanceConvention::Z, &camera);
        assert!(differences(&brought, &rays)[64 * 32 - 1] < 1e-6);
    }

    #[test]
    fn files_without_usable_distances_are_refused_with_the_pixel()
    -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("a.npy");
        let refusal = |shape: &[usize], values: &[f32]| {
            npy::write_f32(&path, shape, values).map_err(|error| error.to_string())?;
            DistanceImage::read(&path, 1.0, true)
                .map(|image| image.known())
                .map_err(|error| error.to_string())
        };
        assert_eq!(refusal(&[1, 3], &[1.0, 0.0, f32::INFINITY]), Ok(1));
        for (shape, values, expected) in [
            (
                &[2, 2][..],
                &[1.0, 2.0, 3.0, -1.0][..],
                "row 1, column 1 is -1",
            ),
            (
                &[2, 2],
                &[1.0, f32::NAN, 3.0, 1.0],
                "row 0, column 1 is NaN",
            ),
            (&[2, 2], &[0.0; 4], "no distance in it is known"),
            (&[4], &[1.0; 4], "expected (rows, columns)"),
        ] {
            let message = refusal(shape, values).err().unwrap_or_default();
            assert!(message.contains(expected), "{message}");
            assert!(message.contains("a.npy"), "{message}");
        }
        Ok(())
    }
}
