//! Registration of neighbouring frames of a video, with a check of its success.

use glam::{Quat, Vec3};

use super::{
    flow,
    grey::GreySphere,
    residual::{PairMotion, explain},
    rotation::align_neighbours,
};

/// Share of the directions with enough detail that must be found again in the other frame.
const LEAST_TRACKED: f64 = 0.35;
/// Share of all directions that must have enough detail.
const LEAST_DETAILED: f64 = 0.02;
/// Largest difference of the rotation from one frame to the other and that of the way back, pixels.
const LARGEST_DISAGREEMENT_PIXELS: f32 = 3.0;
/// Limit of unexplained flow above which no single motion of the camera explains most of the flow, pixels.
const LOOSEST_FIT_PIXELS: f64 = 8.0;

/// Motion between two frames that were registered.
#[derive(Debug, Clone)]
pub struct Registration {
    /// Maps directions of the first camera to the second.
    pub rotation: Quat,
    /// Explanation of the flow by the camera's motion.
    pub motion: PairMotion,
}

/// Registers two neighbouring frames by the flow at `directions`, unit vectors of the first camera.
///
/// Returns `None` where registration fails: too little detail, too little of it found again, rotations there and back
/// that differ, or a flow that no motion of the camera explains.
pub fn register(from: &GreySphere, to: &GreySphere, directions: &[Vec3]) -> Option<Registration> {
    let aligned = align_neighbours(from, to);
    let back = align_neighbours(to, from);
    let pixel = from.pixel_radians(0);
    if aligned.angle_between(back.inverse()) > LARGEST_DISAGREEMENT_PIXELS * pixel {
        return None;
    }
    // A frame is found again in itself wherever it has enough detail.
    let count = |flow: &[super::Flow]| flow.iter().filter(|one| one.moved.is_some()).count() as f64;
    let detailed = count(&flow(from, from, Quat::IDENTITY, directions));
    if detailed < (LEAST_DETAILED * directions.len() as f64).max(1.0) {
        return None;
    }
    let flow = flow(from, to, aligned, directions);
    if count(&flow) < LEAST_TRACKED * detailed {
        return None;
    }
    let motion = explain(&flow, pixel);
    if motion.limit_radians > LOOSEST_FIT_PIXELS * f64::from(pixel) {
        return None;
    }
    Some(Registration {
        rotation: (Quat::from_scaled_axis(-motion.turn) * aligned).normalize(),
        motion,
    })
}
