//! Intersections of rays with the sphere around the cameras.
//!
//! ```text
//! tau = -b + sqrt(b^2 - c)        b = (o - m).d        c = |o - m|^2 - r^2        n = (o + tau d - m) / r
//! ```
//!
//! From within there is always one hit ahead. If `b > 0` the two terms cancel, and the equivalent
//! `tau = -c / (b + sqrt(b^2 - c))` is used.

use glam::DVec3;

use super::plane::{Ray, RayGradient};

/// A sphere seen from within.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// Centre.
    pub centre: DVec3,
    /// Radius.
    pub radius: f64,
}

/// Intersection of a ray with a sphere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SphereHit {
    /// Distance along the ray.
    pub distance: f64,
    /// Unit direction from the centre.
    pub normal: DVec3,
}

/// Returns the hit of a ray that starts within; `None` for any other.
pub fn hit(ray: &Ray, sphere: &Sphere) -> Option<SphereHit> {
    let from = ray.origin - sphere.centre;
    let b = from.dot(ray.direction);
    let c = from.length_squared() - sphere.radius * sphere.radius;
    let is_within = c < 0.0;
    if !is_within {
        return None;
    }
    let root = (b * b - c).sqrt();
    let distance = if b > 0.0 { -c / (b + root) } else { root - b };
    let normal = (from + distance * ray.direction) / sphere.radius;
    normal.is_finite().then_some(SphereHit { distance, normal })
}

/// Returns the gradient by the ray from that by a hit's normal.
pub fn hit_vjp(ray: &Ray, sphere: &Sphere, hit: &SphereHit, by_normal: DVec3) -> RayGradient {
    let by_point = by_normal / sphere.radius;
    // |p|^2 = r^2 determines tau: n.(do + tau dd + d dtau) = 0.
    let by_distance = ray.direction.dot(by_point);
    let along = by_distance / hit.normal.dot(ray.direction) * hit.normal;
    RayGradient {
        origin: by_point - along,
        direction: hit.distance * (by_point - along),
    }
}
