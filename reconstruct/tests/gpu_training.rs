//! Training on a graphics device against training on the processor.
#![expect(
    clippy::unwrap_used,
    reason = "a device that fails or a test scene that cannot be built is a failed test"
)]

#[path = "support/balls.rs"]
mod balls;
#[path = "support/device.rs"]
mod device;

use std::sync::Arc;

use balls::scene;
use device::{assert_gradients_agree, device};
use omnilife_reconstruct::{
    ReconstructError,
    gaussians::static_gaussians,
    gpu::{Gpu, GpuError, GpuStepper},
    initialize,
    methods::{self, MethodRequest},
    render::RenderSettings,
    scene::TrainingScene,
    train::{
        BackendChoice, Session,
        cpu_step::CpuStepper,
        settings::TrainSettings,
        step::{Model, StepSchedule, Stepper},
    },
};
use omnilife_schemas::{points::PointCloud, progress::Silent, records::Backend};

/// Every fifth point of the scene as a model with harmonics up to a degree. Each Gaussian is turned
/// and longer one way than the other: no gradient vanishes.
fn model(scene: &TrainingScene, sh_degree: usize) -> Model {
    let points = PointCloud {
        positions: scene.points.positions.iter().step_by(5).copied().collect(),
        colours: scene.points.colours.iter().step_by(5).copied().collect(),
    };
    let initial = initialize::from_points(&points, 3.0);
    let mut table = static_gaussians::table(&initial, sh_degree);
    for (array, offset) in [
        (static_gaussians::LOG_SCALES, 0.4_f32),
        (static_gaussians::QUATERNIONS, 0.5),
    ] {
        for (index, value) in table.arrays[array].values.iter_mut().enumerate() {
            *value += offset * (1.7 * index as f32).sin();
        }
    }
    Model::new(table)
}

fn on_device<'a>(gpu: &Arc<Gpu>, scene: &'a TrainingScene, model: Model) -> GpuStepper<'a> {
    GpuStepper::new(
        Arc::clone(gpu),
        scene,
        model,
        RenderSettings::new(0.01),
        0.2,
    )
    .unwrap()
}

fn schedule(iteration: u64, sh_degree: usize, rates: &[f32]) -> StepSchedule {
    StepSchedule {
        iteration,
        sh_degree,
        learning_rates: rates.to_vec(),
        ..StepSchedule::default()
    }
}

const RATES: [f32; 6] = [2e-3, 5e-3, 1e-3, 0.05, 2.5e-3, 1.25e-4];

#[test]
fn steps_are_those_of_the_processor() {
    let Some(gpu) = device() else { return };
    let scene = scene();
    let settings = TrainSettings {
        rendering: RenderSettings::new(0.01),
        ssim_weight: 0.2,
        ..methods::odgs::published_settings(100)
    };
    let mut on_gpu = on_device(&gpu, &scene, model(&scene, 1));
    let mut on_cpu = CpuStepper::new(&scene, model(&scene, 1), &settings);
    assert!(matches!(on_gpu.backend(), Backend::Gpu { .. }));
    for iteration in 1..=3 {
        let schedule = schedule(iteration, 1, &RATES);
        on_gpu.step(iteration as usize, &schedule).unwrap();
        on_cpu.step(iteration as usize, &schedule).unwrap();
        if iteration == 1 {
            let (of_gpu, of_cpu) = (on_gpu.model().unwrap(), on_cpu.model().unwrap());
            for (gpu, cpu) in of_gpu.table.arrays.iter().zip(&of_cpu.table.arrays) {
                assert_gradients_agree(gpu.name, &gpu.gradients, &cpu.gradients);
                assert_gradients_agree(gpu.name, &gpu.first_moments, &cpu.first_moments);
            }
            let (of_gpu, of_cpu) = (&of_gpu.statistics, &of_cpu.statistics);
            assert_eq!(of_gpu.views, of_cpu.views);
            assert_gradients_agree("statistics", &of_gpu.sums, &of_cpu.sums);
        }
    }
    let (of_gpu, of_cpu) = (on_gpu.take_sums().unwrap(), on_cpu.take_sums().unwrap());
    assert_eq!((of_gpu.steps, of_cpu.steps), (3, 3));
    for (gpu, cpu) in [
        (of_gpu.loss, of_cpu.loss),
        (of_gpu.squared_error, of_cpu.squared_error),
    ] {
        assert!((gpu - cpu).abs() < 1e-3 * cpu, "{gpu} against {cpu}");
    }
    assert_eq!(of_gpu.refused, [0; 6]);
    let view = &scene.novel_views[0].view;
    let (gpu, cpu) = (
        on_gpu.image(view, 1).unwrap(),
        on_cpu.image(view, 1).unwrap(),
    );
    // Where a gradient is next to nothing, Adam's first steps go one way here, the other there.
    let error: f32 = gpu
        .data
        .iter()
        .zip(&cpu.data)
        .map(|(a, b)| (a - b).abs())
        .sum();
    assert!(error < 1e-3 * gpu.data.len() as f32, "{error}");
}

#[test]
fn a_method_learns_as_on_the_processor() {
    if device().is_none() {
        return;
    }
    let scene = scene();
    let train = |backend| {
        let session = Session {
            backend,
            ..Session::without_files(&Silent)
        };
        let request = MethodRequest {
            maximum_gaussians: Some(180),
            ..MethodRequest::new(20, 7)
        };
        let outcome = methods::find("odgs")
            .unwrap()
            .train(&scene, &request, &session)
            .unwrap();
        let trace = &outcome.trained.state.trace;
        let (first, last) = (trace.first().unwrap(), trace.last().unwrap());
        (
            outcome.trained.stepper.backend(),
            first.train_loss,
            last.clone(),
        )
    };
    let (backend, _, on_cpu) = train(BackendChoice::Cpu);
    assert!(matches!(backend, Backend::Cpu { .. }));
    let (backend, first_loss, on_gpu) = train(BackendChoice::Gpu);
    let Backend::Gpu {
        adapter, limits, ..
    } = backend
    else {
        panic!("the run was made by {backend:?}");
    };
    assert!(!adapter.is_empty() && limits["max_buffer_size"] > 0);
    assert_eq!(on_gpu.iteration, 20);
    assert!(on_gpu.train_loss < 0.9 * first_loss);
    let (gpu, cpu) = (on_gpu.novel_psnr_db.unwrap(), on_cpu.novel_psnr_db.unwrap());
    assert!((gpu - cpu).abs() < 0.3, "{gpu} against {cpu} dB");
}

/// A step without room for its tile entries, and the steps behind it, are done again: the model is
/// to the last bit what it is where there was room from the beginning.
#[test]
fn steps_that_found_no_room_are_done_again() {
    let Some(gpu) = device() else { return };
    let scene = scene();
    // Wide footprints: more entries than there is room for at first.
    let wide = || {
        let mut model = model(&scene, 0);
        for value in &mut model.table.arrays[static_gaussians::LOG_SCALES].values {
            *value = 2.4_f32.ln();
        }
        model
    };
    let run = |renders_first: bool| {
        let mut stepper = on_device(&gpu, &scene, wide());
        let entries_at_first = stepper.room_for_entries();
        if renders_first {
            for view in &scene.input_views {
                stepper.image(&view.view, 0).unwrap();
            }
        }
        for iteration in 1..=4 {
            let schedule = schedule(iteration, 0, &RATES[..5]);
            stepper.step(iteration as usize, &schedule).unwrap();
        }
        let sums = stepper.take_sums().unwrap();
        assert!(stepper.room_for_entries() > entries_at_first);
        (stepper.model().unwrap().clone(), sums)
    };
    let (surprised, prepared) = (run(false), run(true));
    assert_eq!(surprised.1.steps, 4);
    assert!(surprised == prepared);
}

#[test]
fn a_lost_device_ends_a_run_and_leaves_no_old_model() {
    let Some(gpu) = device() else { return };
    let scene = scene();
    let mut stepper = on_device(&gpu, &scene, model(&scene, 0));
    stepper.step(0, &schedule(1, 0, &RATES[..5])).unwrap();
    gpu.destroy();
    let lost = |error: ReconstructError| match error {
        ReconstructError::Gpu(error) => error,
        other => panic!("{other}"),
    };
    let error = lost(stepper.take_sums().unwrap_err());
    assert!(matches!(error, GpuError::Lost { .. }), "{error}");
    lost(stepper.model().map(drop).unwrap_err());
    lost(stepper.step(0, &schedule(2, 0, &RATES[..5])).unwrap_err());
}

#[test]
fn a_loss_that_is_not_finite_ends_a_run_with_its_iteration() {
    let Some(gpu) = device() else { return };
    let scene = scene();
    let settings = RenderSettings {
        background: [f32::NAN; 3],
        ..RenderSettings::new(0.01)
    };
    let mut stepper = GpuStepper::new(gpu, &scene, model(&scene, 0), settings, 0.2).unwrap();
    for iteration in 1..=3 {
        stepper
            .step(0, &schedule(iteration, 0, &RATES[..5]))
            .unwrap();
    }
    let message = stepper.take_sums().unwrap_err().to_string();
    assert!(message.contains("iteration 1"), "{message}");
}
