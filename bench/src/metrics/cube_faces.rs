//! The six faces of the cube around the camera, on which some feed-forward methods are scored: an
//! ERP image gives the poles far more pixels than they have of the sphere, cube faces do not.

use glam::{dvec2, dvec3};
use omnilife_schemas::{
    camera::{CameraModel, ErpCamera, cube::CUBE_FACES},
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
}

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
    CUBE_FACES
        .par_iter()
        .map(|cube_face| {
            let mut face = Face {
                side,
                prediction: Vec::with_capacity(side * side * 3),
                truth: Vec::with_capacity(side * side * 3),
            };
            let coordinate = |index: usize| (2 * index + 1) as f64 / side as f64 - 1.0;
            for (row, column) in (0..side * side).map(|at| (at / side, at % side)) {
                let on_face = dvec3(coordinate(column), coordinate(row), 1.0);
                let direction = cube_face.to_camera * on_face;
                let Some(pixel) = camera.project(direction) else {
                    continue;
                };
                let corners = bilinear([width, height], Edges::Around, dvec2(pixel.x, pixel.y));
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
