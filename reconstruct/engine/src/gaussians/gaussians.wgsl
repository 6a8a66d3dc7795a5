// What a renderer sees: activated Gaussians at one instant. Their harmonics stand in an array
// beside them, constant first: `(coefficient * 3 + channel)` within a Gaussian.

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

// Coefficients up to a degree, the constant one included.
fn sh_count(degree: u32) -> u32 {
    return (degree + 1u) * (degree + 1u);
}
