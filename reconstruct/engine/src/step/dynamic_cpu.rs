//! Training steps of dynamic methods on the processor.
//!
//! A step renders all Gaussians at the view's moment, and where masks supervise them the dynamic ones
//! alone; it adds up the losses of Omni4DGS Eq. 12 or of PVG, and lets Adam move both tables.

use omnilife_schemas::{RgbImage, records::Backend};

use crate::error::EngineError;
use crate::losses;
use crate::training_view::InputViews;
use crate::{
    camera::View,
    gaussians::{
        InstantGaussians, static_gaussians, subset,
        temporal::{self, Look, PEAK_TIMES, TemporalFeatures},
    },
    losses::{maps, photometric::cpu::Loss},
    model::exposure::Exposure,
    parameters::adam,
    render::{cpu::Renderer, raster::RasterGradient},
    training_view::TrainingView,
};
use crate::{
    model::{Model, MovingGaussians, dynamic_settings::DynamicSettings},
    schedule::StepSchedule,
    step::{
        StepSums, Stepper,
        pose_refinement::{self, PoseRefinement},
        settings::TrainSettings,
    },
};

/// The model in memory, and every buffer that a step fills anew.
#[derive(Debug)]
pub struct DynamicStepper<'a> {
    inputs: InputViews<'a>,
    settings: DynamicSettings,
    ssim_weight: f32,
    model: Model,
    renderer: Renderer,
    instant: InstantGaussians,
    gradient: InstantGaussians,
    alone: DynamicAlone,
    loss: Loss,
    exposure: Option<Exposure>,
    pose_refinement: Option<PoseRefinement>,
    target: Vec<f32>,
    mask: Vec<f32>,
    /// By the feature maps.
    feature_gradient: Vec<f32>,
    sums: StepSums,
}

/// What renders the dynamic Gaussians alone.
#[derive(Debug)]
struct DynamicAlone {
    renderer: Renderer,
    instant: InstantGaussians,
    gradient: InstantGaussians,
    /// Positions in the table of moving Gaussians.
    members: Vec<usize>,
    target: Vec<f32>,
    opacity_gradient: Vec<f32>,
}

impl<'a> DynamicStepper<'a> {
    /// Ready for the first step.
    pub fn new(
        inputs: InputViews<'a>,
        model: Model,
        settings: &TrainSettings,
        dynamics: &DynamicSettings,
    ) -> Self {
        let renderer = || Renderer::new(settings.rendering);
        Self {
            inputs,
            settings: dynamics.clone(),
            ssim_weight: settings.ssim_weight,
            model,
            renderer: renderer(),
            instant: InstantGaussians::default(),
            gradient: InstantGaussians::default(),
            alone: DynamicAlone {
                renderer: renderer(),
                instant: InstantGaussians::default(),
                gradient: InstantGaussians::default(),
                members: Vec::new(),
                target: Vec::new(),
                opacity_gradient: Vec::new(),
            },
            loss: Loss::new(inputs.size()[0], inputs.size()[1]),
            exposure: settings.exposure.clone(),
            pose_refinement: settings.pose_refinement,
            target: Vec::new(),
            mask: Vec::new(),
            feature_gradient: Vec::new(),
            sums: StepSums::default(),
        }
    }

    /// Takes the gradient of all losses by all Gaussians as they are drawn, with the camera `drawn`;
    /// returns the loss and the mean squared error.
    fn differentiate(
        &mut self,
        view: &TrainingView,
        drawn: &View,
        look: &Look,
        schedule: &StepSchedule,
    ) -> (f64, f64) {
        let features = self.settings.features;
        self.renderer.settings.sh_degree = schedule.sh_degree;
        let raster = self.renderer.forward(drawn, &self.instant);
        view.write_image(&mut self.target);
        if let Some(exposure) = &self.exposure {
            exposure.normalize(&mut self.target, view.view.time_seconds);
        }
        view.write_mask(&mut self.mask);
        let (value, image_gradient) =
            self.loss
                .forward_backward(&raster.colour, &self.target, self.ssim_weight);
        let mut total = value.total;
        self.feature_gradient.clear();
        if features.count() > 0 {
            self.feature_gradient.resize(raster.features.len(), 0.0);
            total += map_losses(
                &self.settings,
                (&raster.features, &raster.transmittance),
                view.mask.as_ref().map(|_| &self.mask[..]),
                &mut self.feature_gradient,
            );
        }
        let upstream = RasterGradient {
            colour: image_gradient,
            features: &self.feature_gradient,
        };
        self.renderer
            .backward(drawn, &self.instant, &upstream, &mut self.gradient);
        total += self.supervise_dynamic(view, drawn, look, schedule);
        (total, value.mse)
    }

    /// `L_dynamic`: adds its gradient to that by all Gaussians. An empty dynamic set has none, and
    /// counts as a loss of 0.
    fn supervise_dynamic(
        &mut self,
        view: &TrainingView,
        drawn: &View,
        look: &Look,
        schedule: &StepSchedule,
    ) -> f64 {
        let (Some(dynamic), Some(_), Some(moving)) =
            (self.settings.dynamic_loss, &view.mask, &self.model.moving)
        else {
            return 0.0;
        };
        if schedule.scheduled < dynamic.begin_iteration {
            return 0.0;
        }
        let alone = &mut self.alone;
        let pulses = self.settings.time.pulses(&moving.table, look.observer);
        let threshold = self.settings.dynamic_below_staticness;
        let fixed = self.model.table.len();
        alone.members.clear();
        alone.members.extend(
            (0..moving.table.len())
                .filter(|&index| pulses.staticness(index) < threshold)
                .map(|index| fixed + index)
                .filter(|&entry| self.instant.opacities[entry] > 0.0),
        );
        if alone.members.is_empty() {
            return 0.0;
        }
        subset::gather(&self.instant, &alone.members, &mut alone.instant);
        alone.renderer.settings.sh_degree = schedule.sh_degree;
        let raster = alone.renderer.forward(drawn, &alone.instant);
        alone.target.clear();
        let masked = self.target.as_chunks::<3>().0.iter().zip(&self.mask);
        alone
            .target
            .extend(masked.flat_map(|(rgb, mask)| rgb.map(|value| value * mask)));
        let (value, image_gradient) =
            self.loss
                .forward_backward(&raster.colour, &alone.target, dynamic.ssim_weight);
        let image_gradient: Vec<f32> = image_gradient
            .iter()
            .map(|value| dynamic.weight * value)
            .collect();
        alone.opacity_gradient.clear();
        alone.opacity_gradient.resize(raster.features.len(), 0.0);
        let opacity = maps::opacity_map(
            &raster.features,
            &self.mask,
            dynamic.weight,
            &mut alone.opacity_gradient,
        );
        let upstream = RasterGradient {
            colour: &image_gradient,
            features: &alone.opacity_gradient,
        };
        alone
            .renderer
            .backward(drawn, &alone.instant, &upstream, &mut alone.gradient);
        subset::gather_vjp(&alone.gradient, &alone.members, &mut self.gradient);
        f64::from(dynamic.weight) * (value.total + opacity)
    }

    /// `L_m`: adds its gradient to the moving Gaussians' raw ones.
    fn regularize_motion(&mut self, look: &Look) -> f64 {
        let weight = self.settings.motion_weight;
        let Some(moving) = self.model.moving.as_mut().filter(|_| weight > 0.0) else {
            return 0.0;
        };
        let pulses = self.settings.time.pulses(&moving.table, look.observer);
        let threshold = self.settings.dynamic_below_staticness;
        let members: Vec<usize> = (0..moving.table.len())
            .filter(|&index| pulses.staticness(index) >= threshold)
            .collect();
        let cycle = self.settings.time.cycle_frames;
        let (value, gradients) =
            losses::motion::motion(&pulses, &members, look.moment.frame, cycle, weight);
        temporal::add_gradients(&mut moving.table, &gradients);
        f64::from(weight) * value
    }

    fn add_statistics(&mut self) {
        let half_size = self.inputs.half_size();
        let fixed = self.model.table.len();
        let visible = self.renderer.visible();
        let of_static = visible.filter(|visible| visible.gaussian < fixed);
        self.model.statistics.add(of_static, half_size);
        let Some(moving) = &mut self.model.moving else {
            return;
        };
        let MovingGaussians {
            table,
            statistics,
            time_gradients,
        } = moving;
        let of_moving = self.renderer.visible().filter_map(|mut visible| {
            visible.gaussian = visible.gaussian.checked_sub(fixed)?;
            Some(visible)
        });
        if let Some(peaks) = table.position(PEAK_TIMES) {
            let gradients = &table.arrays[peaks].gradients;
            for visible in of_moving {
                time_gradients[visible.gaussian] += gradients[visible.gaussian].abs();
                statistics.add(std::iter::once(visible), half_size);
            }
        } else {
            statistics.add(of_moving, half_size);
        }
    }

    /// One step of Adam on both tables, whose arrays of one name have one step size.
    fn update(&mut self, schedule: &StepSchedule) {
        let Self {
            model,
            sums,
            settings,
            ..
        } = self;
        let moving = model.moving.as_mut().map(|moving| &mut moving.table);
        sums.refused.resize(schedule.learning_rates.len(), 0);
        for table in std::iter::once(&mut model.table).chain(moving) {
            for (index, array) in table.arrays.iter_mut().enumerate() {
                array.learning_rate = schedule.learning_rates[index];
                sums.refused[index] += adam::cpu::step(array, schedule.iteration) as u64;
            }
            settings.time.keep_within_bounds(table);
        }
    }
}

impl Stepper for DynamicStepper<'_> {
    fn backend(&self) -> Backend {
        Backend::Cpu {
            threads: rayon::current_num_threads() as u32,
        }
    }

    fn gaussians(&self) -> usize {
        self.model.len()
    }

    fn moving_gaussians(&self) -> usize {
        self.model.len() - self.model.table.len()
    }

    fn step(&mut self, number: usize, schedule: &StepSchedule) -> Result<(), EngineError> {
        let view = &self.inputs.views[number];
        let drawn = self.model.corrected(&view.view);
        let look = self.settings.look(&drawn, schedule.shift_frames);
        let features = self.settings.features;
        crate::model::instantiate(
            &self.model,
            &self.settings,
            &look,
            &features,
            &mut self.instant,
        );
        let (mut total, squared_error) = self.differentiate(view, &drawn, &look, schedule);
        let by_pose = PoseRefinement::gradient(
            self.pose_refinement,
            schedule,
            &drawn,
            &self.instant,
            &self.gradient,
        );
        let fixed = self.model.table.len();
        static_gaussians::instantiate_vjp(&mut self.model.table, &self.instant, &self.gradient);
        if let Some(moving) = &mut self.model.moving {
            self.settings.time.instantiate_from_vjp(
                &mut moving.table,
                &look,
                &features,
                fixed,
                &self.instant,
                &self.gradient,
            );
        }
        total += self.regularize_motion(&look);
        if !total.is_finite() {
            return Err(EngineError::Diverged {
                iteration: schedule.iteration,
                what: format!("the loss of frame {} is {total}", view.frame),
            });
        }
        self.add_statistics();
        self.sums.steps += 1;
        self.sums.loss += total;
        self.sums.squared_error += squared_error;
        self.update(schedule);
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
        let drawn = self.model.corrected(view);
        let look = self.settings.look(&drawn, 0.0);
        let none = TemporalFeatures::default();
        crate::model::instantiate(&self.model, &self.settings, &look, &none, &mut self.instant);
        self.renderer.settings.sh_degree = sh_degree;
        Ok(self.renderer.image(&drawn, &self.instant))
    }
}

/// `L_v` and the lifespan loss on feature maps and what light they leave; adds the gradients by the
/// maps.
fn map_losses(
    settings: &DynamicSettings,
    (maps, transmittance): (&[f32], &[f32]),
    mask: Option<&[f32]>,
    gradient: &mut [f32],
) -> f64 {
    let mut total = 0.0;
    let velocity_values = match settings.features.velocity_unit {
        Some(_) => 3 * transmittance.len(),
        None => 0,
    };
    if let Some(loss) = settings.velocity_loss {
        let region = match (loss.outside_masks, mask) {
            (false, _) => Some(&[][..]),
            (true, mask) => mask,
        };
        if let Some(region) = region {
            let maps = &maps[..velocity_values];
            total += f64::from(loss.weight)
                * maps::velocity_map(maps, transmittance, region, loss.weight, gradient);
        }
    }
    if settings.features.lifespan.is_some() {
        let weight = settings.lifespan_weight;
        let plane = &maps[velocity_values..];
        let gradient = &mut gradient[velocity_values..];
        total += f64::from(weight) * maps::lifespan_map(plane, transmittance, weight, gradient);
    }
    total
}
