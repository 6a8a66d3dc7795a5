//! How far the surface is that a view sees, from points on it.

use glam::DVec3;

use crate::tracks::views::PosedView;

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

    fn fill(&mut self) {
        let (width, height) = (self.width, self.height);
        for _ in 0..FILLING_ROUNDS {
            let before = self.values.clone();
            let mut holes = 0;
            for row in 0..height {
                for column in 0..width {
                    if before[row * width + column].is_finite() {
                        continue;
                    }
                    let (mut sum, mut count) = (0.0, 0);
                    for row in row.saturating_sub(1)..=(row + 1).min(height - 1) {
                        for column in column.saturating_sub(1)..=(column + 1).min(width - 1) {
                            let value = before[row * width + column];
                            if value.is_finite() {
                                sum += value;
                                count += 1;
                            }
                        }
                    }
                    if count > 0 {
                        self.values[row * width + column] = sum / count as f32;
                    } else {
                        holes += 1;
                    }
                }
            }
            if holes == 0 {
                return;
            }
        }
    }
}
