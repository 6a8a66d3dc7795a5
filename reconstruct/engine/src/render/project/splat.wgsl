// Footprint of a visible Gaussian: a rectangle around it, and the form of q inside.

// q = (dx - slope dy)^2 inverse_variance + dy^2 inverse_row_variance
const ELLIPSE: u32 = 0u;
// q = N / (l^2 + eps N) with N = (f_1.r)^2 + (f_2.r)^2 and l = max(m.r, 0)
const CONE: u32 = 1u;
// Marks of drawn splats beside their gradients; a splat that is not drawn has 0.
const DRAWN_ELLIPSE: f32 = 1.0;
const DRAWN_CONE: f32 = 2.0;

struct Splat {
    // Centre of the rectangle, pixels; for an ellipse, its own centre.
    centre: vec2<f32>,
    // Half width and half height of the rectangle.
    extent: vec2<f32>,
    // Ellipse: inverse variance of a row, slope, inverse row variance. Cone: f_1.
    first: vec3<f32>,
    // Opacity in (0, 1).
    opacity: f32,
    // Ellipse: variance of a row in x. Cone: f_2.
    second: vec3<f32>,
    // Cone: eps.
    depth_variance: f32,
    // Cone: m.
    third: vec3<f32>,
    shape: u32,
}

// Sort key of a Gaussian that is not drawn, larger than any distance.
const CULLED: u32 = 0xffffffffu;

// Largest q of a footprint.
fn largest_q(opacity: f32) -> f32 {
    return 2.0 * log(opacity / ALPHA_MIN);
}

// Ratio q' of a cone, whose footprint is `N <= q' l^2`. Negative if the footprint is everywhere, because the
// camera itself is inside.
fn largest_ratio(depth_variance: f32, q_max: f32) -> f32 {
    let rest = 1.0 - depth_variance * q_max;
    if rest <= 0.0 {
        return -1.0;
    }
    return q_max / rest;
}
