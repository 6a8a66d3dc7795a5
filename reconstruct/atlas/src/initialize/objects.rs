//! Planes of objects, painted with what their masks show.
//!
//! The frame with the largest mask is the reference frame. There an object is at the distance of its box in
//! `tracks.json`, of the depths or of the scene points in its mask; without any it is at a guess from
//! [occlusion](super::order). [Motion inside of the mask](super::in_frames) gives distance, turn and position in other
//! frames, unless the box does. The base opacity is what most masks cover, of those frames that could show it.

use glam::{DQuat, DVec2, DVec3};
use omnilife_engine::{
    camera::Camera,
    surfaces::texture::Texture,
    trajectories::rigid_spline::{RigidPose, RigidSpline},
};
use omnilife_schemas::statistics::median;
use rayon::prelude::*;

use super::{
    background::{PlacedBackground, filled},
    boxes::BoxPath,
    by_distance_in_time, colour_at,
    first_nodes::Evidence,
    in_frames::InFrames,
    pixel_at, point_on, seen_at,
    silhouettes::{Shape, Silhouette, plane_axes, reference},
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

/// Number of frames whose masks make the base opacity, at most.
const VOTING_FRAMES: usize = 24;
/// Steepness of the base opacity by the share of masks: 1 from two thirds on.
const STEEPNESS: f64 = 3.0;
/// Maximum distance of a plane, over that of the background behind it.
const FARTHEST: f64 = 0.95;
/// Minimum distance of a plane, over that of the background.
const NEAREST: f64 = 0.01;

/// Masks of two frames that overlap by so much are the same place of the image.
const SAME_PLACE: f64 = 0.95;

/// Outcome of placing an object.
#[derive(Debug)]
pub enum PlacementOutcome {
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
pub struct PlacementInputs<'a> {
    /// Silhouettes of each object.
    pub seen: &'a [Vec<Silhouette>],
    /// Motion of each over its silhouettes.
    pub in_frames: &'a [InFrames],
    /// Boxes of the objects that have any.
    pub boxes: &'a [Option<BoxPath>],
    /// The known distance of each, with its source.
    pub known: &'a [Option<(f64, String)>],
    /// The distance of each in its reference frame.
    pub depths: &'a [f64],
    /// Minimum distance of the background behind each.
    pub backgrounds: &'a [f64],
    /// Number of knots of trajectories.
    pub knots: usize,
}

/// Makes the node of an object, without fields.
pub fn node(clip: &Clip, object: usize, setting: &PlacementInputs<'_>) -> PlacementOutcome {
    let name = &clip.objects[object];
    let (seen, background) = (&setting.seen[object], setting.backgrounds[object]);
    let Some(reference) = reference(seen) else {
        return PlacementOutcome::LeftOut("its masks are empty".to_owned());
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
        return PlacementOutcome::LeftOut(format!(
            "a mask reaches {:.0} degrees from its middle: too wide for a plane",
            widest.clamp(-1.0, 1.0).acos().to_degrees()
        ));
    }
    if matches!(clip.camera, Camera::Erp(_)) && seen.iter().any(|seen| is_on_a_pole(clip, seen)) {
        return PlacementOutcome::LeftOut("a mask lies on a pole of the panorama".to_owned());
    }
    if is_carried_along(clip, seen) {
        return PlacementOutcome::LeftOut(
            "its masks stand still in the image while the camera turns: a part of what carries the camera, \
             for --ignore-mask"
                .to_owned(),
        );
    }
    let depth = setting.depths[object];
    let (placed, source) = match &setting.boxes[object] {
        Some(path) => (path.poses(clip, seen, reference), path.reason.clone()),
        None => {
            let from = match &setting.known[object] {
                Some((_, source)) => source.clone(),
                None => format!("a guess: {:.2} of the background's", depth / background),
            };
            let in_frames = &setting.in_frames[object];
            (
                poses(clip, object, seen, in_frames, [depth, background]),
                format!("its distance is {from}; {}", in_frames.reason),
            )
        }
    };
    let poses: Vec<(f64, DVec3, DQuat)> = placed
        .iter()
        .map(|(seen, pose)| {
            let rotation = DQuat::from_mat3(&pose.rotation).normalize();
            (clip.frames[seen.frame].time, pose.centre, rotation)
        })
        .collect();
    let of_frames = placed
        .iter()
        .map(|(seen, pose)| half_size(clip, seen, pose));
    let half = of_frames.fold(DVec2::ZERO, DVec2::max);
    let at_reference = placed
        .iter()
        .find(|(seen, _)| seen.frame == reference.frame);
    let Some(of_reference) = at_reference.map(|(seen, pose)| half_size(clip, seen, pose)) else {
        return PlacementOutcome::LeftOut(
            "its plane has no place in its reference frame".to_owned(),
        );
    };
    // A mask that is wrong in one frame must not blow up the plane.
    let size = 2.0 * MARGIN * half.min(2.5 * of_reference);
    let trajectory = RigidSpline::fitted(setting.knots.min(seen.len().max(1)), &poses);
    let per_unit = match clip.camera {
        Camera::Pinhole(camera) => camera.fx / depth,
        Camera::Erp(camera) => f64::from(camera.width) / (std::f64::consts::TAU * depth),
    };
    let texels = (size * per_unit).clamp(DVec2::splat(4.0), DVec2::splat(1080.0));
    let [first, last] = [seen.first(), seen.last()].map(|seen| seen.map_or(0, |seen| seen.frame));
    let of_frames: Vec<f64> = clip.frames.iter().map(|frame| frame.time).collect();
    let times = existence(&of_frames, [first, last]);
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
    paint(clip, object, seen, &mut made, texels, reference.frame);
    PlacementOutcome::Node(Box::new(made), source)
}

/// Returns the begin and the end of an object that is seen in these frames of a clip, at times in [0, 1]: the frames
/// before and after. Views before the first frame of the clip and after its last one are novel, and what is seen there
/// is in these, too.
fn existence(times: &[f64], [first, last]: [usize; 2]) -> [f64; 2] {
    let before = first.checked_sub(1).map(|frame| times[frame]);
    let after = times.get(last + 1).copied();
    [before.unwrap_or(0.0), after.unwrap_or(1.0)]
}

/// Returns the poses of an object's plane by its motion, in the frames that determine one.
fn poses<'a>(
    clip: &Clip,
    object: usize,
    seen: &'a [Silhouette],
    in_frames: &InFrames,
    [depth, background]: [f64; 2],
) -> Vec<(&'a Silhouette, RigidPose)> {
    let Some(reference) = reference(seen) else {
        return Vec::new();
    };
    let shape = Shape::of(clip, reference, depth);
    seen.par_iter()
        .zip(&in_frames.frames)
        .filter_map(|(seen, in_frame)| {
            let own = (depth * in_frame.relative_depth)
                .clamp(NEAREST * background, FARTHEST * background);
            Some((seen, in_frame.pose(clip, object, &shape, seen, own)?))
        })
        .collect()
}

/// Returns half of the sides that a plane at a pose needs for a mask.
fn half_size(clip: &Clip, seen: &Silhouette, pose: &RigidPose) -> DVec2 {
    let frame = &clip.frames[seen.frame];
    let [width, _] = clip.size();
    let to_plane = pose.rotation.transpose();
    let origin = to_plane * (frame.pose.centre - pose.centre);
    let turn = to_plane * frame.pose.rotation;
    let places = seen.pixels.iter().filter_map(|&pixel| {
        let direction = turn * camera_direction(&clip.camera, pixel_centre(pixel, width));
        let along = -origin.z / direction.z;
        (along.is_finite() && along > 0.0).then(|| (origin + along * direction).truncate().abs())
    });
    places.fold(DVec2::ZERO, DVec2::max)
}

/// Returns the minimum depth of the background behind an object's masks, along its plane's normal.
pub fn background_behind(clip: &Clip, seen: &[Silhouette], placed: &PlacedBackground) -> f64 {
    let [width, _] = clip.size();
    let in_frame = |seen: &Silhouette| {
        let pose = &clip.frames[seen.frame].pose;
        let normal = plane_axes(&clip.camera, seen.direction).col(2);
        // The nearest background is behind the mask's edge; every tenth pixel is near some of it.
        let pixels = seen.pixels.iter().step_by(10);
        let depths = pixels.filter_map(|&pixel| {
            let direction = camera_direction(&clip.camera, pixel_centre(pixel, width));
            let along = placed.along(pose.centre, pose.rotation * direction)?;
            Some(along * normal.dot(direction))
        });
        depths.fold(f64::INFINITY, f64::min)
    };
    let least = seen.iter().map(in_frame).fold(f64::INFINITY, f64::min);
    if least.is_finite() && least > 0.0 {
        least
    } else {
        placed.distance
    }
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

/// Returns the median distance along the plane's normal in an object's reference silhouette, and the number of known
/// distances there. `None` where they are too few, or as far as the background.
pub fn depth_of_distances(
    clip: &Clip,
    seen: &[Silhouette],
    evidence: &Evidence<'_>,
    background: f64,
) -> Option<(f64, usize)> {
    let reference = reference(seen)?;
    let image = evidence
        .distances
        .get(&clip.frames[reference.frame].number)?;
    let normal = plane_axes(&clip.camera, reference.direction).col(2);
    let [width, height] = clip.size();
    let scale = DVec2::new(
        image.width as f64 / width as f64,
        image.height as f64 / height as f64,
    );
    let known: Vec<f64> = reference
        .pixels
        .iter()
        .filter_map(|&pixel| {
            let at = pixel_centre(pixel, width);
            let place = at * scale;
            let distance = f64::from(image.sample(place.x, place.y));
            let depth = distance * normal.dot(camera_direction(&clip.camera, at));
            (depth > 0.0).then_some(depth)
        })
        .collect();
    let depth = median(&known)?;
    let is_enough = known.len() >= LEAST_POINTS && depth < NOT_BACKGROUND * background;
    is_enough.then_some((depth, known.len()))
}

/// Paints the base textures: opacity from the masks, colours from inside the mask of the reference frame. Other colours
/// come from the frame nearest in time that sees the object there.
fn paint(
    clip: &Clip,
    object: usize,
    seen: &[Silhouette],
    node: &mut Node,
    texels: [usize; 2],
    reference: usize,
) {
    let [width, height] = texels;
    let Surface::Plane { size, trajectory } = &node.surface else {
        return;
    };
    let size = *size;
    let of_reference = &clip.frames[reference];
    let trajectory = trajectory.clone();
    let pose_in = move |frame: &ClipFrame| -> RigidPose { trajectory.pose(frame.time) };
    let cover = cover_of(clip, object, seen, (size, texels), &pose_in);
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

/// Returns the opacity of each texel, [0, 1]: the share of the masks that cover it, made steeper. A frame votes where
/// it has a mask of the object and neither the image's end nor another object's mask hides the texel.
fn cover_of(
    clip: &Clip,
    object: usize,
    seen: &[Silhouette],
    (size, [width, height]): (DVec2, [usize; 2]),
    pose_in: &(dyn Fn(&ClipFrame) -> RigidPose + Sync),
) -> Vec<f64> {
    let stride = seen.len().div_ceil(VOTING_FRAMES).max(1);
    let voters: Vec<(&ClipFrame, RigidPose)> = seen
        .iter()
        .step_by(stride)
        .map(|seen| &clip.frames[seen.frame])
        .map(|frame| (frame, pose_in(frame)))
        .collect();
    let share = |texel: usize| {
        let uv = texel_uv(texel, width, height);
        let (mut covered, mut votes) = (0.0, 0.0);
        for (frame, pose) in &voters {
            let Some(at) = seen_at(clip, frame, point_on(pose, size, uv)) else {
                continue;
            };
            let pixel = pixel_at(clip, at);
            let mut others = (0..frame.masks.len()).filter(|&other| other != object);
            let is_hidden =
                !frame.shows_scene(pixel) || others.any(|other| frame.covered(other, pixel) >= 0.5);
            if !is_hidden {
                covered += frame.covered(object, pixel);
                votes += 1.0;
            }
        }
        let mean = if votes > 0.0 { covered / votes } else { 0.0 };
        (STEEPNESS * (mean - 0.5) + 0.5).clamp(0.0, 1.0)
    };
    (0..width * height).into_par_iter().map(share).collect()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_object_of_the_first_or_the_last_frame_is_in_the_views_beyond() {
        let times = [0.1, 0.3, 0.5, 0.7];
        assert_eq!(existence(&times, [0, 3]), [0.0, 1.0]);
        assert_eq!(existence(&times, [1, 2]), [0.1, 0.7]);
        assert_eq!(existence(&times, [3, 3]), [0.5, 1.0]);
    }
}
