//! Compositing of a ray's layers, nearest first.
//!
//! ```text
//! C = sum_i T_i a_i c_i        T_i = prod_{j<i} (1 - a_j)
//! dC/dc_i = T_i a_i            dC/da_i = T_i (c_i - B_i)        B_{i-1} = a_i c_i + (1 - a_i) B_i
//! ```
//!
//! `B_i` is the colour behind layer `i`, 0 behind the last. The gradient contains no division, so that it
//! holds for opaque layers.

use glam::DVec3;

/// One layer of a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Layer {
    /// Distance along the ray.
    pub distance: f64,
    /// Index of the surface; of layers at equal distance, the smaller index is in front.
    pub surface: usize,
    /// Its colour.
    pub colour: DVec3,
    /// Its opacity, in [0, 1].
    pub opacity: f64,
}

/// Gradient by a layer.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LayerGradient {
    /// Gradient by the colour.
    pub colour: DVec3,
    /// Gradient by the opacity.
    pub opacity: f64,
}

/// Sorts layers, nearest first, and those of equal distance by the index of their surface.
pub fn sort(layers: &mut [Layer]) {
    layers.sort_by(|a, b| {
        a.distance
            .total_cmp(&b.distance)
            .then(a.surface.cmp(&b.surface))
    });
}

/// Returns the colour of sorted layers.
pub fn compose(layers: &[Layer]) -> DVec3 {
    let (mut colour, mut transmittance) = (DVec3::ZERO, 1.0);
    for layer in layers {
        colour += transmittance * layer.opacity * layer.colour;
        transmittance *= 1.0 - layer.opacity;
    }
    colour
}

/// Computes gradients by sorted layers from that by their colour.
pub fn compose_vjp(layers: &[Layer], upstream: DVec3, gradients: &mut Vec<LayerGradient>) {
    gradients.clear();
    let mut transmittance = 1.0;
    for layer in layers {
        // The gradient by the opacity needs the colour behind, and is set later.
        gradients.push(LayerGradient {
            colour: transmittance * layer.opacity * upstream,
            opacity: transmittance,
        });
        transmittance *= 1.0 - layer.opacity;
    }
    let mut behind = DVec3::ZERO;
    for (layer, gradient) in layers.iter().zip(gradients.iter_mut()).rev() {
        gradient.opacity *= upstream.dot(layer.colour - behind);
        behind = layer.opacity * layer.colour + (1.0 - layer.opacity) * behind;
    }
}
