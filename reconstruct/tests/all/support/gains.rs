//! Gains of a camera.

use omnilife_engine::training_view::TrainingView;
use omnilife_schemas::srgb;

/// Multiplies the light of an image by a gain.
pub(crate) fn brighten(view: &mut TrainingView, gain: f64) {
    for value in &mut view.pixels {
        let level = srgb::brightened(f32::from(*value) / 255.0, gain as f32);
        *value = (255.0 * level.min(1.0)).round() as u8;
    }
}
