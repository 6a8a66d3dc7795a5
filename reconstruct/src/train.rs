//! The training loop: it orders calls and holds no mathematics.

use std::time::{Duration, Instant};

use omnilife_schemas::progress::Progress;
use rand::{SeedableRng, seq::SliceRandom};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

use crate::{
    densify::{self, DensifySettings, Statistics},
    error::ReconstructError,
    gaussians::{GaussianTable, InstantGaussians, static_gaussians as parameterization},
    kernels::{
        adam,
        loss::{LossValue, cpu::Loss},
        raster::RasterGradient,
    },
    optim::Decay,
    render::{RenderSettings, Renderer},
    scene::{SceneView, TrainingScene},
};

/// Step sizes of the parameter arrays.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LearningRates {
    /// Of centres, in normalized units.
    pub positions: Decay,
    /// Of logarithmic scales.
    pub log_scales: Decay,
    /// Of quaternions.
    pub quaternions: Decay,
    /// Of opacity logits.
    pub opacity_logits: Decay,
    /// Of constant spherical harmonics.
    pub sh_constant: Decay,
}

/// Everything the loop needs to know.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainSettings {
    /// Steps of the optimizer.
    pub iterations: u64,
    /// Stops after this time in training steps, seconds of wall clock, whatever the iterations; what
    /// the trace renders does not count.
    pub budget_seconds: Option<f64>,
    /// Seed of view order and split noise.
    pub seed: u64,
    /// Weight of `1 - SSIM` against L1.
    pub ssim_weight: f32,
    /// Colour behind everything.
    pub background: [f32; 3],
    /// Gaussians nearer than this, in normalized units, are not drawn.
    pub near: f32,
    /// Step sizes.
    pub learning_rates: LearningRates,
    /// Density control.
    pub densify: DensifySettings,
    /// Entries of the trace over the run, evenly spread, the last iteration included.
    pub trace_points: u64,
}

/// One row of error against run time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TracePoint {
    /// Training time so far; the trace's own renders are not counted.
    pub wall_seconds: f64,
    /// Iterations done.
    pub iteration: u64,
    /// Gaussians.
    pub gaussians: u64,
    /// Bytes of parameters, gradients and moments.
    pub table_bytes: u64,
    /// Mean training loss since the row before.
    pub train_loss: f64,
    /// PSNR of the mean squared error over the training steps since the row before, dB.
    pub train_psnr_db: f64,
    /// Mean PSNR of the novel views, dB; empty without novel views.
    pub novel_psnr_db: Option<f64>,
    /// Mean SSIM of the novel views (the loss's SSIM, which wraps at the seam).
    pub novel_ssim: Option<f64>,
}

/// A trained model.
#[derive(Debug, Clone)]
pub struct Trained {
    /// The Gaussians.
    pub table: GaussianTable,
    /// Error against run time.
    pub trace: Vec<TracePoint>,
    /// Iterations done.
    pub iterations: u64,
    /// Training time without the trace's renders.
    pub training: Duration,
    /// Gradient values that were not finite and were not applied.
    pub refused_gradients: u64,
    /// Whether the time budget ended the run before its last iteration.
    pub stopped_by_budget: bool,
}

impl Trained {
    /// A renderer set up as in training, and the Gaussians it draws.
    pub fn renderer(&self, settings: &TrainSettings) -> (Renderer, InstantGaussians) {
        let mut instant = InstantGaussians::default();
        parameterization::instantiate(&self.table, &mut instant);
        (new_renderer(settings), instant)
    }
}

/// Trains `table` on the scene's input views.
///
/// The result depends on the settings and the scene alone, not on the number of threads - unless a
/// time budget stops it.
///
/// # Errors
/// When the loss is not finite.
pub fn train(
    scene: &TrainingScene,
    table: GaussianTable,
    settings: &TrainSettings,
    progress: &dyn Progress,
) -> Result<Trained, ReconstructError> {
    let mut trainer = Trainer::new(scene, table, settings);
    progress.begin("training", Some(settings.iterations));
    let outcome = trainer.run(progress);
    progress.end();
    outcome.map(|()| trainer.finish())
}

fn new_renderer(settings: &TrainSettings) -> Renderer {
    Renderer::new(RenderSettings {
        background: settings.background,
        ..RenderSettings::new(settings.near)
    })
}

struct Trainer<'a> {
    scene: &'a TrainingScene,
    settings: &'a TrainSettings,
    table: GaussianTable,
    instant: InstantGaussians,
    gradient: InstantGaussians,
    renderer: Renderer,
    loss: Loss,
    target: Vec<f32>,
    statistics: Statistics,
    random: Pcg64Mcg,
    queue: Vec<usize>,
    iteration: u64,
    training: Duration,
    refused_gradients: u64,
    stopped_by_budget: bool,
    trace: Vec<TracePoint>,
    /// Loss, squared error and number of steps since the last row of the trace.
    since_trace: (f64, f64, u64),
}

impl<'a> Trainer<'a> {
    fn new(scene: &'a TrainingScene, table: GaussianTable, settings: &'a TrainSettings) -> Self {
        Self {
            scene,
            settings,
            statistics: Statistics::new(table.len()),
            table,
            instant: InstantGaussians::default(),
            gradient: InstantGaussians::default(),
            renderer: new_renderer(settings),
            loss: Loss::new(scene.camera.width as usize, scene.camera.height as usize),
            target: Vec::new(),
            random: Pcg64Mcg::seed_from_u64(settings.seed),
            queue: Vec::new(),
            iteration: 0,
            training: Duration::ZERO,
            refused_gradients: 0,
            stopped_by_budget: false,
            trace: Vec::new(),
            since_trace: (0.0, 0.0, 0),
        }
    }

    fn run(&mut self, progress: &dyn Progress) -> Result<(), ReconstructError> {
        let trace_interval = (self.settings.iterations / self.settings.trace_points.max(1)).max(1);
        while self.iteration < self.settings.iterations && !self.stopped_by_budget {
            let begun = Instant::now();
            self.iteration += 1;
            let value = self.step()?;
            self.control_density();
            self.training += begun.elapsed();
            self.stopped_by_budget = self
                .settings
                .budget_seconds
                .is_some_and(|budget| self.training.as_secs_f64() >= budget);
            self.since_trace.0 += value.total;
            self.since_trace.1 += value.mse;
            self.since_trace.2 += 1;
            progress.advance(1);
            let last = self.iteration == self.settings.iterations || self.stopped_by_budget;
            if self.iteration.is_multiple_of(trace_interval) || last {
                self.record(progress);
            }
        }
        Ok(())
    }

    fn step(&mut self) -> Result<LossValue, ReconstructError> {
        let view = self.next_view();
        self.set_learning_rates();
        parameterization::instantiate(&self.table, &mut self.instant);
        let raster = self.renderer.forward(&view.view, &self.instant);
        view.write_image(&mut self.target);
        let (value, image_gradient) =
            self.loss
                .forward_backward(&raster.colour, &self.target, self.settings.ssim_weight);
        if !value.total.is_finite() {
            return Err(ReconstructError::Diverged {
                scene: self.scene.id.clone(),
                iteration: self.iteration,
                what: format!("the loss of frame {} is {}", view.frame, value.total),
            });
        }
        self.renderer.backward(
            &view.view,
            &self.instant,
            &RasterGradient {
                colour: image_gradient,
                features: &[],
            },
            &mut self.gradient,
        );
        parameterization::instantiate_vjp(&mut self.table, &self.instant, &self.gradient);
        let half_size = [
            0.5 * self.scene.camera.width as f32,
            0.5 * self.scene.camera.height as f32,
        ];
        self.statistics.add(self.renderer.visible(), half_size);
        for array in &mut self.table.arrays {
            self.refused_gradients += adam::cpu::step(array, self.iteration) as u64;
        }
        Ok(value)
    }

    /// Random views without replacement, epoch by epoch.
    fn next_view(&mut self) -> &'a SceneView {
        let next = self.queue.pop().unwrap_or_else(|| {
            self.queue = (0..self.scene.input_views.len()).collect();
            self.queue.shuffle(&mut self.random);
            self.queue.pop().unwrap_or(0)
        });
        &self.scene.input_views[next]
    }

    fn set_learning_rates(&mut self) {
        let share = self.share_done();
        let rates = &self.settings.learning_rates;
        let arrays = &mut self.table.arrays;
        arrays[parameterization::POSITIONS].learning_rate = rates.positions.at(share);
        arrays[parameterization::LOG_SCALES].learning_rate = rates.log_scales.at(share);
        arrays[parameterization::QUATERNIONS].learning_rate = rates.quaternions.at(share);
        arrays[parameterization::OPACITY_LOGITS].learning_rate = rates.opacity_logits.at(share);
        arrays[parameterization::SH_CONSTANT].learning_rate = rates.sh_constant.at(share);
    }

    /// Share of the run that is over; under a time budget, the larger of both shares.
    fn share_done(&self) -> f32 {
        let by_iterations = self.iteration as f64 / self.settings.iterations.max(1) as f64;
        let by_time = self
            .settings
            .budget_seconds
            .map_or(0.0, |budget| self.training.as_secs_f64() / budget);
        by_iterations.max(by_time) as f32
    }

    fn control_density(&mut self) {
        let settings = &self.settings.densify;
        // Under a time budget the window is that share of the time.
        let due = (self.share_done() * self.settings.iterations as f32) as u64;
        let inside = (settings.begin_iteration..=settings.end_iteration).contains(&due);
        if inside
            && self
                .iteration
                .is_multiple_of(settings.interval_iterations.max(1))
        {
            densify::densify(
                &mut self.table,
                &self.statistics,
                settings,
                &mut self.random,
            );
            self.statistics = Statistics::new(self.table.len());
        }
        let reset = settings.opacity_reset_iterations;
        if due < settings.end_iteration && reset > 0 && self.iteration.is_multiple_of(reset) {
            densify::reset_opacities(&mut self.table);
        }
    }

    fn record(&mut self, progress: &dyn Progress) {
        parameterization::instantiate(&self.table, &mut self.instant);
        let mut novel = (0.0, 0.0);
        for view in &self.scene.novel_views {
            let image = self.renderer.image(&view.view, &self.instant);
            view.write_image(&mut self.target);
            let value = self.loss.value(&image.data, &self.target, 0.0);
            novel.0 += value.psnr();
            novel.1 += value.ssim;
        }
        let views = self.scene.novel_views.len();
        let mean = |sum: f64| (views > 0).then(|| sum / views as f64);
        let (loss, squared, steps) = std::mem::take(&mut self.since_trace);
        let steps = steps.max(1) as f64;
        let point = TracePoint {
            wall_seconds: self.training.as_secs_f64(),
            iteration: self.iteration,
            gaussians: self.table.len() as u64,
            table_bytes: self.table.bytes() as u64,
            train_loss: loss / steps,
            train_psnr_db: -10.0 * (squared / steps).max(1e-10).log10(),
            novel_psnr_db: mean(novel.0),
            novel_ssim: mean(novel.1),
        };
        let novel_text = point
            .novel_psnr_db
            .map_or(String::new(), |psnr| format!(", novel views {psnr:.2} dB"));
        progress.remark(&format!(
            "{} Gaussians, input views {:.2} dB{novel_text}",
            point.gaussians, point.train_psnr_db
        ));
        self.trace.push(point);
    }

    fn finish(self) -> Trained {
        Trained {
            table: self.table,
            trace: self.trace,
            iterations: self.iteration,
            training: self.training,
            refused_gradients: self.refused_gradients,
            stopped_by_budget: self.stopped_by_budget,
        }
    }
}
