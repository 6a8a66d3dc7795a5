//! The balls of `balls.rs` with a red one that passes in front of them, and masks of it.

use glam::{DVec2, Vec3};
use omnilife_engine::training_view::TrainingView;
use omnilife_reconstruct::scene::TrainingScene;
use omnilife_schemas::camera::CameraModel;

use super::balls;

/// Radius of the ball.
const RADIUS: f32 = 0.7;
/// Its centre in the middle of the clip.
const MIDDLE: Vec3 = Vec3::new(0.0, 0.2, 3.0);
/// Motion from frame to frame.
const STEP: Vec3 = Vec3::new(0.1, 0.0, 0.0);
const COLOUR: [u8; 3] = [230, 20, 20];

pub(crate) fn scene() -> TrainingScene {
    let mut scene = balls::scene();
    let camera = scene.camera;
    for view in scene.input_views.iter_mut().chain(&mut scene.novel_views) {
        let centre = MIDDLE + STEP * (view.frame as f32 - 7.0);
        paint(view, camera, centre);
    }
    scene
}

/// Draws a ball onto the image, and its mask.
fn paint(view: &mut TrainingView, camera: omnilife_schemas::camera::Camera, centre: Vec3) {
    let width = camera.width() as usize;
    let to_centre = view.view.rotation * (centre - view.view.centre);
    let cosine = (1.0 - (RADIUS / to_centre.length()).powi(2)).sqrt();
    let mut mask = vec![0; view.pixels.len() / 3];
    for (pixel, mask) in mask.iter_mut().enumerate() {
        let at = DVec2::new((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
        if camera.unproject(at).as_vec3().dot(to_centre.normalize()) > cosine {
            *mask = 255;
            view.pixels[3 * pixel..3 * pixel + 3].copy_from_slice(&COLOUR);
        }
    }
    view.mask = Some(mask);
}
