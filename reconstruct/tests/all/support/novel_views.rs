//! Quality of the novel views of a trained model.

use omnilife_reconstruct::{methods::MethodOutcome, scene::TrainingScene};

/// Returns the mean PSNR of the rendered novel views, dB, outside of ignored regions.
pub(crate) fn novel_psnr(outcome: &mut MethodOutcome<'_>, scene: &TrainingScene) -> f64 {
    let mut target = Vec::new();
    let scores = scene.novel_views.iter().map(|view| {
        let image = outcome.learner.image(&view.view).unwrap();
        view.write_image(&mut target);
        let pairs = image.data.iter().zip(&target).enumerate();
        let counted = pairs.filter(|(value, _)| view.shows_scene(value / 3));
        let squares: f64 = counted.map(|(_, (a, b))| f64::from(a - b).powi(2)).sum();
        -10.0 * (squares / (3 * view.counted_pixels()) as f64).log10()
    });
    scores.sum::<f64>() / scene.novel_views.len() as f64
}
