//! Camera motion between two images: rotation, heading, and parallax of static content.

use glam::{Quat, Vec3};

use super::{
    align, explain, flow,
    grey::{GreySphere, even_directions},
    residual::NEAR_EPIPOLE,
};

/// Number of directions at which flow is estimated.
const POINTS: usize = 4000;
/// Nearest static content to consider, as a factor over the largest shift that was found.
const BEYOND_SEEN: f32 = 1.25;
/// Share of the flow taken as static, from the shortest.
const STILL_SHARE: f64 = 0.98;
/// Upper limit of the parallax, however near the content, radians.
const MOST_PARALLAX_RADIANS: f32 = 0.6;

/// Motion of the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraMotion {
    /// Maps directions of the first camera to the second.
    pub rotation: Quat,
    /// Unit direction of the translation in the first camera's frame; `None` if it did not move.
    pub heading: Option<Vec3>,
    /// Largest shift of static content at right angles to the heading: the camera's translation over the nearest
    /// distance.
    pub largest_parallax: f32,
}

/// Estimates the motion of the camera from one image to another.
pub fn camera_motion(from: &GreySphere, to: &GreySphere) -> CameraMotion {
    let aligned = align(from, to);
    let directions: Vec<Vec3> = even_directions(POINTS).collect();
    let flow = flow(from, to, aligned, &directions);
    let motion = explain(&flow, from.pixel_radians(0));
    let mut shifts: Vec<f32> = motion.heading.map_or_else(Vec::new, |heading| {
        flow.iter()
            .enumerate()
            .filter(|&(index, _)| motion.is_dynamic(index) == Some(false))
            .filter_map(|(_, flow)| {
                let along = heading - heading.dot(flow.direction) * flow.direction;
                let left = flow.moved? + motion.turn.cross(flow.direction);
                (along.length() > NEAR_EPIPOLE).then(|| -left.dot(along) / along.length_squared())
            })
            .collect()
    });
    shifts.sort_by(f32::total_cmp);
    let nearest = (shifts.len() as f64 * STILL_SHARE) as usize;
    CameraMotion {
        rotation: Quat::from_scaled_axis(-motion.turn) * aligned,
        heading: motion.heading,
        largest_parallax: shifts
            .get(nearest)
            .map_or(0.0, |shift| BEYOND_SEEN * shift)
            .clamp(0.0, MOST_PARALLAX_RADIANS),
    }
}
