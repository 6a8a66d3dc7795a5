//! The scene of `moving_ball.rs` with an operator.

use omnilife_reconstruct::scene::TrainingScene;

use super::moving_ball;

/// Returns the scene: the ball passes in fifteen frames of a second each; the operator is below in every other
/// one.
pub(crate) fn scene() -> TrainingScene {
    let mut scene = moving_ball::scene();
    let [width, height] = scene.camera.size();
    let is_holder = |pixel: usize| pixel / width > height * 5 / 6 && pixel % width > width / 3;
    for view in scene.input_views.iter_mut().step_by(2) {
        view.ignored = Some(
            (0..width * height)
                .map(|at| u8::from(is_holder(at)))
                .collect(),
        );
    }
    scene
}
