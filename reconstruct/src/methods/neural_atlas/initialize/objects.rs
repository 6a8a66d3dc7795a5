//! Planes of objects: where their masks are, as far away as their size in the image says.
//!
//! In the frame where its mask is largest an object is at the distance of the scene points in the mask, or
//! half as far as the background where there are none. In other frames it is as much farther as the root
//! of its area is smaller: things keep their size. Frames in which the mask touches the image's border or
//! another object's mask show a part: they say nothing of the distance, and nothing of the place either
//! where the object is seen whole before and after.

use glam::{DMat3, DQuat, DVec2, DVec3};
use omnilife_engine::{
    camera::Camera,
    surfaces::texture::Texture,
    trajectories::rigid_spline::{RigidPose, RigidSpline},
};
use rayon::prelude::*;

use super::{
    background::filled, by_distance_in_time, colour_at, pixel_at, point_on, seen_at, texel_uv,
};
use crate::methods::neural_atlas::{
    clip::{Clip, ClipFrame, camera_direction, pixel_centre},
    node::{Fields, Node, Surface},
};

/// How much larger than what is seen a plane is, each way.
const MARGIN: f64 = 1.3;
/// Distance where there are no points, over that of the background.
const GUESSED_DEPTH: f64 = 0.5;
/// The share of a mask's points that may be nearer than the object.
const NEAR_SHARE: f64 = 0.1;
/// Fewer points say nothing.
const LEAST_POINTS: usize = 3;
/// Half angle of a mask, seen from the camera, beyond which it gets no plane, radians.
const WIDEST: f64 = 50.0 * std::f64::consts::PI / 180.0;
/// Base opacities (the published code's).
const OPACITIES: [f64; 2] = [0.1, 0.9];

/// What a mask is in one frame.
#[derive(Debug, Clone)]
struct Silhouette {
    frame: usize,
    /// Solid angle, steradians.
    area: f64,
    /// Unit direction to its middle, camera.
    direction: DVec3,
    /// Whether it touches the image's border, another object or what is no part of the scene: it may be a part
    /// of what there is.
    is_partial: bool,
    pixels: Vec<usize>,
}

/// What became of an object.
#[derive(Debug)]
pub enum Made {
    /// A node, and how its distance was found.
    Node(Box<Node>, String),
    /// None, and why.
    LeftOut(String),
}

fn silhouette(clip: &Clip, object: usize, number: usize) -> Option<Silhouette> {
    let frame = &clip.frames[number];
    let mask = frame.masks[object].as_ref()?;
    let [width, height] = clip.size();
    let wraps = matches!(clip.camera, Camera::Erp(_));
    let pixels: Vec<usize> = (0..mask.len())
        .filter(|&pixel| mask[pixel] >= 128)
        .collect();
    let (mut sum, mut area) = (DVec3::ZERO, 0.0);
    let mut is_partial = false;
    for &pixel in &pixels {
        let direction = camera_direction(&clip.camera, pixel_centre(pixel, width));
        let solid = match clip.camera {
            Camera::Erp(camera) => camera.pixel_solid_angle((pixel / width) as u32),
            Camera::Pinhole(camera) => direction.z.powi(3) / (camera.fx * camera.fy),
        };
        sum += solid * direction;
        area += solid;
        let (column, row) = (pixel % width, pixel / width);
        is_partial |= row == 0 || row + 1 == height;
        is_partial |= !wraps && (column == 0 || column + 1 == width);
        // Within two pixels: masks need not touch where edges mix.
        let beside = [
            pixel.saturating_sub(2),
            (pixel + 2).min(mask.len() - 1),
            pixel.saturating_sub(2 * width),
            (pixel + 2 * width).min(mask.len() - 1),
        ];
        is_partial |= beside.iter().any(|&near| !frame.shows_scene(near));
        is_partial |= (0..frame.masks.len())
            .filter(|&other| other != object)
            .any(|other| beside.iter().any(|&near| frame.covered(other, near) >= 0.5));
    }
    (area > 0.0).then(|| Silhouette {
        frame: number,
        area,
        direction: sum.normalize_or(DVec3::Z),
        is_partial,
        pixels,
    })
}

/// Axes of a plane in the camera's frame: the camera's own for a perspective image, those that face the
/// camera for a panorama.
fn plane_axes(camera: &Camera, direction: DVec3) -> DMat3 {
    match camera {
        Camera::Pinhole(_) => DMat3::IDENTITY,
        Camera::Erp(_) => {
            let x = DVec3::Y.cross(direction).normalize_or(DVec3::X);
            DMat3::from_cols(x, direction.cross(x), direction)
        }
    }
}

/// Where directions of a silhouette's pixels meet a plane at `depth` along its normal, in its coordinates.
fn on_plane(clip: &Clip, seen: &Silhouette, axes: &DMat3, depth: f64) -> Vec<DVec2> {
    let [width, _] = clip.size();
    let centre = axes.transpose() * seen.direction;
    let centre = depth * centre.truncate() / centre.z;
    let places = seen.pixels.iter().map(|&pixel| {
        let direction = camera_direction(&clip.camera, pixel_centre(pixel, width));
        let local = axes.transpose() * direction;
        depth * local.truncate() / local.z - centre
    });
    places.collect()
}

/// Whether a silhouette reaches the first or the last row of a panorama.
fn is_on_a_pole(clip: &Clip, seen: &Silhouette) -> bool {
    let [width, height] = clip.size();
    let mut rows = seen.pixels.iter().map(|&pixel| pixel / width);
    rows.any(|row| row == 0 || row + 1 == height)
}

/// The node of an object, without fields. `points` are scene points; `background` is how far away the
/// background is; `knots` is how many its trajectory has.
pub fn node(clip: &Clip, object: usize, points: &[DVec3], background: f64, knots: usize) -> Made {
    let name = &clip.objects[object];
    let seen: Vec<Silhouette> = (0..clip.frames.len())
        .into_par_iter()
        .filter_map(|number| silhouette(clip, object, number))
        .collect();
    let whole = seen.iter().filter(|seen| !seen.is_partial);
    let largest = |a: &&Silhouette, b: &&Silhouette| a.area.total_cmp(&b.area);
    let Some(reference) = whole
        .max_by(largest)
        .or_else(|| seen.iter().max_by(largest))
    else {
        return Made::LeftOut("its masks are empty".to_owned());
    };
    let reference = reference.clone();
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
    let axes = plane_axes(&clip.camera, reference.direction);
    let (depth, depth_from) = match depth_of_points(clip, &reference, &axes, object, points) {
        Some((depth, count)) if depth < 0.9 * background => {
            (depth, format!("from {count} points in its mask"))
        }
        _ => (
            GUESSED_DEPTH * background,
            "a guess: half as far as the background".to_owned(),
        ),
    };
    let depths: Vec<f64> = seen
        .iter()
        .map(|own| {
            let distance = |other: &&Silhouette| other.frame.abs_diff(own.frame);
            let nearest = seen.iter().filter(|other| !other.is_partial);
            let by = nearest.min_by_key(distance).unwrap_or(&reference);
            let found = depth * (reference.area / by.area).sqrt();
            found.clamp(0.01 * background, 0.95 * background)
        })
        .collect();
    let is_whole = |seen: &Silhouette| !seen.is_partial;
    let [first_whole, last_whole] = [
        seen.iter().find(|seen| is_whole(seen)),
        seen.iter().rev().find(|seen| is_whole(seen)),
    ]
    .map(|seen| seen.map_or(usize::MAX, |seen| seen.frame));
    let says_where =
        |seen: &Silhouette| is_whole(seen) || seen.frame < first_whole || seen.frame > last_whole;
    let poses: Vec<(f64, DVec3, DQuat)> = seen
        .iter()
        .zip(&depths)
        .filter(|(seen, _)| says_where(seen))
        .map(|(seen, &depth)| {
            let frame = &clip.frames[seen.frame];
            let axes = plane_axes(&clip.camera, seen.direction);
            let along = axes.col(2).dot(seen.direction);
            let centre = frame.pose.rotation * (depth / along * seen.direction);
            let rotation = frame.pose.rotation * axes;
            (
                frame.time,
                frame.pose.centre + centre,
                DQuat::from_mat3(&rotation).normalize(),
            )
        })
        .collect();
    let mut half = DVec2::ZERO;
    for (seen, &depth) in seen.iter().zip(&depths) {
        let axes = plane_axes(&clip.camera, seen.direction);
        for place in on_plane(clip, seen, &axes, depth) {
            half = half.max(place.abs());
        }
    }
    let of_reference = on_plane(clip, &reference, &axes, depth)
        .into_iter()
        .fold(DVec2::ZERO, |half, place| half.max(place.abs()));
    // A mask that is wrong in one frame must not blow up the plane.
    let size = 2.0 * MARGIN * half.min(2.5 * of_reference);
    let trajectory = RigidSpline::fitted(knots.min(seen.len().max(1)), &poses);
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

/// Distance along the plane's normal of the scene points in a silhouette, and how many they are.
fn depth_of_points(
    clip: &Clip,
    reference: &Silhouette,
    axes: &DMat3,
    object: usize,
    points: &[DVec3],
) -> Option<(f64, usize)> {
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
    (depths.len() >= LEAST_POINTS).then(|| (depths[near], depths.len()))
}

/// Base textures: opacity from the reference frame's mask, colours from there and, where the mask is not,
/// from the frame nearest in time that sees the object there.
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

/// A Gaussian of 5 by 5 texels and a standard deviation of 1.
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
