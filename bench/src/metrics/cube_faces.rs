//! The six faces of the cube around the camera, on which some feed-forward methods are scored. An ERP image gives the
//! poles far more pixels than their share of the sphere; cube faces do not.

use glam::{DVec3, dvec3};
use omnilife_schemas::{
    camera::{CameraModel, ErpCamera},
    interpolation::{Edges, bilinear},
};
use rayon::prelude::*;

use super::ViewPair;

/// Prediction and ground truth on one face: `side * side * 3` values in [0, 1], row-major.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Face {
    pub(super) side: usize,
    pub(super) prediction: Vec<f64>,
    pub(super) truth: Vec<f64>,
    /// Pixels that count, by the nearest pixel of the ERP image; `None` for all.
    pub(super) counted: Option<Vec<bool>>,
}

impl Face {
    /// Returns true if a value of the images counts.
    pub(super) fn counts(&self, value: usize) -> bool {
        (self.counted.as_ref()).is_none_or(|counted| counted[value / 3])
    }

    pub(super) fn counted_pixels(&self) -> usize {
        match &self.counted {
            None => self.side * self.side,
            Some(counted) => counted.iter().filter(|&&is_counted| is_counted).count(),
        }
    }
}

/// The direction of a face's point (a, b), both in [-1, 1], a to the right and b down, in the order of
/// `CUBE_FACES`. Not by its matrices: a sum of products has no negative zeros, so that the middle of the lowest
/// face would be looked up at another longitude, and scores would change.
const DIRECTIONS: [fn(f64, f64) -> DVec3; 6] = [
    |a, b| dvec3(a, b, 1.0),
    |a, b| dvec3(1.0, b, -a),
    |a, b| dvec3(-a, b, -1.0),
    |a, b| dvec3(-1.0, b, a),
    |a, b| dvec3(a, -1.0, b),
    |a, b| dvec3(a, 1.0, -b),
];

/// Renders faces of 90 degrees, as wide as half the height of the ERP image, by bilinear interpolation. It wraps around
/// the seam and repeats the last row beyond the poles. Nothing is rounded to 8 bits again.
pub(super) fn render(pair: &ViewPair) -> Vec<Face> {
    let [width, height] = pair.size();
    let camera = ErpCamera::new(width as u32, height as u32);
    let side = (height / 2).max(1);
    DIRECTIONS
        .par_iter()
        .map(|direction| {
            let mut face = Face {
                side,
                prediction: Vec::with_capacity(side * side * 3),
                truth: Vec::with_capacity(side * side * 3),
                counted: pair.counted().map(|_| Vec::with_capacity(side * side)),
            };
            let coordinate = |index: usize| (2 * index + 1) as f64 / side as f64 - 1.0;
            for (row, column) in (0..side * side).map(|at| (at / side, at % side)) {
                let Some(pixel) = camera.project(direction(coordinate(column), coordinate(row)))
                else {
                    continue;
                };
                if let Some(counted) = &mut face.counted {
                    let column = (pixel.x as usize).min(width - 1);
                    let row = (pixel.y as usize).min(height - 1);
                    counted.push(pair.counts(row * width + column));
                }
                let corners = bilinear([width, height], Edges::Around, pixel);
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
