//! Rays and textured rectangles.
//!
//! ```text
//! tau = n.(c - o) / (n.d)        l = R^T (o + tau d - c)        uv = l_xy / s + 1/2
//! ```
//!
//! The columns of `R` are the rectangle's x, y and normal `n`. A ray hits where `|n.d| >= 1e-6`, `tau > 0`
//! and `uv` is in the unit square: inside is tested in the plane's own coordinates. (The published code
//! tests the box around the corners, which a tilted plane does not fill.) Both sides are seen. Which of
//! two planes is nearer, and whether a plane is hit, have no gradient.

use glam::{DMat3, DVec2, DVec3};

use crate::trajectories::rigid_spline::{PoseGradient, RigidPose};

/// A ray is parallel to a plane below this cosine.
const PARALLEL: f64 = 1e-6;

/// A ray; the direction has unit length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Where it begins.
    pub origin: DVec3,
    /// Where it goes.
    pub direction: DVec3,
}

/// Gradient by a [`Ray`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RayGradient {
    /// By its origin.
    pub origin: DVec3,
    /// By its direction.
    pub direction: DVec3,
}

/// Where a ray meets a rectangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneHit {
    /// Distance along the ray.
    pub distance: f64,
    /// Place on the rectangle, [0, 1] both ways.
    pub uv: DVec2,
    /// The ray's direction in the plane's coordinates.
    pub direction: DVec3,
}

/// Gradient of a hit by what it depends on.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PlaneGradient {
    /// By the pose, through the distance at which the ray meets the plane.
    pub through_distance: PoseGradient,
    /// By the pose where that distance is held, through the place on the rectangle.
    pub through_place: PoseGradient,
    /// By the ray.
    pub ray: RayGradient,
}

impl PlaneGradient {
    /// By the pose.
    pub fn pose(&self) -> PoseGradient {
        let mut whole = self.through_place;
        whole.add(&self.through_distance);
        whole
    }
}

/// The hit of a rectangle of `size` at `pose`; `None` where the ray misses it.
pub fn hit(ray: &Ray, pose: &RigidPose, size: DVec2) -> Option<PlaneHit> {
    let normal = pose.rotation.col(2);
    let slope = normal.dot(ray.direction);
    let distance = normal.dot(pose.centre - ray.origin) / slope;
    // False for NaN too.
    let is_ahead = slope.abs() >= PARALLEL && distance > 0.0;
    if !is_ahead {
        return None;
    }
    let from_centre = ray.origin + distance * ray.direction - pose.centre;
    let to_plane = pose.rotation.transpose();
    let local = to_plane * from_centre;
    let uv = local.truncate() / size + 0.5;
    let is_inside = uv.cmpge(DVec2::ZERO).all() && uv.cmple(DVec2::ONE).all();
    is_inside.then(|| PlaneHit {
        distance,
        uv,
        direction: to_plane * ray.direction,
    })
}

/// Gradients by pose and ray from those by a hit's `uv` and `direction`.
pub fn hit_vjp(
    ray: &Ray,
    pose: &RigidPose,
    size: DVec2,
    hit: &PlaneHit,
    by_uv: DVec2,
    by_direction: DVec3,
) -> PlaneGradient {
    let normal = pose.rotation.col(2);
    let slope = normal.dot(ray.direction);
    let from_centre = ray.origin + hit.distance * ray.direction - pose.centre;
    let by_local = (by_uv / size).extend(0.0);
    let by_point = pose.rotation * by_local;
    let by_distance = ray.direction.dot(by_point);
    let along_normal = by_distance / slope * normal;
    PlaneGradient {
        // tau = n.e/(n.d), e = c - o: by n it is (e - tau d)/(n.d), which is -from_centre/(n.d).
        through_distance: PoseGradient {
            centre: along_normal,
            rotation: outer(-by_distance / slope * from_centre, DVec3::Z),
        },
        through_place: PoseGradient {
            centre: -by_point,
            rotation: outer(from_centre, by_local) + outer(ray.direction, by_direction),
        },
        ray: RayGradient {
            origin: by_point - along_normal,
            direction: hit.distance * (by_point - along_normal) + pose.rotation * by_direction,
        },
    }
}

/// `a b^T`.
pub fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}
