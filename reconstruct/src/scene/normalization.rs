//! Similarity that brings a scene's cameras and points to the size that training works in.

use glam::{DVec3, Vec3};
use omnilife_schemas::{Similarity, points::PointCloud};

/// Median distance of the points from the mean camera, in camera radii, above which the cameras do
/// not give the scale.
const FARTHEST_MEDIAN_POINT: f64 = 1000.0;

/// The cameras' similarity; where they hardly move (a tripod), one that puts the median point at
/// [`FARTHEST_MEDIAN_POINT`].
pub(super) fn normalization(cameras: Similarity, points: &PointCloud) -> Similarity {
    let mut distances: Vec<f64> = points
        .positions
        .iter()
        .map(|&position| {
            cameras
                .normalize(DVec3::from_array(position.map(f64::from)))
                .length()
        })
        .collect();
    distances.sort_by(f64::total_cmp);
    match distances.get(distances.len() / 2) {
        Some(&median) if median > FARTHEST_MEDIAN_POINT => Similarity {
            scale: cameras.scale * FARTHEST_MEDIAN_POINT / median,
            ..cameras
        },
        _ => cameras,
    }
}

/// Whether a point (normalized) is farther from some camera (world) than rounding puts it.
pub(super) fn any_point_away_from_cameras(
    points: &PointCloud,
    normalization: &Similarity,
    centres: &[DVec3],
) -> bool {
    let centres: Vec<Vec3> = centres
        .iter()
        .map(|&centre| normalization.normalize(centre).as_vec3())
        .collect();
    points.positions.iter().any(|&position| {
        let position = Vec3::from_array(position);
        centres
            .iter()
            .all(|centre| centre.distance(position) > 1e-5)
    })
}

pub(super) fn normalize(points: &mut PointCloud, normalization: &Similarity) {
    for position in &mut points.positions {
        let world = DVec3::from_array(position.map(f64::from));
        *position = normalization.normalize(world).as_vec3().to_array();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_still_camera_takes_its_scale_from_the_points() {
        let centre = DVec3::new(3.0, 4.0, 5.0);
        let points = PointCloud {
            positions: vec![[8.0, 4.0, 5.0]; 3],
            colours: vec![[0; 3]; 3],
        };
        let still = Similarity::from_cameras(&[centre; 4]).expect("cameras");
        let similarity = normalization(still, &points);
        let point = similarity.normalize(DVec3::new(8.0, 4.0, 5.0));
        assert!(
            (point.length() - FARTHEST_MEDIAN_POINT).abs() < 1e-6,
            "{point}"
        );
        let moving = Similarity::from_cameras(&[centre, centre + DVec3::X]).expect("cameras");
        assert_eq!(normalization(moving, &points), moving);
    }
}
