//! Training steps on the processor: static Gaussians, where they stand or where a network puts them.

use omnilife_schemas::{RgbImage, records::Backend};

use crate::error::EngineError;
use crate::training_view::InputViews;
use crate::{
    camera::View,
    gaussians::{InstantGaussians, deformable::Deformation, static_gaussians},
    losses::photometric::cpu::Loss,
    model::exposure::Exposure,
    parameters::adam,
};
use crate::{
    model::{Model, cpu_renderer::CpuRenderer, deformation_settings::DeformationSettings},
    schedule::StepSchedule,
    step::{
        StepSums, Stepper,
        pose_refinement::{self, PoseRefinement},
        settings::TrainSettings,
    },
};

/// The model in memory, and every buffer that a step fills anew.
#[derive(Debug)]
pub struct CpuStepper<'a> {
    inputs: InputViews<'a>,
    ssim_weight: f32,
    model: Model,
    renderer: CpuRenderer,
    deformation: Option<(DeformationSettings, Deformation)>,
    instant: InstantGaussians,
    gradient: InstantGaussians,
    loss: Loss,
    exposure: Option<Exposure>,
    pose_refinement: Option<PoseRefinement>,
    target: Vec<f32>,
    sums: StepSums,
}

impl<'a> CpuStepper<'a> {
    /// Ready for the first step.
    pub fn new(inputs: InputViews<'a>, model: Model, settings: &TrainSettings) -> Self {
        Self {
            inputs,
            ssim_weight: settings.ssim_weight,
            model,
            renderer: CpuRenderer::new(settings.renderer, settings.rendering),
            deformation: settings
                .deformation
                .map(|settings| (settings, Deformation::default())),
            instant: InstantGaussians::default(),
            gradient: InstantGaussians::default(),
            loss: Loss::new(inputs.size()[0], inputs.size()[1]),
            exposure: settings.exposure.clone(),
            pose_refinement: settings.pose_refinement,
            target: Vec::new(),
            sums: StepSums::default(),
        }
    }

    fn instantiate(&mut self, time: Option<f32>) {
        let (table, out) = (&self.model.table, &mut self.instant);
        match (time, &mut self.deformation, &self.model.deformation) {
            (Some(time), Some((settings, deformation)), Some(weights)) => {
                let weights = &weights.array.values;
                deformation.instantiate(&settings.model, weights, table, time, out);
            }
            _ => static_gaussians::instantiate(table, out),
        }
    }

    fn instantiate_vjp(&mut self, time: Option<f32>) {
        let table = &mut self.model.table;
        let (instant, gradient) = (&mut self.instant, &mut self.gradient);
        match (time, &mut self.deformation, &mut self.model.deformation) {
            (Some(time), Some((settings, deformation)), Some(weights)) => {
                let (model, weights) = (&settings.model, &mut weights.array);
                deformation.instantiate_vjp(model, weights, table, time, (instant, gradient));
            }
            _ => static_gaussians::instantiate_vjp(table, instant, gradient),
        }
    }

    /// One step of Adam on the Gaussians, and on the network where it took part.
    fn update(&mut self, schedule: &StepSchedule, with_network: bool) {
        let Self { model, sums, .. } = self;
        sums.refused.resize(schedule.learning_rates.len(), 0);
        for (index, array) in model.table.arrays.iter_mut().enumerate() {
            array.learning_rate = schedule.learning_rates[index];
            sums.refused[index] += adam::cpu::step(array, schedule.iteration) as u64;
        }
        if let Some(weights) = model.deformation.as_mut().filter(|_| with_network) {
            let index = model.table.arrays.len();
            weights.steps += 1;
            weights.array.learning_rate = schedule.learning_rates[index];
            sums.refused[index] += adam::cpu::step(&mut weights.array, weights.steps) as u64;
        }
    }
}

impl Stepper for CpuStepper<'_> {
    fn backend(&self) -> Backend {
        Backend::Cpu {
            threads: rayon::current_num_threads() as u32,
        }
    }

    fn gaussians(&self) -> usize {
        self.model.table.len()
    }

    fn step(&mut self, number: usize, schedule: &StepSchedule) -> Result<(), EngineError> {
        let view = &self.inputs.views[number];
        let drawn = self.model.corrected(&view.view);
        let deformation = self.deformation.as_ref();
        let time = deformation.and_then(|(settings, _)| settings.step_time(&view.view, schedule));
        self.instantiate(time);
        let raster = self
            .renderer
            .forward(&drawn, &self.instant, schedule.sh_degree);
        view.write_image(&mut self.target);
        if let Some(exposure) = &self.exposure {
            exposure.normalize(&mut self.target, view.view.time_seconds);
        }
        let (value, image_gradient) =
            self.loss
                .forward_backward(&raster.colour, &self.target, self.ssim_weight);
        if !value.total.is_finite() {
            return Err(EngineError::Diverged {
                iteration: schedule.iteration,
                what: format!("the loss of frame {} is {}", view.frame, value.total),
            });
        }
        self.renderer
            .backward(&drawn, &self.instant, image_gradient, &mut self.gradient);
        let by_pose = PoseRefinement::gradient(
            self.pose_refinement,
            schedule,
            &drawn,
            &self.instant,
            &self.gradient,
        );
        self.instantiate_vjp(time);
        let half_size = self.inputs.half_size();
        self.renderer.add_to(&mut self.model.statistics, half_size);
        self.sums.steps += 1;
        self.sums.loss += value.total;
        self.sums.squared_error += value.mse;
        self.update(schedule, time.is_some());
        let Self { model, sums, .. } = self;
        pose_refinement::move_pose(model, number, by_pose.as_ref(), schedule, sums);
        Ok(())
    }

    fn take_sums(&mut self) -> Result<StepSums, EngineError> {
        Ok(std::mem::take(&mut self.sums))
    }

    fn model(&mut self) -> Result<&Model, EngineError> {
        Ok(&self.model)
    }

    fn model_mut(&mut self) -> Result<&mut Model, EngineError> {
        Ok(&mut self.model)
    }

    fn image(&mut self, view: &View, sh_degree: usize) -> Result<RgbImage, EngineError> {
        let network = self
            .deformation
            .as_ref()
            .zip(self.model.deformation.as_ref());
        let time = network.and_then(|((settings, _), weights)| settings.image_time(view, weights));
        self.instantiate(time);
        let drawn = self.model.corrected(view);
        Ok(self.renderer.image(&drawn, &self.instant, sh_degree))
    }
}
