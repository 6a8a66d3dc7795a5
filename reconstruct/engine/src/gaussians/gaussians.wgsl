// Activated Gaussians at one instant, the renderer's input. Their harmonics are in a separate array, constant
// first: `(coefficient * 3 + channel)` within a Gaussian.

struct Gaussian {
    // Normalized world units.
    position: vec3<f32>,
    // In (0, 1).
    opacity: f32,
    // Standard deviations along the axes.
    scale: vec3<f32>,
    // Unit quaternion (w, x, y, z), axes to world.
    rotation: vec4<f32>,
}

// Number of coefficients up to a degree, including the constant one.
fn sh_count(degree: u32) -> u32 {
    return (degree + 1u) * (degree + 1u);
}
