//! View angle of a plane: the rotation vector from its normal to the ray.
//!
//! ```text
//! phi = theta/s (-y, x)        s = hypot(x, y)        theta = atan2(s, z)
//! ```
//!
//! `x, y, z` are the ray's unit direction in the plane's coordinates; the third component of `phi` is 0. At
//! `s = 0`, `phi` is set to 0, even for a ray against the normal, where any axis would do. (The published
//! code sets 0 there for some axes only.)

use glam::{DVec2, DVec3};

const STRAIGHT: f64 = 1e-7;

/// Returns the two components in the plane, radians.
pub fn view_angle(direction: DVec3) -> DVec2 {
    let across = direction.truncate().length();
    if across < STRAIGHT {
        return DVec2::ZERO;
    }
    across.atan2(direction.z) / across * DVec2::new(-direction.y, direction.x)
}

/// Returns the gradient by the direction from that by the angle.
pub fn view_angle_vjp(direction: DVec3, upstream: DVec2) -> DVec3 {
    let across = direction.truncate().length();
    let turned = DVec2::new(upstream.y, -upstream.x);
    if across < STRAIGHT {
        let factor = if direction.z > 0.0 { 1.0 } else { 0.0 };
        return (factor * turned).extend(0.0);
    }
    let theta = across.atan2(direction.z);
    let square = across * across + direction.z * direction.z;
    let factor = theta / across;
    let by_factor = upstream.dot(DVec2::new(-direction.y, direction.x));
    let by_theta = by_factor / across;
    let by_across = by_theta * direction.z / square - by_factor * factor / across;
    let in_plane = factor * turned + by_across / across * direction.truncate();
    in_plane.extend(-by_theta * across / square)
}
