//! Training steps on a GPU against those on the CPU; resumed and failed training.

use std::sync::Arc;

use balls::{scene, table, vary_shapes};
use device::{assert_gradients_agree, assert_images_agree, device, devices};
use omnilife_engine::{
    EngineError,
    camera::View,
    density::DensifySettings,
    device::{BufferDemand, Gpu, GpuError, PixelSums},
    gaussians::{
        deformable::{Deformable, DeformationModel, settings::DeformationSettings},
        static_gaussians::{self, InitialGaussians, StaticGaussians},
    },
    model::{Model, Part},
    parameters::ParameterTable,
    render::settings::RenderSettings,
    schedule::StepSchedule,
    step::{
        Stepper,
        cpu::CpuStepper,
        gpu::{GpuStepper, memory},
        settings::TrainSettings,
    },
};
use omnilife_reconstruct::{
    baseline, methods,
    options::Options,
    request::{BackendChoice, MethodRequest},
    scene::TrainingScene,
};
use omnilife_schemas::{camera::ErpCamera, records::Backend};

use crate::{
    object_graph,
    support::{balls, device},
};

/// Returns every fifth point of the scene as a model with harmonics up to a degree.
fn model(scene: &TrainingScene, sh_degree: usize) -> Model {
    Model::of_static(table(scene, sh_degree))
}

fn on_device<'a>(gpu: &Arc<Gpu>, scene: &'a TrainingScene, model: Model) -> GpuStepper<'a> {
    GpuStepper::new(Arc::clone(gpu), scene.inputs(), model, &settings()).unwrap()
}

fn settings() -> TrainSettings {
    TrainSettings {
        rendering: RenderSettings::new(0.01),
        ssim_weight: 0.2,
        ..baseline::published_settings(100)
    }
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
fn steps_are_those_of_the_cpu() {
    devices().iter().for_each(compare_steps);
}

fn compare_steps(gpu: &Arc<Gpu>) {
    let scene = scene();
    let mut on_gpu = on_device(gpu, &scene, model(&scene, 1));
    let mut on_cpu = CpuStepper::new(scene.inputs(), model(&scene, 1), &settings());
    let Backend::Gpu {
        subgroup_size,
        sums_per_splat,
        ..
    } = on_gpu.backend()
    else {
        panic!("another backend");
    };
    assert_eq!(subgroup_size, gpu.subgroup_size());
    assert_eq!(sums_per_splat, gpu.pixel_sums() == PixelSums::Splats);
    for iteration in 1..=3 {
        let schedule = schedule(iteration, 1, &RATES);
        on_gpu.step(iteration as usize, &schedule).unwrap();
        on_cpu.step(iteration as usize, &schedule).unwrap();
        if iteration == 1 {
            let of_gpu = on_gpu.model_with_gradients().unwrap();
            let of_cpu = on_cpu.model().unwrap();
            for (gpu, cpu) in of_gpu.parts[0]
                .table
                .arrays
                .iter()
                .zip(&of_cpu.parts[0].table.arrays)
            {
                assert_gradients_agree(gpu.name, &gpu.gradients, &cpu.gradients);
                assert_gradients_agree(gpu.name, &gpu.first_moments, &cpu.first_moments);
            }
            let (of_gpu, of_cpu) = (&of_gpu.parts[0].statistics, &of_cpu.parts[0].statistics);
            assert_eq!(of_gpu.views, of_cpu.views);
            assert_gradients_agree("statistics", &of_gpu.sums, &of_cpu.sums);
        }
    }
    let (of_gpu, of_cpu) = (
        on_gpu.take_statistics().unwrap(),
        on_cpu.take_statistics().unwrap(),
    );
    assert_eq!((of_gpu.steps, of_cpu.steps), (3, 3));
    for (gpu, cpu) in [
        (of_gpu.loss, of_cpu.loss),
        (of_gpu.squared_error, of_cpu.squared_error),
    ] {
        assert!((gpu - cpu).abs() < 1e-5 * cpu, "{gpu} against {cpu}");
    }
    assert_eq!(of_gpu.refused, [0; 6]);
    let view = &scene.novel_views[0].view;
    let (gpu, cpu) = (
        on_gpu.image(view, 1).unwrap(),
        on_cpu.image(view, 1).unwrap(),
    );
    assert_images_agree(&gpu, &cpu);
}

/// Returns a network that takes part from the second step on, with an output other than 0 from the start.
fn deformation(scene: &TrainingScene) -> Deformable {
    let model = DeformationModel {
        depth: 3,
        width: 70,
        skip_after: 1,
        ..DeformationModel::published(3.0)
    };
    let settings = DeformationSettings {
        clock: scene.clock().unwrap(),
        model,
        warm_up_iterations: 1,
        time_noise: None,
    };
    let mut weights = model.network().initial_weights(5);
    let heads = model.network().layers()[3].hidden_weights().start;
    for (index, weight) in weights[heads..].iter_mut().enumerate() {
        *weight = 0.02 * (2.3 * index as f32).sin();
    }
    Deformable::new(settings, weights)
}

/// Returns static Gaussians before those of another part.
fn spiral() -> ParameterTable {
    let place = |index: usize| {
        let angle = 0.7 * index as f32;
        [2.5 * angle.cos(), 0.1 * angle - 0.6, 2.5 * angle.sin()]
    };
    let places = (0..20).map(place).collect();
    let initial =
        InitialGaussians::isotropic(places, &[0.3; 20], vec![[0.2, 0.7, 0.4]; 20], vec![0.5; 20]);
    let mut table = static_gaussians::table(&initial, 1);
    vary_shapes(&mut table);
    table
}

#[test]
fn steps_with_a_network_are_those_of_the_cpu() {
    let Some(gpu) = device() else { return };
    let scene = scene();
    let settings = settings();
    let deformed = || {
        Model::new(vec![
            Part::new(StaticGaussians, spiral()),
            Part::new(deformation(&scene), table(&scene, 1)),
        ])
    };
    let mut on_gpu =
        GpuStepper::new(Arc::clone(&gpu), scene.inputs(), deformed(), &settings).unwrap();
    let mut on_cpu = CpuStepper::new(scene.inputs(), deformed(), &settings);
    let rates = [&RATES[..], &[1e-3]].concat();
    for iteration in 1..=4 {
        let schedule = StepSchedule {
            scheduled: iteration,
            ..schedule(iteration, 1, &rates)
        };
        on_gpu.step(iteration as usize, &schedule).unwrap();
        on_cpu.step(iteration as usize, &schedule).unwrap();
        let of_gpu = on_gpu.model_with_gradients().unwrap();
        let of_cpu = on_cpu.model().unwrap();
        let networks =
            [of_gpu, of_cpu].map(|model| model.parts[1].parameterization.shared().unwrap());
        assert_eq!(networks.map(|network| network.steps), [iteration - 1; 2]);
        if iteration == 2 {
            for (gpu, cpu) in of_gpu.parts.iter().zip(&of_cpu.parts) {
                for (gpu, cpu) in gpu.table.arrays.iter().zip(&cpu.table.arrays) {
                    assert_gradients_agree(gpu.name, &gpu.gradients, &cpu.gradients);
                }
            }
            let [gpu, cpu] = networks.map(|network| &network.array);
            assert_gradients_agree(gpu.name, &gpu.gradients, &cpu.gradients);
            assert_gradients_agree(gpu.name, &gpu.first_moments, &cpu.first_moments);
        }
    }
    assert!(matches!(on_gpu.backend(), Backend::Gpu { .. }));
    assert_eq!(on_gpu.take_statistics().unwrap().refused, [0; 7]);
    let view = &scene.novel_views[0].view;
    let small = View {
        camera: ErpCamera::new(32, 16).into(),
        ..*view
    };
    for view in [view, &small] {
        let images = (
            on_gpu.image(view, 1).unwrap(),
            on_cpu.image(view, 1).unwrap(),
        );
        assert_images_agree(&images.0, &images.1);
    }
}

/// Checks steps of the object graph, in which objects leave out some views and their poses are refined.
#[test]
fn steps_with_objects_are_those_of_the_cpu() {
    let Some(gpu) = device() else { return };
    let scene = object_graph::scene();
    let request = MethodRequest {
        with: vec!["object-poses".to_owned()],
        // Points between others have distances alike, and the last bit decides which is drawn first.
        without: ["view-dependent-colour", "denser-points"]
            .map(str::to_owned)
            .to_vec(),
        options: Options::at_most(400),
        ..MethodRequest::new(100, 3)
    };
    let method = methods::find("object-graph").unwrap();
    let mut prepared = method
        .prepare(&scene, &request, BackendChoice::Cpu)
        .unwrap();
    let mut begin = prepared.learner.gaussians().unwrap().unwrap().clone();
    begin
        .parts
        .iter_mut()
        .for_each(|part| vary_shapes(&mut part.table));
    // On a grid, many have one distance, and the last bit decides which is drawn first.
    let centres = begin.parts[1].table.arrays[static_gaussians::POSITIONS]
        .values
        .iter_mut();
    for (index, value) in centres.enumerate() {
        *value += 0.03 * (12.9898 * index as f32).sin();
    }
    let arrays = begin.trained_arrays();
    let rates: Vec<f32> = arrays.iter().map(|_| 1e-3).collect();
    let settings = settings();
    let mut on_gpu = GpuStepper::new(gpu, scene.inputs(), begin.clone(), &settings).unwrap();
    let mut on_cpu = CpuStepper::new(scene.inputs(), begin, &settings);
    assert_eq!((on_gpu.objects(), on_cpu.objects()), (Some(1), Some(1)));
    for iteration in 1..=4 {
        let schedule = StepSchedule {
            scheduled: iteration,
            ..schedule(iteration, 0, &rates)
        };
        on_gpu.step(2 * iteration as usize, &schedule).unwrap();
        on_cpu.step(2 * iteration as usize, &schedule).unwrap();
        let of_gpu = on_gpu.model_with_gradients().unwrap();
        let models = [of_gpu, on_cpu.model().unwrap()];
        let poses = models.map(|model| model.parts[1].parameterization.shared().unwrap());
        assert_eq!(poses.map(|poses| poses.steps), [iteration; 2]);
        if iteration == 1 {
            let tables = models.map(|model| model.parts.iter().map(|part| &part.table));
            let [of_gpu, of_cpu] = tables;
            for (gpu, cpu) in of_gpu.zip(of_cpu) {
                for (gpu, cpu) in gpu.arrays.iter().zip(&cpu.arrays) {
                    assert_gradients_agree(gpu.name, &gpu.gradients, &cpu.gradients);
                }
            }
            // Sums over an object's Gaussians, less their mean over time: what is left is small beside what was added.
            let [gpu, cpu] = poses.map(|poses| &poses.array.gradients);
            let largest = cpu.iter().map(|value| value.abs()).fold(0.0, f32::max);
            let pairs = gpu.iter().zip(cpu);
            let apart = pairs
                .map(|(gpu, cpu)| (gpu - cpu).abs())
                .fold(0.0, f32::max);
            assert!(largest > 0.0 && apart < 0.03 * largest, "{apart} {largest}");
        }
        let [gpu, cpu] = poses.map(|poses| &poses.array.values);
        for (gpu, cpu) in gpu.iter().zip(cpu) {
            assert!((gpu - cpu).abs() < 2e-4, "{gpu} against {cpu}");
        }
        let mean: f32 = gpu.iter().step_by(4).sum();
        assert!(mean.abs() < 1e-6, "the gauge: {mean}");
    }
    let statistics = on_gpu.take_statistics().unwrap();
    assert_eq!(statistics.refused, vec![0; rates.len()]);
    let of_cpu = on_cpu.take_statistics().unwrap();
    assert!((statistics.loss - of_cpu.loss).abs() < 1e-5 * of_cpu.loss);
    let view = &scene.novel_views[0].view;
    let images = [on_gpu.image(view, 0), on_cpu.image(view, 0)].map(Result::unwrap);
    assert_images_agree(&images[0], &images[1]);
}

/// Checks that a step without room for its tile entries, and the steps after it, are repeated: the model equals
/// that with enough room to the last bit.
#[test]
fn steps_that_found_no_room_are_done_again() {
    let Some(gpu) = device() else { return };
    let scene = scene();
    // Wide footprints: more entries than the initial room.
    let wide = || {
        let mut wide = table(&scene, 0);
        for value in &mut wide.arrays[static_gaussians::LOG_SCALES].values {
            *value = 2.4_f32.ln();
        }
        wide
    };
    let settings = settings();
    let rates = [&RATES[..5], &[1e-3]].concat();
    let run = |renders_first: bool| {
        let model = Model::new(vec![Part::new(deformation(&scene), wide())]);
        let mut stepper =
            GpuStepper::new(Arc::clone(&gpu), scene.inputs(), model, &settings).unwrap();
        let entries_at_first = stepper.room_for_entries();
        if renders_first {
            for view in &scene.input_views {
                stepper.image(&view.view, 0).unwrap();
            }
        }
        for iteration in 1..=4 {
            let schedule = StepSchedule {
                scheduled: iteration,
                ..schedule(iteration, 0, &rates)
            };
            stepper.step(iteration as usize, &schedule).unwrap();
        }
        let sums = stepper.take_statistics().unwrap();
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
    let lost = |error: EngineError| match error {
        EngineError::Gpu(error) => error,
        other => panic!("{other}"),
    };
    let error = lost(stepper.take_statistics().unwrap_err());
    assert!(matches!(error, GpuError::Lost { .. }), "{error}");
    lost(stepper.model().map(drop).unwrap_err());
    lost(stepper.step(0, &schedule(2, 0, &RATES[..5])).unwrap_err());
}

#[test]
fn a_loss_that_is_not_finite_ends_a_run_with_its_iteration() {
    let Some(gpu) = device() else { return };
    let scene = scene();
    let settings = TrainSettings {
        rendering: RenderSettings {
            background: [f32::NAN; 3],
            ..RenderSettings::new(0.01)
        },
        ..settings()
    };
    let mut stepper = GpuStepper::new(gpu, scene.inputs(), model(&scene, 0), &settings).unwrap();
    for iteration in 1..=3 {
        stepper
            .step(0, &schedule(iteration, 0, &RATES[..5]))
            .unwrap();
    }
    let message = stepper.take_statistics().unwrap_err().to_string();
    assert!(message.contains("iteration 1"), "{message}");
}

#[test]
fn a_plan_has_the_buffers_that_training_asks_for() {
    let (Some(planning), Some(gpu)) = (device(), device()) else {
        return;
    };
    let scene = scene();
    let begin = model(&scene, 1);
    let without_density = TrainSettings {
        densify: DensifySettings {
            begin_iteration: u64::MAX,
            ..settings().densify
        },
        ..settings()
    };
    let demand = |gpu: &Arc<Gpu>, settings: &TrainSettings, gaussians: usize| {
        memory::demand(gpu, scene.inputs(), begin.clone(), settings, gaussians).unwrap()
    };
    let planned = demand(&planning, &without_density, begin.len());
    let model = begin.clone();
    let mut stepper =
        GpuStepper::new(Arc::clone(&gpu), scene.inputs(), model, &without_density).unwrap();
    stepper.step(0, &schedule(1, 1, &RATES)).unwrap();
    stepper.wait().unwrap();
    assert_eq!(gpu.buffer_demand(), planned);
    gpu.try_to_hold(&planned).unwrap();

    let Some(planning) = device() else { return };
    let growing = TrainSettings {
        densify: DensifySettings {
            begin_iteration: 1,
            ..settings().densify
        },
        ..settings()
    };
    let larger = demand(&planning, &growing, 10 * begin.len());
    assert!(larger.bytes > 2 * planned.bytes, "{larger:?} {planned:?}");
    assert!(larger.largest_bytes >= planned.largest_bytes);
    let too_large = BufferDemand {
        bytes: 2 * gpu.largest_buffer(),
        largest_bytes: gpu.largest_buffer() + 4,
        ..larger
    };
    let refused = gpu.try_to_hold(&too_large);
    assert!(
        matches!(refused, Err(GpuError::TooSmall { .. })),
        "{refused:?}"
    );
    gpu.exhaust_above(larger.largest_bytes - 4);
    let refused = gpu.try_to_hold(&larger);
    assert!(
        matches!(refused, Err(GpuError::OutOfMemory { .. })),
        "{refused:?}"
    );
}
