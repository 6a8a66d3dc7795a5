//! Drift of a method's arrays between CPU and GPU over fifty steps, beside a control on the CPU.
//!
//! Training amplifies last bits: Adam takes a full step where the sign of a small gradient differs. The control has
//! other last bits and the same mathematics. All cameras turn by half a circle about their own vertical axes, and all
//! panoramas are shifted by half their width: exact in f32, but longitudes are rounded elsewhere, and the gradient of
//! a Gaussian is summed over its tiles in another order.
//!
//! `OMNILIFE_DRIFT_LOSSES=1 cargo test -p omnilife-reconstruct --test all gpu_drift -- --nocapture` prints the table of
//! `docs/results/gpu.md`, and the losses with density control, which nothing here judges.

use std::sync::Arc;

use device::device;
use glam::{Mat3, vec3};
use omnilife_engine::{
    density::DensifySettings,
    device::Gpu,
    model::Model,
    parameters::ParameterArray,
    step::{Stepper, cpu::CpuStepper, gpu::GpuStepper, settings::TrainSettings},
};
use omnilife_reconstruct::{
    learner::{Learner, gaussians::GaussianLearner},
    methods::{self, Prepared},
    options::Options,
    request::{BackendChoice, MethodRequest, PlanChoice},
    scene::TrainingScene,
};

use crate::support::{device, held_camera};

const METHOD: &str = "omni4dgs-plus";
const STEPS: u64 = 50;
/// Relative difference from which an array counts as parted.
const PARTED: f64 = 1e-4;
/// Most drift between CPU and GPU, in drifts of the control.
const MULTIPLE: f64 = 10.0;
/// Drift that counts as none: eight last bits of f32.
const LAST_BITS: f64 = 8.0 * f32::EPSILON as f64;

/// A trained array after a step.
struct ArrayState {
    /// Number of the part, and name.
    name: String,
    values: Vec<f32>,
    /// First moments of Adam; after the first step a tenth of the gradients.
    moments: Vec<f32>,
}

/// State after a step.
struct Step {
    loss: f64,
    gaussians: usize,
    arrays: Vec<ArrayState>,
}

/// Drift of an array between two runs.
struct Drift<'a> {
    name: &'a str,
    /// Step at which it exceeds [`PARTED`].
    parts: Option<usize>,
    /// After the last step.
    at_last: f64,
    /// Relative difference of the first step's gradients.
    gradients: f64,
}

fn array_states(model: &Model) -> Vec<ArrayState> {
    let state = |name: String, array: &ParameterArray| ArrayState {
        name,
        values: array.values.clone(),
        moments: array.first_moments.clone(),
    };
    let mut states = Vec::new();
    for (number, part) in model.parts.iter().enumerate() {
        let trained = part.table.arrays.iter().filter(|array| !array.is_frozen());
        states.extend(trained.map(|array| state(format!("{number} {}", array.name), array)));
    }
    let poses = model.poses.iter().flat_map(|poses| &poses.table.arrays);
    states.extend(poses.map(|array| state(array.name.to_owned(), array)));
    states
}

/// Returns the states of a run after each step, views in their order.
fn run<'a>(
    scene: &'a TrainingScene,
    stepper: Box<dyn Stepper + 'a>,
    settings: &TrainSettings,
) -> Vec<Step> {
    let mut learner = GaussianLearner::with_stepper(scene, stepper, settings.clone()).unwrap();
    let step = |iteration: u64| {
        let at = settings.position(iteration, 0.0);
        let view = iteration as usize % scene.input_views.len();
        learner.step(view, &at).unwrap();
        learner.maintain(&at).unwrap();
        let loss = learner.take_statistics().unwrap().loss;
        let model = learner.gaussians().unwrap().unwrap();
        Step {
            loss,
            gaussians: model.len(),
            arrays: array_states(model),
        }
    };
    (1..=STEPS).map(step).collect()
}

/// Turns all cameras by half a circle, and their panoramas with them.
fn half_turned(scene: &TrainingScene) -> TrainingScene {
    let half_turn = Mat3::from_diagonal(vec3(-1.0, 1.0, -1.0));
    let mut scene = scene.clone();
    let [width, _] = scene.camera.size();
    for view in scene.input_views.iter_mut().chain(&mut scene.novel_views) {
        view.view.rotation = half_turn * view.view.rotation;
        shift_rows(&mut view.pixels, 3 * width);
        for marks in view.mask.iter_mut().chain(&mut view.ignored) {
            shift_rows(marks, width);
        }
    }
    scene
}

/// Shifts rows of `len` values by half of their length.
fn shift_rows(values: &mut [u8], len: usize) {
    for row in values.chunks_mut(len) {
        row.rotate_left(len / 2);
    }
}

/// Returns the root of the sum of squared differences over that of `right`; infinite for arrays of different lengths.
fn relative(left: &[f32], right: &[f32]) -> f64 {
    if left.len() != right.len() {
        return f64::INFINITY;
    }
    let size: f64 = right.iter().map(|&value| f64::from(value).powi(2)).sum();
    let pairs = left.iter().zip(right);
    let apart: f64 = pairs
        .map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2))
        .sum();
    apart.sqrt() / size.sqrt().max(f64::MIN_POSITIVE)
}

/// Returns the drift of every array of `run` from `from`.
fn drifts<'a>(run: &[Step], from: &'a [Step]) -> Vec<Drift<'a>> {
    let of = |number: usize, at: usize| {
        let [left, right] = [run, from].map(|steps| &steps[at].arrays[number]);
        relative(&left.values, &right.values)
    };
    let arrays = from[0].arrays.iter().enumerate();
    let drift = |(number, array): (usize, &'a ArrayState)| Drift {
        name: &array.name,
        parts: (0..from.len())
            .find(|&at| of(number, at) > PARTED)
            .map(|at| at + 1),
        at_last: of(number, from.len() - 1),
        gradients: relative(&run[0].arrays[number].moments, &array.moments),
    };
    arrays.map(drift).collect()
}

/// Returns the largest relative difference of a step's loss.
fn losses_apart(run: &[Step], from: &[Step]) -> f64 {
    let pairs = run.iter().zip(from);
    let apart = pairs.map(|(step, from)| (step.loss / from.loss - 1.0).abs());
    apart.fold(0.0, f64::max)
}

/// Runs on the CPU, on a GPU, and on the CPU with turned cameras.
fn three_runs(
    gpu: &Arc<Gpu>,
    scenes: &[TrainingScene; 2],
    model: &Model,
    settings: &TrainSettings,
) -> [Vec<Step>; 3] {
    let [scene, turned] = scenes;
    let inputs = scene.inputs();
    let on_cpu = CpuStepper::new(inputs, model.clone(), settings);
    let on_gpu = GpuStepper::new(Arc::clone(gpu), inputs, model.clone(), settings).unwrap();
    let control = CpuStepper::new(turned.inputs(), model.clone(), settings);
    [
        run(scene, Box::new(on_cpu), settings),
        run(scene, Box::new(on_gpu), settings),
        run(turned, Box::new(control), settings),
    ]
}

fn print_table(of_gpu: &[Drift<'_>], of_control: &[Drift<'_>]) {
    println!(
        "| Array | parts at step, GPU | control | after {STEPS} steps, GPU | control \
         | gradients of step 1, GPU | control |\n| --- | ---: | ---: | ---: | ---: | ---: | ---: |"
    );
    let parts = |drift: &Drift<'_>| {
        drift
            .parts
            .map_or_else(|| "-".to_owned(), |step| step.to_string())
    };
    for (gpu, control) in of_gpu.iter().zip(of_control) {
        println!(
            "| {} | {} | {} | {:.1e} | {:.1e} | {:.1e} | {:.1e} |",
            gpu.name,
            parts(gpu),
            parts(control),
            gpu.at_last,
            control.at_last,
            gpu.gradients,
            control.gradients
        );
    }
}

/// Prints losses with density control, in which a Gaussian on a threshold is removed on one side alone.
fn print_losses(what: &str, [cpu, gpu, control]: &[Vec<Step>; 3]) {
    for (name, run) in [("GPU", gpu), ("control", control)] {
        let mut pairs = run.iter().zip(cpu);
        let other_number = pairs.position(|(step, from)| step.gaussians != from.gaussians);
        let until = other_number.unwrap_or(cpu.len());
        println!(
            "{what}, {name}: loss of a step {:.1e} apart, {:.1e} in the first {until} steps; {} and {} \
             Gaussians at last",
            losses_apart(run, cpu),
            losses_apart(&run[..until], &cpu[..until]),
            run[run.len() - 1].gaussians,
            cpu[cpu.len() - 1].gaussians,
        );
    }
}

/// Returns the first model of the method with its whole plan, and its settings.
fn start(scene: &TrainingScene) -> (Model, TrainSettings) {
    let request = MethodRequest {
        options: Options::at_most(700),
        plan: PlanChoice::Full,
        ..MethodRequest::new(STEPS, 7)
    };
    let method = methods::find(METHOD).unwrap();
    let Prepared {
        mut learner,
        configuration,
        ..
    } = method.prepare(scene, &request, BackendChoice::Cpu).unwrap();
    let model = learner.gaussians().unwrap().unwrap().clone();
    (model, serde_json::from_value(configuration).unwrap())
}

/// Checks that no array drifts much further between the backends than between two orders of sums on one of them:
/// the rest is last bits that training amplifies. Rows keep their places, because density control is off.
#[test]
fn arrays_drift_on_the_device_as_by_another_order_of_sums() {
    let Some(gpu) = device() else { return };
    let scene = held_camera::scene();
    let (model, settings) = start(&scene);
    let scenes = [scene.clone(), half_turned(&scene)];
    if std::env::var_os("OMNILIFE_DRIFT_LOSSES").is_some() {
        let whole = three_runs(&gpu, &scenes, &model, &settings);
        print_losses("with density control", &whole);
    }
    let rows_stay = TrainSettings {
        densify: DensifySettings {
            begin_iteration: u64::MAX,
            opacity_reset_iterations: 0,
            ..settings.densify.clone()
        },
        ..settings
    };
    let runs = three_runs(&gpu, &scenes, &model, &rows_stay);
    print_losses("without density control", &runs);
    let [cpu, on_gpu, control] = &runs;
    let (of_gpu, of_control) = (drifts(on_gpu, cpu), drifts(control, cpu));
    print_table(&of_gpu, &of_control);

    // The control is the same mathematics, and has other last bits.
    let first = (control[0].loss / cpu[0].loss - 1.0).abs();
    assert!(first < 1e-5, "the control has another loss: {first:.1e}");
    assert!(of_control.iter().any(|drift| drift.at_last > LAST_BITS));
    for (on_gpu, control) in of_gpu.iter().zip(&of_control) {
        let name = on_gpu.name;
        for (what, apart, control) in [
            ("gradients, step 1", on_gpu.gradients, control.gradients),
            ("values at last", on_gpu.at_last, control.at_last),
        ] {
            let limit = MULTIPLE * control.max(LAST_BITS);
            assert!(
                apart <= limit,
                "{what}, {name}: {apart:.1e} apart, the control {control:.1e}"
            );
        }
    }
}
