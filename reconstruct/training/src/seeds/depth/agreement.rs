//! Agreement of the other views with a view's samples: they see the sample too, see it finer, or see past it.

use glam::Vec3;
use omnilife_engine::camera::nearest::Projector;
use rayon::prelude::*;

use super::lift::{DistanceView, SurfaceSamples, pixel_angle};

/// Minimum tolerance of the distances of two views of one surface, as a share.
const LEAST_TOLERANCE: f64 = 0.02;
/// The tolerance in disagreements of the views' distances.
const DISAGREEMENTS: f64 = 3.0;
/// Minimum excess of the distance in a view that sees past a sample, in tolerances.
const FREE_TOLERANCES: f64 = 2.5;
/// Minimum cosine in the density of samples of a slanted surface.
const LEAST_COSINE: f32 = 0.05;

/// Agreement of the views on one sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Agreement {
    /// Other views that see a surface there.
    pub support: u16,
    /// Other views that see past it: it lies in their free space.
    pub free: u16,
    /// True if no other view has a finer sample of the surface.
    pub is_finest: bool,
}

/// Returns the maximum difference of two views' distances to one surface, as a share.
pub fn tolerance(disagreement: Option<f64>) -> f64 {
    LEAST_TOLERANCE.max(DISAGREEMENTS * disagreement.unwrap_or(0.0))
}

/// Returns true if a view sees past a place: its surface there is farther by more than two and a half tolerances.
pub fn sees_past(
    view: &DistanceView<'_>,
    projector: &Projector,
    place: Vec3,
    tolerance: f32,
) -> bool {
    let seen = projector.pixel(place);
    seen.is_some_and(|(pixel, distance)| {
        let theirs = view.distances.values[pixel];
        theirs > 0.0 && !view.hides(pixel) && is_farther(theirs, distance, tolerance)
    })
}

fn is_farther(theirs: f32, distance: f32, tolerance: f32) -> bool {
    theirs > (1.0 + FREE_TOLERANCES as f32 * tolerance) * distance
}

/// Compares the samples of view number `own` with all other views.
///
/// A view j sees the sample's surface where `|D_j - d| < tolerance d`, with the distance `d` of the sample from
/// it. There its own samples have the radius `d pitch / sqrt(cos)`. Among equals the earlier view's stays.
pub fn agreement(
    lifted: &SurfaceSamples,
    own: usize,
    views: &[DistanceView<'_>],
    tolerance: f64,
) -> Vec<Agreement> {
    let others: Vec<(usize, &DistanceView<'_>, Projector)> = views
        .iter()
        .enumerate()
        .filter(|(number, _)| *number != own)
        .map(|(number, view)| (number, view, Projector::new(view.view)))
        .collect();
    let tolerance = tolerance as f32;
    let of_sample = |index: usize| {
        let place = Vec3::from_array(lifted.gaussians.positions[index]);
        let (normal, radius) = (lifted.normals[index], lifted.radii[index]);
        let mut found = Agreement {
            is_finest: true,
            ..Agreement::default()
        };
        for (number, view, projector) in &others {
            let Some((pixel, distance)) = projector.pixel(place) else {
                continue;
            };
            let theirs = view.distances.values[pixel];
            if theirs <= 0.0 || view.hides(pixel) {
                continue;
            }
            found.free += u16::from(is_farther(theirs, distance, tolerance));
            if (theirs - distance).abs() >= tolerance * distance {
                continue;
            }
            found.support += 1;
            let direction = (place - view.view.centre) / distance;
            let cosine = normal.dot(direction).abs().max(LEAST_COSINE);
            let in_camera = view.view.rotation * direction;
            let angle = pixel_angle(&view.view.camera, in_camera.as_dvec3()) as f32;
            let their_radius = distance * angle / cosine.sqrt();
            let is_finer = their_radius < radius || (their_radius == radius && *number < own);
            found.is_finest &= !is_finer;
        }
        found
    };
    (0..lifted.len()).into_par_iter().map(of_sample).collect()
}
