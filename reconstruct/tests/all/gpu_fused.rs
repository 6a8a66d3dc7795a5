//! The fused kernel of Adam: steps against those of separate kernels and of the CPU; models that it refuses.

use std::sync::Arc;

use balls::{scene, table};
use device::{assert_gradients_agree, device};
use omnilife_engine::{
    EngineError,
    device::{Gpu, KernelChoices},
    gaussians::dropout::Dropout,
    model::Model,
    parameters::ParameterTable,
    render::settings::RenderSettings,
    schedule::StepSchedule,
    step::{Stepper, cpu::CpuStepper, gpu::GpuStepper, settings::TrainSettings},
};
use omnilife_reconstruct::{baseline, scene::TrainingScene};
use omnilife_schemas::records::Backend;

use crate::support::{balls, device};

const RATES: [f32; 6] = [2e-3, 5e-3, 1e-3, 0.05, 2.5e-3, 1.25e-4];

/// Returns the adapter with the fused kernel, or `None` without any adapter.
fn fused_device() -> Option<Arc<Gpu>> {
    device()?;
    let choices = KernelChoices {
        fused_adam: true,
        ..KernelChoices::default()
    };
    Some(Arc::new(Gpu::open_with_choices(choices).unwrap()))
}

/// Returns the adapter with separate kernels, whatever the environment chooses.
fn separate_device() -> Arc<Gpu> {
    Arc::new(Gpu::open_with_choices(KernelChoices::default()).unwrap())
}

fn settings() -> TrainSettings {
    TrainSettings {
        rendering: RenderSettings::new(0.01),
        ssim_weight: 0.2,
        ..baseline::published_settings(100)
    }
}

fn on_device<'a>(gpu: Arc<Gpu>, scene: &'a TrainingScene, model: Model) -> GpuStepper<'a> {
    GpuStepper::new(gpu, scene.inputs(), model, &settings()).unwrap()
}

fn schedule(iteration: u64, sh_degree: usize, rates: &[f32]) -> StepSchedule {
    StepSchedule {
        iteration,
        sh_degree,
        learning_rates: rates.to_vec(),
        ..StepSchedule::default()
    }
}

/// Takes steps and returns the table.
fn trained(stepper: &mut dyn Stepper, steps: u64, sh_degree: usize) -> ParameterTable {
    for iteration in 1..=steps {
        let schedule = schedule(iteration, sh_degree, &RATES);
        stepper.step(iteration as usize, &schedule).unwrap();
    }
    stepper.model().unwrap().parts[0].table.clone()
}

/// Compares first moments, which after one step are gradients times a constant, within 5e-3 of the larger of a
/// value and the typical value of its array.
fn compare_moments(what: &str, one: &ParameterTable, other: &ParameterTable) {
    assert_eq!(one.arrays.len(), other.arrays.len(), "{what}");
    for (one, other) in one.arrays.iter().zip(&other.arrays) {
        let what = format!("{what}, {}", one.name);
        assert_gradients_agree(&what, &one.first_moments, &other.first_moments);
    }
}

#[test]
fn first_moments_of_a_fused_step_are_those_of_separate_kernels_and_of_the_cpu() {
    let Some(gpu) = fused_device() else { return };
    let scene = scene();
    let model = || Model::of_static(table(&scene, 1));
    let mut fused = on_device(gpu, &scene, model());
    let Backend::Gpu { fused_adam, .. } = fused.backend() else {
        panic!("another backend");
    };
    assert!(fused_adam);
    let of_fused = trained(&mut fused, 1, 1);
    let of_separate = trained(&mut on_device(separate_device(), &scene, model()), 1, 1);
    let of_cpu = trained(
        &mut CpuStepper::new(scene.inputs(), model(), &settings()),
        1,
        1,
    );
    compare_moments("separate kernels", &of_fused, &of_separate);
    compare_moments("CPU", &of_fused, &of_cpu);
    let values = |table: &ParameterTable| -> Vec<f32> {
        let arrays = table.arrays.iter();
        arrays.flat_map(|array| array.values.clone()).collect()
    };
    assert!(values(&of_fused) != values(&model().parts[0].table));
}

#[test]
fn losses_and_statistics_of_fused_steps_are_those_of_separate_kernels() {
    let Some(gpu) = fused_device() else { return };
    let scene = scene();
    let mut all = [gpu, separate_device()].map(|gpu| {
        let mut stepper = on_device(gpu, &scene, Model::of_static(table(&scene, 1)));
        // The harmonics above the drawn degree have no gradient.
        trained(&mut stepper, 3, 0);
        stepper
    });
    let [fused, separate] = all
        .each_mut()
        .map(|stepper| stepper.take_statistics().unwrap());
    assert_eq!((fused.steps, separate.steps), (3, 3));
    assert!((fused.loss - separate.loss).abs() < 1e-5 * separate.loss);
    assert_eq!(fused.refused, separate.refused);
    let [fused, separate] = all.each_mut().map(|stepper| {
        let part = &stepper.model().unwrap().parts[0];
        (part.statistics.views.clone(), part.statistics.sums.clone())
    });
    assert_eq!(fused.0, separate.0);
    assert_gradients_agree("statistics", &fused.1, &separate.1);
    let rest = |stepper: &mut GpuStepper<'_>| -> Vec<f32> {
        let table = &stepper.model().unwrap().parts[0].table;
        table.arrays.last().unwrap().first_moments.clone()
    };
    for stepper in &mut all {
        assert!(rest(stepper).iter().all(|&moment| moment == 0.0));
    }
}

#[test]
fn frozen_arrays_stay_as_they_are() {
    let Some(gpu) = fused_device() else { return };
    let scene = scene();
    let mut start = table(&scene, 1);
    start.freeze(0);
    start.freeze(4);
    let mut stepper = on_device(gpu, &scene, Model::of_static(start.clone()));
    let rates: Vec<f32> = [1, 2, 3, 5].map(|array| RATES[array]).to_vec();
    stepper.step(1, &schedule(1, 1, &rates)).unwrap();
    let ends = &stepper.model().unwrap().parts[0].table;
    for (number, (end, start)) in ends.arrays.iter().zip(&start.arrays).enumerate() {
        let is_same = end.values == start.values;
        let is_frozen = [0, 4].contains(&number);
        assert_eq!(is_same, is_frozen, "{}", end.name);
        let has_moments = end.first_moments.iter().any(|&moment| moment != 0.0);
        assert_eq!(has_moments, !is_frozen, "{}", end.name);
    }
}

#[test]
fn what_comes_between_splats_and_adam_is_refused() {
    let Some(gpu) = fused_device() else { return };
    let scene = scene();
    let settings = TrainSettings {
        dropout: Some(Dropout {
            last_share: 0.5,
            iterations: 100,
            seed: 1,
        }),
        ..settings()
    };
    let model = Model::of_static(table(&scene, 0));
    let refused = GpuStepper::new(gpu, scene.inputs(), model, &settings);
    assert!(
        matches!(&refused, Err(EngineError::Backend { reason }) if reason.contains("dropout")),
        "{:?}",
        refused.err()
    );
}
