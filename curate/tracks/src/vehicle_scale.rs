//! Estimation of an unknown scale of the world, by the vehicles in it.

use std::path::Path;

use glam::DVec3;
use omnilife_schemas::{
    ground_plane::Plane, posed_view::PosedView, progress::Progress, records::Detection, statistics,
};

use super::{
    detectors::{Detector, DetectorInput},
    is_cut, middle,
};
use crate::error::TracksError;

/// Length of a car, metres: the median of new cars in Europe and of those in traffic counts from the air.
const VEHICLE_METRES: f64 = 4.5;
/// Initial guess of a drone's height above the ground, metres.
const FIRST_ALTITUDE_METRES: f64 = 50.0;
/// Rounds of detection: detectors search vehicles by their size, each round with the scale of the one before.
const ROUNDS: usize = 3;
/// Least number of boxes for an estimate.
const LEAST_BOXES: usize = 10;

/// Returns metres per unit of the world, with the evidence.
///
/// # Errors
/// When a detector fails, or finds too few whole vehicles.
pub(super) fn by_vehicles(
    scene_path: &Path,
    plane: Plane,
    detector: &Detector,
    input: &DetectorInput<'_>,
    progress: &dyn Progress,
) -> Result<(f64, String), TracksError> {
    let heights: Vec<f64> = input
        .views
        .iter()
        .map(|view| plane.height(view.centre))
        .collect();
    let refuse = |reason: &str| {
        let reason = format!(
            "its scale is arbitrary, and vehicles are tracked in metres: {reason}; give \
             --metres-per-unit, or pose it with --altitude or --gsd"
        );
        TracksError::input(scene_path, reason)
    };
    let height = statistics::median(&heights)
        .filter(|height| *height > 0.0)
        .ok_or_else(|| refuse("its cameras are not above a ground"))?;
    let mut metres_per_unit = FIRST_ALTITUDE_METRES / height;
    let mut boxes = 0;
    for _ in 0..ROUNDS {
        let input = DetectorInput {
            metres_per_unit,
            ..*input
        };
        let detections = (detector.detect)(&input, progress)?.boxes;
        let lengths: Vec<f64> = detections
            .iter()
            .filter_map(|detection| length(detection, input.views, plane))
            .collect();
        boxes = lengths.len();
        let median = statistics::median(&lengths)
            .filter(|_| boxes >= LEAST_BOXES)
            .ok_or_else(|| refuse(&format!("{boxes} whole vehicles are too few to go by")))?;
        metres_per_unit = VEHICLE_METRES / median;
    }
    let evidence = format!(
        "half of {boxes} boxes are longer on the ground than {VEHICLE_METRES} m at {metres_per_unit:.4} m \
         in a unit of the world; the cameras are then {:.0} m above it",
        height * metres_per_unit
    );
    Ok((metres_per_unit, evidence))
}

/// Returns the longer side of a box on the ground, world units; `None` if the border of the image cuts it off. A
/// vehicle across the image's axes has a box of nearly the same longer side.
fn length(detection: &Detection, views: &[PosedView], plane: Plane) -> Option<f64> {
    let view = views.iter().find(|view| view.frame == detection.frame)?;
    if is_cut(view, detection.box_pixels) {
        return None;
    }
    let centre = middle(detection.box_pixels);
    let distance = plane.meet(view.centre, view.ray(centre))?;
    let [across, down] = view.ray_steps(centre).map(DVec3::length);
    let [_, _, width, height] = detection.box_pixels;
    Some(distance * (width * across).max(height * down))
}
