//! Access to a stepper for tests and measurements.

use super::{GpuStepper, Newest};
use crate::{
    EngineError,
    device::timer::{StageTimer, Stages},
    model::Model,
    schedule::StepSchedule,
};

impl GpuStepper<'_> {
    /// Returns the current capacity in (splat, tile) pairs of a view.
    pub fn room_for_entries(&self) -> usize {
        let on_device = self.on_device.as_ref();
        on_device.map_or_else(
            || self.shape(self.model.len()).entries,
            |model| model.chain.buffers.shape.entries,
        )
    }

    /// Returns the model as [`Stepper::model`](crate::step::Stepper::model) does, with the gradients of the
    /// last step. They are 0 after steps with the fused kernel of Adam, which keeps none.
    ///
    /// # Errors
    /// If the device fails.
    pub fn model_with_gradients(&mut self) -> Result<&Model, EngineError> {
        self.download()?;
        if let Some(on_device) = &self.on_device {
            for (part, on_device) in self.model.parts.iter_mut().zip(&on_device.parts) {
                on_device.read_gradients(&self.gpu, part)?;
            }
        }
        Ok(&self.model)
    }

    /// Returns the bytes read back from the device so far.
    pub fn bytes_read(&self) -> u64 {
        self.gpu.bytes_read()
    }

    /// Waits until the device has finished all submitted work.
    ///
    /// # Errors
    /// If the device fails.
    pub fn wait(&self) -> Result<(), EngineError> {
        Ok(self.gpu.wait()?)
    }

    /// Takes a step like [`Stepper::step`](crate::step::Stepper::step), waits for it and returns the costs of
    /// its stages.
    ///
    /// # Errors
    /// See [`Stepper::step`](crate::step::Stepper::step).
    pub fn measured_step(
        &mut self,
        view: usize,
        schedule: &StepSchedule,
    ) -> Result<Stages, EngineError> {
        self.settle()?;
        self.upload()?;
        let step = self.next_step(view, schedule);
        let model = self.take_model()?;
        let mut timer = StageTimer::new(&self.gpu)?;
        let uses = self.submit(&model, &step, &mut timer);
        let mut stages = Stages::new();
        for program in model.programs(uses) {
            program.add_costs(&mut stages);
        }
        self.on_device = Some(model);
        self.newest = Newest::Device;
        self.pending.push_back(step.clone());
        if let Some(timer) = &mut timer {
            let seconds = timer.take(&self.gpu)?;
            for (stage, cost) in &mut stages {
                cost.seconds = seconds.get(stage).copied();
            }
        }
        if step.moves_pose {
            self.move_pose(&step)?;
        }
        self.settle()?;
        Ok(stages)
    }
}
