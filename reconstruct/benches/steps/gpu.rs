//! Cost of training steps and of density control on a GPU, measured on the device and at the host.
//!
//! Prints one line of JSON with the size and either `error`, the reason for a missing measurement, or `measured`,
//! in seconds and bytes:
//!
//! * `stages`: for each stage the least seconds of all steps on the device, its kernels, and the bytes of their
//!   buffers if each passes once for each kernel.
//! * `wall_seconds`, `cpu_seconds`: one step among others, by the clock and by the host's computation.
//! * `bytes_read`: read back in 1,000 iterations, density control included.
//! * `densifications`: one that needs more room, and one within it. `decision_seconds` last until the host goes
//!   on, `device_seconds` from then on until the rows have moved; `made` counts buffers and bind groups.
//! * `subgroup_size`: threads of the smallest subgroup, null where sums are taken otherwise. `sums_per_splat`: true
//!   if a thread per splat takes them (`OMNILIFE_GPU_SUMS=splats`). `fused_adam`: true if one kernel reaches from
//!   the gradients by splats to Adam (`OMNILIFE_GPU_ADAM=fused`).
//! * `copied_per_second`: bytes that the device copies, read and written.

use std::{error::Error, sync::Arc, time::Instant};

use omnilife_engine::{
    density::{Densification, DensifySettings, DensityContext, Threshold},
    device::{Gpu, timer::Stages},
    gaussians::static_gaussians::StaticGaussians,
    model::{Model, Part},
    parameters::{ParameterTable, adam::SecondMomentDecay},
    schedule::StepSchedule,
    step::{
        Stepper,
        gpu::{GpuStepper, LOOK_INTERVAL},
        settings::TrainSettings,
    },
    training_view::{InputViews, TrainingView},
};
use omnilife_reconstruct::{ReconstructError, baseline, process::own_cpu_time};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use serde_json::{Value, json};

use crate::scene;

/// Steps before the first measured one.
const WARM_UP_STEPS: u64 = 3;
/// Iterations from one densification to the next, as 3DGS has it.
const DENSIFY_INTERVAL: u64 = 100;

/// Motion of a measured scene.
#[derive(Clone, Copy, PartialEq, Eq)]
enum SceneKind {
    Static,
    /// Gaussians with times of their own, and Omni4DGS's losses.
    Dynamic,
    /// Gaussians deformed by a network of the published size.
    Deformable,
}

/// Measures one size and prints the line.
pub(crate) fn run(
    name: &str,
    gaussians: usize,
    width: u32,
    steps: u64,
) -> Result<(), Box<dyn Error>> {
    let kind = match name {
        "static" => SceneKind::Static,
        "dynamic" => SceneKind::Dynamic,
        "deformable" => SceneKind::Deformable,
        _ => return Err("gpu: the kind is static, dynamic or deformable".into()),
    };
    let subject = Subject::new(kind, gaussians, width);
    let measured = measure(&subject, steps);
    let line = json!({
        "kind": name,
        "gaussians": gaussians,
        "width": width,
        "measured": measured.as_ref().ok(),
        "error": measured.as_ref().err().map(ToString::to_string),
    });
    println!("{line}");
    Ok(())
}

fn measure(subject: &Subject, steps: u64) -> Result<Value, ReconstructError> {
    let gpu = Arc::new(Gpu::open()?);
    let views = subject.views();
    let inputs = InputViews {
        camera: views[0].view.camera,
        views: &views,
    };
    let mut stepper =
        GpuStepper::new(Arc::clone(&gpu), inputs, subject.model(), &subject.settings)?;
    let (wall_seconds, cpu_seconds) = subject.time_of_steps(&mut stepper, steps)?;
    let mut stages = Stages::new();
    let mut schedule = subject.schedule(1_000);
    for step in 0..WARM_UP_STEPS + steps {
        let measured = stepper.measured_step(0, &schedule)?;
        schedule.iteration += 1;
        if step >= WARM_UP_STEPS {
            take_least(&mut stages, measured);
        }
    }
    // From one look of the host to the next.
    schedule.iteration = schedule.iteration.next_multiple_of(LOOK_INTERVAL) + 1;
    let before = gpu.bytes_read();
    for _ in 0..LOOK_INTERVAL {
        stepper.step(0, &schedule)?;
        schedule.iteration += 1;
    }
    stepper.take_statistics()?;
    let of_steps = (gpu.bytes_read() - before) * (1_000 / LOOK_INTERVAL);
    let before = gpu.bytes_read();
    let larger = densify((subject, 1), &gpu, &views, &mut stepper)?;
    let of_density = (gpu.bytes_read() - before) * (1_000 / DENSIFY_INTERVAL);
    stepper.step(0, &schedule)?;
    stepper.take_statistics()?;
    let within = densify((subject, 2), &gpu, &views, &mut stepper)?;
    let adapter = gpu.adapter();
    let stages = stages.into_iter().map(|(name, cost)| {
        json!({
            "name": name,
            "seconds": cost.seconds,
            "kernels": cost.dispatches,
            "bytes": cost.bytes,
        })
    });
    Ok(json!({
        "device": format!("{} ({}, {})", adapter.name, adapter.kind, adapter.driver),
        "stages": stages.collect::<Value>(),
        "wall_seconds": wall_seconds,
        "cpu_seconds": cpu_seconds,
        "bytes_read": of_steps + of_density,
        "densifications": [larger, within],
        "subgroup_size": gpu.subgroup_size(),
        "sums_per_splat": gpu.choices().sums_per_splat,
        "fused_adam": gpu.choices().fused_adam,
        "copied_per_second": gpu.copied_per_second()?,
    }))
}

/// Measures densification number `number`, from 1.
fn densify(
    (subject, number): (&Subject, usize),
    gpu: &Gpu,
    views: &[TrainingView],
    stepper: &mut GpuStepper<'_>,
) -> Result<Value, ReconstructError> {
    let dynamics = subject.settings.dynamics.as_ref();
    let settings = DensifySettings {
        maximum_gaussians: Subject::most_gaussians(subject.gaussians, number),
        ..subject.settings.densify.clone()
    };
    let asked = Densification {
        settings: &settings,
        scheduled: 1_000,
        context: DensityContext {
            views,
            last_view: 0,
            temporal: dynamics.and_then(|dynamics| dynamics.density),
        },
    };
    let mut random = Pcg64Mcg::seed_from_u64(0);
    let (read, made) = (gpu.bytes_read(), gpu.buffers_and_bind_groups_made());
    let begun = Instant::now();
    stepper.densify(&asked, &mut random)?;
    let decided = begun.elapsed();
    stepper.wait()?;
    Ok(json!({
        "decision_seconds": decided.as_secs_f64(),
        "device_seconds": (begun.elapsed() - decided).as_secs_f64(),
        "bytes_read": gpu.bytes_read() - read,
        "made": gpu.buffers_and_bind_groups_made() - made,
    }))
}

/// Keeps the least time that each stage had.
fn take_least(stages: &mut Stages, step: Stages) {
    for (stage, cost) in step {
        match stages.iter_mut().find(|(known, _)| *known == stage) {
            Some((_, least)) => {
                let both = least.seconds.zip(cost.seconds);
                least.seconds = both.map(|(least, now)| least.min(now));
            }
            None => stages.push((stage, cost)),
        }
    }
}

/// Scene of the steps.
struct Subject {
    kind: SceneKind,
    gaussians: usize,
    width: u32,
    settings: TrainSettings,
    table: ParameterTable,
    arrays: usize,
}

impl Subject {
    fn new(kind: SceneKind, gaussians: usize, width: u32) -> Self {
        let mut settings = baseline::published_settings(30_000);
        settings.rendering.near = 0.01;
        // All visible Gaussians would grow.
        settings.densify.gradient_threshold = Threshold::constant(f32::MIN_POSITIVE);
        settings.densify.maximum_gaussians = Self::most_gaussians(gaussians, 2);
        let table = match kind {
            SceneKind::Dynamic => {
                let dynamics = settings.dynamics.insert(scene::dynamics());
                scene::moving_scene(gaussians, dynamics)
            }
            SceneKind::Static | SceneKind::Deformable => scene::scene(gaussians),
        };
        let mut subject = Self {
            kind,
            gaussians,
            width,
            settings,
            table,
            arrays: 0,
        };
        subject.arrays = subject.model().trained_arrays().len();
        subject
    }

    /// Returns the most Gaussians after so many densifications: each adds a twentieth. The first one needs more
    /// room, which suffices for the next one.
    fn most_gaussians(gaussians: usize, densifications: usize) -> u64 {
        (gaussians + densifications * (gaussians / 20)) as u64
    }

    fn model(&self) -> Model {
        let table = self.table.clone();
        let part = match &self.settings.dynamics {
            Some(dynamics) => Part::new(dynamics.parameterization(), table),
            None if self.kind == SceneKind::Deformable => Part::new(scene::deformation(), table),
            None => Part::new(StaticGaussians, table),
        };
        Model::new(vec![part])
    }

    /// Returns one view, with a mask of a tenth of it.
    fn views(&self) -> [TrainingView; 1] {
        let view = scene::view(self.width);
        let image = scene::target(self.gaussians, &view, self.settings.rendering);
        let pixels = image.to_rgb8();
        let covered = |pixel: usize| if pixel.is_multiple_of(10) { 255 } else { 0 };
        [TrainingView {
            frame: 0,
            mask: Some((0..pixels.len() / 3).map(covered).collect()),
            ignored: None,
            pixels,
            view,
        }]
    }

    /// Returns a schedule of steps that hardly change anything: the scene stays the same.
    fn schedule(&self, iteration: u64) -> StepSchedule {
        StepSchedule {
            iteration,
            scheduled: iteration,
            second_moments: SecondMomentDecay::PUBLISHED,
            learning_rates: vec![1e-7; self.arrays],
            ..StepSchedule::default()
        }
    }

    /// Returns wall and CPU seconds of a step among others.
    fn time_of_steps(
        &self,
        stepper: &mut GpuStepper<'_>,
        steps: u64,
    ) -> Result<(f64, Option<f64>), ReconstructError> {
        let mut schedule = self.schedule(1);
        for _ in 0..WARM_UP_STEPS {
            stepper.step(0, &schedule)?;
            schedule.iteration += 1;
        }
        stepper.take_statistics()?;
        let (begun, cpu) = (Instant::now(), own_cpu_time());
        for _ in 0..steps.max(1) {
            stepper.step(0, &schedule)?;
            schedule.iteration += 1;
        }
        stepper.take_statistics()?;
        let each = |seconds: f64| seconds / steps.max(1) as f64;
        let wall = begun.elapsed().as_secs_f64();
        let cpu = cpu.zip(own_cpu_time());
        Ok((
            each(wall),
            cpu.map(|(before, now)| each(now.saturating_sub(before).as_secs_f64())),
        ))
    }
}
