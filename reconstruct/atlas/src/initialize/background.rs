//! The background: a plane that all frames look at, or a sphere around the cameras.

use std::f64::consts::PI;

use glam::{DMat3, DQuat, DVec2, DVec3};
use omnilife_engine::{
    camera::Camera,
    surfaces::texture::Texture,
    trajectories::rigid_spline::{RigidPose, RigidSpline},
};
use omnilife_schemas::statistics::quantile;
use rayon::prelude::*;

use super::{by_distance_in_time, colour_at, pixel_at, planes, point_on, seen_at, texel_uv};
use crate::{
    clip::{Clip, ClipFrame, camera_direction},
    node::{Fields, Node, Surface},
};

/// Name of the background's node.
pub const BACKGROUND: &str = "background";
/// Half of the field of view beyond which a plane is not a background, radians.
const WIDEST: f64 = 60.0 * PI / 180.0;
/// Size of the plane over its visible part, each way.
const MARGIN: f64 = 1.06;
/// Texels of a side, at most.
const MOST_TEXELS: f64 = 2048.0;
/// Share of the scene's points that are before the background, where they are on no plane.
const FAR_SHARE: f64 = 0.9;
/// Distance over the cameras' path without points.
const FAR_OVER_PATH: f64 = 4.0;
/// Minimum share of the scene's points on a plane that is the background.
const LEAST_AGREEING: f64 = 0.4;
/// Minimum distance of a plane through points, over the cameras' distance from their mean.
const LEAST_DISTANCE: f64 = 0.1;
/// Maximum distance in view, over that of the middle.
const FARTHEST: f64 = 50.0;
/// Distance without evidence: cameras do not move.
const STILL_DISTANCE: f64 = 2.0;

/// Surface of the background, with a reason.
#[derive(Debug, Clone, PartialEq)]
pub struct PlacedBackground {
    /// Its surface.
    pub surface: Surface,
    /// Texels across and down that its base texture has.
    pub texels: [usize; 2],
    /// Distance from the mean camera, normalized units.
    pub distance: f64,
    /// Reason for this surface and this distance.
    pub reason: String,
}

/// Returns directions from the cameras to the borders of their images, world.
fn border_directions(clip: &Clip) -> Vec<(DVec3, DVec3)> {
    let [width, height] = clip.size().map(|side| side as f64);
    let steps = (0..=16).map(|step| f64::from(step) / 16.0);
    let places: Vec<DVec2> = steps
        .flat_map(|s| {
            [
                DVec2::new(s * width, 0.0),
                DVec2::new(s * width, height),
                DVec2::new(0.0, s * height),
                DVec2::new(width, s * height),
            ]
        })
        .collect();
    let rays = clip.frames.iter().flat_map(|frame| {
        places.iter().map(|&at| {
            let direction = camera_direction(&clip.camera, at);
            (frame.pose.centre, frame.pose.rotation * direction)
        })
    });
    rays.collect()
}

/// Returns the mean position of the cameras, and the length of their path.
fn path_of(clip: &Clip) -> (DVec3, f64) {
    let count = clip.frames.len().max(1) as f64;
    let mean = clip.frames.iter().map(|f| f.pose.centre).sum::<DVec3>() / count;
    let steps = clip
        .frames
        .windows(2)
        .map(|pair| pair[0].pose.centre.distance(pair[1].pose.centre));
    (mean, steps.sum())
}

/// Returns the distance from the mean camera without a plane through points, and its source.
fn guessed_distance(points: &[DVec3], mean: DVec3, path: f64) -> (f64, &'static str) {
    let distances: Vec<f64> = points.iter().map(|point| point.distance(mean)).collect();
    match quantile(&distances, FAR_SHARE) {
        Some(far) if far > FAR_OVER_PATH * path => {
            (far, "the 90th percentile of the scene's points")
        }
        _ if path < 1e-6 => (STILL_DISTANCE, "any: the cameras stand still"),
        _ => (FAR_OVER_PATH * path, "four times the cameras' path"),
    }
}

/// Decides on surface and distance. `points` are the scene's points.
pub fn place(clip: &Clip, points: &[DVec3]) -> PlacedBackground {
    let (mean, path) = path_of(clip);
    let forward: DVec3 = clip.frames.iter().map(|f| f.pose.rotation.col(2)).sum();
    let axis = forward.normalize_or(DVec3::Z);
    let borders = border_directions(clip);
    let widest = borders
        .iter()
        .map(|(_, direction)| direction.dot(axis).clamp(-1.0, 1.0).acos())
        .fold(0.0, f64::max);
    let view = format!("{:.0} degrees of view", 2.0 * widest.to_degrees());
    match clip.camera {
        Camera::Pinhole(_) if widest <= WIDEST => {
            let plane = plane_of(clip, points, axis, &borders);
            plane_in_view(clip, &plane, &borders, &view)
        }
        camera => {
            let (distance, why) = guessed_distance(points, mean, path);
            sphere(clip, &camera, mean, distance, &view, why)
        }
    }
}

/// Returns a sphere around the mean camera.
fn sphere(
    clip: &Clip,
    camera: &Camera,
    mean: DVec3,
    radius: f64,
    view: &str,
    why: &str,
) -> PlacedBackground {
    let (texels, what) = match camera {
        Camera::Erp(_) => (clip.size(), "panoramas"),
        Camera::Pinhole(camera) => {
            let around = (2.0 * PI * camera.fx).min(MOST_TEXELS);
            ([around as usize, (0.5 * around) as usize], view)
        }
    };
    PlacedBackground {
        surface: Surface::Sphere {
            centre: mean,
            radius,
        },
        texels,
        distance: radius,
        reason: format!("a sphere ({what}), its radius {why}"),
    }
}

/// A plane before the cameras.
struct Facing {
    /// Point of the plane before the mean camera.
    middle: DVec3,
    /// Its axes: columns, the last one away from the cameras.
    rotation: DMat3,
    /// Distance of `middle` from the mean camera.
    distance: f64,
    /// Source of its place.
    why: String,
}

/// Returns the plane of the background: through points where these lie on one, else parallel to the mean image.
fn plane_of(clip: &Clip, points: &[DVec3], axis: DVec3, borders: &[(DVec3, DVec3)]) -> Facing {
    let (mean, path) = path_of(clip);
    let upright = &clip.frames[clip.frames.len() / 2].pose;
    let camera = facing(axis, upright);
    let baseline = clip
        .frames
        .iter()
        .map(|frame| frame.pose.centre.distance(mean))
        .fold(0.0, f64::max);
    let focal = match clip.camera {
        Camera::Pinhole(camera) => camera.fx,
        Camera::Erp(camera) => f64::from(camera.width) / (2.0 * PI),
    };
    let own: Vec<DVec3> = points
        .iter()
        .map(|&point| camera.transpose() * (point - mean))
        .collect();
    let at_borders: Vec<DVec2> = borders
        .iter()
        .map(|&(_, direction)| camera.transpose() * direction)
        .filter(|local| local.z > 0.0)
        .map(|local| local.truncate() / local.z)
        .collect();
    let of_pixel = 1.0 / (focal * baseline);
    let found = planes::fitted(&own, of_pixel, &at_borders);
    let far = found.filter(|found| {
        found.agreeing >= LEAST_AGREEING && found.normal.z * LEAST_DISTANCE * baseline < 1.0
    });
    if let Some(found) = far {
        let normal = (camera * found.normal).normalize();
        let distance = 1.0 / found.normal.z;
        let tilt = normal.dot(axis).clamp(-1.0, 1.0).acos().to_degrees();
        let within = if found.tolerance < of_pixel {
            format!("{:.0} % of the depth", 100.0 * planes::MOST_TOLERANCE)
        } else {
            "a pixel of parallax".to_owned()
        };
        let plane = Facing {
            middle: mean + distance * axis,
            rotation: facing(normal, upright),
            distance,
            why: format!(
                "through the scene's points: {:.0} % of {} within {within}, tilted by {tilt:.0} degrees",
                100.0 * found.agreeing,
                found.points
            ),
        };
        if is_before(&plane, borders) {
            return plane;
        }
    }
    let (distance, why) = guessed_distance(points, mean, path);
    let none = found.map_or_else(String::new, |found| {
        format!(
            "; {:.0} % of {} points at most are on one plane",
            100.0 * found.agreeing,
            found.points
        )
    });
    Facing {
        middle: mean + distance * axis,
        rotation: camera,
        distance,
        why: format!("its distance {why}{none}"),
    }
}

/// Returns true if all rays meet a plane before their cameras, and none far behind its middle.
fn is_before(plane: &Facing, borders: &[(DVec3, DVec3)]) -> bool {
    let normal = plane.rotation.col(2);
    borders.iter().all(|&(origin, direction)| {
        let along = normal.dot(plane.middle - origin) / normal.dot(direction);
        along > 0.0 && along < FARTHEST * plane.distance
    })
}

/// Returns the part of a plane that the cameras see.
fn plane_in_view(
    clip: &Clip,
    plane: &Facing,
    borders: &[(DVec3, DVec3)],
    view: &str,
) -> PlacedBackground {
    let (middle, rotation) = (plane.middle, plane.rotation);
    let normal = rotation.col(2);
    let (mut low, mut high) = (DVec2::MAX, DVec2::MIN);
    let mut nearest = f64::INFINITY;
    for &(origin, direction) in borders {
        let along = normal.dot(middle - origin) / normal.dot(direction);
        let local = rotation.transpose() * (origin + along * direction - middle);
        low = low.min(local.truncate());
        high = high.max(local.truncate());
        nearest = nearest.min(along);
    }
    let size = MARGIN * (high - low);
    let centre = middle + rotation * (0.5 * (low + high)).extend(0.0);
    // The nearest part has the finest texture; without a tilt that is the middle.
    let nearest = nearest.clamp(0.25 * plane.distance, plane.distance);
    let per_unit = match clip.camera {
        Camera::Pinhole(camera) => camera.fx / nearest,
        Camera::Erp(camera) => f64::from(camera.width) / (2.0 * PI * nearest),
    };
    let texels = (size * per_unit).clamp(DVec2::splat(2.0), DVec2::splat(MOST_TEXELS));
    PlacedBackground {
        surface: Surface::Plane {
            size,
            trajectory: RigidSpline {
                positions: vec![centre],
                rotations: vec![DQuat::from_mat3(&rotation)],
            },
        },
        texels: [texels.x.ceil() as usize, texels.y.ceil() as usize],
        distance: plane.distance,
        reason: format!("a plane ({view}), {}", plane.why),
    }
}

impl PlacedBackground {
    /// Returns the distance along a ray to the background; `None` where the ray misses it.
    pub fn along(&self, origin: DVec3, direction: DVec3) -> Option<f64> {
        let along = match &self.surface {
            Surface::Plane { trajectory, .. } => {
                let pose = trajectory.pose(0.0);
                let normal = pose.rotation.col(2);
                normal.dot(pose.centre - origin) / normal.dot(direction)
            }
            Surface::Sphere { radius, .. } => *radius,
        };
        (along.is_finite() && along > 0.0).then_some(along)
    }
}

/// Returns the axes of a plane that faces `axis`, as upright as a camera.
fn facing(axis: DVec3, camera: &RigidPose) -> DMat3 {
    let right = camera.rotation.col(0);
    let x = (right - right.dot(axis) * axis).normalize_or(DVec3::X);
    DMat3::from_cols(x, axis.cross(x), axis)
}

/// Makes the background's node. Texels are read from the frame nearest in time to the clip's middle that sees
/// them uncovered.
///
/// # Errors
/// When no frame shows an uncovered pixel.
pub fn node(clip: &Clip, placed: &PlacedBackground) -> Result<Node, String> {
    let has_open = clip
        .frames
        .iter()
        .any(|frame| (0..clip.pixel_count()).any(|pixel| shows_background(frame, pixel)));
    if !has_open {
        return Err("masks must leave the background visible in a frame, and they cover every pixel of every frame".to_owned());
    }
    let [width, height] = placed.texels;
    let frames = by_distance_in_time(clip, 0.5);
    let open: Vec<Vec<bool>> = frames
        .iter()
        .map(|frame| far_from_masks(clip, frame))
        .collect();
    let point = |texel: usize| match &placed.surface {
        Surface::Plane { size, trajectory } => {
            let pose = trajectory.pose(0.0);
            point_on(&pose, *size, texel_uv(texel, width, height))
        }
        Surface::Sphere { centre, radius } => {
            let longitude = ((texel % width) as f64 + 0.5) / width as f64 * 2.0 * PI - PI;
            let latitude = (0.5 - ((texel / width) as f64 + 0.5) / height as f64) * PI;
            let (sin, cos) = longitude.sin_cos();
            let direction = DVec3::new(latitude.cos() * sin, -latitude.sin(), latitude.cos() * cos);
            *centre + *radius * direction
        }
    };
    let read: Vec<Option<[f64; 3]>> = (0..width * height)
        .into_par_iter()
        .map(|texel| {
            let point = point(texel);
            frames.iter().zip(&open).find_map(|(frame, open)| {
                let at = seen_at(clip, frame, point)?;
                open[pixel_at(clip, at)].then(|| colour_at(clip, frame, at))
            })
        })
        .collect();
    Ok(Node {
        id: BACKGROUND.to_owned(),
        surface: placed.surface.clone(),
        colour: filled(width, height, &read),
        opacity: None,
        fields: Fields::default(),
        offsets: None,
        times: [f64::MIN, f64::MAX],
        delay: 0.0,
        overlay: None,
    })
}

fn shows_background(frame: &ClipFrame, pixel: usize) -> bool {
    frame.shows_scene(pixel) && !frame.is_covered(pixel)
}

/// Returns the pixels of a frame with no covered pixel within two: a mask's edge is not exact, and pixels mix
/// there.
fn far_from_masks(clip: &Clip, frame: &ClipFrame) -> Vec<bool> {
    let [width, height] = clip.size();
    let mut open = vec![true; width * height];
    for pixel in (0..width * height).filter(|&pixel| !shows_background(frame, pixel)) {
        let (column, row) = (pixel % width, pixel / width);
        for near_row in row.saturating_sub(2)..=(row + 2).min(height - 1) {
            for near_column in column.saturating_sub(2)..=(column + 2).min(width - 1) {
                open[near_row * width + near_column] = false;
            }
        }
    }
    open
}

/// Gives unread texels the colours of their neighbours, from coarser images of the texture down.
pub(super) fn filled(width: usize, height: usize, read: &[Option<[f64; 3]>]) -> Texture<3> {
    let known: Vec<[f64; 4]> = read
        .iter()
        .map(|texel| texel.map_or([0.0; 4], |[r, g, b]| [r, g, b, 1.0]))
        .collect();
    let all = spread(width, height, known);
    Texture {
        width,
        height,
        texels: all
            .iter()
            .map(|&[r, g, b, _]| [r as f32, g as f32, b as f32])
            .collect(),
    }
}

/// Spreads colours with weights of at least 0: a weight of 0 takes the colour of the image at half the size.
fn spread(width: usize, height: usize, mut known: Vec<[f64; 4]>) -> Vec<[f64; 4]> {
    if known.iter().all(|texel| texel[3] > 0.0) || (width <= 1 && height <= 1) {
        return known;
    }
    let (half_width, half_height) = (width.div_ceil(2), height.div_ceil(2));
    let mut half = vec![[0.0; 4]; half_width * half_height];
    for (at, texel) in known.iter().enumerate() {
        let into = &mut half[(at / width / 2) * half_width + at % width / 2];
        for (sum, value) in into.iter_mut().zip([
            texel[0] * texel[3],
            texel[1] * texel[3],
            texel[2] * texel[3],
            texel[3],
        ]) {
            *sum += value;
        }
    }
    for texel in &mut half {
        let weight = texel[3];
        if weight > 0.0 {
            *texel = [texel[0] / weight, texel[1] / weight, texel[2] / weight, 1.0];
        }
    }
    let half = spread(half_width, half_height, half);
    for (at, texel) in known.iter_mut().enumerate() {
        if texel[3] == 0.0 {
            let [r, g, b, _] = half[(at / width / 2) * half_width + at % width / 2];
            *texel = [r, g, b, 1.0];
        }
    }
    known
}
