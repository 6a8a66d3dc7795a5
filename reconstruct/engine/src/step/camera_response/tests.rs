//! Steps that learn a camera beside a scene as it is.

use glam::{Mat3, Vec3};
use omnilife_schemas::{camera::ErpCamera, srgb};

use super::*;
use crate::{
    EngineError,
    camera::View,
    gaussians::static_gaussians::{self, InitialGaussians, SH_CONSTANT},
    model::camera_response::CameraResponse,
    parameters::adam::SecondMomentDecay,
    step::{
        Stepper, check_gpu,
        cpu::CpuStepper,
        settings::{TrainSettings, tests::settings},
    },
    training_view::{InputViews, TrainingView},
};

const CAMERA: ErpCamera = ErpCamera {
    width: 32,
    height: 16,
};

/// Returns opaque Gaussians in all directions, with a response of the camera for views a second apart.
fn model(views: usize, colour: impl Fn(usize) -> [f32; 3]) -> Model {
    let place = |index: usize| {
        let y = 1.0 - (index as f32 + 0.5) / 200.0;
        let (sin, cos) = (2.399_963 * index as f32).sin_cos();
        let rho = (1.0 - y * y).sqrt();
        [2.0 * rho * cos, 2.0 * y, 2.0 * rho * sin]
    };
    let gaussians = InitialGaussians::isotropic(
        (0..400).map(place).collect(),
        &[0.3; 400],
        (0..400).map(colour).collect(),
        vec![0.95; 400],
    );
    let mut model = Model::of_static(static_gaussians::table(&gaussians, 0));
    let times = (0..views).map(|view| view as f64).collect();
    model.response = Some(CameraResponse::new(times, &CAMERA.into(), None));
    model
}

fn view(number: usize) -> View {
    View {
        camera: CAMERA.into(),
        rotation: Mat3::IDENTITY,
        centre: Vec3::ZERO,
        time_seconds: number as f64,
    }
}

fn training_view(number: usize, pixels: Vec<u8>) -> TrainingView {
    TrainingView {
        frame: number as u32,
        view: view(number),
        pixels,
        mask: None,
        ignored: None,
    }
}

fn with_response(begin_iteration: u64) -> TrainSettings {
    TrainSettings {
        response: Some(ResponseSettings {
            begin_iteration,
            learnt: None,
        }),
        ..settings(None)
    }
}

fn inputs(views: &[TrainingView]) -> InputViews<'_> {
    InputViews {
        camera: CAMERA.into(),
        views,
    }
}

/// Returns the schedule of a step that moves gains and the curve alone.
fn schedule(stepper: &CpuStepper<'_>, iteration: u64, rate: f32) -> StepSchedule {
    let of_response = |array: &TrainedArray| [CAMERA_GAINS, CAMERA_CURVE].contains(&array.name);
    let rates = stepper
        .arrays()
        .into_iter()
        .map(|array| if of_response(&array) { rate } else { 0.0 });
    StepSchedule {
        iteration,
        scheduled: iteration,
        learning_rates: rates.collect(),
        second_moments: SecondMomentDecay::PUBLISHED,
        ..StepSchedule::default()
    }
}

#[test]
fn gains_of_known_images_are_learnt_beside_their_scene() {
    let colour = |index: usize| [0.15, 0.3, 0.45].map(|level| level + 0.001 * index as f32);
    let logs = [-0.3_f32, 0.2, 0.1];
    let of_none = inputs(&[]);
    let mut truth = CpuStepper::new(of_none, model(3, colour), &with_response(0));
    let scene = truth.image(&view(0), 0).expect("on the CPU").data;
    let byte =
        |level: f32, log: f32| (255.0 * srgb::brightened(level, log.exp()).min(1.0)).round() as u8;
    let views = [0, 1, 2].map(|number| {
        let pixels = scene.iter().map(|&level| byte(level, logs[number]));
        training_view(number, pixels.collect())
    });
    let begin = model(3, colour);
    let mut stepper = CpuStepper::new(inputs(&views), begin.clone(), &with_response(4));
    let steps = 240;
    for number in 0..steps {
        let fall = 0.01_f32.powf(number as f32 / steps as f32);
        let schedule = schedule(&stepper, number + 1, 0.05 * fall);
        stepper
            .step(number as usize % 3, &schedule)
            .expect("a finite loss");
        let moves = stepper.model.response != begin.response;
        assert_eq!(moves, number >= 3, "{number}");
    }
    assert!(
        stepper.model.parts[0].table.arrays[SH_CONSTANT].values
            == begin.parts[0].table.arrays[SH_CONSTANT].values
    );
    let learnt = stepper
        .model
        .response
        .as_ref()
        .and_then(CameraResponse::learnt);
    let learnt = learnt.expect("three views");
    for (number, log) in logs.into_iter().enumerate() {
        for gain in learnt.gains.gain(number as f64) {
            assert!((gain / log.exp() - 1.0).abs() < 0.03, "{number}: {gain}");
        }
    }
    // A moment between the first two has a gain between theirs, the first image its own.
    for (seconds, log) in [(0.0, -0.3), (0.5, -0.05)] {
        let shown = View {
            time_seconds: seconds,
            ..view(0)
        };
        let shown = stepper.image(&shown, 0).expect("on the CPU").data;
        for (found, &level) in shown.iter().zip(&scene) {
            let expected = f32::from(byte(level, log)) / 255.0;
            assert!(
                (found - expected).abs() < 0.01,
                "{seconds}: {found} {expected}"
            );
        }
    }
}

#[test]
fn a_saturated_image_pulls_at_nothing_that_is_shown_as_bright() {
    let white = [training_view(0, vec![255; 32 * 16 * 3])];
    // Where it covers a pixel, the grey is shown at 1.6 times white, and below white.
    for (log, is_settled) in [(2.2, true), (-0.2, false)] {
        let mut begin = model(1, |_| [0.6; 3]);
        if let Some(response) = &mut begin.response {
            response.gains.arrays[0].values = vec![log; 3];
        }
        let mut stepper = CpuStepper::new(inputs(&white), begin, &with_response(0));
        let schedule = schedule(&stepper, 1, 0.01);
        stepper.step(0, &schedule).expect("a finite loss");
        let loss = stepper.take_statistics().expect("on the CPU").loss;
        let by_colours = &stepper.model.parts[0].table.arrays[SH_CONSTANT].gradients;
        assert_eq!(by_colours.iter().all(|&by| by == 0.0), is_settled);
        assert_eq!(loss < 1e-5, is_settled, "{loss}");
    }
}

#[test]
fn gaussians_get_the_gradient_of_what_is_shown() {
    let black = [training_view(0, vec![0; 32 * 16 * 3])];
    // Returns the loss of a scene whose red is shifted, and its gradient by the shift.
    let loss = |shift: f32| {
        let mut begin = model(1, |index| [0.3 + 0.001 * index as f32; 3]);
        let colours = &mut begin.parts[0].table.arrays[SH_CONSTANT].values;
        for colour in colours.as_chunks_mut::<3>().0 {
            colour[0] += shift;
        }
        if let Some(response) = &mut begin.response {
            response.gains.arrays[0].values = vec![0.4, -0.3, 0.2];
            response.shared.array.values = vec![0.3, -0.2];
        }
        let mut stepper = CpuStepper::new(inputs(&black), begin, &with_response(0));
        let schedule = schedule(&stepper, 1, 0.0);
        stepper.step(0, &schedule).expect("a finite loss");
        let by_colours = &stepper.model.parts[0].table.arrays[SH_CONSTANT].gradients;
        let by_shift: f64 = by_colours.iter().step_by(3).map(|&by| f64::from(by)).sum();
        (
            stepper.take_statistics().expect("on the CPU").loss,
            by_shift,
        )
    };
    let step = 0.01;
    let expected = (loss(step).0 - loss(-step).0) / (2.0 * f64::from(step));
    let found = loss(0.0).1;
    assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
}

#[test]
fn a_gpu_is_refused() {
    let refused = check_gpu(&with_response(0));
    assert!(
        matches!(refused, Err(EngineError::Backend { .. })),
        "{refused:?}"
    );
    assert!(check_gpu(&settings(None)).is_ok());
}
