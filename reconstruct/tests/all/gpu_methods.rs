//! Every method over some steps of its whole plan: GPU and CPU agree. The model starts at its maximum size, so
//! that density control prunes alone; `gpu_density` of the engine judges its growth.
//!
//! A card takes fifty steps. A software adapter takes fewer, unless `OMNILIFE_PARITY_STEPS` has their number.

use std::path::Path;

use device::device;
use glam::Vec3;
use novel_views::novel_psnr;
use omnilife_engine::{
    gaussians::static_gaussians::POSITIONS,
    model::{Model, Part, TrainedArray},
    schedule::StepSchedule,
    step::{Stepper, cpu::CpuStepper, gpu::GpuStepper, settings::TrainSettings},
};
use omnilife_reconstruct::{
    evidence::once::PilotOnce,
    methods::{METHODS, Method, deformable, panogs, requirement::Requirement},
    options::Options,
    request::{BackendChoice, MethodRequest, PlanChoice},
    scene::TrainingScene,
    train::Session,
};
use omnilife_schemas::{progress::Silent, records::Backend};

use crate::{
    depth, object_graph,
    support::{device, held_camera, novel_views, trained::small_options},
};

const STEPS: u64 = 50;
/// Steps on a software adapter, and those of a network, of which it takes seconds for each.
const SOFTWARE_STEPS: [u64; 2] = [16, 4];
const MAX_GAUSSIANS: usize = 700;
/// Maximum relative difference of the sum of all steps' losses: the same as for that of four steps.
const LOSS_LIMIT: f64 = 2e-3;

struct Run {
    losses: Vec<f64>,
    gaussians: Vec<u64>,
    psnr_db: f64,
}

/// Returns the number of steps that both backends take of a method here.
fn steps_of(method: &Method) -> u64 {
    let is_software = device().is_some_and(|gpu| gpu.adapter().kind.is_software());
    let given = std::env::var("OMNILIFE_PARITY_STEPS");
    let given = given.map(|steps| steps.parse().expect("OMNILIFE_PARITY_STEPS is a number"));
    let [plain, network] = SOFTWARE_STEPS;
    match given {
        Ok(steps) => steps,
        Err(_) if !is_software => STEPS,
        Err(_) if method.id == deformable::METHOD.id => network,
        Err(_) => plain,
    }
}

fn run(method: &Method, scene: &TrainingScene, without: &[&str], backend: BackendChoice) -> Run {
    let session = Session {
        backend,
        ..Session::without_files(&Silent)
    };
    let request = MethodRequest {
        options: small_options(method, MAX_GAUSSIANS, &[]),
        plan: PlanChoice::Full,
        without: without.iter().map(|&name| name.to_owned()).collect(),
        trace_every: Some(1),
        ..MethodRequest::new(steps_of(method), 7)
    };
    let mut outcome = method.train(scene, &request, &session).unwrap();
    match (backend, outcome.learner.backend()) {
        (BackendChoice::Cpu, Backend::Cpu { .. }) => {}
        (
            BackendChoice::Gpu,
            Backend::Gpu {
                adapter, limits, ..
            },
        ) => assert!(!adapter.is_empty() && limits["max_buffer_size"] > 0),
        (asked, made) => panic!("{}: {made:?} for {asked:?}", method.id),
    }
    let psnr_db = novel_psnr(&mut outcome, scene);
    let trace = &outcome.training.state.trace;
    assert_eq!(trace.last().unwrap().iteration, steps_of(method));
    Run {
        losses: trace.iter().filter_map(|point| point.train_loss).collect(),
        gaussians: trace.iter().map(|point| point.primitives).collect(),
        psnr_db,
    }
}

/// Returns a scene with everything that a method requires; `folder` holds its files.
fn scene_of(method: &Method, folder: &Path) -> TrainingScene {
    if method.id == panogs::METHOD.id {
        let mut room = depth::panogs::scene(folder, 6, depth::panogs::as_given);
        room.novel_views.extend(room.input_views.pop());
        room.novel_depth_priors.extend(room.depth_priors.pop());
        return room;
    }
    let tracked = method.needs(Requirement::Tracks).then(object_graph::scene);
    TrainingScene {
        tracks: tracked.and_then(|tracked| tracked.tracks),
        ..held_camera::scene()
    }
}

/// Compares a method on both backends, without some of its components.
fn compare(method: &Method, without: &[&str]) {
    if device().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let scene = scene_of(method, folder.path());
    // A GPU makes no pilot fit of its own: the CPU's is that of both.
    let _once = PilotOnce::begin();
    let [cpu, gpu] = [BackendChoice::Cpu, BackendChoice::Gpu]
        .map(|backend| run(method, &scene, without, backend));
    let sums = [&cpu, &gpu].map(|run| run.losses.iter().sum::<f64>());
    let apart = cpu.losses.iter().zip(&gpu.losses);
    let apart = apart.map(|(cpu, gpu)| (gpu - cpu).abs() / cpu);
    let numbers = [&cpu, &gpu].map(|run| *run.gaussians.last().unwrap());
    println!(
        "{}: loss {sums:?}, a step's at most {:.1e} apart, {} Gaussians, then {numbers:?}, {:.2} and {:.2} dB",
        method.id,
        apart.fold(0.0, f64::max),
        cpu.gaussians[0],
        cpu.psnr_db,
        gpu.psnr_db
    );
    let steps = steps_of(method) as usize;
    assert_eq!([cpu.losses.len(), gpu.losses.len()], [steps; 2]);
    let what = method.id;
    assert!((sums[0] - sums[1]).abs() < LOSS_LIMIT * sums[0], "{what}");
    // A Gaussian that is on different sides of a threshold by its last bits grows on one of them.
    assert!(
        numbers[0].abs_diff(numbers[1]) <= numbers[0] / 100,
        "{what}"
    );
    assert!((cpu.psnr_db - gpu.psnr_db).abs() < 0.3, "{what}");
}

#[test]
fn steps_of_every_method_are_those_of_the_cpu() {
    let runs_there = |method: &&Method| method.backends.contains(&BackendChoice::Gpu);
    let methods: Vec<_> = METHODS.iter().filter(runs_there).collect();
    assert!(methods.len() >= 7, "{methods:?}");
    let _once = PilotOnce::begin();
    for method in methods {
        compare(method, &[]);
    }
}

#[test]
fn steps_with_frozen_arrays_are_those_of_the_cpu() {
    compare(&panogs::METHOD, &[panogs::SHAPE_REFINEMENT, panogs::SHARDS]);
}

/// Checks that centres stay until they may move, and then leave their balls on neither device, however long a step is.
#[test]
fn centres_are_held_near_their_anchors_as_on_the_cpu() {
    let Some(gpu) = device() else { return };
    let folder = tempfile::tempdir().unwrap();
    let scene = scene_of(&panogs::METHOD, folder.path());
    let request = MethodRequest {
        options: Options::at_most(400),
        plan: PlanChoice::Full,
        without: vec![panogs::SHARDS.to_owned()],
        ..MethodRequest::new(STEPS, 7)
    };
    let mut prepared = depth::panogs::prepared(&scene, &request);
    let begin = prepared.learner.gaussians().unwrap().unwrap().clone();
    let settings: TrainSettings = serde_json::from_value(prepared.configuration).unwrap();
    let arrays = begin.trained_arrays();
    let rate = |array: &TrainedArray| if array.name == "positions" { 1.0 } else { 1e-3 };
    let rates: Vec<f32> = arrays.iter().map(rate).collect();
    assert!(rates.contains(&1.0), "centres do not move");
    let mut on_gpu = GpuStepper::new(gpu, scene.inputs(), begin.clone(), &settings).unwrap();
    let mut on_cpu = CpuStepper::new(scene.inputs(), begin.clone(), &settings);
    // Distances of all centres from their anchors, which are their first positions.
    let moved = |model: &Model| -> Vec<f32> {
        let parts = model.parts.iter().zip(&begin.parts);
        let of_part = |(part, begin): (&Part, &Part)| -> Vec<f32> {
            let [now, first] = [part, begin].map(|part| &part.table.arrays[POSITIONS].values);
            let pairs = now.as_chunks::<3>().0.iter().zip(first.as_chunks::<3>().0);
            pairs
                .map(|(now, first)| Vec3::from_array(*now).distance(Vec3::from_array(*first)))
                .collect()
        };
        parts.flat_map(of_part).collect()
    };
    for (iteration, scheduled) in [(1, 1), (2, STEPS), (3, STEPS)] {
        let schedule = StepSchedule {
            iteration,
            scheduled,
            learning_rates: rates.clone(),
            ..StepSchedule::default()
        };
        on_gpu.step(iteration as usize, &schedule).unwrap();
        on_cpu.step(iteration as usize, &schedule).unwrap();
        let of_gpu = moved(on_gpu.model().unwrap());
        let of_cpu = moved(on_cpu.model().unwrap());
        let farthest = of_cpu.iter().copied().fold(0.0, f32::max);
        assert_eq!(farthest > 0.0, iteration > 1, "{farthest}");
        let pairs = of_gpu.iter().zip(&of_cpu);
        let apart = pairs.filter(|(gpu, cpu)| (*gpu - *cpu).abs() > 1e-3 * gpu.max(**cpu));
        // A gradient of 0 on one device alone is a step on the other.
        assert!(apart.count() <= of_cpu.len() / 50, "step {iteration}");
    }
}
