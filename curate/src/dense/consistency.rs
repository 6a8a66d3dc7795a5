//! Consistency of depths between views.

use glam::DVec3;
use omnilife_schemas::camera::{CameraModel, PinholeCamera};
use rayon::prelude::*;

use crate::posed_view::PosedView;

/// Largest relative difference between the depths of one place in two views.
const TOLERANCE: f64 = 0.01;
/// Confirmations that a depth needs; all if it was compared with fewer views.
const CONFIRMATIONS: usize = 2;

/// The depth of every pixel of a view.
#[derive(Debug, Clone)]
pub(super) struct DepthMap {
    pub(super) camera: PinholeCamera,
    /// The view at its own camera; only its pose is used.
    pub(super) view: PosedView,
    /// Along the viewing direction, world units, row by row.
    pub(super) depths: Vec<f32>,
}

impl DepthMap {
    /// Returns the world point of a pixel.
    pub(super) fn point(&self, pixel: usize) -> DVec3 {
        let width = self.camera.width as usize;
        let place = glam::dvec2((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
        let ray = self.camera.unproject(place);
        self.view.centre + self.view.to_world * ray * (f64::from(self.depths[pixel]) / ray.z)
    }

    /// Returns the distance along the ray of a pixel.
    pub(super) fn distance(&self, pixel: usize) -> f32 {
        self.point(pixel).distance(self.view.centre) as f32
    }

    /// Returns true if its own depth agrees with that of a world point.
    fn confirms(&self, point: DVec3) -> bool {
        let seen = self.view.in_camera(point);
        let Some(place) = self.camera.project(seen) else {
            return false;
        };
        let (width, height) = (i64::from(self.camera.width), i64::from(self.camera.height));
        let (left, top) = (
            (place.x - 0.5).floor() as i64,
            (place.y - 0.5).floor() as i64,
        );
        // One pixel around is enough: at an edge of depth the other ones belong to something else.
        [(0, 0), (1, 0), (0, 1), (1, 1)].iter().any(|&(dx, dy)| {
            let (column, row) = (left + dx, top + dy);
            let is_inside = (0..width).contains(&column) && (0..height).contains(&row);
            is_inside && {
                let depth = f64::from(self.depths[(row * width + column) as usize]);
                (depth - seen.z).abs() <= TOLERANCE * seen.z
            }
        })
    }
}

/// Returns per pixel the share of witnesses that confirm its depth; 0 if too few do.
pub(super) fn confirmed(map: &DepthMap, others: &[&DepthMap]) -> Vec<f32> {
    let needed = CONFIRMATIONS.min(others.len());
    (0..map.depths.len())
        .into_par_iter()
        .map(|pixel| {
            if !map.depths[pixel].is_finite() {
                return 0.0;
            }
            let point = map.point(pixel);
            let count = others.iter().filter(|other| other.confirms(point)).count();
            if needed > 0 && count >= needed {
                count as f32 / others.len() as f32
            } else {
                0.0
            }
        })
        .collect()
}
