//! Training steps on a GPU: rendering, loss, gradients, Adam and density statistics
//! without waiting for the host.
//!
//! The host writes a few numbers per step and reads back now and then. A step that finds no room
//! for its tile entries halts the device: it and the steps behind it change nothing. When the host
//! looks, it makes more room and gives those steps to the device again; nothing is lost.

use std::{collections::VecDeque, sync::Arc};

use omnilife_schemas::{RgbImage, records::Backend};

use crate::error::EngineError;
use crate::render::gpu::GpuRenderer;
use crate::training_view::InputViews;
use crate::{
    camera::View,
    gaussians::{
        ActivatedGaussians,
        parameterization::{DeviceKind, Viewpoint},
        static_gaussians,
        temporal::TemporalFeatures,
    },
    losses::photometric::gpu::{loss_value, pack_pixels},
    model::{Model, Part, TrainedArray},
    render::settings::RenderSettings,
    schedule::StepSchedule,
    step::{StepStatistics, Stepper, settings::TrainSettings},
};
use crate::{
    device::{DeviceBuffer, Gpu, GpuError},
    render::{
        buffers::{DeviceStatus, HALTED_FULL, HALTED_RUNNING, RenderShape},
        gpu::with_slack,
    },
    step::device_model::{DeviceArrays, DeviceModel, NetworkStep, StepKernels},
};

/// Steps that the device may be given before the host looks what became of them.
const LOOK_INTERVAL: u64 = 50;

/// Which copy of the model is the newest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Newest {
    Host,
    Device,
    Both,
}

/// A step that the device was given and the host has not looked after.
#[derive(Debug, Clone, PartialEq, Default)]
struct Pending {
    view: usize,
    schedule: StepSchedule,
    network: Option<NetworkStep>,
}

/// The only part of a model that a GPU can train.
///
/// # Errors
/// With the name of the parameterization that has no kernels there, or where there are several parts.
fn part(model: &Model) -> Result<&Part, EngineError> {
    let refused = |reason: String| Err(EngineError::Backend { reason });
    let without = |part: &&Part| part.parameterization.device_twin().is_none();
    match (model.parts.iter().find(without), &model.parts[..]) {
        (Some(part), _) => refused(format!(
            "{} Gaussians have no GPU kernels yet; use the backend cpu",
            part.parameterization.id()
        )),
        (None, [part]) => Ok(part),
        (None, parts) => refused(format!(
            "a model of {} parts is trained on the CPU only; use the backend cpu",
            parts.len()
        )),
    }
}

/// Training steps on a GPU; the twin of [`crate::step::cpu::CpuStepper`].
#[derive(Debug)]
pub struct GpuStepper<'a> {
    gpu: Arc<Gpu>,
    inputs: InputViews<'a>,
    settings: RenderSettings,
    kernels: StepKernels,
    /// Images of the input views.
    targets: Vec<DeviceBuffer<u32>>,
    model: Model,
    newest: Newest,
    on_device: Option<DeviceModel>,
    /// Room for tile entries.
    entries: usize,
    pending: VecDeque<Pending>,
    statistics: StepStatistics,
}

impl<'a> GpuStepper<'a> {
    /// Uploads the scene's input views.
    ///
    /// # Errors
    /// When the device fails or its memory does not suffice.
    pub fn new(
        gpu: Arc<Gpu>,
        inputs: InputViews<'a>,
        model: Model,
        settings: &TrainSettings,
    ) -> Result<Self, EngineError> {
        let size = (inputs.camera.width(), inputs.camera.height());
        let kernels = StepKernels::new(
            Arc::clone(&gpu),
            size,
            settings.ssim_weight,
            part(&model)?,
            LOOK_INTERVAL as usize,
        )?;
        let targets = inputs
            .views
            .iter()
            .map(|view| DeviceBuffer::of(&gpu, "image of a view", &pack_pixels(&view.pixels)))
            .collect::<Result<_, GpuError>>()?;
        Ok(Self {
            inputs,
            settings: settings.rendering,
            kernels,
            targets,
            model,
            newest: Newest::Host,
            on_device: None,
            entries: 0,
            pending: VecDeque::new(),
            statistics: StepStatistics::default(),
            gpu,
        })
    }

    /// (Splat, tile) pairs of a view that there is room for at the moment.
    pub fn room_for_entries(&self) -> usize {
        self.shape().entries
    }

    fn shape(&self) -> RenderShape {
        let table = &self.part().table;
        RenderShape {
            gaussians: table.len(),
            sh_degree: static_gaussians::sh_degree(table),
            features: 0,
            width: self.inputs.size()[0],
            height: self.inputs.size()[1],
            entries: self.entries.max(RenderShape::first_entries(table.len())),
        }
    }

    /// Puts the host's model on the device where that is the newer one.
    fn upload(&mut self) -> Result<(), GpuError> {
        if self.newest != Newest::Host {
            return Ok(());
        }
        // Before the new one is made: both may not fit.
        self.on_device = None;
        let arrays = DeviceArrays::upload(&self.gpu, self.part())?;
        self.on_device = Some(self.device_model(arrays)?);
        self.newest = Newest::Both;
        Ok(())
    }

    /// The model with the programs of a step on it.
    fn device_model(&mut self, arrays: DeviceArrays) -> Result<DeviceModel, GpuError> {
        let shape = self.shape();
        self.entries = shape.entries;
        self.kernels.device_model(arrays, shape)
    }

    /// The model on the device; whoever takes it puts it back, unless the device has failed. Then
    /// it is gone for good, and no older copy takes its place.
    fn take_model(&mut self) -> Result<DeviceModel, GpuError> {
        self.on_device.take().ok_or_else(|| {
            self.gpu
                .failed("its copy of the model was lost with an earlier error")
        })
    }

    /// Gives one step to the device.
    fn submit(&self, model: &DeviceModel, step: &Pending) {
        let gpu = &*self.gpu;
        let schedule = &step.schedule;
        let settings = RenderSettings {
            sh_degree: schedule.sh_degree,
            ..self.settings
        };
        let scene_view = &self.inputs.views[step.view].view;
        model.chain.buffers.set_view(gpu, scene_view, &settings);
        self.kernels.adam.set_step(
            gpu,
            &model.table,
            (schedule.iteration, schedule.second_moments),
            &schedule.learning_rates,
        );
        if let Some(network) = &step.network {
            self.kernels.set_network_step(model, network);
        }
        let programs = model.programs(gpu, step.network.map(|network| network.time));
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let image = &self.targets[step.view].raw;
        encoder.copy_buffer_to_buffer(image, 0, &self.kernels.target.raw, 0, image.size());
        programs.step.encode(&mut encoder);
        gpu.queue.submit([encoder.finish()]);
    }

    /// Waits for the pending steps, makes room where it was missing and has the rest done again.
    fn settle(&mut self) -> Result<(), EngineError> {
        while !self.pending.is_empty() {
            let model = self.take_model()?;
            let gpu = &*self.gpu;
            let status = model.chain.buffers.status.read(gpu)?[0];
            let losses = self.kernels.losses.read(gpu)?;
            for value in &losses[..status.steps as usize] {
                let value = loss_value(*value);
                self.statistics.steps += 1;
                self.statistics.loss += value.total;
                self.statistics.squared_error += value.mse;
            }
            self.pending.drain(..status.steps as usize);
            let networks = usize::from(self.part().parameterization.shared().is_some());
            let arrays = model.table.ends.len() + networks;
            self.statistics.refused.resize(arrays, 0);
            for (sum, &refused) in self.statistics.refused.iter_mut().zip(&status.refused) {
                *sum += u64::from(refused);
            }
            let fresh = [DeviceStatus::default()];
            model.chain.buffers.status.write(gpu, 0, &fresh);
            match (status.halted, self.pending.front()) {
                (HALTED_FULL, Some(_)) => {
                    let model = self.make_room(model, status.entries)?;
                    for step in &self.pending {
                        self.submit(&model, step);
                    }
                    self.on_device = Some(model);
                }
                (HALTED_RUNNING, None) => self.on_device = Some(model),
                (HALTED_RUNNING, Some(_)) => {
                    return Err(gpu
                        .failed("the device did not take all of its steps")
                        .into());
                }
                (_, front) => {
                    let Pending { view, schedule, .. } = front.cloned().unwrap_or_default();
                    return Err(EngineError::Diverged {
                        iteration: schedule.iteration,
                        what: format!(
                            "the loss of frame {} is not finite",
                            self.inputs.views[view].frame
                        ),
                    });
                }
            }
        }
        Ok(())
    }

    /// The only part of the model.
    fn part(&self) -> &Part {
        &self.model.parts[0]
    }

    /// The network's part in the next step, where it has one.
    fn network_step(&mut self, view: usize, schedule: &StepSchedule) -> Option<NetworkStep> {
        let view = &self.inputs.views[view].view;
        let at = Viewpoint::of_step(view, schedule.shift_frames, schedule.scheduled);
        let time = self.network_time(&at)?;
        let weights = self.model.parts[0].parameterization.shared_mut()?;
        weights.steps += 1;
        Some(NetworkStep {
            time,
            number: weights.steps,
            learning_rate: schedule.learning_rates.last().copied().unwrap_or_default(),
        })
    }

    /// The network's time of a viewpoint, where there is one and it takes part.
    fn network_time(&self, at: &Viewpoint) -> Option<f32> {
        match self.part().parameterization.device_twin()?.0 {
            DeviceKind::Deformable(deformable) => deformable.network_time(at),
            DeviceKind::Static => None,
        }
    }

    /// The same model with room for at least `entries`.
    fn make_room(&mut self, model: DeviceModel, entries: u32) -> Result<DeviceModel, GpuError> {
        // The renderer's buffers go before the larger ones are made: both may not fit.
        let arrays = model.into_arrays();
        self.entries = with_slack(entries);
        self.device_model(arrays)
    }

    /// Brings the host's copy of the model up to date.
    fn download(&mut self) -> Result<(), EngineError> {
        self.settle()?;
        if self.newest == Newest::Device {
            let on_device = self.take_model()?;
            let gpu = &*self.gpu;
            let part = &mut self.model.parts[0];
            on_device.table.read(gpu, &mut part.table.arrays)?;
            let of_network = part.parameterization.shared_mut().zip(on_device.weights());
            if let Some((weights, on_device)) = of_network {
                on_device.read(gpu, std::slice::from_mut(&mut weights.array))?;
            }
            part.statistics.sums = on_device.gradient_sums.read(gpu)?;
            part.statistics.views = on_device.view_counts.read(gpu)?;
            self.on_device = Some(on_device);
            self.newest = Newest::Both;
        }
        Ok(())
    }

    /// Renders with the buffers of the training steps, which fit the size of the input views.
    fn render(
        &mut self,
        view: &View,
        network_time: Option<f32>,
        settings: &RenderSettings,
    ) -> Result<Vec<f32>, GpuError> {
        loop {
            let model = self.take_model()?;
            let gpu = &*self.gpu;
            model.chain.buffers.set_view(gpu, view, settings);
            model.programs(gpu, network_time).activate.submit(gpu);
            model.chain.forward.submit(gpu);
            let status = model.chain.buffers.status.read(gpu)?[0];
            let fresh = [DeviceStatus::default()];
            model.chain.buffers.status.write(gpu, 0, &fresh);
            if status.halted == HALTED_RUNNING {
                let image = model.chain.buffers.image.read(gpu)?;
                self.on_device = Some(model);
                return Ok(image);
            }
            let model = self.make_room(model, status.entries)?;
            self.on_device = Some(model);
        }
    }
}

impl Stepper for GpuStepper<'_> {
    fn backend(&self) -> Backend {
        self.gpu.record()
    }

    fn gaussians(&self) -> usize {
        self.model.len()
    }

    fn gaussians_with_times(&self) -> usize {
        self.model.len_with_times()
    }

    fn arrays(&self) -> Vec<TrainedArray> {
        self.model.trained_arrays()
    }

    fn step(&mut self, view: usize, schedule: &StepSchedule) -> Result<(), EngineError> {
        self.upload()?;
        let step = Pending {
            view,
            network: self.network_step(view, schedule),
            schedule: schedule.clone(),
        };
        let model = self.take_model()?;
        self.submit(&model, &step);
        self.on_device = Some(model);
        self.newest = Newest::Device;
        self.pending.push_back(step);
        let look = schedule.iteration.is_multiple_of(LOOK_INTERVAL);
        if look || self.pending.len() as u64 == LOOK_INTERVAL {
            self.settle()?;
        }
        Ok(())
    }

    fn take_statistics(&mut self) -> Result<StepStatistics, EngineError> {
        self.settle()?;
        Ok(std::mem::take(&mut self.statistics))
    }

    fn model(&mut self) -> Result<&Model, EngineError> {
        self.download()?;
        Ok(&self.model)
    }

    fn model_mut(&mut self) -> Result<&mut Model, EngineError> {
        self.download()?;
        self.newest = Newest::Host;
        Ok(&mut self.model)
    }

    fn image(&mut self, view: &View, sh_degree: usize) -> Result<RgbImage, EngineError> {
        self.settle()?;
        self.upload()?;
        let settings = RenderSettings {
            sh_degree,
            ..self.settings
        };
        let at = Viewpoint::of_image(view);
        let (width, height) = (view.camera.width() as usize, view.camera.height() as usize);
        let image = if self.inputs.size() == [width, height] {
            self.render(view, self.network_time(&at), &settings)?
        } else {
            self.download()?;
            let mut activated = ActivatedGaussians::default();
            self.model
                .activate(&at, &TemporalFeatures::default(), &mut activated);
            let mut renderer = GpuRenderer::new(Arc::clone(&self.gpu), settings);
            renderer.forward(view, &activated)?.colour
        };
        Ok(RgbImage {
            width,
            height,
            data: image[..width * height * 3]
                .iter()
                .map(|value| value.clamp(0.0, 1.0))
                .collect(),
        })
    }
}
