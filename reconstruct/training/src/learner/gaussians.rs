//! Training of Gaussians: schedules, density control, and steps on a backend.

use std::path::Path;

use omnilife_engine::gaussians::{
    ActivatedGaussians, parameterization::Viewpoint, temporal::TemporalFeatures,
};
use omnilife_engine::model::Model;
use omnilife_engine::{
    EngineError,
    camera::View,
    density::{Densification, DensityContext},
    device::adapters::AdapterKind,
    model::{
        TrainedArray,
        saved::{LoadError, SavedModel},
    },
    parameters::{adam::SecondMomentDecay, short_schedule::LearningRate},
    schedule::{Position, StepSchedule},
    step::{
        BackendChoice, StepStatistics, Stepper, settings::TrainSettings, shards::Shards, stepper,
    },
};
use omnilife_schemas::{RgbImage, records::Backend};
use rand::RngExt;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

use super::{Learner, ModelSize, SavedLearner, work::StepWork};
use crate::{
    error::ReconstructError,
    formats,
    random::{Purpose, stream},
    scene::TrainingScene,
};

/// A model of Gaussians under a method's settings.
#[derive(Debug)]
pub struct GaussianLearner<'a> {
    scene: &'a TrainingScene,
    settings: TrainSettings,
    stepper: Box<dyn Stepper + 'a>,
    /// Step sizes of each trained array.
    rates: Vec<LearningRate>,
    schedule: StepSchedule,
    /// The last rendered view.
    last_view: usize,
    state: State,
}

/// Position of the schedules beside the iteration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct State {
    time_shift: Pcg64Mcg,
    density: Pcg64Mcg,
    /// The iteration of the schedule at the last reset of opacities.
    last_reset: u64,
    sh_degree: usize,
}

#[derive(Serialize, Deserialize)]
struct Header {
    settings: TrainSettings,
    state: State,
    model: SavedModel,
}

impl<'a> GaussianLearner<'a> {
    /// Makes a learner before its first step.
    ///
    /// # Errors
    /// When an array of the model has no learning rate in the settings, or the backend cannot train the model.
    pub fn new(
        scene: &'a TrainingScene,
        model: Model,
        settings: TrainSettings,
        backend: BackendChoice,
    ) -> Result<Self, ReconstructError> {
        let stepper = stepper(scene.inputs(), model, &settings, backend)?;
        Self::with_stepper(scene, stepper, settings)
    }

    /// Makes a learner with a stepper that was made with these settings.
    ///
    /// # Errors
    /// When an array of its model has no learning rate in the settings.
    pub fn with_stepper(
        scene: &'a TrainingScene,
        stepper: Box<dyn Stepper + 'a>,
        settings: TrainSettings,
    ) -> Result<Self, ReconstructError> {
        let rate = |array: &TrainedArray| {
            let known = settings.learning_rates.get(array.name).copied();
            known.ok_or_else(|| ReconstructError::Request {
                reason: format!(
                    "the method's settings have no learning rate for {}",
                    array.name
                ),
            })
        };
        let arrays = stepper.arrays();
        let rates = arrays.iter().map(rate).collect::<Result<Vec<_>, _>>()?;
        let begin = settings.position(0, 0.0);
        Ok(Self {
            stepper,
            schedule: StepSchedule {
                learning_rates: vec![0.0; rates.len()],
                ..StepSchedule::default()
            },
            rates,
            last_view: 0,
            state: State {
                time_shift: stream(settings.seed, Purpose::TimeShift),
                density: stream(settings.seed, Purpose::Density),
                last_reset: 0,
                sh_degree: settings.active_sh_degree(&begin),
            },
            scene,
            settings,
        })
    }

    /// Returns a warning for the start of a run: the adapter has less room than density control may need.
    pub fn room(&self) -> Option<String> {
        let room = self.stepper.most_gaussians()? as u64;
        let maximum = self.settings.densify.maximum_gaussians;
        let Backend::Gpu { adapter, .. } = self.stepper.backend() else {
            return None;
        };
        (maximum > room).then(|| {
            format!(
                "the largest buffer of {adapter} has room for {room} Gaussians of this method, which \
                 may have {maximum}: where it grows beyond, training ends; --set max-gaussians={room} \
                 keeps below"
            )
        })
    }

    /// Sets the step sizes of the next step, by the number of steps of the whole run.
    fn set_learning_rates(&mut self, at: &Position) {
        let share = at.share as f32;
        let iterations = at.real_iterations(self.settings.iterations) as f64;
        let short = self.settings.short_schedule;
        self.schedule.second_moments = short.map_or(SecondMomentDecay::PUBLISHED, |short| {
            short.second_moments(iterations)
        });
        for (next, rate) in self.schedule.learning_rates.iter_mut().zip(&self.rates) {
            *next = short.map_or_else(
                || rate.published.at(share),
                |short| short.rate(rate, share, iterations),
            );
        }
    }

    /// Returns the shift of the next step's Gaussians to earlier times: temporal smoothing, noise on the time, or
    /// 0.
    fn next_shift(&mut self, scheduled: u64) -> f32 {
        let random = &mut self.state.time_shift;
        let deformation = self.settings.deformation.as_ref();
        if let Some(noise) = deformation.and_then(|deformation| deformation.time_noise) {
            let normal: f32 = StandardNormal.sample(random);
            return normal * noise.frames_at(scheduled);
        }
        let dynamics = self.settings.dynamics.as_ref();
        match dynamics.and_then(|dynamics| dynamics.smoothing) {
            Some(smoothing) if random.random_bool(smoothing.probability) => {
                random.random_range(-smoothing.reach_frames..=smoothing.reach_frames)
            }
            _ => 0.0,
        }
    }
}

impl Learner for GaussianLearner<'_> {
    fn backend(&self) -> Backend {
        self.stepper.backend()
    }

    fn size(&self) -> ModelSize {
        // Values and two moments of all; gradients of all, or on the CPU of a shard at a time.
        let is_on_cpu = matches!(self.stepper.backend(), Backend::Cpu { .. });
        let shards = self.settings.shards.as_ref().filter(|_| is_on_cpu);
        let learning = shards.map_or(1.0, Shards::largest_share);
        let bytes = |array: &TrainedArray| {
            let values = array.values as u64;
            12 * values + (4.0 * learning * values as f64) as u64
        };
        ModelSize {
            primitives: self.stepper.gaussians() as u64,
            with_times: self.stepper.gaussians_with_times() as u64,
            objects: self.stepper.objects().map(|objects| objects as u64),
            bytes: self.stepper.arrays().iter().map(bytes).sum(),
        }
    }

    fn work(&self) -> Option<StepWork> {
        let arrays = self.stepper.arrays();
        let values = arrays.iter().map(|array| array.values as u64).sum();
        Some(StepWork::of(self.scene, &self.settings, values))
    }

    fn arrays(&self) -> Vec<TrainedArray> {
        self.stepper.arrays()
    }

    fn step(&mut self, view: usize, at: &Position) -> Result<(), EngineError> {
        self.last_view = view;
        self.state.sh_degree = self.settings.active_sh_degree(at);
        self.schedule.iteration = at.iteration;
        self.schedule.scheduled = at.scheduled;
        self.schedule.shift_frames = self.next_shift(at.scheduled);
        self.schedule.sh_degree = self.state.sh_degree;
        self.set_learning_rates(at);
        self.stepper.step(view, &self.schedule)
    }

    fn maintain(&mut self, at: &Position) -> Result<(), EngineError> {
        let settings = &self.settings.densify;
        if settings.is_due(at) {
            let dynamics = self.settings.dynamics.as_ref();
            let asked = Densification {
                settings,
                scheduled: at.scheduled,
                context: DensityContext {
                    views: &self.scene.input_views,
                    last_view: self.last_view,
                    temporal: dynamics.and_then(|dynamics| dynamics.density),
                },
            };
            self.stepper.densify(&asked, &mut self.state.density)?;
        }
        if settings.resets_opacities(at, self.state.last_reset) {
            self.state.last_reset = at.scheduled;
            self.stepper.reset_opacities()?;
        }
        Ok(())
    }

    fn take_statistics(&mut self) -> Result<StepStatistics, EngineError> {
        self.stepper.take_statistics()
    }

    fn image(&mut self, view: &View) -> Result<RgbImage, EngineError> {
        let mut image = self.stepper.image(view, self.state.sh_degree)?;
        // A response, which the stepper applies, has gains of its own.
        if let (Some(exposure), None) = (&self.settings.exposure, &self.settings.response) {
            exposure.apply(&mut image.data, view.time_seconds);
        }
        Ok(image)
    }

    fn gaussians(&mut self) -> Result<Option<&Model>, EngineError> {
        self.stepper.model().map(Some)
    }

    fn activated(
        &mut self,
        view: &View,
        out: &mut ActivatedGaussians,
    ) -> Result<Option<f32>, EngineError> {
        let model = self.stepper.model_mut()?;
        let at = Viewpoint::of_image(&model.corrected(view));
        model.activate(&at, &TemporalFeatures::default(), out);
        Ok(Some(self.settings.rendering.near))
    }

    fn save(&mut self) -> Result<SavedLearner, EngineError> {
        let model = self.stepper.model()?;
        if let Some(what) = model.not_finite() {
            return Err(EngineError::Diverged {
                iteration: self.schedule.iteration,
                what,
            });
        }
        let (model, body) = SavedModel::of(model);
        let header = Header {
            settings: self.settings.clone(),
            state: self.state.clone(),
            model,
        };
        let header = serde_json::to_string(&header).map_err(|error| EngineError::Backend {
            reason: format!("the checkpoint's header: {error}"),
        })?;
        Ok(SavedLearner { header, body })
    }

    fn restore(&mut self, saved: &SavedLearner) -> Result<(), LoadError> {
        let header: Header = serde_json::from_str(&saved.header)
            .map_err(|error| LoadError::Damaged(format!("its header is not readable: {error}")))?;
        if header.settings != self.settings {
            return Err(LoadError::Other);
        }
        let model = self
            .stepper
            .model_mut()
            .map_err(|error| LoadError::Damaged(error.to_string()))?;
        header.model.restore(&saved.body, model)?;
        self.state = header.state;
        Ok(())
    }

    fn export(&mut self, folder: &Path) -> Result<Vec<String>, ReconstructError> {
        let model = self.stepper.model()?;
        formats::write_model(folder, model, &self.settings, self.scene)
    }

    fn warnings(&self) -> Vec<String> {
        let none = self.stepper.gaussians() == 0;
        let none = none.then(|| "no Gaussian is left; the views show the background".to_owned());
        let slow = match self.stepper.backend() {
            Backend::Gpu {
                adapter, device, ..
            } if device == AdapterKind::Software.to_string() => Some(format!(
                "{adapter} is a software adapter: slower than the backend cpu"
            )),
            _ => None,
        };
        none.into_iter().chain(slow).collect()
    }
}
