//! The training loop: it orders calls and holds no mathematics. It knows a learner, but not the learner's model.
//!
//! * [`trace`]: progress, row by row; [`trace_views`]: the novel views at these rows;
//!   `surface_faults`: ghosts and holes there; [`input_psnr`]: PSNR of input views there, by region. [`watch`]: a page
//!   and event files that show the rows.
//! * [`checkpoint`]: saved state; `resume`: resuming from it; `nonfinite`: the stop on values that are not
//!   finite.

pub mod checkpoint;
pub mod input_psnr;
mod nonfinite;
mod resume;
mod surface_faults;
pub mod trace;
pub mod trace_views;
pub mod watch;

use std::{
    path::PathBuf,
    time::{Duration, Instant},
};

use omnilife_engine::{EngineError, schedule::Position, step::settings::TrainSettings};
use omnilife_schemas::{elapsed::Elapsed, progress::Progress};
use rand::seq::SliceRandom;
use serde::{Deserialize, Serialize};

use self::{
    checkpoint::LoopState,
    input_psnr::InputPsnr,
    nonfinite::too_many_nonfinite,
    resume::resume,
    surface_faults::KnownSurfaces,
    trace::TracePoint,
    trace_views::TraceViews,
    watch::{Watch, WatchFiles, WatchedRow},
};
use crate::{
    error::ReconstructError, learner::Learner, process, request::BackendChoice,
    scene::TrainingScene,
};

/// Iterations between two checks of the backend's sums.
const CHECK_INTERVAL: u64 = 100;

/// Environment of a run: progress, files and backend.
#[derive(Clone)]
pub struct Session<'a> {
    /// Receives the progress.
    pub progress: &'a dyn Progress,
    /// Files of trace and checkpoints; `None` in tests and previews.
    pub files: Option<TrainingFiles>,
    /// Backend of the steps.
    pub backend: BackendChoice,
    /// Time of the run before its first step. It counts as training.
    pub planning: Elapsed,
}

/// Files that training writes as it goes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TrainingFiles {
    /// CSV of the trace.
    pub trace: PathBuf,
    /// Novel views that are rendered at its rows.
    pub trace_views: Option<TraceViews>,
    /// Views of the training while it learns.
    pub watch: WatchFiles,
    /// The checkpoint; read at the start if it exists.
    pub checkpoint: PathBuf,
    /// Iterations between two checkpoints; 0 writes none.
    pub checkpoint_every: u64,
    /// Hash of all inputs of the run.
    pub inputs_sha256: String,
}

impl<'a> Session<'a> {
    /// Returns a session on the CPU without files.
    pub fn without_files(progress: &'a dyn Progress) -> Self {
        Self {
            progress,
            files: None,
            backend: BackendChoice::Cpu,
            planning: Elapsed::default(),
        }
    }
}

/// Length of a run, and settings of the loop's views and trace.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LoopSettings {
    /// Steps of the optimizer.
    pub iterations: u64,
    /// Ends training after this time in planning and steps, seconds of wall clock, whatever the
    /// iterations.
    pub budget_seconds: Option<f64>,
    /// Seed of the order of views.
    pub seed: u64,
    /// Iterations from one row of the trace to the next. `None`: rows at equal ratios of CPU time, two per
    /// octave. Rows before the first step and after the last one are added.
    pub trace_every: Option<u64>,
}

impl LoopSettings {
    /// Returns the position of a run in its schedule. Under a time budget the schedule has the time after
    /// planning.
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

/// Result of a training.
#[derive(Debug)]
pub struct TrainingOutcome {
    /// Final state of the loop, with the trace.
    pub state: LoopState,
    /// True if the time budget ended the run before its last iteration.
    pub stopped_by_budget: bool,
    /// Warnings for readers of the scores.
    pub warnings: Vec<String>,
}

/// Trains `learner` on the scene's input views, from the session's checkpoint if it exists.
///
/// On the CPU the result depends on the settings and the scene alone, not on the number of threads or on
/// interruptions, unless a time budget stops it.
///
/// # Errors
/// When the loss or a large share of an array's gradients is not finite, the checkpoint is damaged, a file cannot
/// be written or the backend fails.
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
    if outcome.is_err() {
        let row = shown_row(&trainer.state, &settings, session, false);
        trainer.watch.stop(&row);
    }
    outcome.map(|()| trainer.finish())
}

struct Trainer<'a> {
    scene: &'a TrainingScene,
    settings: LoopSettings,
    session: &'a Session<'a>,
    learner: &'a mut dyn Learner,
    state: LoopState,
    /// Known surfaces for the measure of ghosts and holes.
    surfaces: Option<KnownSurfaces>,
    /// Page and event files.
    watch: Watch,
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
        let watch = match &session.files {
            Some(files) => Watch::begin(&files.watch, state.iteration)?,
            None => Watch::default(),
        };
        Ok(Self {
            scene,
            settings,
            session,
            learner,
            state,
            surfaces: None,
            watch,
            stopped_by_budget: false,
            warnings,
        })
    }

    /// Reads the scene's known distances. Unusable ones cause a warning, for a method need not use them.
    fn find_surfaces(&mut self) {
        if self.session.files.is_none() {
            return;
        }
        let begun = Instant::now();
        match KnownSurfaces::of(self.scene) {
            Ok(surfaces) => self.surfaces = surfaces,
            Err(error) => {
                let warning = format!("no ghosts and holes are measured: {error}");
                self.session.progress.note(&format!("warning: {warning}"));
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
            // Before density control: a row right after an opacity reset does not represent the scene.
            if last || self.is_row_due() {
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

    /// Adds the time of a part of training to the run's; evaluation is not training.
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

    fn named(&self, error: EngineError) -> ReconstructError {
        ReconstructError::of_engine(&self.scene.id, error)
    }

    /// Draws random views without replacement, epoch by epoch.
    fn next_view(&mut self) -> usize {
        if self.state.queue.is_empty() {
            self.state.queue.extend(0..self.scene.input_views.len());
            self.state.queue.shuffle(&mut self.state.view_order);
        }
        self.state.queue.pop().unwrap_or(0)
    }

    /// Adds up the statistics since the last check, and stops a run whose values are not finite.
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

    /// Returns true if the trace has a row after this iteration, whether or not the run ends there.
    fn is_row_due(&self) -> bool {
        match self.settings.trace_every {
            Some(every) => self.state.iteration.is_multiple_of(every.max(1)),
            None => trace::is_due(&self.state),
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
        self.show(last)
    }

    /// Shows the last row of the trace on the page and in TensorBoard.
    fn show(&mut self, is_last: bool) -> Result<(), ReconstructError> {
        let begun = Instant::now();
        let row = shown_row(&self.state, &self.settings, self.session, is_last);
        self.watch.show(&row, self.scene, self.learner)?;
        self.state.evaluation += begun.elapsed();
        Ok(())
    }

    /// Returns true if novel views are written at the rows of the trace: then ghosts, holes and input views are
    /// measured there too.
    fn keeps_novel_views(&self) -> bool {
        let files = self.session.files.as_ref();
        let kept = files.and_then(|files| files.trace_views.as_ref());
        kept.is_some_and(|kept| !kept.frames.is_empty())
    }

    /// Writes the current novel views, for the benchmark to score.
    fn keep_novel_views(&mut self) -> Result<(), ReconstructError> {
        let files = self.session.files.as_ref();
        let Some(kept) = files.and_then(|files| files.trace_views.as_ref()) else {
            return Ok(());
        };
        kept.write(self.state.iteration, &self.scene.novel_views, |view| {
            Ok(self.learner.image(&view.view)?)
        })
    }

    /// Writes a checkpoint if one is due, or if `now` is true.
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
            &self.scene.normalization,
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

fn shown_row<'a>(
    state: &'a LoopState,
    settings: &LoopSettings,
    session: &'a Session<'_>,
    is_last: bool,
) -> WatchedRow<'a> {
    let files = session.files.as_ref();
    WatchedRow {
        state,
        iterations: settings.iterations,
        trace_views: files.and_then(|files| files.trace_views.as_ref()),
        is_last,
    }
}

/// Returns `sum` and the CPU time since `begun`.
fn sum_of_cpu_time(sum: Option<Duration>, begun: Option<Duration>) -> Option<Duration> {
    Some(sum? + process::own_cpu_time()?.saturating_sub(begun?))
}
