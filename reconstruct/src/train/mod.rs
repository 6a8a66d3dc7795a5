//! The training loop: it orders calls and holds no mathematics.
//!
//! * [`settings`]: what to do, and where in its schedule a run stands.
//! * [`step`]: what a backend does; [`cpu_step`]: the processor; [`dynamic_step`]: the processor where
//!   Gaussians depend on time, as [`dynamic_settings`] say.
//! * [`deformation_settings`]: what a network that deforms static Gaussians adds to a step;
//!   [`pose_refinement`]: what is done with the pose of the view that is drawn.
//! * [`timing`]: what a step takes; [`trace`]: error against run time; [`checkpoint`]: how a run survives an interruption; `resume`: how it goes on.

pub mod checkpoint;
mod nonfinite;
mod resume;
pub mod timing;
pub mod trace;

use std::{
    path::PathBuf,
    sync::Arc,
    time::{Duration, Instant},
};

use omnilife_schemas::progress::Progress;
use rand::{RngExt, seq::SliceRandom};
use rand_distr::{Distribution, StandardNormal};

use crate::request::BackendChoice;
use crate::train::{
    checkpoint::LoopState, nonfinite::too_much_refused, resume::resume, trace::TracePoint,
};
use crate::{error::ReconstructError, process, scene::TrainingScene};
use omnilife_engine::EngineError;
use omnilife_engine::{
    density::{self, DensityContext},
    device::Gpu,
    gaussians::deformable::DEFORMATION_WEIGHTS,
    losses::photometric::cpu::Loss,
    model::pose_corrections::{CAMERA_CENTRES, CAMERA_ROTATIONS},
    parameters::{ArrayShape, decay::Decay, memory},
    step::gpu::GpuStepper,
};
use omnilife_engine::{
    model::Model,
    render::settings::RendererChoice,
    schedule::{Position, StepSchedule},
    step::{Stepper, cpu::CpuStepper, dynamic_cpu::DynamicStepper, settings::TrainSettings},
};

/// Iterations between two looks at what the backend has summed up.
const CHECK_INTERVAL: u64 = 100;

/// What surrounds a run: who hears of it, where it goes, what computes it.
pub struct Session<'a> {
    /// Hears how far it is.
    pub progress: &'a dyn Progress,
    /// Where trace and checkpoints go; nowhere in tests and previews.
    pub files: Option<TrainingFiles>,
    /// What computes the steps.
    pub backend: BackendChoice,
}

/// Files that training writes as it goes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TrainingFiles {
    /// CSV of the trace.
    pub trace: PathBuf,
    /// The checkpoint; read at the beginning when it is there.
    pub checkpoint: PathBuf,
    /// Iterations between two checkpoints; 0 writes none.
    pub checkpoint_every: u64,
    /// Hash of everything that went into the run.
    pub inputs_sha256: String,
}

impl<'a> Session<'a> {
    /// A run on the processor that leaves no files.
    pub fn without_files(progress: &'a dyn Progress) -> Self {
        Self {
            progress,
            files: None,
            backend: BackendChoice::Cpu,
        }
    }
}

/// A trained model.
#[derive(Debug)]
pub struct Trained<'a> {
    /// The model where it was trained, ready to render.
    pub stepper: Box<dyn Stepper + 'a>,
    /// Where the loop ended, with the trace.
    pub state: LoopState,
    /// Degree of the spherical harmonics in use at the end.
    pub sh_degree: usize,
    /// Whether the time budget ended the run before its last iteration.
    pub stopped_by_budget: bool,
    /// Lines that a reader of the scores should know.
    pub remarks: Vec<String>,
}

/// Trains `model` on the scene's input views, from the session's checkpoint where there is one.
///
/// On the processor the result depends on the settings and the scene alone, not on the number of
/// threads or on interruptions - unless a time budget stops it.
///
/// # Errors
/// When the loss or a large share of an array's gradients is not finite, the checkpoint is damaged,
/// a file cannot be written or the backend fails.
pub fn train<'a>(
    scene: &'a TrainingScene,
    model: impl Into<Model>,
    settings: &TrainSettings,
    session: &Session<'_>,
) -> Result<Trained<'a>, ReconstructError> {
    let mut trainer = Trainer::begin(scene, model.into(), settings, session)?;
    let left = settings.iterations - trainer.state.iteration.min(settings.iterations);
    session.progress.begin("training", Some(left));
    let heeding = process::TERMINATION.heed();
    let outcome = trainer.run();
    drop(heeding);
    session.progress.end();
    outcome.map(|()| trainer.finish())
}

/// The only place that knows which backends there are.
fn new_stepper<'a>(
    scene: &'a TrainingScene,
    model: Model,
    settings: &TrainSettings,
    backend: BackendChoice,
) -> Result<Box<dyn Stepper + 'a>, ReconstructError> {
    match (backend, &settings.dynamics) {
        (BackendChoice::Cpu, Some(dynamics)) => {
            let stepper = DynamicStepper::new(scene.inputs(), model, settings, dynamics);
            Ok(Box::new(stepper))
        }
        (BackendChoice::Cpu, None) => {
            Ok(Box::new(CpuStepper::new(scene.inputs(), model, settings)))
        }
        (BackendChoice::Gpu, Some(_)) => Err(EngineError::Backend {
            reason: "Gaussians with times of their own are trained on the processor only; use the \
                     backend cpu"
                .to_owned(),
        }
        .into()),
        (BackendChoice::Gpu, None)
            if settings.exposure.is_some() || settings.pose_refinement.is_some() =>
        {
            Err(EngineError::Backend {
                reason: "exposure is compensated and poses are refined on the processor only; use \
                         the backend cpu, or leave both components out"
                    .to_owned(),
            }
            .into())
        }
        (BackendChoice::Gpu, None) => {
            if settings.renderer != RendererChoice::Exact {
                return Err(EngineError::Backend {
                    reason: "the graphics backend has no renderer with the published quirks; use \
                             the backend cpu"
                        .to_owned(),
                }
                .into());
            }
            let gpu = Arc::new(Gpu::open()?);
            Ok(Box::new(GpuStepper::new(
                gpu,
                scene.inputs(),
                model,
                settings,
            )?))
        }
    }
}

struct Trainer<'a, 's> {
    scene: &'a TrainingScene,
    settings: &'s TrainSettings,
    session: &'s Session<'s>,
    stepper: Box<dyn Stepper + 'a>,
    /// One decay per array.
    decays: Vec<Decay>,
    /// Of the model; those that only moving Gaussians have, or the weights of a network, at the end.
    arrays: Vec<ArrayShape>,
    /// How many of them static Gaussians have.
    static_arrays: usize,
    state: LoopState,
    schedule: StepSchedule,
    /// The view rendered last.
    last_view: usize,
    stopped_by_budget: bool,
    remarks: Vec<String>,
    /// Judges the novel views for the trace.
    loss: Loss,
    target: Vec<f32>,
}

impl<'a, 's> Trainer<'a, 's> {
    fn begin(
        scene: &'a TrainingScene,
        model: Model,
        settings: &'s TrainSettings,
        session: &'s Session<'s>,
    ) -> Result<Self, ReconstructError> {
        let (arrays, static_arrays) = (model.shapes(), model.table.arrays.len());
        let decays = arrays
            .iter()
            .map(|array| settings.learning_rates.get(array.name).copied())
            .collect::<Option<Vec<Decay>>>()
            .unwrap_or_else(|| unreachable!("every array of {arrays:?} has a learning rate"));
        let mut remarks = Vec::new();
        let (state, model) = resume(model, settings, session, &mut remarks)?;
        let position = settings.position(state.iteration, state.training.as_secs_f64());
        let size = (scene.camera.width as usize, scene.camera.height as usize);
        Ok(Self {
            scene,
            settings,
            session,
            stepper: new_stepper(scene, model, settings, session.backend)?,
            schedule: StepSchedule {
                iteration: state.iteration,
                sh_degree: settings.active_sh_degree(&position),
                learning_rates: vec![0.0; decays.len()],
                ..StepSchedule::default()
            },
            decays,
            arrays,
            static_arrays,
            state,
            last_view: 0,
            stopped_by_budget: false,
            remarks,
            loss: Loss::new(size.0, size.1),
            target: Vec::new(),
        })
    }

    fn run(&mut self) -> Result<(), ReconstructError> {
        while self.state.iteration < self.settings.iterations && !self.stopped_by_budget {
            self.state.iteration += 1;
            let position = self.position();
            self.timed(|trainer| trainer.step(&position))?;
            self.stopped_by_budget = self
                .settings
                .budget_seconds
                .is_some_and(|budget| self.state.training.as_secs_f64() >= budget);
            self.session.progress.advance(1);
            let iteration = self.state.iteration;
            let last = iteration == self.settings.iterations || self.stopped_by_budget;
            if last || iteration.is_multiple_of(CHECK_INTERVAL) {
                self.check()?;
            }
            // Before density control: a row right after an opacity reset says nothing of the scene.
            if last || iteration.is_multiple_of(self.settings.trace_every.max(1)) {
                self.record()?;
            }
            if !last {
                self.timed(|trainer| trainer.control_density(&position))?;
            }
            let interrupted = process::TERMINATION.is_requested() && !last;
            self.save_checkpoint(interrupted)?;
            if interrupted {
                return Err(ReconstructError::Interrupted {
                    scene: self.scene.id.clone(),
                    iteration,
                });
            }
        }
        Ok(())
    }

    /// Counts a part of training into the run's time; evaluation is not training.
    fn timed(
        &mut self,
        part: impl FnOnce(&mut Self) -> Result<(), ReconstructError>,
    ) -> Result<(), ReconstructError> {
        let (begun, cpu_begun) = (Instant::now(), process::cpu_time());
        part(self)?;
        self.state.training += begun.elapsed();
        self.state.training_cpu = sum_of_cpu_time(self.state.training_cpu, cpu_begun);
        Ok(())
    }

    fn position(&self) -> Position {
        let seconds = self.state.training.as_secs_f64();
        self.settings.position(self.state.iteration, seconds)
    }

    fn step(&mut self, position: &Position) -> Result<(), ReconstructError> {
        self.last_view = self.next_view();
        self.schedule.iteration = position.iteration;
        self.schedule.scheduled = position.scheduled;
        self.schedule.shift_frames = self.next_shift(position.scheduled);
        self.schedule.sh_degree = self.settings.active_sh_degree(position);
        for (rate, decay) in self.schedule.learning_rates.iter_mut().zip(&self.decays) {
            *rate = decay.at(position.share as f32);
        }
        self.stepper
            .step(self.last_view, &self.schedule)
            .map_err(|error| ReconstructError::of_engine(&self.scene.id, error))
    }

    /// Random views without replacement, epoch by epoch.
    fn next_view(&mut self) -> usize {
        if self.state.queue.is_empty() {
            self.state.queue.extend(0..self.scene.input_views.len());
            self.state.queue.shuffle(&mut self.state.random);
        }
        self.state.queue.pop().unwrap_or(0)
    }

    /// How early the next step's state is: temporal smoothing, noise on the time, or 0.
    fn next_shift(&mut self, scheduled: u64) -> f32 {
        let deformation = self.settings.deformation.as_ref();
        if let Some(noise) = deformation.and_then(|deformation| deformation.time_noise) {
            let normal: f32 = StandardNormal.sample(&mut self.state.random);
            return normal * noise.frames_at(scheduled);
        }
        let dynamics = self.settings.dynamics.as_ref();
        let Some(smoothing) = dynamics.and_then(|dynamics| dynamics.smoothing) else {
            return 0.0;
        };
        let random = &mut self.state.random;
        if random.random_bool(smoothing.probability) {
            random.random_range(-smoothing.reach_frames..=smoothing.reach_frames)
        } else {
            0.0
        }
    }

    fn control_density(&mut self, position: &Position) -> Result<(), ReconstructError> {
        let settings = &self.settings.densify;
        if settings.is_due(position) {
            let context = DensityContext {
                views: &self.scene.input_views,
                last_view: self.last_view,
                dynamics: self.settings.dynamics.as_ref(),
            };
            let model = self.stepper.model_mut()?;
            density::densify(
                model,
                settings,
                position.scheduled,
                &context,
                &mut self.state.random,
            );
            density::order::along_sphere(model, &self.scene.input_views);
        }
        if settings.resets_opacities(position, self.state.last_reset) {
            self.state.last_reset = position.scheduled;
            density::reset_opacities(self.stepper.model_mut()?);
        }
        Ok(())
    }

    /// Takes the backend's sums, and stops a run whose gradients are not worth following.
    fn check(&mut self) -> Result<(), ReconstructError> {
        let sums = self
            .stepper
            .take_sums()
            .map_err(|error| ReconstructError::of_engine(&self.scene.id, error))?;
        let rows = |array: usize| match self.arrays[array].name {
            // A step moves the pose of one view.
            CAMERA_ROTATIONS | CAMERA_CENTRES => 1,
            _ => self.rows(array),
        };
        if let Some(what) = too_much_refused(&self.arrays, rows, &sums) {
            return Err(ReconstructError::Diverged {
                scene: self.scene.id.clone(),
                iteration: self.state.iteration,
                what,
            });
        }
        self.state.since_trace.add(&sums);
        Ok(())
    }

    /// Adds a row to the trace.
    fn record(&mut self) -> Result<(), ReconstructError> {
        self.check()?;
        let begun = Instant::now();
        let novel = self.novel_scores()?;
        self.state.evaluation += begun.elapsed();
        let sums = std::mem::take(&mut self.state.since_trace);
        self.state.refused.resize(self.arrays.len(), 0);
        for (total, refused) in self.state.refused.iter_mut().zip(&sums.refused) {
            *total += refused;
        }
        let size = (self.stepper.gaussians(), self.table_bytes());
        let point = TracePoint::new(&self.state, &sums, size, &self.arrays, novel);
        self.session.progress.remark(&point.text());
        self.state.trace.push(point);
        if let Some(files) = &self.session.files {
            trace::write_csv(&files.trace, &self.state.trace)?;
        }
        Ok(())
    }

    /// How many rows an array has.
    fn rows(&self, array: usize) -> usize {
        match self.arrays[array].name {
            DEFORMATION_WEIGHTS => 1,
            CAMERA_ROTATIONS | CAMERA_CENTRES => self.scene.input_views.len(),
            _ if array < self.static_arrays => self.stepper.gaussians(),
            _ => self.stepper.moving_gaussians(),
        }
    }

    /// Bytes of everything that is trained.
    fn table_bytes(&self) -> u64 {
        let arrays = self.arrays.iter().enumerate();
        arrays
            .map(|(number, array)| memory::table_bytes(self.rows(number) as u64, &[*array]))
            .sum()
    }

    /// Mean PSNR and SSIM of the novel views.
    fn novel_scores(&mut self) -> Result<Option<[f64; 2]>, ReconstructError> {
        let views = &self.scene.novel_views;
        let mut sum = [0.0; 2];
        for view in views {
            let mut image = self.stepper.image(&view.view, self.schedule.sh_degree)?;
            self.settings.expose(&mut image, view.view.time_seconds);
            view.write_image(&mut self.target);
            let value = self.loss.value(&image.data, &self.target, 0.0);
            sum[0] += value.psnr();
            sum[1] += value.ssim;
        }
        Ok((!views.is_empty()).then(|| sum.map(|sum| sum / views.len() as f64)))
    }

    /// Writes a checkpoint where one is due, or `now`.
    fn save_checkpoint(&mut self, now: bool) -> Result<(), ReconstructError> {
        let Some(files) = &self.session.files else {
            return Ok(());
        };
        let every = files.checkpoint_every;
        if every == 0 || !(now || self.state.iteration.is_multiple_of(every)) {
            return Ok(());
        }
        self.check()?;
        let model = self.stepper.model()?;
        if let Some(what) = checkpoint::not_finite(model) {
            return Err(ReconstructError::Diverged {
                scene: self.scene.id.clone(),
                iteration: self.state.iteration,
                what,
            });
        }
        checkpoint::write(
            &files.checkpoint,
            &files.inputs_sha256,
            self.settings,
            &self.state,
            model,
        )?;
        Ok(())
    }

    fn finish(self) -> Trained<'a> {
        Trained {
            stepper: self.stepper,
            state: self.state,
            sh_degree: self.schedule.sh_degree,
            stopped_by_budget: self.stopped_by_budget,
            remarks: self.remarks,
        }
    }
}

/// `sum` and the processor time since `begun`.
fn sum_of_cpu_time(sum: Option<Duration>, begun: Option<Duration>) -> Option<Duration> {
    Some(sum? + process::cpu_time()?.saturating_sub(begun?))
}
