//! Training steps on the processor.

use omnilife_schemas::{RgbImage, records::Backend};

use super::{
    cpu_renderer::CpuRenderer,
    settings::TrainSettings,
    step::{Model, StepSchedule, StepSums, Stepper},
};
use crate::{
    camera::View,
    error::ReconstructError,
    gaussians::{InstantGaussians, static_gaussians as parameterization},
    kernels::{adam, loss::cpu::Loss},
    scene::TrainingScene,
};

/// The model in memory, and every buffer that a step fills anew.
#[derive(Debug)]
pub struct CpuStepper<'a> {
    scene: &'a TrainingScene,
    ssim_weight: f32,
    model: Model,
    renderer: CpuRenderer,
    instant: InstantGaussians,
    gradient: InstantGaussians,
    loss: Loss,
    target: Vec<f32>,
    sums: StepSums,
}

impl<'a> CpuStepper<'a> {
    /// Ready for the first step.
    pub fn new(scene: &'a TrainingScene, model: Model, settings: &TrainSettings) -> Self {
        Self {
            scene,
            ssim_weight: settings.ssim_weight,
            model,
            renderer: CpuRenderer::new(settings.renderer, settings.rendering),
            instant: InstantGaussians::default(),
            gradient: InstantGaussians::default(),
            loss: Loss::new(scene.camera.width as usize, scene.camera.height as usize),
            target: Vec::new(),
            sums: StepSums::default(),
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

    fn step(&mut self, view: usize, schedule: &StepSchedule) -> Result<(), ReconstructError> {
        let view = &self.scene.input_views[view];
        let table = &mut self.model.table;
        parameterization::instantiate(table, &mut self.instant);
        let raster = self
            .renderer
            .forward(&view.view, &self.instant, schedule.sh_degree);
        view.write_image(&mut self.target);
        let (value, image_gradient) =
            self.loss
                .forward_backward(&raster.colour, &self.target, self.ssim_weight);
        if !value.total.is_finite() {
            return Err(ReconstructError::Diverged {
                scene: self.scene.id.clone(),
                iteration: schedule.iteration,
                what: format!("the loss of frame {} is {}", view.frame, value.total),
            });
        }
        self.renderer.backward(
            &view.view,
            &self.instant,
            image_gradient,
            &mut self.gradient,
        );
        parameterization::instantiate_vjp(table, &self.instant, &self.gradient);
        let half_size = [
            0.5 * self.scene.camera.width as f32,
            0.5 * self.scene.camera.height as f32,
        ];
        self.renderer.add_to(&mut self.model.statistics, half_size);
        self.sums.steps += 1;
        self.sums.loss += value.total;
        self.sums.squared_error += value.mse;
        self.sums.refused.resize(table.arrays.len(), 0);
        for (index, array) in table.arrays.iter_mut().enumerate() {
            array.learning_rate = schedule.learning_rates[index];
            self.sums.refused[index] += adam::cpu::step(array, schedule.iteration) as u64;
        }
        Ok(())
    }

    fn take_sums(&mut self) -> Result<StepSums, ReconstructError> {
        Ok(std::mem::take(&mut self.sums))
    }

    fn model(&mut self) -> Result<&Model, ReconstructError> {
        Ok(&self.model)
    }

    fn model_mut(&mut self) -> Result<&mut Model, ReconstructError> {
        Ok(&mut self.model)
    }

    fn image(&mut self, view: &View, sh_degree: usize) -> Result<RgbImage, ReconstructError> {
        parameterization::instantiate(&self.model.table, &mut self.instant);
        Ok(self.renderer.image(view, &self.instant, sh_degree))
    }
}
