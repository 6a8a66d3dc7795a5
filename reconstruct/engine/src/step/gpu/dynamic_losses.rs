//! Losses of dynamic methods on a GPU; the twin of `step/dynamic_losses.rs`.

use crate::{
    camera::Camera,
    device::{DeviceBuffer, Gpu, GpuError, Program},
    losses::{
        maps::gpu::{MapLoss, MapLosses, Maps},
        motion::gpu::Motion,
        photometric::gpu::{Loss, LossWeights},
    },
    model::dynamic_settings::{DynamicSettings, MotionForm},
    render::{
        buffers::{DeviceStatus, RenderShape},
        gpu::{Chain, Chains},
    },
    schedule::StepSchedule,
    step::gpu::{device_model::DevicePart, kernels::Terms},
};

/// Kernels of a method's losses other than the photometric one.
#[derive(Debug)]
pub(super) struct DynamicKernels {
    settings: DynamicSettings,
    maps: Maps,
    motion: Option<Motion>,
    alone: Option<AloneKernels>,
}

/// Kernels that draw the dynamic Gaussians alone.
#[derive(Debug)]
struct AloneKernels {
    chains: Chains,
    loss: Loss,
}

/// Programs that draw the dynamic Gaussians alone.
#[derive(Debug)]
pub(super) struct DeviceAlone {
    pub(super) chain: Chain,
    /// Rendering and losses.
    pub(super) forward: Program,
    /// Backward pass, which adds to the gradients by all Gaussians.
    pub(super) backward: Program,
}

impl DynamicKernels {
    pub(super) fn new(
        gpu: &Gpu,
        settings: &DynamicSettings,
        camera: &Camera,
    ) -> Result<Self, GpuError> {
        let alone = settings.dynamic_loss.map(|dynamic| {
            let weights = LossWeights {
                ssim: dynamic.ssim_weight,
                total: dynamic.weight,
                masked: true,
            };
            Ok(AloneKernels {
                chains: Chains::default(),
                // Planes after the colour: transmittance, and the opacity as a feature.
                loss: Loss::new(gpu, camera, 2, weights)?,
            })
        });
        let [width, height] = camera.size();
        Ok(Self {
            settings: settings.clone(),
            maps: Maps::new(gpu, width * height)?,
            motion: settings
                .motion_loss
                .map(|loss| {
                    Motion::new(gpu, loss.of_each(1, camera), loss.form == MotionForm::Seen)
                })
                .transpose()?,
            alone: alone.transpose()?,
        })
    }

    /// Sets a view's losses, true if its gain is removed, and its number of pixels that count, for everything that
    /// is submitted later.
    pub(super) fn set(&self, gpu: &Gpu, has_mask: bool, (removes_gain, counted): (bool, usize)) {
        let settings = &self.settings;
        let of_view = settings
            .velocity_loss
            .filter(|loss| has_mask || !loss.outside_masks);
        let losses = MapLosses {
            counted: counted as f32,
            velocity_planes: if settings.features.velocity_unit.is_some() {
                3
            } else {
                0
            },
            masked: u32::from(of_view.is_some_and(|loss| loss.outside_masks)),
            velocity_weight: of_view.map_or(0.0, |loss| loss.weight),
            lifespan_weight: match settings.features.lifespan {
                Some(_) => settings.lifespan_weight,
                None => 0.0,
            },
            opacity_weight: settings.dynamic_loss.map_or(0.0, |dynamic| dynamic.weight),
            ..MapLosses::default()
        };
        self.maps.set(gpu, losses);
        if let Some(alone) = &self.alone {
            alone.loss.set_view(gpu, removes_gain, counted);
        }
    }

    /// Returns true if a step draws the dynamic Gaussians alone.
    pub(super) fn draws_alone(&self, has_mask: bool, schedule: &StepSchedule) -> bool {
        let dynamic = self.settings.dynamic_loss;
        has_mask && dynamic.is_some_and(|dynamic| schedule.scheduled >= dynamic.begin_iteration)
    }

    /// Records the losses on the maps of a render, and adds their gradient to `upstream`.
    pub(super) fn record_maps(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        images: [&DeviceBuffer<f32>; 2],
        target: &DeviceBuffer<u32>,
        terms: &Terms,
    ) -> Result<(), GpuError> {
        if self.settings.features.count() > 0 {
            let maps = &self.maps;
            let partials = maps.record(gpu, program, MapLoss::Temporal, images, target)?;
            terms.record(gpu, program, &partials);
        }
        Ok(())
    }

    /// Records the motion regularization, which adds to the gradients by the parameters of a part.
    pub(super) fn record_motion(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        part: &DevicePart,
        terms: &Terms,
    ) -> Result<(), GpuError> {
        if let (Some(motion), Some(time)) = (&self.motion, part.parameterization.time()) {
            let partials = motion.record(gpu, program, time, &part.table)?;
            terms.record(gpu, program, &partials);
        }
        Ok(())
    }

    /// Records the programs that draw the dynamic Gaussians alone, if a loss needs them and any have times.
    pub(super) fn alone(
        &mut self,
        gpu: &Gpu,
        (parts, all): (&[DevicePart], &Chain),
        target: &DeviceBuffer<u32>,
        terms: &Terms,
    ) -> Result<Option<DeviceAlone>, GpuError> {
        let with_times: Vec<_> = parts
            .iter()
            .filter_map(|part| Some((part, part.parameterization.time()?)))
            .collect();
        let (Some(alone), Some((first, _)), Some((last, _))) =
            (&mut self.alone, with_times.first(), with_times.last())
        else {
            return Ok(None);
        };
        let end = last.entries.first + last.entries.len;
        let begin = first.entries.first;
        let between = parts
            .iter()
            .filter(|part| (begin..end.max(begin + 1)).contains(&part.entries.first));
        let shape = RenderShape {
            gaussians: between.map(|part| part.table.capacity).sum(),
            features: 1,
            ..all.buffers.shape
        };
        let status: DeviceBuffer<DeviceStatus> = all.buffers.status.clone();
        let chain = alone.chains.chain(gpu, (shape, end - begin), status)?;
        let activated = [&all.buffers.activated, &chain.buffers.activated];
        let ones = vec![1.0; shape.gaussians];
        activated[1].features.write(gpu, 0, &ones);
        let member_count = DeviceBuffer::zeros(gpu, "count of dynamic Gaussians", 1)?;

        let mut forward = Program::default();
        forward.begin_stage("dynamic alone");
        forward.clear(&member_count.raw);
        for (part, time) in &with_times {
            time.gather_dynamic(gpu, &mut forward, &part.table, activated, &member_count);
        }
        forward.append(&chain.forward);
        let image = &chain.buffers.image;
        let loss = &alone.loss;
        forward.begin_stage("loss");
        loss.record(gpu, &mut forward, image, target);
        let images = [image, &loss.gradient];
        let partials = self
            .maps
            .record(gpu, &mut forward, MapLoss::Opacity, images, target)?;
        terms.record_alone(gpu, &mut forward, &partials, &loss.value, &member_count);

        let mut backward = Program::default();
        alone
            .chains
            .backward(gpu, &mut backward, &chain.buffers, &loss.gradient)?;
        backward.begin_stage("dynamic alone");
        for (_, time) in &with_times {
            time.gather_dynamic_vjp(gpu, &mut backward, activated);
        }
        Ok(Some(DeviceAlone {
            chain,
            forward,
            backward,
        }))
    }
}
