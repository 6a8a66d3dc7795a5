//! Losses of dynamic methods in addition to the photometric one: Omni4DGS Eq. 12 or PVG.
//!
//! If masks supervise the dynamic Gaussians, these are rendered a second time, alone.

use crate::{
    camera::View,
    gaussians::{
        ActivatedGaussians,
        parameterization::Viewpoint,
        static_gaussians::OPACITY_LOGITS,
        subset,
        temporal::{self, TemporalFeatures},
    },
    losses::{
        self,
        maps::{self, CountedPixels},
        photometric::{PixelMarks, cpu::Loss},
    },
    model::{
        Model,
        camera_response::ViewResponse,
        dynamic_settings::{DynamicSettings, MotionForm},
    },
    render::{
        cpu::Renderer,
        raster::{Raster, RasterGradient},
        settings::RenderSettings,
    },
    schedule::StepSchedule,
    step::camera_response::ResponseMemory,
};

/// Losses of one method, and all buffers that a step overwrites.
#[derive(Debug)]
pub(super) struct DynamicLosses {
    settings: DynamicSettings,
    alone: DynamicAlone,
    feature_gradient: Vec<f32>,
}

pub(super) struct StepView<'a> {
    /// Camera with corrected pose.
    pub(super) drawn: &'a View,
    pub(super) at: &'a Viewpoint,
    pub(super) schedule: &'a StepSchedule,
    /// Image of the view with the exposure removed, HWC.
    pub(super) target: &'a [f32],
    /// True for saturated values of the image; empty if gains are neither removed nor learnt.
    pub(super) saturated: &'a [bool],
    /// Response of the camera at the view, if it is learnt.
    pub(super) response: Option<&'a ViewResponse>,
    /// Mask, if the view has one.
    pub(super) mask: Option<&'a [f32]>,
    /// Pixels that count.
    pub(super) counted: CountedPixels<'a>,
}

/// Renderer of the dynamic Gaussians alone.
#[derive(Debug)]
struct DynamicAlone {
    renderer: Renderer,
    activated: ActivatedGaussians,
    gradient: ActivatedGaussians,
    /// Indices of the dynamic Gaussians among all activated ones.
    members: Vec<usize>,
    target: Vec<f32>,
    /// True for saturated values where the mask is 1.
    saturated: Vec<bool>,
    opacity_gradient: Vec<f32>,
    response: ResponseMemory,
}

impl DynamicLosses {
    pub(super) fn new(settings: &DynamicSettings, rendering: RenderSettings) -> Self {
        Self {
            settings: settings.clone(),
            alone: DynamicAlone {
                renderer: Renderer::new(rendering),
                activated: ActivatedGaussians::default(),
                gradient: ActivatedGaussians::default(),
                members: Vec::new(),
                target: Vec::new(),
                saturated: Vec::new(),
                opacity_gradient: Vec::new(),
                response: ResponseMemory::default(),
            },
            feature_gradient: Vec::new(),
        }
    }

    /// Returns the feature channels to render.
    pub(super) fn features(&self) -> TemporalFeatures {
        self.settings.features
    }

    /// Returns `L_v` plus the lifespan loss on the feature maps of a render, and the gradient by the maps.
    pub(super) fn maps(&mut self, raster: &Raster, step: &StepView<'_>) -> (f64, &[f32]) {
        self.feature_gradient.clear();
        let mut total = 0.0;
        if self.settings.features.count() > 0 {
            self.feature_gradient.resize(raster.features.len(), 0.0);
            total = map_losses(
                &self.settings,
                (&raster.features, &raster.transmittance),
                (step.mask, step.counted),
                &mut self.feature_gradient,
            );
        }
        (total, &self.feature_gradient)
    }

    /// Returns `L_dynamic` and adds its gradient to that by all Gaussians. Without dynamic Gaussians both are
    /// 0.
    pub(super) fn supervise(
        &mut self,
        step: &StepView<'_>,
        model: &Model,
        activated: &ActivatedGaussians,
        loss: &mut Loss,
        gradient: &mut ActivatedGaussians,
    ) -> f64 {
        let (Some(dynamic), Some(mask)) = (self.settings.dynamic_loss, step.mask) else {
            return 0.0;
        };
        if step.schedule.scheduled < dynamic.begin_iteration {
            return 0.0;
        }
        let alone = &mut self.alone;
        alone.find_members(model, step.at, activated);
        if alone.members.is_empty() {
            return 0.0;
        }
        subset::gather(activated, &alone.members, &mut alone.activated);
        alone.renderer.settings.sh_degree = step.schedule.sh_degree;
        let raster = alone.renderer.forward(step.drawn, &alone.activated);
        alone.target.clear();
        let masked = step.target.as_chunks::<3>().0.iter().zip(mask);
        alone
            .target
            .extend(masked.flat_map(|(rgb, mask)| rgb.map(|value| value * mask)));
        alone.saturated.clear();
        let saturated = step.saturated.iter().enumerate();
        alone
            .saturated
            .extend(saturated.map(|(value, &is_saturated)| is_saturated && mask[value / 3] >= 1.0));
        let marks = PixelMarks {
            ignored: step.counted.ignored,
            saturated: &alone.saturated,
        };
        let shown = alone.response.shown(step.response, &raster.colour);
        let (value, by_shown) =
            loss.forward_backward_marked(marks, shown, &alone.target, dynamic.ssim_weight);
        // The response learns from whole images alone.
        let image_gradient = (alone.response).by_render(step.response, &raster.colour, by_shown);
        let image_gradient: Vec<f32> = image_gradient
            .iter()
            .map(|value| dynamic.weight * value)
            .collect();
        alone.opacity_gradient.clear();
        alone.opacity_gradient.resize(raster.features.len(), 0.0);
        let opacity = maps::opacity_map(
            &raster.features,
            (mask, step.counted),
            dynamic.weight,
            &mut alone.opacity_gradient,
        );
        let upstream = RasterGradient::new(&image_gradient, &alone.opacity_gradient);
        alone
            .renderer
            .backward(step.drawn, &alone.activated, &upstream, &mut alone.gradient);
        subset::gather_vjp(&alone.gradient, &alone.members, gradient);
        f64::from(dynamic.weight) * (value.total + opacity)
    }

    /// Returns `L_m` and adds its gradient to the raw ones of static Gaussians with their own times. Those of the
    /// photometric loss tell which a view shows.
    pub(super) fn regularize_motion(&self, drawn: &View, at: &Viewpoint, model: &mut Model) -> f64 {
        let Some(loss) = self.settings.motion_loss else {
            return 0.0;
        };
        let mut total = 0.0;
        for part in &mut model.parts {
            let Some(temporal) = part.parameterization.temporal() else {
                continue;
            };
            let look = temporal.look(at);
            let mut members = temporal.members(&part.table, &look, false);
            if loss.form == MotionForm::Seen {
                let by_logits = &part.table.arrays[OPACITY_LOGITS].gradients;
                members.retain(|&index| by_logits[index] != 0.0);
            }
            let temporal_table = temporal.time.temporal_table(&part.table, look.observer);
            let cycle = temporal.time.cycle_frames;
            let (value, gradients) = losses::motion::motion(
                &temporal_table,
                &members,
                look.frame_time.frame,
                cycle,
                loss.of_each(members.len(), &drawn.camera),
            );
            temporal::add_gradients(&mut part.table, &gradients);
            total += value;
        }
        total
    }
}

impl DynamicAlone {
    /// Finds the dynamic Gaussians that are drawn at all.
    fn find_members(&mut self, model: &Model, at: &Viewpoint, activated: &ActivatedGaussians) {
        self.members.clear();
        let mut first = 0;
        for part in &model.parts {
            if let Some(temporal) = part.parameterization.temporal() {
                let look = temporal.look(at);
                let dynamic = temporal.members(&part.table, &look, true);
                let entries = dynamic.into_iter().map(|index| first + index);
                self.members
                    .extend(entries.filter(|&entry| activated.opacities[entry] > 0.0));
            }
            first += part.table.len();
        }
    }
}

/// Returns `L_v` plus the lifespan loss from feature maps and transmittance; adds the gradients by the maps.
fn map_losses(
    settings: &DynamicSettings,
    (maps, transmittance): (&[f32], &[f32]),
    (mask, counted): (Option<&[f32]>, CountedPixels<'_>),
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
                * maps::velocity_map(
                    maps,
                    transmittance,
                    (region, counted),
                    loss.weight,
                    gradient,
                );
        }
    }
    if settings.features.lifespan.is_some() {
        let weight = settings.lifespan_weight;
        let plane = &maps[velocity_values..];
        let gradient = &mut gradient[velocity_values..];
        total +=
            f64::from(weight) * maps::lifespan_map(plane, transmittance, counted, weight, gradient);
    }
    total
}
