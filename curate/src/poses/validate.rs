//! Validation of poses from structure from motion. Errors are angles, not pixels: a pixel near the poles of an ERP
//! image has hardly any width.

use std::collections::BTreeMap;

use glam::{DQuat, DVec3};
use omnilife_schemas::{
    Pose,
    camera::CameraModel,
    pose,
    records::{PoseValidation, ValidationStatus},
    statistics,
};
use serde::{Deserialize, Serialize};

use super::colmap::{ColmapImage, ColmapModel};

/// Limits of valid poses. The defaults were set on rendered scenes with known poses: of 18 degraded runs they flag 14,
/// and the other four were accurate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ValidationLimits {
    /// Least share of frames in one model.
    pub registered_share: f64,
    /// Largest median reprojection angle, degrees.
    pub median_error_degrees: f64,
    /// Largest 90th percentile of the reprojection angle, degrees.
    pub p90_error_degrees: f64,
    /// Least number of points that any registered frame sees.
    pub fewest_points: f64,
    /// Least mean number of observations of a point.
    pub mean_track: f64,
    /// Least median triangulation angle, degrees.
    pub median_triangulation_degrees: f64,
    /// Largest ratio of a step to the local median step.
    pub step_ratio: f64,
    /// Largest ratio of the change of inter-frame rotation to its median (0.5 degrees at least).
    pub rotation_change_ratio: f64,
}

impl Default for ValidationLimits {
    fn default() -> Self {
        Self {
            registered_share: 0.95,
            median_error_degrees: 0.20,
            p90_error_degrees: 0.60,
            fewest_points: 100.0,
            mean_track: 3.5,
            median_triangulation_degrees: 1.5,
            step_ratio: 3.0,
            rotation_change_ratio: 8.0,
        }
    }
}

/// Frames on either side of a step whose steps make its local median.
const STEP_NEIGHBOURS: usize = 7;
/// Local medians are floored at this share of the global one, so that a stop is not a jump.
const STEP_FLOOR: f64 = 0.3;
/// Floor of the median change of rotation, degrees.
const ROTATION_CHANGE_FLOOR_DEGREES: f64 = 0.5;
/// Points whose triangulation angle is measured, at most, spread over all.
const TRIANGULATION_SAMPLES: usize = 3000;

/// Measures a model against the limits. `names` are the frames in order of time.
pub fn validate(
    model: &ColmapModel,
    names: &[String],
    limits: &ValidationLimits,
) -> PoseValidation {
    let by_name: BTreeMap<&str, &ColmapImage> = model
        .images
        .values()
        .map(|image| (image.name.as_str(), image))
        .collect();
    let path: Vec<(usize, &ColmapImage)> = names
        .iter()
        .enumerate()
        .filter_map(|(index, name)| by_name.get(name.as_str()).map(|&image| (index, image)))
        .collect();
    let mut report = Report::default();
    let share = path.len() as f64 / names.len().max(1) as f64;
    report.at_least("registered_share", Some(share), limits.registered_share);

    let errors = reprojection_errors_degrees(model);
    report.at_most(
        "median_error_degrees",
        statistics::median(&errors),
        limits.median_error_degrees,
    );
    report.at_most(
        "p90_error_degrees",
        statistics::quantile(&errors, 0.9),
        limits.p90_error_degrees,
    );
    let fewest = path.iter().map(|(_, image)| image.observations.len()).min();
    report.at_least(
        "fewest_points",
        fewest.map(|count| count as f64),
        limits.fewest_points,
    );
    let tracks: usize = model.points.values().map(|point| point.track.len()).sum();
    let mean_track = (!model.points.is_empty()).then(|| tracks as f64 / model.points.len() as f64);
    report.at_least("mean_track", mean_track, limits.mean_track);
    report.at_least(
        "median_triangulation_degrees",
        statistics::median(&triangulation_degrees(model)),
        limits.median_triangulation_degrees,
    );
    report.at_most("step_ratio", step_ratio(&path), limits.step_ratio);
    report.at_most(
        "rotation_change_ratio",
        rotation_change_ratio(&path),
        limits.rotation_change_ratio,
    );
    report
        .measures
        .insert("points".to_owned(), model.points.len() as f64);
    let poses: Vec<Option<Pose>> = names
        .iter()
        .map(|name| by_name.get(name.as_str()).map(|image| image.pose()))
        .collect();
    report.problems.extend(pose::far_frames(&poses));
    PoseValidation {
        status: if report.problems.is_empty() {
            ValidationStatus::Valid
        } else {
            ValidationStatus::Unstable
        },
        registered_frames: path.len() as u32,
        total_frames: names.len() as u32,
        measures: report.measures,
        problems: report.problems,
    }
}

#[derive(Default)]
struct Report {
    measures: BTreeMap<String, f64>,
    problems: Vec<String>,
}

impl Report {
    fn at_least(&mut self, name: &str, value: Option<f64>, limit: f64) {
        self.add(name, value, limit, "at least", |value| value >= limit);
    }

    fn at_most(&mut self, name: &str, value: Option<f64>, limit: f64) {
        self.add(name, value, limit, "at most", |value| value <= limit);
    }

    fn add(
        &mut self,
        name: &str,
        value: Option<f64>,
        limit: f64,
        relation: &str,
        holds: impl Fn(f64) -> bool,
    ) {
        // A value that is not finite must not reach JSON, which cannot express it.
        let Some(value) = value.filter(|value| value.is_finite()) else {
            self.problems.push(format!("{name} cannot be measured"));
            return;
        };
        self.measures.insert(name.to_owned(), value);
        if !holds(value) {
            self.problems
                .push(format!("{name} is {value:.3}, expected {relation} {limit}"));
        }
    }
}

/// Returns the angle between two vectors of any length, degrees.
pub(super) fn angle_degrees(a: DVec3, b: DVec3) -> f64 {
    // atan2 keeps its precision at small angles, where the arc cosine loses it.
    a.cross(b).length().atan2(a.dot(b)).to_degrees()
}

/// Returns the angle between the ray of every feature and the direction of its point, degrees.
fn reprojection_errors_degrees(model: &ColmapModel) -> Vec<f64> {
    let camera = model.camera.camera();
    let mut errors = Vec::new();
    for image in model.images.values() {
        let world_to_camera = image.rotation.inverse();
        for (pixel, id) in &image.observations {
            if let Some(point) = model.points.get(id) {
                let ray = camera.unproject(*pixel);
                errors.push(angle_degrees(
                    ray,
                    world_to_camera * (point.position - image.centre),
                ));
            }
        }
    }
    errors
}

/// Returns the widest angle under which a point sees the first, middle and last camera of its track, degrees.
fn triangulation_degrees(model: &ColmapModel) -> Vec<f64> {
    let stride = (model.points.len() / TRIANGULATION_SAMPLES).max(1);
    model
        .points
        .values()
        .step_by(stride)
        .filter_map(|point| {
            let mut track: Vec<u32> = point.track.clone();
            track.sort_unstable();
            let ends = [track.first()?, track.get(track.len() / 2)?, track.last()?];
            let mut rays = [DVec3::ZERO; 3];
            for (ray, id) in rays.iter_mut().zip(ends) {
                *ray = model.images.get(id)?.centre - point.position;
            }
            let [a, b, c] = rays;
            Some(
                angle_degrees(a, b)
                    .max(angle_degrees(b, c))
                    .max(angle_degrees(a, c)),
            )
        })
        .collect()
}

/// Returns the largest step between consecutive registered frames over the median step around it. Steps over missing
/// frames count per frame.
fn step_ratio(path: &[(usize, &ColmapImage)]) -> Option<f64> {
    let steps: Vec<f64> = path
        .windows(2)
        .map(|pair| pair[0].1.centre.distance(pair[1].1.centre) / (pair[1].0 - pair[0].0) as f64)
        .collect();
    let floor = STEP_FLOOR * statistics::median(&steps)?;
    steps
        .iter()
        .enumerate()
        .map(|(index, step)| {
            let around = index.saturating_sub(STEP_NEIGHBOURS)
                ..(index + STEP_NEIGHBOURS + 1).min(steps.len());
            let local = statistics::median(&steps[around]).unwrap_or(0.0);
            step / local.max(floor).max(f64::MIN_POSITIVE)
        })
        .max_by(f64::total_cmp)
}

/// Returns the largest change between consecutive inter-frame rotations over the median change.
fn rotation_change_ratio(path: &[(usize, &ColmapImage)]) -> Option<f64> {
    let turns: Vec<(usize, DQuat)> = path
        .windows(2)
        .map(|pair| {
            (
                pair[1].0 - pair[0].0,
                pair[0].1.rotation.inverse() * pair[1].1.rotation,
            )
        })
        .collect();
    let changes: Vec<f64> = turns
        .windows(2)
        .filter(|pair| pair[0].0 == 1 && pair[1].0 == 1)
        .map(|pair| pair[0].1.angle_between(pair[1].1).to_degrees())
        .collect();
    let median = statistics::median(&changes)?.max(ROTATION_CHANGE_FLOOR_DEGREES);
    changes
        .iter()
        .copied()
        .max_by(f64::total_cmp)
        .map(|largest| largest / median)
}
