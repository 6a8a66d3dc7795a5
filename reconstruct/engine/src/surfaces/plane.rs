//! Intersections of rays with textured rectangles.
//!
//! ```text
//! tau = n.(c - o) / (n.d)        l = R^T (o + tau d - c)        uv = l_xy / s + 1/2
//! ```
//!
//! The columns of `R` are the rectangle's x, y and normal `n`. A ray hits if `|n.d| >= 1e-6`, `tau > 0` and
//! `uv` is in the unit square. The published code tests the axis-aligned box of the corners instead, which a
//! tilted plane does not fill. Both sides are visible. The order of two planes, and the existence of a hit,
//! have no gradient.

use glam::{DMat3, DVec2, DVec3};

use crate::trajectories::rigid_spline::{PoseGradient, RigidPose};

/// Cosine below which a ray is parallel to a plane.
const PARALLEL: f64 = 1e-6;

/// A ray; the direction has unit length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Starting point.
    pub origin: DVec3,
    /// Unit direction.
    pub direction: DVec3,
}

/// Gradient by a [`Ray`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RayGradient {
    /// Gradient by the origin.
    pub origin: DVec3,
    /// Gradient by the direction.
    pub direction: DVec3,
}

/// Intersection of a ray with a rectangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneHit {
    /// Distance along the ray.
    pub distance: f64,
    /// Position on the rectangle, [0, 1] both ways.
    pub uv: DVec2,
    /// The ray's direction in the plane's coordinates.
    pub direction: DVec3,
}

/// Gradient of a hit by pose and ray.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PlaneGradient {
    /// Gradient by the pose, through the distance at which the ray meets the plane.
    pub through_distance: PoseGradient,
    /// Gradient by the pose at a fixed distance, through the position on the rectangle.
    pub through_place: PoseGradient,
    /// Gradient by the ray.
    pub ray: RayGradient,
}

impl PlaneGradient {
    /// Returns the total gradient by the pose.
    pub fn pose(&self) -> PoseGradient {
        let mut whole = self.through_place;
        whole.add(&self.through_distance);
        whole
    }
}

/// Returns the hit of a rectangle of `size` at `pose`; `None` if the ray misses it.
pub fn hit(ray: &Ray, pose: &RigidPose, size: DVec2) -> Option<PlaneHit> {
    let normal = pose.rotation.col(2);
    let slope = normal.dot(ray.direction);
    let distance = normal.dot(pose.centre - ray.origin) / slope;
    // Also false for NaN.
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

/// Returns gradients by pose and ray from those by a hit's `uv` and `direction`.
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

/// Returns `a b^T`.
pub fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}
