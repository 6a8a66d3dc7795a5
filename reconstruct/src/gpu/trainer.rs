//! Training steps on a graphics device: rendering, loss, gradients, Adam and density statistics
//! without waiting for the host.
//!
//! The host writes a few numbers per step and reads back now and then. A step that finds no room
//! for its tile entries halts the device: it and the steps behind it change nothing. When the host
//! looks, it makes more room and gives those steps to the device again; nothing is lost.

use std::{collections::VecDeque, sync::Arc};

use omnilife_schemas::{RgbImage, records::Backend};

use super::{
    buffer::{DeviceBuffer, Uniform},
    device::Gpu,
    error::GpuError,
    program::{Kernel, Program},
    render_buffers::{DeviceStatus, HALTED_FULL, HALTED_RUNNING, RenderBuffers, RenderShape},
    renderer::{Chain, Chains, with_slack},
    shader::{Shader, wgsl_struct},
    table::TableBuffers,
};
use crate::{
    camera::View,
    error::ReconstructError,
    gaussians::static_gaussians::{self, gpu::StaticGaussians},
    kernels::{
        RenderSettings,
        adam::gpu::Adam,
        loss::gpu::{Loss, loss_value, pack_pixels},
    },
    scene::TrainingScene,
    train::step::{Model, StepSchedule, StepSums, Stepper},
};

/// Steps that the device may be given before the host looks what became of them.
const LOOK_INTERVAL: u64 = 50;

/// From the arrays of a table to Gaussians at one instant and back with gradients, on the device.
/// One implementation per parameterization, in its folder beside the WGSL.
pub(crate) trait Parameterization: std::fmt::Debug {
    /// Fills `buffers.gaussians` and `buffers.harmonics`.
    fn instantiate(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        table: &TableBuffers,
        buffers: &RenderBuffers,
    ) -> Result<(), GpuError>;

    /// Fills `table.gradients`.
    fn instantiate_vjp(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        table: &TableBuffers,
        buffers: &RenderBuffers,
    ) -> Result<(), GpuError>;
}

wgsl_struct! {
    /// What the statistics depend on.
    pub(crate) struct StepView {
        gaussians: u32,
        pad: u32,
        half_size: [f32; 2],
    }
}

pub(crate) fn shader(shape: &RenderShape) -> Shader {
    Shader {
        file: "step.wgsl",
        constants: shape.constants(),
        parts: &[
            include_str!("common.wgsl"),
            include_str!("status.wgsl"),
            include_str!("step.wgsl"),
        ],
    }
}

/// Kernels that do not depend on the number of Gaussians.
#[derive(Debug)]
struct Kernels {
    parameterization: StaticGaussians,
    loss: Loss,
    adam: Adam,
    judge_loss: Kernel,
    add_statistics: Kernel,
}

/// The model on the device, and the program of a step on it.
#[derive(Debug)]
struct DeviceModel {
    table: TableBuffers,
    gradient_sums: DeviceBuffer<f32>,
    view_counts: DeviceBuffer<u32>,
    chain: Chain,
    instantiate: Program,
    step: Program,
}

/// Which copy of the model is the newest.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Newest {
    Host,
    Device,
    Both,
}

/// Training steps on a graphics device; the twin of [`crate::train::cpu_step::CpuStepper`].
#[derive(Debug)]
pub struct GpuStepper<'a> {
    gpu: Arc<Gpu>,
    scene: &'a TrainingScene,
    settings: RenderSettings,
    chains: Chains,
    kernels: Kernels,
    /// Images of the input views.
    targets: Vec<DeviceBuffer<u32>>,
    target: DeviceBuffer<u32>,
    losses: DeviceBuffer<[f32; 4]>,
    model: Model,
    newest: Newest,
    on_device: Option<DeviceModel>,
    /// Room for tile entries.
    entries: usize,
    /// Steps that the device was given and the host has not looked after.
    pending: VecDeque<(usize, StepSchedule)>,
    sums: StepSums,
}

impl<'a> GpuStepper<'a> {
    /// Uploads the scene's input views.
    ///
    /// # Errors
    /// When the device fails or its memory does not suffice.
    pub fn new(
        gpu: Arc<Gpu>,
        scene: &'a TrainingScene,
        model: Model,
        settings: RenderSettings,
        ssim_weight: f32,
    ) -> Result<Self, GpuError> {
        let size = (scene.camera.width, scene.camera.height);
        let pixels = size.0 as usize * size.1 as usize;
        let shape = RenderShape {
            gaussians: 0,
            sh_degree: 0,
            features: 0,
            width: size.0 as usize,
            height: size.1 as usize,
            entries: 0,
        };
        let [judge_loss, add_statistics] =
            Kernel::compile(&gpu, &shader(&shape), ["judge_loss", "add_statistics"])?;
        let kernels = Kernels {
            parameterization: StaticGaussians::new(&gpu)?,
            loss: Loss::new(&gpu, size, true, ssim_weight)?,
            adam: Adam::new(&gpu)?,
            judge_loss,
            add_statistics,
        };
        let targets = scene
            .input_views
            .iter()
            .map(|view| DeviceBuffer::of(&gpu, "image of a view", &pack_pixels(&view.pixels)))
            .collect::<Result<_, GpuError>>()?;
        Ok(Self {
            scene,
            settings,
            chains: Chains::default(),
            kernels,
            targets,
            target: DeviceBuffer::zeros(&gpu, "image of the view", pixels)?,
            losses: DeviceBuffer::zeros(&gpu, "losses", LOOK_INTERVAL as usize)?,
            model,
            newest: Newest::Host,
            on_device: None,
            entries: 0,
            pending: VecDeque::new(),
            sums: StepSums::default(),
            gpu,
        })
    }

    /// (Splat, tile) pairs of a view that there is room for at the moment.
    pub fn room_for_entries(&self) -> usize {
        self.shape().entries
    }

    fn shape(&self) -> RenderShape {
        let table = &self.model.table;
        RenderShape {
            gaussians: table.len(),
            sh_degree: static_gaussians::sh_degree(table),
            features: 0,
            width: self.scene.camera.width as usize,
            height: self.scene.camera.height as usize,
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
        let gpu = &*self.gpu;
        let statistics = &self.model.statistics;
        let model = self.device_model(
            TableBuffers::new(gpu, &self.model.table)?,
            DeviceBuffer::of(gpu, "gradient statistics", &statistics.sums)?,
            DeviceBuffer::of(gpu, "view statistics", &statistics.views)?,
        )?;
        self.on_device = Some(model);
        self.newest = Newest::Both;
        Ok(())
    }

    /// Records the programs of a step on a model.
    fn device_model(
        &mut self,
        table: TableBuffers,
        gradient_sums: DeviceBuffer<f32>,
        view_counts: DeviceBuffer<u32>,
    ) -> Result<DeviceModel, GpuError> {
        let shape = self.shape();
        self.entries = shape.entries;
        let gpu = &*self.gpu;
        let Kernels {
            parameterization,
            loss,
            adam,
            judge_loss,
            add_statistics,
        } = &self.kernels;
        let chain = self.chains.chain(gpu, shape)?;
        let buffers = &chain.buffers;
        let status = &buffers.status.raw;
        let mut instantiate = Program::default();
        parameterization.instantiate(gpu, &mut instantiate, &table, buffers)?;
        let mut step = Program::default();
        step.append(&instantiate);
        step.append(&chain.forward);
        loss.record(gpu, &mut step, &buffers.image, &self.target);
        step.run_workgroups(
            gpu,
            judge_loss,
            1,
            &[&loss.value.raw, status, &self.losses.raw],
        );
        self.chains
            .backward(gpu, &mut step, buffers, &loss.gradient)?;
        parameterization.instantiate_vjp(gpu, &mut step, &table, buffers)?;
        let half_size = [0.5 * shape.width as f32, 0.5 * shape.height as f32];
        let view = Uniform::of(
            gpu,
            "statistics",
            &StepView {
                gaussians: shape.gaussians as u32,
                pad: 0,
                half_size,
            },
        )?;
        step.run(
            gpu,
            add_statistics,
            shape.gaussians,
            &[
                &view.raw,
                status,
                &buffers.splat_gradients.raw,
                &gradient_sums.raw,
                &view_counts.raw,
            ],
        );
        adam.record(gpu, &mut step, &table, status);
        Ok(DeviceModel {
            table,
            gradient_sums,
            view_counts,
            chain,
            instantiate,
            step,
        })
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
    fn submit(&self, model: &DeviceModel, view: usize, schedule: &StepSchedule) {
        let gpu = &*self.gpu;
        let settings = RenderSettings {
            sh_degree: schedule.sh_degree,
            ..self.settings
        };
        let scene_view = &self.scene.input_views[view].view;
        model.chain.buffers.set_view(gpu, scene_view, &settings);
        self.kernels.adam.set_step(
            gpu,
            &model.table,
            schedule.iteration,
            &schedule.learning_rates,
        );
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let image = &self.targets[view].raw;
        encoder.copy_buffer_to_buffer(image, 0, &self.target.raw, 0, image.size());
        model.step.encode(&mut encoder);
        gpu.queue.submit([encoder.finish()]);
    }

    /// Waits for the pending steps, makes room where it was missing and has the rest done again.
    fn settle(&mut self) -> Result<(), ReconstructError> {
        while !self.pending.is_empty() {
            let model = self.take_model()?;
            let gpu = &*self.gpu;
            let status = model.chain.buffers.status.read(gpu)?[0];
            let losses = self.losses.read(gpu)?;
            for value in &losses[..status.steps as usize] {
                let value = loss_value(*value);
                self.sums.steps += 1;
                self.sums.loss += value.total;
                self.sums.squared_error += value.mse;
            }
            self.pending.drain(..status.steps as usize);
            let arrays = model.table.ends.len();
            self.sums.refused.resize(arrays, 0);
            for (sum, &refused) in self.sums.refused.iter_mut().zip(&status.refused) {
                *sum += u64::from(refused);
            }
            let fresh = [DeviceStatus::default()];
            model.chain.buffers.status.write(gpu, 0, &fresh);
            match (status.halted, self.pending.front()) {
                (HALTED_FULL, Some(_)) => {
                    let model = self.make_room(model, status.entries)?;
                    for (view, schedule) in &self.pending {
                        self.submit(&model, *view, schedule);
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
                    let (view, schedule) = front.cloned().unwrap_or_default();
                    return Err(ReconstructError::Diverged {
                        scene: self.scene.id.clone(),
                        iteration: schedule.iteration,
                        what: format!(
                            "the loss of frame {} is not finite",
                            self.scene.input_views[view].frame
                        ),
                    });
                }
            }
        }
        Ok(())
    }

    /// The same model with room for at least `entries`.
    fn make_room(&mut self, model: DeviceModel, entries: u32) -> Result<DeviceModel, GpuError> {
        let DeviceModel {
            table,
            gradient_sums,
            view_counts,
            chain,
            ..
        } = model;
        // Before the larger one is made: both may not fit.
        drop(chain);
        self.entries = with_slack(entries);
        self.device_model(table, gradient_sums, view_counts)
    }

    /// Brings the host's copy of the model up to date.
    fn download(&mut self) -> Result<(), ReconstructError> {
        self.settle()?;
        if self.newest == Newest::Device {
            let on_device = self.take_model()?;
            let gpu = &*self.gpu;
            on_device.table.read(gpu, &mut self.model.table)?;
            self.model.statistics.sums = on_device.gradient_sums.read(gpu)?;
            self.model.statistics.views = on_device.view_counts.read(gpu)?;
            self.on_device = Some(on_device);
            self.newest = Newest::Both;
        }
        Ok(())
    }

    /// Renders with the buffers of the training steps, which fit the size of the input views.
    fn render(&mut self, view: &View, settings: &RenderSettings) -> Result<Vec<f32>, GpuError> {
        loop {
            let model = self.take_model()?;
            let gpu = &*self.gpu;
            model.chain.buffers.set_view(gpu, view, settings);
            model.instantiate.submit(gpu);
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
        self.model.table.len()
    }

    fn step(&mut self, view: usize, schedule: &StepSchedule) -> Result<(), ReconstructError> {
        self.upload()?;
        let model = self.take_model()?;
        self.submit(&model, view, schedule);
        self.on_device = Some(model);
        self.newest = Newest::Device;
        self.pending.push_back((view, schedule.clone()));
        let look = schedule.iteration.is_multiple_of(LOOK_INTERVAL);
        if look || self.pending.len() as u64 == LOOK_INTERVAL {
            self.settle()?;
        }
        Ok(())
    }

    fn take_sums(&mut self) -> Result<StepSums, ReconstructError> {
        self.settle()?;
        Ok(std::mem::take(&mut self.sums))
    }

    fn model(&mut self) -> Result<&Model, ReconstructError> {
        self.download()?;
        Ok(&self.model)
    }

    fn model_mut(&mut self) -> Result<&mut Model, ReconstructError> {
        self.download()?;
        self.newest = Newest::Host;
        Ok(&mut self.model)
    }

    fn image(&mut self, view: &View, sh_degree: usize) -> Result<RgbImage, ReconstructError> {
        self.settle()?;
        self.upload()?;
        let settings = RenderSettings {
            sh_degree,
            ..self.settings
        };
        let (width, height) = (view.camera.width() as usize, view.camera.height() as usize);
        let camera = &self.scene.camera;
        let image = if (camera.width as usize, camera.height as usize) == (width, height) {
            self.render(view, &settings)?
        } else {
            self.download()?;
            let mut instant = Default::default();
            static_gaussians::instantiate(&self.model.table, &mut instant);
            let mut renderer = super::GpuRenderer::new(Arc::clone(&self.gpu), settings);
            renderer.forward(view, &instant)?.colour
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
