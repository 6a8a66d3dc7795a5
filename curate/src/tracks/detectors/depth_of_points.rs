//! How far the surface is that a view sees, from points on it.

use glam::DVec3;
use rayon::prelude::*;

use crate::posed_view::PosedView;

/// Distances along the rays of a view's pixels; infinite where nothing is known.
#[derive(Debug, Clone, PartialEq)]
pub struct DistanceMap {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Row by row.
    pub values: Vec<f32>,
}

/// Rounds in which holes are filled from their neighbours.
const FILLING_ROUNDS: usize = 64;

impl DistanceMap {
    /// The nearest point in every pixel and its eight neighbours; pixels without any take the mean of the
    /// nearest that have one.
    pub fn new(view: &PosedView, points: &[DVec3]) -> Self {
        let [width, height] = view.camera.size();
        let mut values = vec![f32::INFINITY; width * height];
        for &point in points {
            let Some(pixel) = view.pixel(point) else {
                continue;
            };
            let distance = point.distance(view.centre) as f32;
            let (column, row) = (pixel.x as usize, pixel.y as usize);
            for row in row.saturating_sub(1)..=(row + 1).min(height - 1) {
                for column in column.saturating_sub(1)..=(column + 1).min(width - 1) {
                    let value = &mut values[row * width + column];
                    *value = value.min(distance);
                }
            }
        }
        let mut map = Self {
            width,
            height,
            values,
        };
        map.fill();
        map
    }

    /// The least and the largest of the values that are within some pixels of each, columns and rows;
    /// infinite where nothing is known.
    pub fn around(&self, radius: usize) -> [Vec<f32>; 2] {
        let (width, height) = (self.width, self.height);
        let pass = |values: &[f32], along_rows: bool, pick: fn(f32, f32) -> f32| -> Vec<f32> {
            let pixel = |pixel: usize| {
                let (row, column) = (pixel / width, pixel % width);
                let (at, end, stride) = if along_rows {
                    (column, width, 1)
                } else {
                    (row, height, width)
                };
                let near = at.saturating_sub(radius)..=(at + radius).min(end - 1);
                near.map(|other| values[pixel + other * stride - at * stride])
                    .fold(values[pixel], pick)
            };
            (0..values.len()).into_par_iter().map(pixel).collect()
        };
        [f32::min as fn(f32, f32) -> f32, f32::max]
            .map(|pick| pass(&pass(&self.values, true, pick), false, pick))
    }

    /// Gives holes the means of their known neighbours, from their borders inwards.
    fn fill(&mut self) {
        let (width, height) = (self.width, self.height);
        let mut holes: Vec<usize> = (0..self.values.len())
            .filter(|&pixel| !self.values[pixel].is_finite())
            .collect();
        for _ in 0..FILLING_ROUNDS {
            let mut filled = Vec::new();
            holes.retain(|&pixel| {
                let (row, column) = (pixel / width, pixel % width);
                let (mut sum, mut count) = (0.0, 0);
                for row in row.saturating_sub(1)..=(row + 1).min(height - 1) {
                    for column in column.saturating_sub(1)..=(column + 1).min(width - 1) {
                        let value = self.values[row * width + column];
                        if value.is_finite() {
                            sum += value;
                            count += 1;
                        }
                    }
                }
                if count > 0 {
                    filled.push((pixel, sum / count as f32));
                }
                count == 0
            });
            for &(pixel, value) in &filled {
                self.values[pixel] = value;
            }
            if holes.is_empty() || filled.is_empty() {
                return;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(values: Vec<f32>) -> DistanceMap {
        DistanceMap {
            width: 5,
            height: values.len() / 5,
            values,
        }
    }

    #[test]
    fn holes_take_the_means_of_what_is_around_them() {
        let hole = f32::INFINITY;
        let mut one = map(vec![2.0, hole, hole, hole, 6.0]);
        one.fill();
        assert_eq!(one.values, [2.0, 2.0, 4.0, 6.0, 6.0]);
        let mut none = map(vec![hole; 10]);
        none.fill();
        assert!(none.values.iter().all(|value| value.is_infinite()));
    }

    #[test]
    fn around_a_pixel_are_the_least_and_the_largest() {
        let mut values = vec![3.0; 25];
        values[12] = 1.0;
        values[24] = 9.0;
        let [least, most] = map(values).around(1);
        assert_eq!((least[6], least[0], least[18]), (1.0, 3.0, 1.0));
        assert_eq!((most[18], most[12]), (9.0, 3.0));
    }
}
