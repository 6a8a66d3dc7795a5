//! The background: a plane that all frames look at, or a sphere around the cameras.

use std::f64::consts::PI;

use glam::{DMat3, DQuat, DVec2, DVec3};
use omnilife_engine::{
    camera::Camera,
    surfaces::texture::Texture,
    trajectories::rigid_spline::{RigidPose, RigidSpline},
};
use rayon::prelude::*;

use super::{by_distance_in_time, colour_at, pixel_at, point_on, seen_at, texel_uv};
use crate::{
    clip::{Clip, ClipFrame, camera_direction},
    node::{Fields, Node, Surface},
};

/// Name of the background's node.
pub const BACKGROUND: &str = "background";
/// Half of the field of view beyond which a plane is no background, radians.
const WIDEST: f64 = 60.0 * PI / 180.0;
/// Size of the plane over its visible part, each way.
const MARGIN: f64 = 1.06;
/// Texels of a side, at most.
const MOST_TEXELS: f64 = 2048.0;
/// Distance without evidence: cameras do not move.
const STILL_DISTANCE: f64 = 2.0;

/// Surface of the background, with a reason.
#[derive(Debug, Clone, PartialEq)]
pub struct Placed {
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

/// Decides on surface and distance. `point_distances` are the scene points' distances from the mean camera.
pub fn place(clip: &Clip, point_distances: &[f64]) -> Placed {
    let count = clip.frames.len().max(1) as f64;
    let mean = clip.frames.iter().map(|f| f.pose.centre).sum::<DVec3>() / count;
    let path: f64 = clip
        .frames
        .windows(2)
        .map(|pair| pair[0].pose.centre.distance(pair[1].pose.centre))
        .sum();
    let mut sorted = point_distances.to_vec();
    sorted.sort_by(f64::total_cmp);
    let by_points = sorted.get(sorted.len() * 9 / 10).copied();
    let is_still = path < 1e-6;
    let (distance, why) = match by_points {
        Some(far) if far > 4.0 * path => (far, "the 90th percentile of the scene's points"),
        _ if is_still => (STILL_DISTANCE, "any: the cameras stand still"),
        _ => (4.0 * path, "four times the cameras' path"),
    };
    let forward: DVec3 = clip.frames.iter().map(|f| f.pose.rotation.col(2)).sum();
    let axis = forward.normalize_or(DVec3::Z);
    let borders = border_directions(clip);
    let widest = borders
        .iter()
        .map(|(_, direction)| direction.dot(axis).clamp(-1.0, 1.0).acos())
        .fold(0.0, f64::max);
    let is_sphere = matches!(clip.camera, Camera::Erp(_)) || widest > WIDEST;
    let view = format!("{:.0} degrees of view", 2.0 * widest.to_degrees());
    if is_sphere {
        let [width, height] = clip.size();
        let across = match clip.camera {
            Camera::Erp(_) => [width, height],
            Camera::Pinhole(camera) => {
                let around = (2.0 * PI * camera.fx).min(MOST_TEXELS);
                [around as usize, (0.5 * around) as usize]
            }
        };
        let what = match clip.camera {
            Camera::Erp(_) => "panoramas".to_owned(),
            Camera::Pinhole(_) => view,
        };
        return Placed {
            surface: Surface::Sphere {
                centre: mean,
                radius: distance,
            },
            texels: across,
            distance,
            reason: format!("a sphere ({what}), its radius {why}"),
        };
    }
    let rotation = facing(axis, &clip.frames[clip.frames.len() / 2].pose);
    let middle = mean + distance * axis;
    let (mut low, mut high) = (DVec2::MAX, DVec2::MIN);
    for (origin, direction) in borders {
        let along = axis.dot(middle - origin) / axis.dot(direction);
        let local = rotation.transpose() * (origin + along * direction - middle);
        low = low.min(local.truncate());
        high = high.max(local.truncate());
    }
    let size = MARGIN * (high - low);
    let centre = middle + rotation * (0.5 * (low + high)).extend(0.0);
    let per_unit = match clip.camera {
        Camera::Pinhole(camera) => camera.fx / distance,
        Camera::Erp(camera) => f64::from(camera.width) / (2.0 * PI * distance),
    };
    let texels = (size * per_unit).clamp(DVec2::splat(2.0), DVec2::splat(MOST_TEXELS));
    Placed {
        surface: Surface::Plane {
            size,
            trajectory: RigidSpline {
                positions: vec![centre],
                rotations: vec![DQuat::from_mat3(&rotation)],
            },
        },
        texels: [texels.x.ceil() as usize, texels.y.ceil() as usize],
        distance,
        reason: format!("a plane ({view}), its distance {why}"),
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
pub fn node(clip: &Clip, placed: &Placed) -> Result<Node, String> {
    let has_open = clip
        .frames
        .iter()
        .any(|frame| (0..clip.pixel_count()).any(|pixel| shows_background(frame, pixel)));
    if !has_open {
        return Err("masks cover every pixel of every frame: there is no background".to_owned());
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
