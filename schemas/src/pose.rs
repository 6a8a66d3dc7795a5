//! Camera poses and the similarity that normalizes a scene.

use glam::{DMat3, DQuat, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::statistics::median;

/// Factor of the median distance from the median camera beyond which a camera is far out.
const FAR_MEDIANS: f64 = 20.0;
/// Number of cameras of which one, rounded up, may be a mistake. More far cameras are part of the path: that of a
/// camera that stands for most of a clip and then walks.
const CAMERAS_PER_MISTAKE: usize = 10;
/// Largest invisible rounding of coordinates, in units of a scene's extent.
const UNSEEN_ROUNDING: f64 = 1e-5;
/// Largest deviation of the length of a given quaternion from 1.
const UNIT_TOLERANCE: f64 = 0.01;
/// Number of frames that a warning lists.
const LISTED_FRAMES: usize = 10;

/// Position and rotation of a camera: `x_w = R x_c + centre`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Pose {
    /// Camera-to-world rotation as a quaternion (w, x, y, z).
    pub rotation_wxyz: [f64; 4],
    /// Camera centre in world units.
    pub centre: [f64; 3],
}

impl Pose {
    /// Makes the pose with rotation matrix `camera_to_world` and this centre. The matrix must be a rotation to about
    /// 1e-3; it is orthonormalized.
    ///
    /// Returns `None` for reflections, shears, scales and non-finite entries.
    pub fn from_matrix(camera_to_world: DMat3, centre: DVec3) -> Option<Self> {
        let deviation = camera_to_world * camera_to_world.transpose() - DMat3::IDENTITY;
        let largest = deviation
            .to_cols_array()
            .iter()
            .fold(0.0_f64, |largest, entry| largest.max(entry.abs()));
        // NaN compares false, so it is refused too.
        let is_rotation = largest < 1e-3 && camera_to_world.determinant() > 0.0;
        if !is_rotation || !centre.is_finite() {
            return None;
        }
        let q = DQuat::from_mat3(&camera_to_world).normalize();
        Some(Self::new(q, centre))
    }

    /// Makes the pose with a rotation from the camera to the world, a unit quaternion, and this centre.
    pub fn new(to_world: DQuat, centre: DVec3) -> Self {
        let DQuat { x, y, z, w } = to_world;
        Self {
            rotation_wxyz: [w, x, y, z],
            centre: centre.to_array(),
        }
    }

    /// Returns the camera-to-world rotation. A quaternion that is not of unit length is normalized; a zero or
    /// non-finite one gives `None`.
    pub fn rotation(&self) -> Option<DQuat> {
        let [w, x, y, z] = self.rotation_wxyz;
        let q = DQuat::from_xyzw(x, y, z, w);
        let length = q.length();
        (length.is_finite() && length > 1e-12).then(|| q / length)
    }

    /// Returns the camera centre in world units.
    pub fn centre(&self) -> DVec3 {
        DVec3::from_array(self.centre)
    }

    /// Returns true if the quaternion is of unit length to a hundredth, as it is when printed with three digits. Four
    /// numbers of another meaning mostly are not.
    pub fn is_unit(&self) -> bool {
        let [w, x, y, z] = self.rotation_wxyz;
        let length = DQuat::from_xyzw(x, y, z, w).length();
        (length - 1.0).abs() <= UNIT_TOLERANCE
    }

    /// Returns whether the rotation and the centre can be used.
    pub fn is_valid(&self) -> bool {
        self.rotation().is_some() && self.centre().is_finite()
    }
}

/// Returns the angle between two rotations, radians in `[0, pi]`.
pub fn angle_between(one: DQuat, other: DQuat) -> f64 {
    let difference = one.inverse() * other;
    // The arc tangent keeps small angles, which the arc cosine of a scalar product rounds away.
    2.0 * difference.xyz().length().atan2(difference.w.abs())
}

/// `x_normalized = scale * (x_world - offset)`: recentring and scaling without rotation.
///
/// Scenes are normalized once on load, in f64, and the similarity is undone on export.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Similarity {
    /// World point that becomes the origin.
    pub offset: [f64; 3],
    /// Normalized units per world unit, positive.
    pub scale: f64,
}

impl Similarity {
    /// Makes a similarity from the world point that becomes the origin, and normalized units per world unit.
    pub const fn new(offset: [f64; 3], scale: f64) -> Self {
        Self { offset, scale }
    }

    /// Recentres at the mean camera and scales so that the farthest camera is 1 unit from it.
    ///
    /// The camera radius is at least 1e-9 of the distance of the mean camera from the world's origin (and 1e-12), so
    /// that cameras in one place give a finite scale. Returns `None` without cameras or with non-finite centres.
    pub fn from_cameras(centres: &[DVec3]) -> Option<Self> {
        if centres.is_empty() || centres.iter().any(|centre| !centre.is_finite()) {
            return None;
        }
        let mean = centres.iter().sum::<DVec3>() / centres.len() as f64;
        let radius = centres
            .iter()
            .map(|centre| centre.distance(mean))
            .fold(0.0, f64::max)
            .max(least_radius(mean));
        Some(Self {
            offset: mean.to_array(),
            scale: 1.0 / radius,
        })
    }

    /// Makes [`Similarity::from_cameras`] without the far ones ([`far_cameras`]), as long as these are at most a
    /// tenth of all, rounded up: a few wrong poses do not change it.
    pub fn from_most_cameras(centres: &[DVec3]) -> Option<Self> {
        let far = far_cameras(centres);
        if far.len() > centres.len().div_ceil(CAMERAS_PER_MISTAKE) {
            return Self::from_cameras(centres);
        }
        let kept = centres.iter().enumerate();
        let kept = kept.filter(|(index, _)| far.binary_search(index).is_err());
        let kept: Vec<DVec3> = kept.map(|(_, &centre)| centre).collect();
        Self::from_cameras(&kept)
    }

    /// Recentres at the median of the positions along each axis and scales so that their median distance from it is 1
    /// unit; limited as in [`Similarity::from_cameras`].
    ///
    /// Returns `None` without positions or with non-finite ones.
    pub fn from_median(places: &[DVec3]) -> Option<Self> {
        let (middle, distance) = middle(places)?;
        Some(Self {
            offset: middle.to_array(),
            scale: 1.0 / distance.max(least_radius(middle)),
        })
    }

    /// Returns true where world coordinates around the offset can be kept in 32-bit floats: their rounding there
    /// (`f32::EPSILON` of the offset) is at most 1e-5 of a unit.
    pub fn fits_f32(&self) -> bool {
        let rounding = f64::from(f32::EPSILON) * DVec3::from_array(self.offset).length();
        rounding * self.scale <= UNSEEN_ROUNDING
    }

    /// Converts world to normalized coordinates.
    pub fn normalize(&self, world: DVec3) -> DVec3 {
        self.scale * (world - DVec3::from_array(self.offset))
    }

    /// Converts normalized to world coordinates.
    pub fn restore(&self, normalized: DVec3) -> DVec3 {
        normalized / self.scale + DVec3::from_array(self.offset)
    }
}

/// Returns the cameras that are more than 20 median distances away from the median camera, in rising order: wrong
/// poses, mostly. It is empty where most cameras are in one place, which gives no measure, and with non-finite
/// centres.
pub fn far_cameras(centres: &[DVec3]) -> Vec<usize> {
    let Some((middle, distance)) = middle(centres) else {
        return Vec::new();
    };
    if distance <= least_radius(middle) {
        return Vec::new();
    }
    let is_far = |index: &usize| centres[*index].distance(middle) > FAR_MEDIANS * distance;
    (0..centres.len()).filter(is_far).collect()
}

/// Returns a line that names the frames whose cameras are far out ([`far_cameras`]); `None` without any.
pub fn far_frames(poses: &[Option<Pose>]) -> Option<String> {
    let posed = poses.iter().enumerate();
    let posed = posed.filter_map(|(frame, pose)| Some((frame, pose.filter(Pose::is_valid)?)));
    let (frames, centres): (Vec<usize>, Vec<DVec3>) =
        posed.map(|(frame, pose)| (frame, pose.centre())).unzip();
    let far = far_cameras(&centres);
    if far.is_empty() {
        return None;
    }
    let listed = far.iter().take(LISTED_FRAMES);
    let listed: Vec<String> = listed.map(|&index| frames[index].to_string()).collect();
    let more = far.len() - listed.len();
    Some(format!(
        "the cameras of {} of {} frames are more than {FAR_MEDIANS} times as far from the median camera as \
         the median of all is; their poses may be wrong: frames {}{}",
        far.len(),
        centres.len(),
        listed.join(", "),
        if more > 0 {
            format!(" and {more} more")
        } else {
            String::new()
        }
    ))
}

/// Returns a line where all of several cameras are in one place, up to the rounding of its coordinates, so that no
/// parallax tells distances; `None` elsewhere.
pub fn one_place(poses: &[Option<Pose>]) -> Option<String> {
    let valid = poses.iter().flatten().filter(|pose| pose.is_valid());
    let centres: Vec<DVec3> = valid.map(Pose::centre).collect();
    let (middle, _) = middle(&centres)?;
    let radius = least_radius(middle);
    let is_one = centres
        .iter()
        .all(|centre| centre.distance(middle) <= radius);
    (is_one && centres.len() > 1).then(|| {
        format!(
            "all {} cameras are within {radius:.0e} of one place: methods that need parallax cannot use them",
            centres.len()
        )
    })
}

/// Returns the median of positions along each axis, and their median distance from it; `None` without positions or
/// with non-finite ones.
fn middle(places: &[DVec3]) -> Option<(DVec3, f64)> {
    if places.iter().any(|place| !place.is_finite()) {
        return None;
    }
    let along = |axis: usize| -> Option<f64> {
        let coordinates: Vec<f64> = places.iter().map(|place| place[axis]).collect();
        median(&coordinates)
    };
    let middle = DVec3::new(along(0)?, along(1)?, along(2)?);
    let distances: Vec<f64> = places.iter().map(|place| place.distance(middle)).collect();
    Some((middle, median(&distances)?))
}

/// Returns the radius of cameras or points below which the rounding of world coordinates dominates.
fn least_radius(centre: DVec3) -> f64 {
    (1e-9 * centre.length()).max(1e-12)
}
