//! Steps on a view whose gain is removed.

use glam::{Mat3, Vec3};
use omnilife_schemas::camera::ErpCamera;

use super::*;
use crate::{
    gaussians::static_gaussians::{self, InitialGaussians, SH_CONSTANT, StaticGaussians},
    parameters::{ParameterTable, adam::SecondMomentDecay},
    step::settings::tests::settings,
    training_view::TrainingView,
};

/// Returns opaque grey Gaussians in all directions.
fn table() -> ParameterTable {
    let place = |index: usize| {
        let y = 1.0 - (index as f32 + 0.5) / 200.0;
        let (sin, cos) = (2.399_963 * index as f32).sin_cos();
        let rho = (1.0 - y * y).sqrt();
        [2.0 * rho * cos, 2.0 * y, 2.0 * rho * sin]
    };
    let grey = InitialGaussians::isotropic(
        (0..400).map(place).collect(),
        &[0.3; 400],
        vec![[0.6; 3]; 400],
        vec![0.95; 400],
    );
    static_gaussians::table(&grey, 0)
}

/// Returns the loss of a step on an image of one level, and true if it changes colours. `None` removes no
/// gain.
fn step(level: u8, gain: Option<f32>) -> (f64, bool) {
    let camera = ErpCamera::new(32, 16);
    let view = TrainingView {
        frame: 0,
        view: View {
            camera: camera.into(),
            rotation: Mat3::IDENTITY,
            centre: Vec3::ZERO,
            time_seconds: 0.0,
        },
        pixels: vec![level; 32 * 16 * 3],
        mask: None,
        ignored: None,
    };
    let views = [view];
    let inputs = InputViews {
        camera: camera.into(),
        views: &views,
    };
    let mut settings = settings(None);
    settings.exposure = gain.and_then(|gain| {
        let at = |seconds: f64, gain: f32| (seconds, vec![[[0.05 * gain; 3], [0.05; 3]]; 60]);
        // Gains are relative to their median, 1.
        Exposure::estimate(&[at(0.0, gain), at(1.0, 1.0), at(2.0, 1.0 / gain)])
    });
    let model = Model::new(vec![Part::new(StaticGaussians, table())]);
    let schedule = StepSchedule {
        iteration: 1,
        learning_rates: model.trained_arrays().iter().map(|_| 0.01).collect(),
        second_moments: SecondMomentDecay::PUBLISHED,
        ..StepSchedule::default()
    };
    let mut stepper = CpuStepper::new(inputs, model, &settings);
    stepper.step(0, &schedule).expect("a finite loss");
    let loss = stepper.take_statistics().expect("on the CPU").loss;
    let colours = &stepper.model.parts[0].table.arrays[SH_CONSTANT].values;
    (loss, *colours != table().arrays[SH_CONSTANT].values)
}

#[test]
fn a_saturated_image_pulls_at_nothing_that_is_as_bright_where_its_gain_is_taken_out() {
    // The scene has at least an eighth of white, the level 0.39, and the render is brighter.
    let (loss, moves) = step(255, Some(8.0));
    assert!(loss < 1e-5 && !moves, "{loss}");
    // The scene has at least eight times white, and the render is darker.
    let (loss, moves) = step(255, Some(0.125));
    assert!(loss > 0.1 && moves, "{loss}");
    for (level, gain) in [(250, Some(8.0)), (0, Some(8.0)), (255, None)] {
        let (loss, moves) = step(level, gain);
        assert!(loss > 0.1 && moves, "{level} {gain:?}: {loss}");
    }
}
