//! Planes of objects: at the position of their masks, and at the distance that their size in the image gives.
//!
//! The frame with the largest mask is the reference frame. There an object is at the distance of the scene points
//! in its mask; without points it is at a guess from [occlusion](super::order). In other frames its distance
//! grows as the root of its area shrinks: objects keep their size. A mask that touches the image's border or
//! another object's mask shows a part of the object. Such a frame gives no distance; its position comes from the
//! [silhouette](super::silhouettes) of the whole.

use glam::{DQuat, DVec2, DVec3};
use omnilife_engine::{
    camera::Camera,
    surfaces::texture::Texture,
    trajectories::rigid_spline::{RigidPose, RigidSpline},
};
use rayon::prelude::*;

use super::{
    background::filled,
    by_distance_in_time, colour_at, pixel_at, point_on, seen_at,
    silhouettes::{Shape, Silhouette, middle, on_plane, plane_axes, reference, relative_depths},
    texel_uv,
};
use crate::{
    clip::{Clip, ClipFrame, camera_direction, pixel_centre},
    node::{Fields, Node, Surface},
};

/// Size of a plane over its visible part, each way.
const MARGIN: f64 = 1.3;
/// The share of a mask's points that may be nearer than the object.
const NEAR_SHARE: f64 = 0.1;
/// Points from this share of the background's distance on are the background's.
const NOT_BACKGROUND: f64 = 0.9;
/// Minimum number of points for a distance.
const LEAST_POINTS: usize = 3;
/// Half angle of a mask, seen from the camera, beyond which it gets no plane, radians.
const WIDEST: f64 = 50.0 * std::f64::consts::PI / 180.0;
/// Base opacities (the published code's).
const OPACITIES: [f64; 2] = [0.1, 0.9];

/// Masks of two frames that overlap by so much are the same place of the image.
const SAME_PLACE: f64 = 0.95;

/// Outcome of placing an object.
#[derive(Debug)]
pub enum Made {
    /// A node, and the source of its distance.
    Node(Box<Node>, String),
    /// No node, and the reason.
    LeftOut(String),
}

/// Returns true if a silhouette reaches the first or the last row of a panorama.
fn is_on_a_pole(clip: &Clip, seen: &Silhouette) -> bool {
    let [width, height] = clip.size();
    let mut rows = seen.pixels.iter().map(|&pixel| pixel / width);
    rows.any(|row| row == 0 || row + 1 == height)
}

/// Returns true if masks keep their position in the image while the camera rotates by more than their width. Such
/// an object is a part of the camera's carrier, outside of the scene.
fn is_carried_along(clip: &Clip, seen: &[Silhouette]) -> bool {
    let Some((first, others)) = seen.split_first() else {
        return false;
    };
    let [width, _] = clip.size();
    let begun = clip.frames[first.frame].pose.rotation;
    let radius = first
        .pixels
        .iter()
        .map(|&pixel| camera_direction(&clip.camera, pixel_centre(pixel, width)))
        .map(|direction| direction.angle_between(first.direction))
        .fold(0.0, f64::max);
    let turned = others
        .iter()
        .map(|other| begun.transpose() * clip.frames[other.frame].pose.rotation)
        .map(|turn| (turn * first.direction).angle_between(first.direction))
        .fold(0.0, f64::max);
    turned > 2.0 * radius
        && seen.len() == clip.frames.len()
        && others
            .iter()
            .all(|other| first.overlap(other) >= SAME_PLACE)
}

/// Inputs for placing objects.
#[derive(Debug)]
pub struct Setting<'a> {
    /// Silhouettes of each object.
    pub seen: &'a [Vec<Silhouette>],
    /// The distance of each by scene points, and their number.
    pub by_points: &'a [Option<(f64, usize)>],
    /// The distance of each in its reference frame.
    pub depths: &'a [f64],
    /// Distance of the background.
    pub background: f64,
    /// Number of knots of trajectories.
    pub knots: usize,
}

/// Makes the node of an object, without fields.
pub fn node(clip: &Clip, object: usize, setting: &Setting<'_>) -> Made {
    let name = &clip.objects[object];
    let (seen, background) = (&setting.seen[object], setting.background);
    let Some(reference) = reference(seen) else {
        return Made::LeftOut("its masks are empty".to_owned());
    };
    let [width, _] = clip.size();
    let widest = seen
        .iter()
        .flat_map(|seen| seen.pixels.iter().map(|&pixel| (seen.direction, pixel)))
        .map(|(middle, pixel)| {
            let direction = camera_direction(&clip.camera, pixel_centre(pixel, width));
            middle.dot(direction)
        })
        .fold(1.0, f64::min);
    if widest < WIDEST.cos() {
        return Made::LeftOut(format!(
            "a mask reaches {:.0} degrees from its middle: too wide for a plane",
            widest.clamp(-1.0, 1.0).acos().to_degrees()
        ));
    }
    if matches!(clip.camera, Camera::Erp(_)) && seen.iter().any(|seen| is_on_a_pole(clip, seen)) {
        return Made::LeftOut("a mask lies on a pole of the panorama".to_owned());
    }
    if is_carried_along(clip, seen) {
        return Made::LeftOut(
            "its masks stand still in the image while the camera turns: a part of what carries the camera, \
             for --ignore-mask"
                .to_owned(),
        );
    }
    let axes = plane_axes(&clip.camera, reference.direction);
    let depth = setting.depths[object];
    let depth_from = match setting.by_points[object] {
        Some((_, count)) => format!("from {count} points in its mask"),
        None => format!("a guess: {:.2} of the background's", depth / background),
    };
    let depths: Vec<f64> = relative_depths(seen, reference)
        .into_iter()
        .map(|relative| (depth * relative).clamp(0.01 * background, 0.95 * background))
        .collect();
    let shape = Shape::of(clip, reference, depth);
    let poses: Vec<(f64, DVec3, DQuat)> = seen
        .par_iter()
        .zip(&depths)
        .filter_map(|(seen, &depth)| {
            let pose = if seen.is_partial {
                shape.placed(clip, object, seen, depth)?
            } else {
                middle(clip, seen, depth)
            };
            let rotation = DQuat::from_mat3(&pose.rotation).normalize();
            Some((clip.frames[seen.frame].time, pose.centre, rotation))
        })
        .collect();
    let mut half = DVec2::ZERO;
    for (seen, &depth) in seen.iter().zip(&depths) {
        let axes = plane_axes(&clip.camera, seen.direction);
        for place in on_plane(clip, seen, &axes, depth) {
            half = half.max(place.abs());
        }
    }
    let of_reference = on_plane(clip, reference, &axes, depth)
        .into_iter()
        .fold(DVec2::ZERO, |half, place| half.max(place.abs()));
    // A mask that is wrong in one frame must not blow up the plane.
    let size = 2.0 * MARGIN * half.min(2.5 * of_reference);
    let trajectory = RigidSpline::fitted(setting.knots.min(seen.len().max(1)), &poses);
    let per_unit = match clip.camera {
        Camera::Pinhole(camera) => camera.fx / depth,
        Camera::Erp(camera) => f64::from(camera.width) / (std::f64::consts::TAU * depth),
    };
    let texels = (size * per_unit).clamp(DVec2::splat(4.0), DVec2::splat(1080.0));
    let [first, last] = [seen.first(), seen.last()].map(|seen| seen.map_or(0, |seen| seen.frame));
    let times = [
        clip.frames[first.saturating_sub(1)].time,
        clip.frames[(last + 1).min(clip.frames.len() - 1)].time,
    ];
    let mut made = Node {
        id: name.clone(),
        surface: Surface::Plane { size, trajectory },
        colour: Texture::constant(1, 1, [0.5; 3]),
        opacity: None,
        fields: Fields::default(),
        offsets: None,
        times,
        delay: 0.0,
        overlay: None,
    };
    let texels = [texels.x.ceil() as usize, texels.y.ceil() as usize];
    paint(clip, object, &mut made, texels, reference.frame);
    Made::Node(Box::new(made), depth_from)
}

/// Returns the distance along the plane's normal of the scene points in an object's reference silhouette, and
/// their number. `None` where they are too few, or as far as the background.
pub fn depth_of_points(
    clip: &Clip,
    object: usize,
    seen: &[Silhouette],
    points: &[DVec3],
    background: f64,
) -> Option<(f64, usize)> {
    let reference = reference(seen)?;
    let axes = plane_axes(&clip.camera, reference.direction);
    let frame = &clip.frames[reference.frame];
    let mut depths: Vec<f64> = points
        .iter()
        .filter_map(|&point| {
            let at = seen_at(clip, frame, point)?;
            (frame.covered(object, pixel_at(clip, at)) >= 0.5).then(|| {
                let local = frame.pose.rotation.transpose() * (point - frame.pose.centre);
                axes.col(2).dot(local)
            })
        })
        .filter(|&depth| depth > 0.0)
        .collect();
    depths.sort_by(f64::total_cmp);
    let near = (NEAR_SHARE * depths.len() as f64) as usize;
    let is_enough = depths.len() >= LEAST_POINTS && depths[near] < NOT_BACKGROUND * background;
    is_enough.then(|| (depths[near], depths.len()))
}

/// Paints the base textures: opacity from the reference frame's mask, colours from inside the mask. Other colours
/// come from the frame nearest in time that sees the object there.
fn paint(clip: &Clip, object: usize, node: &mut Node, texels: [usize; 2], reference: usize) {
    let [width, height] = texels;
    let Surface::Plane { size, .. } = &node.surface else {
        return;
    };
    let size = *size;
    let of_reference = &clip.frames[reference];
    let pose_in = |frame: &ClipFrame| -> RigidPose { node.given_pose(frame.time) };
    let reference_pose = pose_in(of_reference);
    let cover: Vec<f64> = (0..width * height)
        .into_par_iter()
        .map(|texel| {
            let point = point_on(&reference_pose, size, texel_uv(texel, width, height));
            let at = seen_at(clip, of_reference, point);
            at.map_or(0.0, |at| of_reference.covered(object, pixel_at(clip, at)))
        })
        .collect();
    let [low, high] = OPACITIES;
    let smooth = blurred(&cover, width, height);
    let opacity = Texture {
        width,
        height,
        texels: smooth
            .iter()
            .map(|&share| [(low + (high - low) * share) as f32])
            .collect(),
    };
    let frames = by_distance_in_time(clip, of_reference.time);
    let poses: Vec<RigidPose> = frames.iter().map(|frame| pose_in(frame)).collect();
    let read: Vec<Option<[f64; 3]>> = (0..width * height)
        .into_par_iter()
        .map(|texel| {
            let uv = texel_uv(texel, width, height);
            frames.iter().zip(&poses).find_map(|(frame, pose)| {
                let at = seen_at(clip, frame, point_on(pose, size, uv))?;
                let is_it = frame.covered(object, pixel_at(clip, at)) >= 0.5;
                is_it.then(|| colour_at(clip, frame, at))
            })
        })
        .collect();
    node.colour = filled(width, height, &read);
    node.opacity = Some(opacity);
}

/// Blurs with a Gaussian of 5 by 5 texels and a standard deviation of 1.
fn blurred(values: &[f64], width: usize, height: usize) -> Vec<f64> {
    let kernel: Vec<f64> = (-2..=2).map(|x| (-0.5 * f64::from(x * x)).exp()).collect();
    let sum: f64 = kernel.iter().sum();
    let pass = |values: &[f64], step: usize, count: usize, place: &dyn Fn(usize) -> usize| {
        (0..values.len())
            .map(|at| {
                let own = place(at);
                let terms = kernel.iter().enumerate().map(|(tap, weight)| {
                    let other = (own + tap).saturating_sub(2).min(count - 1);
                    weight * values[at + other * step - own * step]
                });
                terms.sum::<f64>() / sum
            })
            .collect::<Vec<f64>>()
    };
    let rows = pass(values, 1, width, &|at| at % width);
    pass(&rows, width, height, &|at| at / width)
}
