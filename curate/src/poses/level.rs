//! Levelling: structure from motion leaves the world's orientation arbitrary.

use glam::{DQuat, DVec3};
use omnilife_schemas::{camera::Camera, ground_plane::Plane};

use super::colmap::ColmapModel;

/// World up after levelling: the world's y points down, as the cameras' does.
pub const UP: DVec3 = DVec3::NEG_Y;
/// Cameras agree on no up below this length of the mean of their unit up vectors.
pub const LEAST_AGREEMENT: f64 = 0.5;
/// Least share of points on a plane that is the ground of a perspective flight...
const LEAST_GROUND_SHARE: f64 = 0.3;
/// ...if cameras look down at it, on average by this sine of the angle.
const LEAST_DOWNWARD: f64 = 0.35;

/// Result of levelling.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Levelling {
    /// The normal of the ground became up.
    ByGround {
        /// Share of the points that are on it.
        share: f64,
    },
    /// The mean up of the cameras became up.
    ByCameras {
        /// Length of the mean of their unit up vectors, 0 (no common up) to 1 (all the same).
        agreement: f64,
    },
    /// The cameras agree on no up: the world is unchanged.
    None {
        /// The same measure, too low.
        agreement: f64,
    },
}

/// Rotates the world so that its up becomes [`UP`].
///
/// People and stabilizers hold 360-degree cameras upright on average, so the mean up is vertical to a few degrees. If
/// the cameras tumble it is not, and the world is unchanged. A drone's camera looks down, so that its up says little;
/// the ground under it gives the vertical.
pub fn level(model: &mut ColmapModel) -> Levelling {
    if let Some((plane, share)) = ground(model) {
        model.rotate_world(DQuat::from_rotation_arc(plane.normal, UP));
        return Levelling::ByGround { share };
    }
    let sum: DVec3 = model
        .images
        .values()
        .map(|image| image.rotation * DVec3::NEG_Y)
        .sum();
    let agreement = if model.images.is_empty() {
        0.0
    } else {
        sum.length() / model.images.len() as f64
    };
    if agreement < LEAST_AGREEMENT {
        return Levelling::None { agreement };
    }
    model.rotate_world(DQuat::from_rotation_arc(sum.normalize(), UP));
    Levelling::ByCameras { agreement }
}

/// Returns the ground that perspective cameras look down at, and the share of the points on it.
fn ground(model: &ColmapModel) -> Option<(Plane, f64)> {
    if !matches!(model.camera.camera(), Camera::Pinhole(_)) {
        return None;
    }
    let points: Vec<DVec3> = model.points.values().map(|point| point.position).collect();
    let centres: Vec<DVec3> = model.images.values().map(|image| image.centre).collect();
    let (plane, share) = Plane::dominant(&points, &centres)?;
    let downward = model
        .images
        .values()
        .map(|image| -(image.rotation * DVec3::Z).dot(plane.normal))
        .sum::<f64>()
        / model.images.len() as f64;
    let is_ground = share >= LEAST_GROUND_SHARE && downward >= LEAST_DOWNWARD;
    is_ground.then_some((plane, share))
}
