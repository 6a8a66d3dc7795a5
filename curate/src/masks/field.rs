//! Scalar fields on the pixels of an equirectangular image, smoothed around the seam.

use std::f64::consts::PI;

use opencv::{
    core::{BORDER_REPLICATE, Mat, Point},
    imgproc,
};

use crate::opencv_images::across_seam;

/// One value per pixel, row-major. Columns wrap around, rows end at the poles.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Field {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) values: Vec<f32>,
}

impl Field {
    /// Returns the weighted mean of each value's neighbours along its row and column, by a Gaussian of this standard
    /// deviation in pixels; across the seam if it `wraps`.
    pub(super) fn blurred(&self, sigma_pixels: f32, wraps: bool) -> opencv::Result<Self> {
        let reach = (3.0 * sigma_pixels).ceil() as i32;
        let gauss = |offset: i32| (-0.5 * (offset as f32 / sigma_pixels).powi(2)).exp();
        self.filtered(&(-reach..=reach).map(gauss).collect::<Vec<f32>>(), wraps)
    }

    /// Means over squares of `2 * reach + 1` pixels; across the seam if it `wraps`.
    pub(super) fn box_mean(&self, reach: usize, wraps: bool) -> opencv::Result<Self> {
        self.filtered(&vec![1.0; 2 * reach + 1], wraps)
    }

    /// Returns the field filtered along rows and along columns by weights around their middle.
    fn filtered(&self, weights: &[f32], wraps: bool) -> opencv::Result<Self> {
        let total: f32 = weights.iter().sum();
        let weights: Vec<f32> = weights.iter().map(|weight| weight / total).collect();
        let kernel = Mat::from_slice(&weights)?;
        let middle = Point::new(-1, -1);
        let filter = |from: &Mat, to: &mut Mat| {
            imgproc::sep_filter_2d(
                from,
                to,
                -1,
                &kernel,
                &kernel,
                middle,
                0.0,
                BORDER_REPLICATE,
            )
        };
        let reach = if wraps { weights.len() / 2 } else { 0 };
        let values = across_seam(&self.values, self.width, reach, filter)?;
        Ok(Self { values, ..*self })
    }

    /// Returns half the lengths of the differences between the neighbours on both sides; across the seam if it `wraps`.
    pub(super) fn slopes(&self, wraps: bool) -> Self {
        let (width, height) = (self.width, self.height);
        let at = |x: usize, y: usize| self.values[y * width + x];
        let mut values = Vec::with_capacity(self.values.len());
        for y in 0..height {
            for x in 0..width {
                let [left, right] = if wraps {
                    [(x + width - 1) % width, (x + 1) % width]
                } else {
                    [x.saturating_sub(1), (x + 1).min(width - 1)]
                };
                let along = at(right, y) - at(left, y);
                let across = at(x, (y + 1).min(height - 1)) - at(x, y.saturating_sub(1));
                values.push(0.5 * (along * along + across * across).sqrt());
            }
        }
        Self { values, ..*self }
    }

    /// Returns the minimum of two fields of one size.
    pub(super) fn smaller(mut self, other: &Self) -> Self {
        for (value, other) in self.values.iter_mut().zip(&other.values) {
            *value = value.min(*other);
        }
        self
    }

    /// Returns the maximum of two fields of one size.
    pub(super) fn larger(mut self, other: &Self) -> Self {
        for (value, other) in self.values.iter_mut().zip(&other.values) {
            *value = value.max(*other);
        }
        self
    }

    /// Returns the area-weighted median over the sphere; 0 for an empty field.
    pub(super) fn median_on_sphere(&self) -> f32 {
        self.median_below(0)
    }

    /// Returns the area-weighted median over the part of the sphere from a row on downwards; 0 for an empty part.
    pub(super) fn median_below(&self, first_row: usize) -> f32 {
        self.median(|row| match row < first_row {
            true => 0.0,
            false => (PI * (row as f64 + 0.5) / self.height as f64).sin(),
        })
    }

    /// Returns the median of pixels with a weight by their row; 0 for an empty field.
    pub(super) fn median(&self, weight: impl Fn(usize) -> f64) -> f32 {
        let mut weighted: Vec<(f32, f64)> = self
            .values
            .iter()
            .enumerate()
            .map(|(index, &value)| (value, weight(index / self.width)))
            .filter(|(_, weight)| *weight > 0.0)
            .collect();
        weighted.sort_by(|a, b| a.0.total_cmp(&b.0));
        let half = 0.5 * weighted.iter().map(|(_, weight)| weight).sum::<f64>();
        let mut below = 0.0;
        for (value, weight) in weighted {
            below += weight;
            if below >= half {
                return value;
            }
        }
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(width: usize, height: usize, value: impl Fn(usize, usize) -> f32) -> Field {
        let values = (0..width * height)
            .map(|index| value(index % width, index / width))
            .collect();
        Field {
            width,
            height,
            values,
        }
    }

    #[test]
    fn smoothing_goes_on_over_the_seam_and_keeps_what_is_even() {
        let even = field(16, 8, |_, _| 0.3)
            .blurred(2.0, true)
            .expect("filtered");
        assert!(even.values.iter().all(|value| (value - 0.3).abs() < 1e-6));
        let spot = field(16, 8, |x, y| f32::from(u8::from(x == 0 && y == 4)));
        let plain = spot.box_mean(1, false).expect("filtered");
        let spot = spot.box_mean(1, true).expect("filtered");
        let at = |x: usize, y: usize| spot.values[y * 16 + x];
        for (x, y) in [(15, 3), (15, 5), (0, 4), (1, 4)] {
            assert!((at(x, y) - 1.0 / 9.0).abs() < 1e-6, "{x} {y}");
        }
        assert_eq!(at(14, 4), 0.0);
        assert_eq!(plain.values[4 * 16 + 15], 0.0);
        let ramp = field(16, 8, |x, _| x as f32);
        let slopes = [true, false].map(|wraps| ramp.slopes(wraps).values[4 * 16]);
        assert_eq!(slopes, [7.0, 0.5]);
    }

    #[test]
    fn the_median_is_of_the_area_of_the_sphere() {
        // Rows around the poles: half of the pixels, 0.29 of the area.
        let caps = field(8, 64, |_, y| if (16..48).contains(&y) { 1.0 } else { 5.0 });
        assert_eq!(caps.median_on_sphere(), 1.0);
        assert_eq!(caps.median_below(48), 5.0);
        assert_eq!(caps.median_below(32), 1.0);
        assert_eq!(caps.median_below(64), 0.0);
        let ramp = field(8, 64, |_, y| y as f32);
        assert!((ramp.median_on_sphere() - 31.5).abs() <= 0.5);
        let of_first_row = ramp.median(|row| f64::from(u8::from(row == 0)));
        assert_eq!([of_first_row, caps.median(|_| 1.0)], [0.0, 1.0]);
        assert_eq!(ramp.slopes(true).values[8 * 20], 1.0);
    }
}
