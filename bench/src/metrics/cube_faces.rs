//! The six faces of the cube around the camera, on which some feed-forward methods are scored: an
//! ERP image gives the poles far more pixels than they have of the sphere, cube faces do not.

use glam::{DVec3, dvec3};
use omnilife_schemas::camera::{CameraModel, ErpCamera};
use rayon::prelude::*;

use super::ViewPair;

/// Prediction and ground truth on one face: `side * side * 3` values in [0, 1], row-major.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Face {
    pub(super) side: usize,
    pub(super) prediction: Vec<f64>,
    pub(super) truth: Vec<f64>,
}

/// The direction of a face's point (a, b), both in [-1, 1], a to the right and b down. Front, right,
/// back, left, then up and down as seen by turning from the front.
const DIRECTIONS: [fn(f64, f64) -> DVec3; 6] = [
    |a, b| dvec3(a, b, 1.0),
    |a, b| dvec3(1.0, b, -a),
    |a, b| dvec3(-a, b, -1.0),
    |a, b| dvec3(-1.0, b, a),
    |a, b| dvec3(a, -1.0, b),
    |a, b| dvec3(a, 1.0, -b),
];

/// Faces of 90 degrees, as wide as half the height of the ERP image, by bilinear interpolation:
/// around the seam, and at the poles with the last row standing for those beyond. Nothing is
/// rounded to 8 bits again.
pub(super) fn render(pair: &ViewPair) -> Vec<Face> {
    let [width, height] = pair.size();
    let camera = ErpCamera {
        width: width as u32,
        height: height as u32,
    };
    let side = (height / 2).max(1);
    DIRECTIONS
        .par_iter()
        .map(|direction| {
            let mut face = Face {
                side,
                prediction: Vec::with_capacity(side * side * 3),
                truth: Vec::with_capacity(side * side * 3),
            };
            let coordinate = |index: usize| (2 * index + 1) as f64 / side as f64 - 1.0;
            for (row, column) in (0..side * side).map(|at| (at / side, at % side)) {
                let Some(pixel) = camera.project(direction(coordinate(column), coordinate(row)))
                else {
                    continue;
                };
                let corners = corners(pixel.x - 0.5, pixel.y - 0.5, [width, height]);
                for (values, bytes) in [
                    (&mut face.prediction, pair.prediction()),
                    (&mut face.truth, pair.truth()),
                ] {
                    values.extend((0..3).map(|channel| {
                        let weighted = corners.iter().map(|&(index, weight)| {
                            weight * (f64::from(bytes[3 * index + channel]) / 255.0)
                        });
                        weighted.sum::<f64>()
                    }));
                }
            }
            face
        })
        .collect()
}

/// The four pixels around a position, counted in whole pixels from the centre of the first, and
/// their weights.
fn corners(x: f64, y: f64, [width, height]: [usize; 2]) -> [(usize, f64); 4] {
    let (left, top) = (x.floor(), y.floor());
    let (right_share, bottom_share) = (x - left, y - top);
    let column = |offset: f64| (left + offset).rem_euclid(width as f64) as usize % width;
    let row = |offset: f64| (top + offset).clamp(0.0, (height - 1) as f64) as usize;
    [
        (0.0, 0.0, (1.0 - right_share) * (1.0 - bottom_share)),
        (1.0, 0.0, right_share * (1.0 - bottom_share)),
        (0.0, 1.0, (1.0 - right_share) * bottom_share),
        (1.0, 1.0, right_share * bottom_share),
    ]
    .map(|(dx, dy, weight)| (row(dy) * width + column(dx), weight))
}
