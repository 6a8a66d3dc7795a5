//! Distances of the surface in a view, from points on it.

use glam::DVec3;
use omnilife_schemas::posed_view::PosedView;
use rayon::prelude::*;

use crate::detectors::pixels_around::around;

/// Distances along the rays of a view's pixels; infinite if unknown.
#[derive(Debug, Clone, PartialEq)]
pub struct DistanceMap {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Row by row.
    pub values: Vec<f32>,
}

/// Replaces values by smaller, or larger, ones of others.
type Pick = fn(&mut [f32], &[f32]);

#[multiversion::multiversion(targets("x86_64+avx2"))]
fn least(values: &mut [f32], others: &[f32]) {
    for (value, other) in values.iter_mut().zip(others) {
        *value = if *other < *value { *other } else { *value };
    }
}

#[multiversion::multiversion(targets("x86_64+avx2"))]
fn largest(values: &mut [f32], others: &[f32]) {
    for (value, other) in values.iter_mut().zip(others) {
        *value = if *other > *value { *other } else { *value };
    }
}

/// Rounds in which holes are filled from their neighbours.
const FILLING_ROUNDS: usize = 64;

impl DistanceMap {
    /// Takes the nearest point in every pixel and its eight neighbours; pixels without any take the mean of the nearest
    /// known ones.
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

    /// Returns the least and the largest value within some pixels of each, columns and rows; infinite if unknown.
    pub fn around(&self, radius: usize) -> [Vec<f32>; 2] {
        [least as Pick, largest].map(|pick| self.picked(radius, pick))
    }

    /// Returns the picked value of those within some pixels of each.
    fn picked(&self, radius: usize, pick: Pick) -> Vec<f32> {
        let (width, height) = (self.width, self.height);
        let mut along_rows = self.values.clone();
        let rows = self.values.par_chunks_exact(width);
        along_rows
            .par_chunks_exact_mut(width)
            .zip(rows)
            .for_each(|(out, row)| {
                for step in 1..=radius.min(width - 1) {
                    pick(&mut out[step..], &row[..width - step]);
                    pick(&mut out[..width - step], &row[step..]);
                }
            });
        let mut out = along_rows.clone();
        out.par_chunks_exact_mut(width)
            .enumerate()
            .for_each(|(row, out)| {
                for other in row.saturating_sub(radius)..=(row + radius).min(height - 1) {
                    pick(out, &along_rows[other * width..(other + 1) * width]);
                }
            });
        out
    }

    /// Gives holes the means of their known neighbours, from their borders inwards.
    fn fill(&mut self) {
        let (width, height) = (self.width, self.height);
        let size = [width, height];
        let is_hole = |value: f32| !value.is_finite();
        let is_beside_known = |pixel: usize| {
            let mut is_beside = false;
            around(pixel, size, |beside| {
                is_beside |= !is_hole(self.values[beside]);
            });
            is_beside
        };
        let mut border: Vec<usize> = (0..self.values.len())
            .filter(|&pixel| is_hole(self.values[pixel]) && is_beside_known(pixel))
            .collect();
        // Known or filled pixels, and those about to be.
        let mut is_taken: Vec<bool> = self.values.iter().map(|&value| !is_hole(value)).collect();
        border.iter().for_each(|&pixel| is_taken[pixel] = true);
        for _ in 0..FILLING_ROUNDS {
            let mean = |&pixel: &usize| {
                let (mut sum, mut count) = (0.0, 0);
                around(pixel, size, |beside| {
                    let value = self.values[beside];
                    if !is_hole(value) {
                        sum += value;
                        count += 1;
                    }
                });
                sum / count as f32
            };
            let means: Vec<f32> = border.iter().map(mean).collect();
            let mut next = Vec::new();
            for (&pixel, mean) in border.iter().zip(means) {
                self.values[pixel] = mean;
                around(pixel, size, |beside| {
                    if !is_taken[beside] {
                        is_taken[beside] = true;
                        next.push(beside);
                    }
                });
            }
            border = next;
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
