//! What a training step costs, stage by stage, on a scene of a given size.
//!
//! * [`scene`]: the scenes; [`cpu`]: an iteration on the CPU; `gpu`: on a GPU.
//! * [`table`]: for people.

pub mod cpu;
mod gpu;
pub mod scene;
pub mod table;

use std::time::{Duration, Instant};

use omnilife_engine::{
    density::Threshold,
    device::timer::{StageCost, Stages},
    gaussians::static_gaussians::StaticGaussians,
    model::{Model, Part},
    parameters::{ParameterTable, adam::SecondMomentDecay},
    schedule::StepSchedule,
    step::{BackendChoice, Stepper, cpu::CpuStepper, settings::TrainSettings},
    training_view::{InputViews, TrainingView},
};

use crate::{baseline, error::ReconstructError, process::own_cpu_time};

/// Steps before any is measured.
const WARM_UP_STEPS: u64 = 3;
/// Iterations from one densification to the next, as 3DGS has it.
const DENSIFY_INTERVAL: u64 = 100;

/// What Gaussians of a measured scene do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SceneKind {
    /// They never move.
    Static,
    /// They have times of their own, and Omni4DGS's losses.
    Dynamic,
    /// A network of the published size deforms them.
    Deformable,
}

impl SceneKind {
    /// In tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Static => "static",
            Self::Dynamic => "dynamic",
            Self::Deformable => "deformable",
        }
    }
}

/// What is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CostRequest {
    /// What computes.
    pub backend: BackendChoice,
    /// Gaussians.
    pub gaussians: usize,
    /// Columns of the ERP image; rows are half as many.
    pub width: u32,
    /// What the Gaussians do.
    pub kind: SceneKind,
    /// Steps that are measured.
    pub steps: u64,
}

/// What a step costs.
#[derive(Debug, Clone, PartialEq)]
pub struct StepCost {
    /// What was measured.
    pub request: CostRequest,
    /// The device in words.
    pub device: String,
    /// The least of all steps for each stage; seconds are of the CPU, or on the device.
    pub stages: Stages,
    /// Seconds by the wall clock of one step among others.
    pub wall_seconds: f64,
    /// CPU seconds of one step among others: on a GPU, what the host does.
    pub cpu_seconds: Option<f64>,
    /// Bytes that the host reads back in 1,000 iterations, density control included.
    pub bytes_read: u64,
    /// What a densification that needs more room costs, and one that does not; none on the CPU.
    pub density: Option<[DensityCost; 2]>,
    /// Threads of the smallest subgroup, where sums over pixels are taken in subgroups.
    pub subgroup_size: Option<u32>,
    /// Bytes that the device copies in a second, read and written; none on the CPU.
    pub copied_per_second: Option<f64>,
}

/// What one densification of a model on a GPU costs, seconds by the wall clock.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DensityCost {
    /// Until the host goes on: the decision, and recording the programs of a step where more room is needed.
    pub decision_seconds: f64,
    /// From then on until the device has moved the rows.
    pub device_seconds: f64,
    /// Bytes that the host reads back.
    pub bytes_read: u64,
    /// Buffers and bind groups that are made for it.
    pub made: u64,
}

impl DensityCost {
    /// All of it.
    pub fn seconds(&self) -> f64 {
        self.decision_seconds + self.device_seconds
    }
}

/// Measures steps.
///
/// # Errors
/// When the backend fails or its memory does not suffice.
pub fn measure(request: CostRequest) -> Result<StepCost, ReconstructError> {
    match request.backend {
        BackendChoice::Cpu => on_cpu(request),
        BackendChoice::Gpu => gpu::measure(request),
    }
}

fn on_cpu(request: CostRequest) -> Result<StepCost, ReconstructError> {
    let subject = Subject::new(request);
    let mut stages = Stages::new();
    if request.kind == SceneKind::Static {
        let rendering = subject.settings.rendering;
        let mut iteration = cpu::Iteration::new(request.gaussians, request.width, rendering);
        for step in 0..WARM_UP_STEPS + request.steps {
            let mut laps = Vec::new();
            iteration.run(|stage, seconds| laps.push((stage, seconds)));
            if step >= WARM_UP_STEPS {
                take_least(
                    &mut stages,
                    laps.into_iter().map(|(stage, seconds)| {
                        let seconds = Some(seconds);
                        (
                            stage,
                            StageCost {
                                seconds,
                                ..StageCost::default()
                            },
                        )
                    }),
                );
            }
        }
    }
    let views = subject.views();
    let model = subject.model();
    let mut stepper = CpuStepper::new(subject.inputs(&views), model, &subject.settings);
    let (wall_seconds, cpu_seconds) = subject.time_of_steps(&mut stepper)?;
    Ok(StepCost {
        request,
        device: format!(
            "{} threads of {}",
            rayon::current_num_threads(),
            std::env::consts::ARCH
        ),
        stages,
        wall_seconds,
        cpu_seconds,
        bytes_read: 0,
        density: None,
        subgroup_size: None,
        copied_per_second: None,
    })
}

/// Keeps the least time that each stage had.
fn take_least(stages: &mut Stages, step: impl Iterator<Item = (&'static str, StageCost)>) {
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

/// The scene that steps are made on.
struct Subject {
    request: CostRequest,
    settings: TrainSettings,
    table: ParameterTable,
    /// Arrays that learn.
    arrays: usize,
}

impl Subject {
    fn new(request: CostRequest) -> Self {
        let mut settings = baseline::published_settings(30_000);
        settings.rendering.near = 0.01;
        // All that are seen would grow.
        settings.densify.gradient_threshold = Threshold::constant(f32::MIN_POSITIVE);
        settings.densify.maximum_gaussians = Self::most_gaussians(request, 2);
        let table = match request.kind {
            SceneKind::Dynamic => {
                let dynamics = settings.dynamics.insert(scene::dynamics());
                scene::moving_scene(request.gaussians, dynamics)
            }
            SceneKind::Static | SceneKind::Deformable => scene::scene(request.gaussians),
        };
        let mut subject = Self {
            request,
            settings,
            table,
            arrays: 0,
        };
        subject.arrays = subject.model().trained_arrays().len();
        subject
    }

    /// How many Gaussians there may be after so many densifications: each adds a twentieth. The first one needs
    /// more room, which suffices for the next one.
    fn most_gaussians(request: CostRequest, densifications: usize) -> u64 {
        (request.gaussians + densifications * (request.gaussians / 20)) as u64
    }

    fn model(&self) -> Model {
        let table = self.table.clone();
        let part = match &self.settings.dynamics {
            Some(dynamics) => Part::new(dynamics.parameterization(), table),
            None if self.request.kind == SceneKind::Deformable => {
                Part::new(scene::deformation(), table)
            }
            None => Part::new(StaticGaussians, table),
        };
        Model::new(vec![part])
    }

    /// One view, with a mask of a tenth of it.
    fn views(&self) -> [TrainingView; 1] {
        let view = scene::view(self.request.width);
        let image = scene::target(self.request.gaussians, &view, self.settings.rendering);
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

    fn inputs<'a>(&self, views: &'a [TrainingView; 1]) -> InputViews<'a> {
        InputViews {
            camera: views[0].view.camera,
            views,
        }
    }

    /// Steps that hardly change anything: the scene stays what it is.
    fn schedule(&self, iteration: u64) -> StepSchedule {
        StepSchedule {
            iteration,
            scheduled: iteration,
            second_moments: SecondMomentDecay::PUBLISHED,
            learning_rates: vec![1e-7; self.arrays],
            ..StepSchedule::default()
        }
    }

    /// Wall and CPU seconds of a step among others.
    fn time_of_steps(
        &self,
        stepper: &mut dyn Stepper,
    ) -> Result<(f64, Option<f64>), ReconstructError> {
        let steps = self.request.steps.max(1);
        let mut schedule = self.schedule(1);
        for _ in 0..WARM_UP_STEPS {
            stepper.step(0, &schedule)?;
            schedule.iteration += 1;
        }
        stepper.take_statistics()?;
        let (begun, cpu) = (Instant::now(), own_cpu_time());
        for _ in 0..steps {
            stepper.step(0, &schedule)?;
            schedule.iteration += 1;
        }
        stepper.take_statistics()?;
        let wall = begun.elapsed().as_secs_f64() / steps as f64;
        let spent = |before: Duration, after: Duration| after.saturating_sub(before).as_secs_f64();
        let cpu = cpu.zip(own_cpu_time());
        Ok((wall, cpu.map(|(a, b)| spent(a, b) / steps as f64)))
    }
}
