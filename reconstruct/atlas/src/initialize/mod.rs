//! First nodes of an atlas, from a clip with poses and masks (Neural Atlas Graphs, supplement A.4). Evidence
//! decides for each object, in the order of its worth.
//!
//! * [`first_nodes`]: all of them, with a line on the evidence of each.
//! * [`background`]: a plane behind everything, or a sphere around the cameras. [`planes`]: the plane of points.
//! * [`objects`]: a plane for each object. [`boxes`]: from boxes. [`in_frames`]: from what happens in its masks, which
//!   [`tracking`] finds in the texture and [`silhouettes`] in the outline. [`order`]: occlusion.

pub mod background;
pub mod boxes;
pub mod first_nodes;
pub mod in_frames;
pub mod objects;
pub mod order;
pub mod planes;
pub mod silhouettes;
pub mod tracking;

use glam::DVec2;
use omnilife_engine::{camera::Camera, trajectories::rigid_spline::RigidPose};

use super::clip::{Clip, ClipFrame, project};

/// Returns the position of a world point in a frame's image, pixels; `None` outside of the image.
pub(super) fn seen_at(clip: &Clip, frame: &ClipFrame, point: glam::DVec3) -> Option<DVec2> {
    let local = frame.pose.rotation.transpose() * (point - frame.pose.centre);
    let at = project(&clip.camera, local)?;
    let [width, height] = clip.size();
    let is_inside = at.x >= 0.0 && at.y >= 0.0 && at.x <= width as f64 && at.y <= height as f64;
    is_inside.then_some(at)
}

pub(super) fn pixel_at(clip: &Clip, at: DVec2) -> usize {
    let [width, height] = clip.size();
    let column = (at.x as usize).min(width - 1);
    let row = (at.y as usize).min(height - 1);
    row * width + column
}

/// Returns the colour of a frame at a position, linear between pixels' centres.
fn colour_at(clip: &Clip, frame: &ClipFrame, at: DVec2) -> [f64; 3] {
    let [width, height] = clip.size();
    let place = at - 0.5;
    let floor = place.floor();
    let part = place - floor;
    let wraps = matches!(clip.camera, Camera::Erp(_));
    let mut colour = [0.0; 3];
    for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let column = floor.x as i64 + dx;
        let column = if wraps {
            column.rem_euclid(width as i64)
        } else {
            column.clamp(0, width as i64 - 1)
        };
        let row = (floor.y as i64 + dy).clamp(0, height as i64 - 1);
        let weight = (if dx == 1 { part.x } else { 1.0 - part.x })
            * (if dy == 1 { part.y } else { 1.0 - part.y });
        let pixel = frame.colour(row as usize * width + column as usize);
        for (sum, value) in colour.iter_mut().zip(pixel) {
            *sum += weight * value;
        }
    }
    colour
}

/// Returns the mean of a frame's channels at a position, linear between pixels' centres.
pub(super) fn grey_at(clip: &Clip, frame: &ClipFrame, at: DVec2) -> f64 {
    colour_at(clip, frame, at).iter().sum::<f64>() / 3.0
}

/// Returns the world point of a plane's `uv`.
fn point_on(pose: &RigidPose, size: DVec2, uv: DVec2) -> glam::DVec3 {
    pose.centre + pose.rotation * ((uv - 0.5) * size).extend(0.0)
}

/// Returns the `uv` of a texel; 0 and 1 are the outermost centres.
fn texel_uv(texel: usize, width: usize, height: usize) -> DVec2 {
    let share = |at: usize, count: usize| {
        if count > 1 {
            at as f64 / (count - 1) as f64
        } else {
            0.5
        }
    };
    DVec2::new(share(texel % width, width), share(texel / width, height))
}

/// Returns frames in the order of their distance in time from a moment.
fn by_distance_in_time(clip: &Clip, time: f64) -> Vec<&ClipFrame> {
    let mut frames: Vec<&ClipFrame> = clip.frames.iter().collect();
    frames.sort_by(|a, b| (a.time - time).abs().total_cmp(&(b.time - time).abs()));
    frames
}
