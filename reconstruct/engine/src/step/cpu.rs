//! Training steps on the CPU.
//!
//! A step renders all Gaussians for the view, computes the losses and their gradients, and updates every part
//! of the model with Adam. Losses of dynamic methods only are in `dynamic_losses.rs`.

use omnilife_schemas::{RgbImage, records::Backend};

use super::{
    StepStatistics, Stepper,
    camera_response::{ResponseMemory, ResponseSettings},
    dynamic_losses::{DynamicLosses, StepView},
    pose_refinement::{self, PoseRefinement},
    settings::TrainSettings,
    shards::{ShardMemory, Shards},
    size_limit::SizeLimit,
};
use crate::{
    EngineError,
    camera::View,
    gaussians::{
        ActivatedGaussians,
        dropout::Dropout,
        parameterization::Viewpoint,
        temporal::{PEAK_TIMES, TemporalFeatures},
    },
    losses::{
        maps::CountedPixels,
        photometric::{Columns, PixelMarks, cpu::Loss},
    },
    model::{Model, Part, TrainedArray, cpu_renderer::CpuRenderer, exposure::Exposure},
    parameters::{GradientMemory, ParameterArray, adam},
    schedule::StepSchedule,
    training_view::InputViews,
};

/// The model in memory, and all buffers that a step overwrites.
#[derive(Debug)]
pub struct CpuStepper<'a> {
    pub(super) inputs: InputViews<'a>,
    pub(super) ssim_weight: f32,
    pub(super) model: Model,
    /// Arrays of the model, in the order of learning rates and statistics.
    pub(super) arrays: Vec<TrainedArray>,
    pub(super) renderer: CpuRenderer,
    pub(super) activated: ActivatedGaussians,
    pub(super) gradient: ActivatedGaussians,
    pub(super) loss: Loss,
    dynamic: Option<DynamicLosses>,
    pub(super) exposure: Option<Exposure>,
    dropout: Option<Dropout>,
    size_limit: Option<SizeLimit>,
    response: Option<ResponseSettings>,
    response_memory: ResponseMemory,
    pose_refinement: Option<PoseRefinement>,
    shards: Option<Shards>,
    pub(super) shard_memory: ShardMemory,
    pub(super) target: Vec<f32>,
    /// True for saturated values of the image, if gains are removed from it.
    pub(super) saturated: Vec<bool>,
    mask: Vec<f32>,
    pub(super) statistics: StepStatistics,
}

impl<'a> CpuStepper<'a> {
    /// Creates a stepper before its first step.
    pub fn new(inputs: InputViews<'a>, mut model: Model, settings: &TrainSettings) -> Self {
        let [width, height] = inputs.size();
        if settings.shards.is_some() {
            for part in &mut model.parts {
                part.table.take_gradients(&mut GradientMemory::default());
            }
        }
        Self {
            inputs,
            ssim_weight: settings.ssim_weight,
            arrays: model.trained_arrays(),
            size_limit: SizeLimit::of(&model, settings),
            model,
            renderer: CpuRenderer::new(settings.renderer, settings.rendering),
            activated: ActivatedGaussians::default(),
            gradient: ActivatedGaussians::default(),
            loss: Loss::new(width, height, Columns::of(&inputs.camera)),
            dynamic: settings
                .dynamics
                .as_ref()
                .map(|dynamics| DynamicLosses::new(dynamics, settings.rendering)),
            // A response begins with the gains, and images keep theirs.
            exposure: (settings.exposure.clone()).filter(|_| settings.response.is_none()),
            dropout: settings.dropout,
            response: settings.response.clone(),
            response_memory: ResponseMemory::default(),
            pose_refinement: settings.pose_refinement,
            shards: settings.shards.clone(),
            shard_memory: ShardMemory::default(),
            target: Vec::new(),
            saturated: Vec::new(),
            mask: Vec::new(),
            statistics: StepStatistics::default(),
        }
    }

    fn features(&self) -> TemporalFeatures {
        self.dynamic
            .as_ref()
            .map_or_else(TemporalFeatures::default, DynamicLosses::features)
    }

    /// Writes the image with which a view's render is compared, its gain removed, and the saturated values of an
    /// image with gains, removed or learnt.
    pub(super) fn write_target(&mut self, number: usize) {
        let view = &self.inputs.views[number];
        match &self.exposure {
            Some(exposure) => {
                let seconds = view.view.time_seconds;
                exposure.write_normalized(&view.pixels, seconds, &mut self.target);
                view.write_saturated(&mut self.saturated);
            }
            None => view.write_image(&mut self.target),
        }
        if self.response.is_some() {
            view.write_saturated(&mut self.saturated);
        }
    }

    /// Computes the gradient of all losses by all Gaussians drawn from `at`; returns the loss and the mean
    /// squared error.
    fn differentiate(
        &mut self,
        number: usize,
        drawn: &View,
        at: &Viewpoint,
        schedule: &StepSchedule,
    ) -> (f64, f64) {
        self.write_target(number);
        let view = &self.inputs.views[number];
        let marks = PixelMarks {
            ignored: view.ignored.as_deref(),
            saturated: &self.saturated,
        };
        let raster = self
            .renderer
            .forward(drawn, &self.activated, schedule.sh_degree);
        let response =
            (self.model.response.as_ref()).map(|response| response.of_view(number, &drawn.camera));
        let shown = (self.response_memory).shown(response.as_ref(), &raster.colour);
        let (value, by_shown) =
            (self.loss).forward_backward_marked(marks, shown, &self.target, self.ssim_weight);
        let image_gradient =
            (self.response_memory).by_render(response.as_ref(), &raster.colour, by_shown);
        let mut total = value.total;
        let Some(dynamic) = &mut self.dynamic else {
            self.renderer.backward(
                drawn,
                &self.activated,
                image_gradient,
                &[],
                &mut self.gradient,
            );
            return (total, value.mse);
        };
        view.write_mask(&mut self.mask);
        let step = StepView {
            drawn,
            at,
            schedule,
            target: &self.target,
            saturated: marks.saturated,
            response: response.as_ref(),
            mask: view.mask.as_ref().map(|_| &self.mask[..]),
            counted: CountedPixels {
                ignored: marks.ignored,
            },
        };
        let (maps, feature_gradient) = dynamic.maps(raster, &step);
        total += maps;
        self.renderer.backward(
            drawn,
            &self.activated,
            image_gradient,
            feature_gradient,
            &mut self.gradient,
        );
        total += dynamic.supervise(
            &step,
            &self.model,
            &self.activated,
            &mut self.loss,
            &mut self.gradient,
        );
        (total, value.mse)
    }

    fn add_statistics(&mut self) {
        let half_size = self.inputs.half_size();
        let mut first = 0;
        for part in &mut self.model.parts {
            let (table, statistics) = (&part.table, &mut part.statistics);
            let len = table.len();
            let of_times = table
                .position(PEAK_TIMES)
                .filter(|_| !statistics.time_gradients.is_empty());
            self.renderer.for_each_visible(|mut visible| {
                if (first..first + len).contains(&visible.gaussian) {
                    visible.gaussian -= first;
                    if let Some(peaks) = of_times {
                        let by_peak = table.arrays[peaks].gradients[visible.gaussian];
                        statistics.time_gradients[visible.gaussian] += by_peak.abs();
                    }
                    statistics.add(std::iter::once(visible), half_size);
                }
            });
            first += len;
        }
    }

    /// Takes one step of Adam on all parts; arrays of one name share one step size.
    fn update(&mut self, schedule: &StepSchedule) {
        let Self {
            model,
            arrays,
            statistics,
            ..
        } = self;
        for part in &mut model.parts {
            update(part, schedule.iteration, arrays, schedule, statistics);
        }
    }
}

/// Takes step number `number` of Adam on a part. `arrays` are those of the model, in the order of step sizes.
pub(super) fn update(
    part: &mut Part,
    number: u64,
    arrays: &[TrainedArray],
    schedule: &StepSchedule,
    statistics: &mut StepStatistics,
) {
    statistics.refused.resize(arrays.len(), 0);
    let mut step = |array: &mut ParameterArray, number: u64, decay: adam::SecondMomentDecay| {
        let known = arrays.iter().position(|known| known.name == array.name);
        if let Some(index) = known {
            array.learning_rate = schedule.learning_rates[index];
            statistics.refused[index] += adam::cpu::step(array, number, decay) as u64;
        }
    };
    for array in &mut part.table.arrays {
        step(array, number, schedule.second_moments);
    }
    if let Some(shared) = part.parameterization.stepped_shared() {
        shared.steps += 1;
        step(
            &mut shared.array,
            shared.steps,
            adam::SecondMomentDecay::PUBLISHED,
        );
    }
    part.parameterization.keep_within_bounds(&mut part.table);
}

/// Returns an error that ends the run if its loss is not finite.
pub(super) fn require_finite(
    loss: f64,
    frame: u32,
    schedule: &StepSchedule,
) -> Result<(), EngineError> {
    if loss.is_finite() {
        return Ok(());
    }
    Err(EngineError::Diverged {
        iteration: schedule.iteration,
        what: format!("the loss of frame {frame} is {loss}"),
    })
}

impl Stepper for CpuStepper<'_> {
    fn backend(&self) -> Backend {
        Backend::Cpu {
            threads: rayon::current_num_threads() as u32,
        }
    }

    fn sizes(&self) -> &Model {
        &self.model
    }

    fn step(&mut self, number: usize, schedule: &StepSchedule) -> Result<(), EngineError> {
        if let Some(shards) = self.shards.clone() {
            return self.step_in_shards(&shards, number, schedule);
        }
        let view = &self.inputs.views[number];
        let drawn = self.model.corrected(&view.view);
        let at = Viewpoint::of_step(&drawn, schedule.shift_frames, schedule.scheduled);
        let features = self.features();
        self.model.activate(&at, &features, &mut self.activated);
        let dropout = self.dropout;
        let dropout = dropout.map(|all| all.of_step(schedule.iteration, schedule.scheduled));
        if let Some(dropout) = dropout {
            dropout.drop_out(&mut self.activated);
        }
        if let Some(limit) = self.size_limit {
            limit.cut(&mut self.model, &mut self.activated, &drawn);
        }
        let (mut total, squared_error) = self.differentiate(number, &drawn, &at, schedule);
        let by_pose = PoseRefinement::gradient(
            self.pose_refinement,
            schedule,
            &drawn,
            &self.activated,
            &self.gradient,
        );
        if let Some(dropout) = dropout {
            dropout.drop_out_vjp(&mut self.activated, &mut self.gradient);
        }
        self.model
            .activate_backward(&at, &features, &mut self.activated, &mut self.gradient);
        if let Some(dynamic) = &self.dynamic {
            total += dynamic.regularize_motion(&drawn, &at, &mut self.model);
        }
        require_finite(total, view.frame, schedule)?;
        self.add_statistics();
        self.statistics.steps += 1;
        self.statistics.loss += total;
        self.statistics.squared_error += squared_error;
        self.update(schedule);
        let Self {
            model,
            arrays,
            response,
            response_memory,
            statistics,
            ..
        } = self;
        response_memory.update(
            (&mut *model, &arrays[..]),
            number,
            response.as_ref(),
            schedule,
            statistics,
        );
        pose_refinement::move_pose(model, number, by_pose.as_ref(), schedule, statistics);
        Ok(())
    }

    fn take_statistics(&mut self) -> Result<StepStatistics, EngineError> {
        Ok(std::mem::take(&mut self.statistics))
    }

    fn model(&mut self) -> Result<&Model, EngineError> {
        Ok(&self.model)
    }

    fn model_mut(&mut self) -> Result<&mut Model, EngineError> {
        Ok(&mut self.model)
    }

    fn image(&mut self, view: &View, sh_degree: usize) -> Result<RgbImage, EngineError> {
        let drawn = self.model.corrected(view);
        let at = Viewpoint::of_image(&drawn);
        let none = TemporalFeatures::default();
        self.model.activate(&at, &none, &mut self.activated);
        let Some(response) = &self.model.response else {
            return Ok(self.renderer.image(&drawn, &self.activated, sh_degree));
        };
        let response = response.at(view.time_seconds, &drawn.camera);
        let raster = self.renderer.forward(&drawn, &self.activated, sh_degree);
        Ok(response.image(raster))
    }
}

#[cfg(test)]
mod tests;
