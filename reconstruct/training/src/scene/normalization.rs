//! Similarity that brings a scene's cameras and points to the size of training.

use glam::{DVec3, Vec3};
use omnilife_schemas::{Similarity, points::PointCloud, statistics};

/// Maximum median distance of the points from the mean camera, in camera radii, for a scale by the cameras.
const FARTHEST_MEDIAN_POINT: f64 = 1000.0;

/// Cameras that determine a scene's extent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CameraExtent {
    /// All up to the farthest one, as in 3DGS and its successors.
    Farthest,
    /// Without those that are far from all others, whose poses are wrong
    /// ([`Similarity::from_most_cameras`]).
    Most,
}

impl CameraExtent {
    /// Returns the similarity that normalizes cameras; `None` without cameras or with non-finite centres.
    pub(super) fn similarity(self, centres: &[DVec3]) -> Option<Similarity> {
        match self {
            Self::Farthest => Similarity::from_cameras(centres),
            Self::Most => Similarity::from_most_cameras(centres),
        }
    }
}

/// Returns the cameras' similarity; where they hardly move (a tripod), one that puts the median point at
/// [`FARTHEST_MEDIAN_POINT`].
pub(super) fn normalization(cameras: Similarity, points: &PointCloud) -> Similarity {
    let distances: Vec<f64> = points
        .positions
        .iter()
        .map(|&position| cameras.normalize(DVec3::from_array(position)).length())
        .collect();
    match statistics::median(&distances) {
        Some(median) if median > FARTHEST_MEDIAN_POINT => Similarity {
            scale: cameras.scale * FARTHEST_MEDIAN_POINT / median,
            ..cameras
        },
        _ => cameras,
    }
}

/// Returns true if a point (normalized) is farther from some camera (world) than the error of rounding.
pub(super) fn any_point_away_from_cameras(
    points: &PointCloud<f32>,
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

/// Returns world points in normalized coordinates.
pub(super) fn normalized(points: PointCloud, normalization: &Similarity) -> PointCloud<f32> {
    let normalize = |&position: &[f64; 3]| {
        let normalized = normalization.normalize(DVec3::from_array(position));
        normalized.as_vec3().to_array()
    };
    PointCloud {
        positions: points.positions.iter().map(normalize).collect(),
        colours: points.colours,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_still_camera_takes_its_scale_from_the_points() {
        let centre = DVec3::new(3.0, 4.0, 5.0);
        let points = PointCloud::of_colour(vec![[8.0, 4.0, 5.0]; 3], [0; 3]);
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

    /// Checks that measures of a scene do not change when the scene is moved.
    #[test]
    fn points_far_from_the_origin_are_normalized_as_near_it() {
        let place = |n: usize| DVec3::new((n as f64).sin(), (1.7 * n as f64).cos(), 0.3 * n as f64);
        let of = |offset: DVec3| {
            let centres: Vec<DVec3> = (0..9).map(|n| offset + place(n)).collect();
            let points = PointCloud {
                positions: (0..50)
                    .map(|n| (offset + place(3 * n)).to_array())
                    .collect(),
                colours: vec![[0; 3]; 50],
            };
            let similarity = Similarity::from_cameras(&centres).expect("cameras");
            normalized(points, &similarity)
        };
        let near = of(DVec3::ZERO);
        let far = of(DVec3::new(5e5, 5e6, 0.0));
        for (a, b) in near.positions.iter().zip(&far.positions) {
            let [a, b] = [*a, *b].map(Vec3::from_array);
            assert!(a.distance(b) < 1e-5, "{a} {b}");
        }
    }

    #[test]
    fn the_farthest_camera_decides_where_it_is_asked_to() {
        let mut centres: Vec<DVec3> = (0..20).map(|n| DVec3::X * f64::from(n)).collect();
        let right = Similarity::from_cameras(&centres);
        centres.push(DVec3::Y * 1e5);
        let far = Similarity::from_cameras(&centres);
        assert_eq!(CameraExtent::Most.similarity(&centres), right);
        assert_eq!(CameraExtent::Farthest.similarity(&centres), far);
    }
}
