//! Parallax test for frames of a perspective camera.
//!
//! Structure from motion of a hovering camera can end in poses that look sound: with a wrong focal length and a
//! spurious lens, rotations become paths. So its observations are fitted once more by rotations alone, of a camera
//! without a lens. If the residual is at most a pixel, there is no parallax.

use std::collections::BTreeMap;

use glam::{DMat3, DQuat, DVec2, DVec3};
use omnilife_schemas::{camera::Camera, statistics::median};

use super::colmap::{ColmapImage, ColmapModel};

/// Largest residual of rotations alone, pixels, of a camera that only rotates.
pub(super) const TURNS_PIXELS: f64 = 1.0;
/// Focal lengths to test, over the width: from, to, and their ratio; then so much finer.
const FOCALS: [f64; 3] = [0.4, 3.0, 1.05];
const FINER: f64 = 1.004;
/// Maximum number of tested pairs of frames; each shares this many points at least.
const PAIRS: usize = 12;
const LEAST_SHARED: usize = 50;
/// Steps to the rotation of a pair.
const STEPS: usize = 12;

/// Fit of a model by rotations alone, of a camera without a lens.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TurnsAlone {
    /// Median distance from observations in the pair of frames with the worst fit, pixels.
    pub(super) pixels: f64,
    /// The focal length that fits best, pixels.
    pub(super) focal: f64,
}

/// Fits a model by rotations alone; `names` are the frames in order of time. `None` for panoramas, and if no two frames
/// far apart share enough points.
pub(super) fn turns_alone(model: &ColmapModel, names: &[String]) -> Option<TurnsAlone> {
    let Camera::Pinhole(straight) = model.camera.camera() else {
        return None;
    };
    let lens = model.camera.lens();
    let frame = lens.map_or(straight, |lens| lens.camera);
    let middle = DVec2::new(frame.cx, frame.cy);
    let width = f64::from(frame.width);
    let seen = |image: &ColmapImage| -> BTreeMap<u64, DVec2> {
        let of_frame = |pixel: DVec2| match lens {
            Some(lens) => lens.source(&straight, pixel),
            None => pixel,
        };
        let observations = image.observations.iter();
        observations
            .map(|&(pixel, id)| (id, of_frame(pixel) - middle))
            .collect()
    };
    let by_name = |name: &String| model.images.values().find(|image| image.name == *name);
    let path: Vec<BTreeMap<u64, DVec2>> = names.iter().filter_map(by_name).map(seen).collect();
    // The larger the interval, the farther a moving camera has come.
    let gap = (path.len() / 3).max(1);
    let step = path.len().saturating_sub(gap).div_ceil(PAIRS).max(1);
    let pairs: Vec<Vec<[DVec2; 2]>> = (0..path.len().saturating_sub(gap))
        .step_by(step)
        .map(|first| {
            let second = &path[first + gap];
            let shared = path[first].iter();
            shared
                .filter_map(|(id, &one)| Some([one, *second.get(id)?]))
                .collect::<Vec<[DVec2; 2]>>()
        })
        .filter(|pair| pair.len() >= LEAST_SHARED)
        .collect();
    if pairs.is_empty() {
        return None;
    }
    let worst = |focal: f64| {
        let pixels = pairs.iter().map(|pair| left_by_turn(pair, focal));
        pixels.fold(0.0, f64::max)
    };
    let best_of = |focals: Vec<f64>| {
        let tried = focals.into_iter().map(|focal| TurnsAlone {
            pixels: worst(focal),
            focal,
        });
        tried.min_by(|a, b| a.pixels.total_cmp(&b.pixels))
    };
    let [from, to, factor] = FOCALS;
    let coarse = std::iter::successors(Some(from * width), |focal| Some(focal * factor));
    let best = best_of(coarse.take_while(|focal| *focal <= to * width).collect())?;
    let finer = (-12..=12).map(|power| best.focal * FINER.powi(power));
    best_of(finer.collect())
}

/// Returns the residual of the best rotation for a pair of frames, pixels: the median over the points that both see.
fn left_by_turn(pair: &[[DVec2; 2]], focal: f64) -> f64 {
    let rays: Vec<[DVec3; 2]> = pair
        .iter()
        .map(|places| places.map(|place| place.extend(focal).normalize()))
        .collect();
    let Some(turn) = rotation_between(&rays) else {
        return f64::INFINITY;
    };
    let left: Vec<f64> = rays
        .iter()
        .zip(pair)
        .map(|([one, _], [_, seen])| {
            let turned = turn * *one;
            (focal * turned.truncate() / turned.z.max(1e-6)).distance(*seen)
        })
        .collect();
    median(&left).unwrap_or(f64::INFINITY)
}

/// Returns the rotation that brings the first of each pair of unit rays onto the second, by least squares; `None` if
/// the rays do not determine one.
pub(super) fn rotation_between(rays: &[[DVec3; 2]]) -> Option<DQuat> {
    let mut turn = DQuat::IDENTITY;
    for _ in 0..STEPS {
        // Least squares over small rotations that bring the first rays onto the second.
        let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for [one, other] in rays {
            let turned = turn * *one;
            matrix += DMat3::IDENTITY
                - DMat3::from_cols(turned * turned.x, turned * turned.y, turned * turned.z);
            right += turned.cross(*other);
        }
        let step = matrix.inverse() * right;
        if !step.is_finite() {
            return None;
        }
        turn = (DQuat::from_scaled_axis(step) * turn).normalize();
        if step.length() < 1e-12 {
            break;
        }
    }
    Some(turn)
}

#[cfg(test)]
mod tests {
    use omnilife_schemas::camera::{CameraModel, PinholeCamera};

    use super::*;

    /// Returns a clip over a road with houses; the camera turns, and moves by `step` from frame to frame.
    fn model(step: f64) -> (ColmapModel, Vec<String>) {
        let camera = PinholeCamera::with_horizontal_field_of_view(640, 360, 1.1);
        let down = DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z);
        let points: Vec<DVec3> = (0..900)
            .map(|n| {
                let (x, y) = (f64::from(n % 30) - 15.0, f64::from(n / 30) - 15.0);
                DVec3::new(2.0 * x, 1.4 * y, if n % 7 == 0 { 9.0 } else { 0.0 })
            })
            .collect();
        let names: Vec<String> = (0..9).map(|frame| format!("{frame:06}.png")).collect();
        let images = names.iter().enumerate().map(|(frame, name)| {
            let f = frame as f64;
            let turn = DMat3::from_euler(glam::EulerRot::XYZ, 0.02 * f.sin(), 0.01 * f, 0.02 * f);
            let (to_world, centre) = (turn * down, DVec3::new(step * f, 0.0, 45.0));
            let observations = points.iter().enumerate().filter_map(|(id, point)| {
                let pixel = camera.project(to_world.transpose() * (*point - centre))?;
                Some((pixel, id as u64))
            });
            let image = ColmapImage {
                name: name.clone(),
                rotation: DQuat::from_mat3(&to_world),
                centre,
                observations: observations.collect(),
            };
            (frame as u32, image)
        });
        let model = ColmapModel {
            camera: Camera::from(camera).into(),
            images: images.collect(),
            points: BTreeMap::new(),
        };
        (model, names)
    }

    #[test]
    fn turns_explain_a_hovering_camera_and_no_flight() {
        let (hover, names) = model(0.0);
        let found = turns_alone(&hover, &names).expect("shared points");
        assert!(found.pixels < 0.2, "{found:?}");
        let Camera::Pinhole(camera) = hover.camera.camera() else {
            panic!("a pinhole");
        };
        assert!((found.focal / camera.fx - 1.0).abs() < 0.02, "{found:?}");
        // Half a metre from frame to frame at a height of 45 m.
        let (flight, names) = model(0.5);
        let found = turns_alone(&flight, &names).expect("shared points");
        assert!(found.pixels > 1.5 * TURNS_PIXELS, "{found:?}");
        assert_eq!(turns_alone(&hover, &names[..1]), None);
    }
}
