//! Training steps on a GPU, measured on the device and at the host.

use std::{sync::Arc, time::Instant};

use omnilife_engine::{
    density::{Densification, DensifySettings, DensityContext},
    device::{Gpu, timer::Stages},
    step::{
        Stepper,
        gpu::{GpuStepper, LOOK_INTERVAL},
    },
    training_view::TrainingView,
};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

use super::{
    CostRequest, DENSIFY_INTERVAL, DensityCost, StepCost, Subject, WARM_UP_STEPS, take_least,
};
use crate::error::ReconstructError;

pub(super) fn measure(request: CostRequest) -> Result<StepCost, ReconstructError> {
    let gpu = Arc::new(Gpu::open()?);
    let subject = Subject::new(request);
    let views = subject.views();
    let inputs = subject.inputs(&views);
    let mut stepper =
        GpuStepper::new(Arc::clone(&gpu), inputs, subject.model(), &subject.settings)?;
    let (wall_seconds, cpu_seconds) = subject.time_of_steps(&mut stepper)?;
    let mut stages = Stages::new();
    let mut schedule = subject.schedule(1_000);
    for step in 0..WARM_UP_STEPS + request.steps {
        let measured = stepper.measured_step(0, &schedule)?;
        schedule.iteration += 1;
        if step >= WARM_UP_STEPS {
            take_least(&mut stages, measured.into_iter());
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
    let larger = densify((&subject, 1), &gpu, &views, &mut stepper)?;
    let bytes_read = of_steps + larger.bytes_read * (1_000 / DENSIFY_INTERVAL);
    stepper.step(0, &schedule)?;
    stepper.take_statistics()?;
    let within = densify((&subject, 2), &gpu, &views, &mut stepper)?;
    let adapter = gpu.adapter();
    Ok(StepCost {
        request,
        device: format!("{} ({}, {})", adapter.name, adapter.kind, adapter.driver),
        stages,
        wall_seconds,
        cpu_seconds,
        bytes_read,
        density: Some([larger, within]),
        subgroup_size: gpu.subgroup_size(),
        copied_per_second: Some(gpu.copied_per_second()?),
    })
}

/// What densification number `number`, from 1, costs the host.
fn densify(
    (subject, number): (&Subject, usize),
    gpu: &Gpu,
    views: &[TrainingView],
    stepper: &mut GpuStepper<'_>,
) -> Result<DensityCost, ReconstructError> {
    let dynamics = subject.settings.dynamics.as_ref();
    let settings = DensifySettings {
        maximum_gaussians: Subject::most_gaussians(subject.request, number),
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
    Ok(DensityCost {
        decision_seconds: decided.as_secs_f64(),
        device_seconds: (begun.elapsed() - decided).as_secs_f64(),
        bytes_read: gpu.bytes_read() - read,
        made: gpu.buffers_and_bind_groups_made() - made,
    })
}
