//! Levelling: structure from motion leaves the world's orientation arbitrary.

use glam::{DQuat, DVec3};

use super::colmap::ColmapModel;

/// World up after levelling: the world's y points down, as the cameras' does.
pub const UP: DVec3 = DVec3::NEG_Y;
/// Below this length of the mean of the cameras' unit up vectors they agree on no up.
pub const LEAST_AGREEMENT: f64 = 0.5;

/// What levelling did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Levelling {
    /// Length of the mean of the cameras' unit up vectors, 0 (no common up) to 1 (all the same).
    pub agreement: f64,
    /// Whether the world was turned.
    pub levelled: bool,
}

/// Turns the world so that the mean camera up becomes [`UP`].
///
/// People and stabilizers hold 360-degree cameras upright on average, so the mean up is gravity to
/// a few degrees. Where the cameras tumble it is not, and the world stays as it is.
pub fn level(model: &mut ColmapModel) -> Levelling {
    let sum: DVec3 = model
        .images
        .values()
        .map(|image| image.rotation * DVec3::NEG_Y)
        .sum();
    let agreement = if model.images.is_empty() {
        0.0
    } else {
        sum.length() / model.images.len() as f64
    };
    let levelled = agreement >= LEAST_AGREEMENT;
    if levelled {
        model.rotate_world(DQuat::from_rotation_arc(sum.normalize(), UP));
    }
    Levelling {
        agreement,
        levelled,
    }
}
