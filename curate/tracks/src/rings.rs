//! Points around objects, in the images of views.

use glam::{DVec2, DVec3};
use omnilife_schemas::posed_view::PosedView;

/// Size of the ring around a box, over its sides.
const RING: f64 = 1.5;
/// Least number of points for a plane in a ring.
pub const LEAST_RING_POINTS: usize = 20;
/// Maximum number of used points of a ring.
const MOST_RING_POINTS: usize = 400;

/// Projected points of a scene in a view, by squares of its image.
#[derive(Debug)]
pub struct PointsInView {
    columns: usize,
    rows: usize,
    squares: Vec<Vec<(DVec2, DVec3)>>,
}

/// Side of a square, pixels.
const SQUARE: f64 = 16.0;

impl PointsInView {
    /// Sorts points into the squares of a view.
    pub fn new(view: &PosedView, points: &[DVec3]) -> Self {
        let [width, height] = view.camera.size().map(|side| side as f64);
        let (columns, rows) = (
            (width / SQUARE).ceil() as usize,
            (height / SQUARE).ceil() as usize,
        );
        let mut squares = vec![Vec::new(); columns * rows];
        for &point in points {
            if let Some(pixel) = view.pixel(point) {
                let (column, row) = ((pixel.x / SQUARE) as usize, (pixel.y / SQUARE) as usize);
                squares[row * columns + column].push((pixel, point));
            }
        }
        Self {
            columns,
            rows,
            squares,
        }
    }

    /// Points around a box (left, top, width, height) and not in it.
    pub fn ring(&self, [left, top, width, height]: [f64; 4]) -> Vec<DVec3> {
        let (more_x, more_y) = (0.5 * (RING - 1.0) * width, 0.5 * (RING - 1.0) * height);
        // A small box has a ring too.
        let (more_x, more_y) = (more_x.max(6.0), more_y.max(6.0));
        let square = |value: f64, last: usize| ((value / SQUARE).max(0.0) as usize).min(last);
        let (first_column, last_column) = (
            square(left - more_x, self.columns - 1),
            square(left + width + more_x, self.columns - 1),
        );
        let (first_row, last_row) = (
            square(top - more_y, self.rows - 1),
            square(top + height + more_y, self.rows - 1),
        );
        let mut ring = Vec::new();
        for row in first_row..=last_row {
            for column in first_column..=last_column {
                for &(pixel, point) in &self.squares[row * self.columns + column] {
                    let (dx, dy) = (
                        (pixel.x - left - 0.5 * width).abs() - 0.5 * width,
                        (pixel.y - top - 0.5 * height).abs() - 0.5 * height,
                    );
                    let is_inside = dx <= 0.0 && dy <= 0.0;
                    if !is_inside && dx <= more_x && dy <= more_y {
                        ring.push(point);
                    }
                }
            }
        }
        let step = ring.len().div_ceil(MOST_RING_POINTS).max(1);
        ring.into_iter().step_by(step).collect()
    }
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, dvec3};
    use omnilife_schemas::camera::PinholeCamera;

    use super::*;

    fn view() -> PosedView {
        PosedView {
            frame: 0,
            seconds: 0.0,
            camera: PinholeCamera::with_horizontal_field_of_view(640, 360, 1.1).into(),
            to_world: DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z),
            centre: dvec3(0.0, 0.0, 40.0),
        }
    }

    #[test]
    fn a_ring_has_what_is_around_a_box_and_nothing_in_it() {
        let view = view();
        let ground: Vec<DVec3> = (0..3000)
            .map(|n| dvec3(f64::from(n % 60) - 30.0, f64::from(n / 60) - 25.0, 0.0))
            .collect();
        let sorted = PointsInView::new(&view, &ground);
        let ring = sorted.ring([280.0, 150.0, 80.0, 60.0]);
        assert!(ring.len() >= LEAST_RING_POINTS, "{}", ring.len());
        for point in ring {
            let pixel = view.pixel(point).expect("seen");
            let inside = (280.0..=360.0).contains(&pixel.x) && (150.0..=210.0).contains(&pixel.y);
            assert!(!inside && (260.0..=380.0).contains(&pixel.x), "{pixel}");
        }
        assert!(sorted.ring([-500.0, -500.0, 3.0, 3.0]).is_empty());
    }
}
