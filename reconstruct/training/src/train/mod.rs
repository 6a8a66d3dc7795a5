//! The training loop: it orders calls and holds no mathematics. It knows a learner and nothing of what
//! that is made of.
//!
//! * [`timing`]: what a step takes; [`trace`]: where it stood, row by row; [`trace_views`]: the
//!   novel views at these rows; `surface_faults`: ghosts and holes there; [`input_psnr`]: how well input views are
//!   met there, by region; [`checkpoint`]: how a run survives
//!   an interruption; `resume`: how it goes on; `nonfinite`: when it stops for want of numbers.

pub mod checkpoint;
pub mod input_psnr;
mod nonfinite;
mod resume;
mod surface_faults;
pub mod timing;
pub mod trace;
pub mod trace_views;

use std::{
    path::PathBuf,
    time::{Duration, Instant},
};

use omnilife_engine::{EngineError, schedule::Position, step::settings::TrainSettings};
use omnilife_schemas::{elapsed::Elapsed, progress::Progress};
use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};

use self::{
    checkpoint::LoopState, input_psnr::InputPsnr, nonfinite::too_many_nonfinite, resume::resume,
    surface_faults::KnownSurfaces, trace::TracePoint, trace_views::TraceViews,
};
use crate::{
    error::ReconstructError, learner::Learner, process, request::BackendChoice,
    scene::TrainingScene,
};

/// Iterations between two looks at what the backend has summed up.
const CHECK_INTERVAL: u64 = 100;

/// What surrounds a run: who hears of it, where it goes, what computes it.
#[derive(Clone)]
pub struct Session<'a> {
    /// Hears how far it is.
    pub progress: &'a dyn Progress,
    /// Where trace and checkpoints go; nowhere in tests and previews.
    pub files: Option<TrainingFiles>,
    /// What computes the steps.
    pub backend: BackendChoice,
    /// What the run took before its first step. It counts as training.
    pub planning: Elapsed,
}

/// Files that training writes as it goes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TrainingFiles {
    /// CSV of the trace.
    pub trace: PathBuf,
    /// Novel views that are rendered at its rows.
    pub trace_views: Option<TraceViews>,
    /// The checkpoint; read at the beginning when it is there.
    pub checkpoint: PathBuf,
    /// Iterations between two checkpoints; 0 writes none.
    pub checkpoint_every: u64,
    /// Hash of everything that went into the run.
    pub inputs_sha256: String,
}

impl<'a> Session<'a> {
    /// A run on the CPU that leaves no files.
    pub fn without_files(progress: &'a dyn Progress) -> Self {
        Self {
            progress,
            files: None,
            backend: BackendChoice::Cpu,
            planning: Elapsed::default(),
        }
    }
}

/// How long a run is, and what the loop draws and writes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LoopSettings {
    /// Steps of the optimizer.
    pub iterations: u64,
    /// Ends training after this time in planning and steps, seconds of wall clock, whatever the
    /// iterations.
    pub budget_seconds: Option<f64>,
    /// Seed of the order of views.
    pub seed: u64,
    /// Iterations from one row of the trace to the next; none: rows after 1, 2, 3, 4, 6, 8, 11, 16 ... iterations,
    /// at equal ratios. Before the first step and after the last one there are rows too.
    pub trace_every: Option<u64>,
}

impl LoopSettings {
    /// Returns true where the trace has a row after these iterations, whether or not the run ends there.
    fn has_row(&self, iteration: u64) -> bool {
        self.trace_every.map_or_else(
            || trace::is_half_octave(iteration),
            |every| iteration.is_multiple_of(every.max(1)),
        )
    }

    /// Where in its schedule a run stands. Under a time budget the schedule has the time that planning
    /// leaves.
    fn position(&self, iteration: u64, training: Duration, planning: Duration) -> Position {
        let steps = training.saturating_sub(planning).as_secs_f64();
        let left = |budget: f64| (budget - planning.as_secs_f64()).max(f64::MIN_POSITIVE);
        Position::new(
            self.iterations,
            self.budget_seconds.map(left),
            iteration,
            steps,
        )
    }
}

impl From<&TrainSettings> for LoopSettings {
    fn from(settings: &TrainSettings) -> Self {
        Self {
            iterations: settings.iterations,
            budget_seconds: settings.budget_seconds,
            seed: settings.seed,
            trace_every: settings.trace_every,
        }
    }
}

/// How a training ended.
#[derive(Debug)]
pub struct TrainingOutcome {
    /// Where the loop ended, with the trace.
    pub state: LoopState,
    /// Whether the time budget ended the run before its last iteration.
    pub stopped_by_budget: bool,
    /// Lines that a reader of the scores should know.
    pub warnings: Vec<String>,
}

/// Trains `learner` on the scene's input views, from the session's checkpoint where there is one.
///
/// On the CPU the result depends on the settings and the scene alone, not on the number of threads or
/// on interruptions - unless a time budget stops it.
///
/// # Errors
/// When the loss or a large share of an array's gradients is not finite, the checkpoint is damaged,
/// a file cannot be written or the backend fails.
pub fn train(
    scene: &TrainingScene,
    learner: &mut dyn Learner,
    settings: LoopSettings,
    session: &Session<'_>,
) -> Result<TrainingOutcome, ReconstructError> {
    let mut trainer = Trainer::begin(scene, learner, settings, session)?;
    let left = settings.iterations - trainer.state.iteration.min(settings.iterations);
    session.progress.begin("training", Some(left));
    let guard = process::TERMINATION.guard();
    let outcome = trainer.run();
    drop(guard);
    session.progress.end();
    outcome.map(|()| trainer.finish())
}

struct Trainer<'a> {
    scene: &'a TrainingScene,
    settings: LoopSettings,
    session: &'a Session<'a>,
    learner: &'a mut dyn Learner,
    state: LoopState,
    /// Where ghosts and holes are looked for.
    surfaces: Option<KnownSurfaces>,
    stopped_by_budget: bool,
    warnings: Vec<String>,
}

impl<'a> Trainer<'a> {
    fn begin(
        scene: &'a TrainingScene,
        learner: &'a mut dyn Learner,
        settings: LoopSettings,
        session: &'a Session<'a>,
    ) -> Result<Self, ReconstructError> {
        let mut warnings = Vec::new();
        let state = resume(learner, &settings, session, &mut warnings)?;
        Ok(Self {
            scene,
            settings,
            session,
            learner,
            state,
            surfaces: None,
            stopped_by_budget: false,
            warnings,
        })
    }

    /// Reads the distances that the scene knows; what makes them unusable is a warning, for a method need
    /// not use them.
    fn find_surfaces(&mut self) {
        if self.session.files.is_none() {
            return;
        }
        let begun = Instant::now();
        match KnownSurfaces::of(self.scene) {
            Ok(surfaces) => self.surfaces = surfaces,
            Err(error) => {
                let warning = format!("no ghosts and holes are measured: {error}");
                self.session.progress.note(&warning);
                self.warnings.push(warning);
            }
        }
        self.state.evaluation += begun.elapsed();
    }

    fn run(&mut self) -> Result<(), ReconstructError> {
        self.find_surfaces();
        if self.state.iteration == 0 {
            self.record(false)?;
        }
        while self.state.iteration < self.settings.iterations && !self.stopped_by_budget {
            self.state.iteration += 1;
            let iteration = self.state.iteration;
            let planning = self.session.planning.wall();
            let position = (self.settings).position(iteration, self.state.training, planning);
            let view = self.next_view();
            self.timed(|learner| learner.step(view, &position))?;
            self.stopped_by_budget = self
                .settings
                .budget_seconds
                .is_some_and(|budget| self.state.training.as_secs_f64() >= budget);
            self.session.progress.advance(1);
            let last = iteration == self.settings.iterations || self.stopped_by_budget;
            if last || iteration.is_multiple_of(CHECK_INTERVAL) {
                self.check()?;
            }
            // Before density control: a row right after an opacity reset says nothing of the scene.
            if last || self.settings.has_row(iteration) {
                self.record(last)?;
            }
            if !last {
                self.timed(|learner| learner.maintain(&position))?;
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
        part: impl FnOnce(&mut dyn Learner) -> Result<(), EngineError>,
    ) -> Result<(), ReconstructError> {
        let (begun, cpu_begun) = (Instant::now(), process::own_cpu_time());
        part(self.learner).map_err(|error| self.named(error))?;
        self.state.training += begun.elapsed();
        self.state.training_cpu = sum_of_cpu_time(self.state.training_cpu, cpu_begun);
        Ok(())
    }

    /// An error of the engine with the scene's name.
    fn named(&self, error: EngineError) -> ReconstructError {
        ReconstructError::of_engine(&self.scene.id, error)
    }

    /// Random views without replacement, epoch by epoch.
    fn next_view(&mut self) -> usize {
        if self.state.queue.is_empty() {
            self.state.queue.extend(0..self.scene.input_views.len());
            self.state.queue.shuffle(&mut self.state.view_order);
        }
        self.state.queue.pop().unwrap_or(0)
    }

    /// Adds up what happened since the last look, and stops a run that is not worth its time.
    fn check(&mut self) -> Result<(), ReconstructError> {
        let statistics = self
            .learner
            .take_statistics()
            .map_err(|error| self.named(error))?;
        self.state.since_trace.add(&statistics);
        match too_many_nonfinite(&self.learner.arrays(), &statistics) {
            None => Ok(()),
            Some(what) => Err(ReconstructError::Diverged {
                scene: self.scene.id.clone(),
                iteration: self.state.iteration,
                what,
            }),
        }
    }

    /// Adds a row to the trace; the views of the last one are the run's predictions.
    fn record(&mut self, last: bool) -> Result<(), ReconstructError> {
        self.check()?;
        let begun = Instant::now();
        if !last {
            self.keep_novel_views()?;
        }
        let is_due = last || self.keeps_novel_views();
        let faults = match &self.surfaces {
            Some(surfaces) if is_due => surfaces.faults(self.learner)?,
            _ => None,
        };
        let input_psnr = match &self.session.files {
            Some(_) if is_due => InputPsnr::of(self.scene, self.learner)?,
            _ => None,
        };
        self.state.evaluation += begun.elapsed();
        let statistics = std::mem::take(&mut self.state.since_trace);
        let arrays = self.learner.arrays();
        self.state.refused.resize(arrays.len(), 0);
        for (total, refused) in self.state.refused.iter_mut().zip(&statistics.refused) {
            *total += refused;
        }
        let size = self.learner.size();
        let mut point = TracePoint::new(&self.state, &statistics, size, &arrays);
        point.surfaces = faults;
        point.input_psnr = input_psnr;
        let planning_seconds = self.session.planning.wall_seconds;
        self.session.progress.status(&point.text(planning_seconds));
        self.state.trace.push(point);
        if let Some(files) = &self.session.files {
            trace::write_csv(&files.trace, &self.state.trace)?;
        }
        Ok(())
    }

    /// Whether novel views are left at the rows of the trace: then ghosts, holes and input views are measured there
    /// too.
    fn keeps_novel_views(&self) -> bool {
        let files = self.session.files.as_ref();
        let kept = files.and_then(|files| files.trace_views.as_ref());
        kept.is_some_and(|kept| !kept.frames.is_empty())
    }

    /// Leaves the novel views as they are now, for the benchmark to score.
    fn keep_novel_views(&mut self) -> Result<(), ReconstructError> {
        let files = self.session.files.as_ref();
        let Some(kept) = files.and_then(|files| files.trace_views.as_ref()) else {
            return Ok(());
        };
        kept.write(self.state.iteration, &self.scene.novel_views, |view| {
            Ok(self.learner.image(&view.view)?)
        })
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
        let saved = self.learner.save().map_err(|error| self.named(error))?;
        checkpoint::write(
            &files.checkpoint,
            &files.inputs_sha256,
            &self.settings,
            &self.state,
            &saved,
        )?;
        Ok(())
    }

    fn finish(self) -> TrainingOutcome {
        TrainingOutcome {
            state: self.state,
            stopped_by_budget: self.stopped_by_budget,
            warnings: self.warnings,
        }
    }
}

/// `sum` and the CPU time since `begun`.
fn sum_of_cpu_time(sum: Option<Duration>, begun: Option<Duration>) -> Option<Duration> {
    Some(sum? + process::own_cpu_time()?.saturating_sub(begun?))
}
