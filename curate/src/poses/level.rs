//! Levelling: structure from motion leaves the world's orientation arbitrary.

use glam::{DQuat, DVec3};
use omnilife_schemas::camera::Camera;

use super::colmap::ColmapModel;
use crate::ground_plane::Plane;

/// World up after levelling: the world's y points down, as the cameras' does.
pub const UP: DVec3 = DVec3::NEG_Y;
/// Below this length of the mean of the cameras' unit up vectors they agree on no up.
pub const LEAST_AGREEMENT: f64 = 0.5;
/// A plane that so many points are on is the ground of a perspective flight...
const LEAST_GROUND_SHARE: f64 = 0.3;
/// ...where cameras look down at it, on average by this sine of the angle.
const LEAST_DOWNWARD: f64 = 0.35;

/// What levelling did.
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
    /// The cameras agree on no up: the world stays as it is.
    None {
        /// The same, too low.
        agreement: f64,
    },
}

/// Turns the world so that its up becomes [`UP`].
///
/// People and stabilizers hold 360-degree cameras upright on average, so the mean up is gravity to
/// a few degrees. Where the cameras tumble it is not, and the world stays as it is. A drone's camera
/// looks down, and its up says little; the ground under it does.
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

/// The ground that perspective cameras look down at, and the share of the points that are on it.
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
