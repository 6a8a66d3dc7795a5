//! Training steps on a GPU: rendering, losses, gradients, Adam and density statistics, without waiting for
//! the host. The exception is a step that refines a pose.
//!
//! The host writes a few numbers per step and reads back rarely. A step whose tile entries exceed the
//! capacity halts the device: it and the steps after it change nothing. When the host reads the status, it
//! enlarges the buffers and submits those steps again; nothing is lost.
//!
//! A step in shards takes one backward pass over all Gaussians: shards save no memory here. Only those that the
//! view trains are updated.

pub mod activation;
mod density;
mod device_model;
mod dynamic_losses;
pub(crate) mod fused_adam;
mod image;
pub(crate) mod kernels;
mod measure;
pub mod memory;
pub(crate) mod opacity_reset;
mod room;
pub mod single_kernels;
pub(crate) mod size_limit;

use std::{collections::VecDeque, sync::Arc};

use omnilife_schemas::{RgbImage, records::Backend};
use rand_pcg::Pcg64Mcg;

use self::{
    device_model::{
        DeviceModel, DevicePart, PartTables, StepUses, copies, parts, sh_degree, uses_shared,
    },
    kernels::StepKernels,
};
use crate::{
    EngineError,
    camera::View,
    density::{Densification, Densified},
    device::{DeviceBuffer, Gpu, GpuError, timer::StageTimer},
    gaussians::parameterization::Viewpoint,
    losses::photometric::gpu::{loss_value, plain_levels, target_image},
    model::Model,
    render::{
        buffers::{DeviceStatus, HALTED_FULL, HALTED_RUNNING, RenderShape},
        gpu::with_slack,
        project::by_camera::gpu as by_camera,
        settings::RenderSettings,
    },
    schedule::StepSchedule,
    step::{StepStatistics, Stepper, pose_refinement, settings::TrainSettings},
    training_view::InputViews,
};

/// Maximum number of steps submitted before the host reads the status.
pub const LOOK_INTERVAL: u64 = 50;

/// Newest copy of the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Newest {
    Host,
    Device,
    Both,
}

/// A submitted step whose status the host has not read.
#[derive(Debug, Clone, PartialEq, Default)]
struct Pending {
    view: usize,
    schedule: StepSchedule,
    /// Number of the optimizer's step on shared parameters, from 1; 0 if they are not trained.
    shared_step: u64,
    /// Number of the optimizer's step on each shard, from 1; `None` for one that the view does not train. Empty
    /// without shards.
    shards: Vec<Option<u64>>,
    moves_pose: bool,
}

/// Refuses models that a GPU cannot train.
///
/// # Errors
/// If a parameterization, which is named, has no GPU kernels, or several parts have shared parameters.
fn check(model: &Model) -> Result<(), EngineError> {
    let refused = |reason: String| Err(EngineError::Backend { reason });
    let mut shared = 0;
    for part in &model.parts {
        let parameterization = &part.parameterization;
        if parameterization.device_twin().is_none() {
            return refused(format!(
                "{} Gaussians have no GPU kernels yet; use the backend cpu",
                parameterization.id()
            ));
        }
        shared += usize::from(parameterization.shared().is_some());
    }
    if shared > 1 {
        return refused(format!(
            "{shared} parts of the model have shared parameters, a GPU trains those of one; use the \
             backend cpu"
        ));
    }
    Ok(())
}

/// Training steps on a GPU; the twin of [`crate::step::cpu::CpuStepper`].
#[derive(Debug)]
pub struct GpuStepper<'a> {
    gpu: Arc<Gpu>,
    inputs: InputViews<'a>,
    settings: TrainSettings,
    kernels: StepKernels,
    /// Packed images and masks of the input views, and their numbers of pixels that count.
    targets: Vec<(DeviceBuffer<u32>, usize)>,
    model: Model,
    newest: Newest,
    on_device: Option<DeviceModel>,
    /// Capacity in tile entries.
    entries: usize,
    pending: VecDeque<Pending>,
    statistics: StepStatistics,
}

impl<'a> GpuStepper<'a> {
    /// Uploads the scene's input views.
    ///
    /// # Errors
    /// If the model has no GPU kernels, or the device fails or runs out of memory.
    pub fn new(
        gpu: Arc<Gpu>,
        inputs: InputViews<'a>,
        model: Model,
        settings: &TrainSettings,
    ) -> Result<Self, EngineError> {
        let stepper = Self::of_any_size(gpu, inputs, model, settings)?;
        stepper.check_room()?;
        Ok(stepper)
    }

    /// Creates a stepper of a model for which the adapter may have no room.
    fn of_any_size(
        gpu: Arc<Gpu>,
        inputs: InputViews<'a>,
        model: Model,
        settings: &TrainSettings,
    ) -> Result<Self, EngineError> {
        check(&model)?;
        if gpu.choices().fused_adam {
            fused_adam::check(&model, settings)?;
        }
        let (of_model, look_interval) = ((&model, settings), LOOK_INTERVAL as usize);
        let kernels = StepKernels::new(Arc::clone(&gpu), &inputs, of_model, look_interval)?;
        let exposure = settings.exposure.as_ref();
        let targets = inputs.views.iter().map(|view| {
            let levels = exposure.map_or_else(plain_levels, |exposure| {
                exposure.levels(view.view.time_seconds)
            });
            target_image(&gpu, view, &levels)
        });
        Ok(Self {
            inputs,
            settings: settings.clone(),
            kernels,
            targets: targets.collect::<Result<_, _>>()?,
            model,
            newest: Newest::Host,
            on_device: None,
            entries: 0,
            pending: VecDeque::new(),
            statistics: StepStatistics::default(),
            gpu,
        })
    }

    /// Returns the buffer sizes for this number of Gaussians.
    fn shape(&self, gaussians: usize) -> RenderShape {
        let dynamics = self.settings.dynamics.as_ref();
        RenderShape {
            gaussians,
            sh_degree: sh_degree(&self.model),
            features: dynamics.map_or(0, |dynamics| dynamics.features.count()),
            width: self.inputs.size()[0],
            height: self.inputs.size()[1],
            entries: self.entries.max(RenderShape::first_entries(gaussians)),
        }
    }

    /// Uploads the host's model if it is newer.
    fn upload(&mut self) -> Result<(), GpuError> {
        if self.newest != Newest::Host {
            return Ok(());
        }
        // Free the old one first: both may not fit.
        self.on_device = None;
        self.put(copies(&self.gpu, &self.model)?)?;
        self.newest = Newest::Both;
        Ok(())
    }

    /// Creates the device model from parameters on the device.
    fn put(&mut self, tables: Vec<PartTables>) -> Result<(), GpuError> {
        let dynamics = self.settings.dynamics.as_ref();
        let kernels = &self.kernels;
        let of_all = (dynamics, &kernels.row_mover, &kernels.parameterizations);
        let parts = parts(&self.gpu, &self.model, of_all, tables)?;
        self.on_device = Some(self.device_model(parts)?);
        Ok(())
    }

    /// Creates the model with the programs of a step on it.
    fn device_model(&mut self, parts: Vec<DevicePart>) -> Result<DeviceModel, GpuError> {
        let shape = self.shape(parts.iter().map(|part| part.table.capacity).sum());
        self.entries = shape.entries;
        self.kernels.device_model(parts, shape)
    }

    /// Takes the model on the device, which the caller must put back unless the device has failed. Then the
    /// model is lost, and no older copy replaces it.
    fn take_model(&mut self) -> Result<DeviceModel, GpuError> {
        self.on_device.take().ok_or_else(|| {
            self.gpu
                .failed("its copy of the model was lost with an earlier error")
        })
    }

    /// Submits one step; a timer, if given, records the times of its stages. Returns the step's optional
    /// components.
    fn submit(
        &self,
        model: &DeviceModel,
        step: &Pending,
        timer: &mut Option<StageTimer>,
    ) -> StepUses {
        let gpu = &*self.gpu;
        let schedule = &step.schedule;
        let input = &self.inputs.views[step.view];
        let drawn = self.model.corrected(&input.view);
        let at = Viewpoint::of_step(&drawn, schedule.shift_frames, schedule.scheduled);
        let rendering = RenderSettings {
            sh_degree: schedule.sh_degree,
            ..self.settings.rendering
        };
        model.set_view(gpu, &drawn, &at, &rendering);
        model.set_step(gpu, schedule, (step.shared_step, &step.shards));
        let uses = StepUses {
            shared: uses_shared(&self.model, &at),
            alone: self.set_losses(step.view, schedule),
            pose: step.moves_pose,
        };
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let image = &self.targets[step.view].0.raw;
        encoder.copy_buffer_to_buffer(image, 0, &self.kernels.target.raw, 0, image.size());
        for program in model.programs(uses) {
            program.encode_timed(&mut encoder, timer);
        }
        if let Some(timer) = timer {
            timer.resolve(&mut encoder);
        }
        gpu.queue.submit([encoder.finish()]);
        uses
    }

    /// Sets the losses of a view; returns true if its dynamic Gaussians are drawn alone.
    fn set_losses(&self, number: usize, schedule: &StepSchedule) -> bool {
        let gpu = &*self.gpu;
        let (view, counted) = (&self.inputs.views[number], self.targets[number].1);
        let removes_gain = self.settings.exposure.is_some();
        // If all views are alike, the initial settings hold for every step.
        let ignore_something = self.inputs.views.iter().any(|view| view.ignored.is_some());
        if removes_gain || ignore_something {
            self.kernels.loss.set_view(gpu, removes_gain, counted);
        }
        self.kernels.dynamic.as_ref().is_some_and(|dynamic| {
            dynamic.set(gpu, view.mask.is_some(), (removes_gain, counted));
            dynamic.draws_alone(view.mask.is_some(), schedule)
        })
    }

    /// Waits for the pending steps; if one halted for capacity, enlarges the buffers and submits the rest
    /// again.
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
            let arrays = self.model.trained_arrays().len();
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
                        self.submit(&model, step, &mut None);
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

    fn next_step(&mut self, view: usize, schedule: &StepSchedule) -> Pending {
        let seen = &self.inputs.views[view].view;
        let at = Viewpoint::of_step(seen, schedule.shift_frames, schedule.scheduled);
        let mut shared_step = 0;
        if uses_shared(&self.model, &at) {
            let parts = self.model.parts.iter_mut();
            for shared in parts.filter_map(|part| part.parameterization.shared_mut()) {
                shared.steps += 1;
                shared_step = shared.steps;
            }
        }
        let shards = self.settings.shards.as_ref().map(|shards| {
            let parts = self.model.parts.iter_mut().enumerate();
            let next = parts.map(|(shard, part)| {
                let learns = shards.learns_from(shard, view);
                part.steps += u64::from(learns);
                learns.then_some(part.steps)
            });
            next.collect()
        });
        let refinement = self.settings.pose_refinement;
        let begins = refinement.map(|refinement| refinement.begin_iteration);
        Pending {
            view,
            shared_step,
            shards: shards.unwrap_or_default(),
            moves_pose: begins.is_some_and(|begin| schedule.scheduled >= begin),
            schedule: schedule.clone(),
        }
    }

    /// Recreates the model with capacity for at least `entries`.
    fn make_room(&mut self, model: DeviceModel, entries: u32) -> Result<DeviceModel, GpuError> {
        // The renderer's buffers are freed before larger ones are allocated: both may not fit.
        let parts = model.parts;
        self.entries = with_slack(entries);
        self.device_model(parts)
    }

    /// Refines the pose of the view drawn by a step. This happens on the host, because the view's next step
    /// needs it.
    fn move_pose(&mut self, step: &Pending) -> Result<(), EngineError> {
        self.settle()?;
        let model = self.take_model()?;
        let parts = model.pose.as_ref().map(|pose| {
            let count = by_camera::part_count(self.model.len());
            pose.parts.read_range(&self.gpu, 0..count)
        });
        self.on_device = Some(model);
        let gradient = parts.transpose()?.map(|parts| by_camera::sum(&parts));
        pose_refinement::move_pose(
            &mut self.model,
            step.view,
            gradient.as_ref(),
            &step.schedule,
            &mut self.statistics,
        );
        Ok(())
    }

    /// Downloads the model if the device's copy is newer.
    fn download(&mut self) -> Result<(), EngineError> {
        self.settle()?;
        if self.newest == Newest::Device {
            let on_device = self.take_model()?;
            let gpu = &*self.gpu;
            for (part, on_device) in self.model.parts.iter_mut().zip(&on_device.parts) {
                on_device.read(gpu, part)?;
            }
            self.on_device = Some(on_device);
            self.newest = Newest::Both;
        }
        Ok(())
    }
}

impl Stepper for GpuStepper<'_> {
    fn backend(&self) -> Backend {
        self.gpu.record()
    }

    fn sizes(&self) -> &Model {
        &self.model
    }

    fn step(&mut self, view: usize, schedule: &StepSchedule) -> Result<(), EngineError> {
        self.upload()?;
        let step = self.next_step(view, schedule);
        let model = self.take_model()?;
        self.submit(&model, &step, &mut None);
        self.on_device = Some(model);
        self.newest = Newest::Device;
        self.pending.push_back(step.clone());
        if step.moves_pose {
            return self.move_pose(&step);
        }
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

    fn densify(
        &mut self,
        asked: &Densification<'_>,
        random: &mut Pcg64Mcg,
    ) -> Result<Densified, EngineError> {
        self.densify_on_device(asked, random)
    }

    fn reset_opacities(&mut self) -> Result<(), EngineError> {
        self.settle()?;
        self.upload()?;
        let model = self.take_model()?;
        model.opacity_reset.submit(&self.gpu);
        self.on_device = Some(model);
        self.newest = Newest::Device;
        Ok(())
    }

    fn most_gaussians(&self) -> Option<usize> {
        Some(self.room_for_gaussians())
    }

    fn image(&mut self, view: &View, sh_degree: usize) -> Result<RgbImage, EngineError> {
        self.rendered_image(view, sh_degree)
    }
}
