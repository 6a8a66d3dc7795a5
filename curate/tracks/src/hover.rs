//! Tracking with a hovering camera. It sees no parallax: images of different times differ by a homography, and that of
//! a plane at any distance is the same. So static content is modelled as a plane: the one of the scene's points, which
//! is assumed too, or without points one across the viewing direction at a distance of 1. The rest of tracking is the
//! same as over true ground.

use glam::DVec3;
use omnilife_schemas::{
    points::PointCloud,
    posed_view::PosedView,
    records::{PoseSource, Scene},
    scene_points::ScenePoints,
};

use crate::error::TracksError;

/// Least distance between neighbouring points of the plane, pixels.
const SPACING: usize = 4;
/// Maximum number of frames whose views the plane covers.
const MOST_FRAMES: usize = 12;
/// Least cosine between rays and the normal of the plane, at its end: 75 degrees.
const LEAST_COSINE: f64 = 0.26;

/// Returns points of static content, and remarks on them: those of a scene, or of the plane below a hovering camera.
///
/// # Errors
/// When the points cannot be read.
pub(super) fn static_points(
    points: Option<&ScenePoints>,
    scene: &Scene,
    views: &[PosedView],
) -> Result<(Vec<DVec3>, Vec<String>), TracksError> {
    match points {
        Some(points) => {
            let points = PointCloud::read_ply(&points.file)?.positions.into_iter();
            let warnings = scene.planar_ground().into_iter().collect();
            Ok((points.map(DVec3::from_array).collect(), warnings))
        }
        None if is_hovering(scene, views) => {
            let warning = "the camera hovers over ground of unknown position: tracks are on a plane \
                           across the viewing direction, images are compared by homographies";
            Ok((plane_points(views), vec![warning.to_owned()]))
        }
        None => Ok((Vec::new(), Vec::new())),
    }
}

/// Returns true if a scene's poses are rotations of a camera in one place.
fn is_hovering(scene: &Scene, views: &[PosedView]) -> bool {
    let is_registered = matches!(scene.pose_source, PoseSource::Registered { .. });
    let first = views.first().map(|view| view.centre);
    is_registered && views.iter().all(|view| Some(view.centre) == first)
}

/// Returns points of the plane that any of the views sees.
fn plane_points(views: &[PosedView]) -> Vec<DVec3> {
    let axis = |view: &PosedView| view.to_world.z_axis;
    let Some(normal) = views.iter().map(axis).sum::<DVec3>().try_normalize() else {
        return Vec::new();
    };
    let step = views.len().div_ceil(MOST_FRAMES).max(1);
    let mut points = Vec::new();
    for view in views.iter().step_by(step) {
        let [width, height] = view.camera.size();
        for row in (0..height).step_by(SPACING) {
            for column in (0..width).step_by(SPACING) {
                let pixel = glam::dvec2(column as f64 + 0.5, row as f64 + 0.5);
                let ray = view.ray(pixel);
                let cosine = ray.dot(normal);
                if cosine > LEAST_COSINE {
                    points.push(view.centre + ray / cosine);
                }
            }
        }
    }
    points
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, dvec3};
    use omnilife_schemas::camera::PinholeCamera;

    use super::*;

    #[test]
    fn the_plane_lies_across_the_view_at_a_distance_of_one() {
        let down = DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z);
        let views: Vec<PosedView> = [-0.1, 0.1]
            .into_iter()
            .map(|turn| PosedView {
                frame: 0,
                seconds: 0.0,
                camera: PinholeCamera::with_horizontal_field_of_view(64, 36, 1.0).into(),
                to_world: DMat3::from_rotation_x(turn) * down,
                centre: dvec3(1.0, 2.0, 3.0),
            })
            .collect();
        let points = plane_points(&views);
        assert_eq!(points.len(), 2 * 16 * 9);
        assert!(points.iter().all(|point| (point.z - 2.0).abs() < 1e-12));
        // Each view's own middle is covered.
        let middle = views[0].centre + views[0].to_world.z_axis / 0.1_f64.cos();
        let nearest = points.iter().map(|point| point.distance(middle));
        assert!(nearest.fold(f64::INFINITY, f64::min) < 0.1);
    }
}
