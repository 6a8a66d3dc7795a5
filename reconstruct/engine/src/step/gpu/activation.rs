//! Activation of all parts' parameters on a GPU, and its VJP.

use std::sync::Arc;

use super::{
    check,
    device_model::{DevicePart, copies, parts, sh_degree, uses_shared},
    opacity_reset::OpacityResets,
};
use crate::{
    EngineError,
    device::{Gpu, GpuError, Program},
    gaussians::{
        ActivatedGaussians, activated_buffers::ActivatedBuffers, device_twin::CompiledKernels,
        parameterization::Viewpoint,
    },
    losses::motion::gpu::Motion,
    model::Model,
    parameters::rows::RowMover,
};

/// Programs of the activation and its VJP.
#[derive(Debug, Default)]
pub(super) struct Activation {
    pub(super) forward: Program,
    pub(super) backward: Program,
}

impl Activation {
    /// Records the activation of all parts, for viewpoints at which their shared parameters are used or not.
    pub(super) fn record(
        gpu: &Gpu,
        parts: &[DevicePart],
        activated: &ActivatedBuffers,
        uses_shared: bool,
    ) -> Result<Self, GpuError> {
        let mut activation = Self::default();
        activation.forward.begin_stage("activate");
        activation.backward.begin_stage("activate backward");
        for part in parts {
            let buffers = part.buffers(activated, uses_shared);
            let twin = &part.parameterization;
            twin.activate(gpu, &mut activation.forward, &buffers)?;
            twin.activate_vjp(gpu, &mut activation.backward, &buffers)?;
        }
        Ok(activation)
    }
}

/// Activates models on a GPU without rendering them, to test kernels.
#[derive(Debug)]
pub struct GpuActivator {
    gpu: Arc<Gpu>,
    kernels: CompiledKernels,
    row_mover: RowMover,
}

impl GpuActivator {
    /// Creates an activator; the first model of a kind compiles the kernels of its parameterization.
    ///
    /// # Errors
    /// If the device fails.
    pub fn new(gpu: Arc<Gpu>) -> Result<Self, EngineError> {
        Ok(Self {
            kernels: CompiledKernels::default(),
            row_mover: RowMover::new(&gpu)?,
            gpu,
        })
    }

    /// Uploads a copy of the model, activated for a viewpoint.
    ///
    /// # Errors
    /// If the model has no GPU kernels, or the device fails or runs out of memory.
    pub fn activation(&self, model: Model, at: &Viewpoint) -> Result<GpuActivation, EngineError> {
        check(&model)?;
        let gpu = Arc::clone(&self.gpu);
        let tables = copies(&gpu, &model)?;
        let of_all = (None, &self.row_mover, &self.kernels);
        let parts = parts(&gpu, &model, of_all, tables)?;
        let buffers = ActivatedBuffers::new(&gpu, model.len(), sh_degree(&model), 0)?;
        let activation = Activation::record(&gpu, &parts, &buffers, uses_shared(&model, at))?;
        for part in &parts {
            part.parameterization.set_moment(&gpu, at);
        }
        Ok(GpuActivation {
            gpu,
            model,
            parts,
            buffers,
            activation,
        })
    }
}

impl GpuActivator {
    /// Returns a model after a reset of its opacities, as [`reset_opacities`](crate::density::reset_opacities) does.
    ///
    /// # Errors
    /// If the model has no GPU kernels, or the device fails or runs out of memory.
    pub fn reset_opacities(&self, mut model: Model) -> Result<Model, EngineError> {
        check(&model)?;
        let gpu = &*self.gpu;
        let tables = copies(gpu, &model)?;
        let of_all = (None, &self.row_mover, &self.kernels);
        let parts = parts(gpu, &model, of_all, tables)?;
        OpacityResets::new(gpu)?.record(gpu, &parts)?.submit(gpu);
        for (part, on_device) in model.parts.iter_mut().zip(&parts) {
            on_device.read(gpu, part)?;
        }
        Ok(model)
    }

    /// Returns the motion regularization of a model's static Gaussians with their own times (Omni4DGS Eqs. 10 and
    /// 11), a mean with this weight, and the model with its gradients alone.
    ///
    /// # Errors
    /// If the model has no GPU kernels, or the device fails or runs out of memory.
    pub fn motion(
        &self,
        mut model: Model,
        at: &Viewpoint,
        weight: f32,
    ) -> Result<(f64, Model), EngineError> {
        check(&model)?;
        let gpu = &*self.gpu;
        let tables = copies(gpu, &model)?;
        let of_all = (None, &self.row_mover, &self.kernels);
        let parts = parts(gpu, &model, of_all, tables)?;
        let motion = Motion::new(gpu, weight, false)?;
        let (mut program, mut sums) = (Program::default(), Vec::new());
        for part in &parts {
            part.parameterization.set_moment(gpu, at);
            if let Some(time) = part.parameterization.time() {
                sums.push(motion.record(gpu, &mut program, time, &part.table)?);
            }
        }
        program.submit(gpu);
        let mut value = 0.0;
        for sums in sums {
            value += sums.read(gpu)?.into_iter().map(f64::from).sum::<f64>();
        }
        for (part, on_device) in model.parts.iter_mut().zip(&parts) {
            on_device.read_gradients(gpu, part)?;
        }
        Ok((value, model))
    }
}

/// Model on a GPU, activated for a viewpoint.
#[derive(Debug)]
pub struct GpuActivation {
    gpu: Arc<Gpu>,
    model: Model,
    parts: Vec<DevicePart>,
    buffers: ActivatedBuffers,
    activation: Activation,
}

impl GpuActivation {
    /// Returns the activated Gaussians.
    ///
    /// # Errors
    /// If the device fails.
    pub fn activate(&self) -> Result<ActivatedGaussians, EngineError> {
        self.activation.forward.submit(&self.gpu);
        let mut out = ActivatedGaussians::default();
        self.buffers.read(&self.gpu, &mut out)?;
        Ok(out)
    }

    /// Computes the VJP of [`GpuActivation::activate`], which must have been called before; returns the model
    /// with the gradients by its parameters.
    ///
    /// # Errors
    /// If the device fails.
    pub fn activate_backward(
        &mut self,
        gradient: &ActivatedGaussians,
    ) -> Result<&Model, EngineError> {
        self.buffers.write_gradient(&self.gpu, gradient);
        self.activation.backward.submit(&self.gpu);
        for (part, on_device) in self.model.parts.iter_mut().zip(&self.parts) {
            on_device.read_gradients(&self.gpu, part)?;
        }
        Ok(&self.model)
    }
}
