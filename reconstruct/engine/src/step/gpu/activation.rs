//! Activation of all parts' parameters on a GPU, and its VJP.

use std::sync::Arc;

use super::{
    check,
    device_model::{
        DeviceNetwork, DevicePart, DevicePartKind, Moment, copies, network_time, parts, sh_degree,
    },
};
use crate::{
    EngineError,
    device::{Gpu, GpuError, Program},
    gaussians::{
        ActivatedGaussians,
        activated_buffers::ActivatedBuffers,
        deformable::gpu::{DeformableGaussians, DeformationKernels},
        parameterization::{DeviceKind, DeviceParameterization, DeviceTwin, Viewpoint},
        static_gaussians::gpu::StaticGaussians,
        temporal::gpu::{DeviceTemporal, TemporalKernels},
    },
    model::Model,
    parameters::rows::RowMover,
};

/// Kernels of the parameterizations of a model.
#[derive(Debug)]
pub(super) struct ActivationKernels {
    static_gaussians: StaticGaussians,
    pub(super) temporal: Option<TemporalKernels>,
    deformation: Option<DeformationKernels>,
}

/// Programs of the activation and its VJP.
#[derive(Debug, Default)]
pub(super) struct Activation {
    pub(super) forward: Program,
    pub(super) backward: Program,
}

impl ActivationKernels {
    pub(super) fn new(gpu: &Gpu, model: &Model) -> Result<Self, GpuError> {
        let is_of = |kind: fn(DeviceKind<'_>) -> bool| {
            let parts = model.parts.iter();
            let mut twins = parts.filter_map(|part| part.parameterization.device_twin());
            twins.any(|DeviceTwin(twin)| kind(twin))
        };
        let with_times = is_of(|kind| matches!(kind, DeviceKind::Temporal(_)));
        let deforms = is_of(|kind| matches!(kind, DeviceKind::Deformable(_)));
        Self::compile(gpu, with_times, deforms)
    }

    fn compile(gpu: &Gpu, with_times: bool, deforms: bool) -> Result<Self, GpuError> {
        Ok(Self {
            static_gaussians: StaticGaussians::new(gpu)?,
            temporal: with_times.then(|| TemporalKernels::new(gpu)).transpose()?,
            deformation: deforms.then(|| DeformationKernels::new(gpu)).transpose()?,
        })
    }

    /// Records the activation of all parts, with or without the network.
    pub(super) fn record(
        &self,
        gpu: &Gpu,
        parts: &[DevicePart],
        activated: &ActivatedBuffers,
        with_network: bool,
    ) -> Result<Activation, GpuError> {
        let mut activation = Activation::default();
        activation.forward.begin_stage("activate");
        activation.backward.begin_stage("activate backward");
        let canonical = &self.static_gaussians;
        for part in parts {
            let (temporal, deformable);
            let twin: &dyn DeviceParameterization =
                match (&part.kind, &self.temporal, &self.deformation) {
                    (DevicePartKind::Temporal(view), Some(kernels), _) => {
                        temporal = DeviceTemporal {
                            canonical,
                            kernels,
                            view,
                        };
                        &temporal
                    }
                    (DevicePartKind::Deformable(network), _, Some(kernels)) if with_network => {
                        let DeviceNetwork { buffers, .. } = &**network;
                        deformable = DeformableGaussians {
                            canonical,
                            kernels,
                            buffers,
                        };
                        &deformable
                    }
                    _ => canonical,
                };
            let table = (&part.table, &part.rows);
            twin.activate(gpu, &mut activation.forward, table, activated)?;
            twin.activate_vjp(gpu, &mut activation.backward, table, activated)?;
        }
        Ok(activation)
    }
}

/// Activates models on a GPU without rendering them, to test kernels.
#[derive(Debug)]
pub struct GpuActivator {
    gpu: Arc<Gpu>,
    kernels: ActivationKernels,
    row_mover: RowMover,
}

impl GpuActivator {
    /// Compiles the kernels of all parameterizations.
    ///
    /// # Errors
    /// If the device fails.
    pub fn new(gpu: Arc<Gpu>) -> Result<Self, EngineError> {
        Ok(Self {
            kernels: ActivationKernels::compile(&gpu, true, true)?,
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
        let parts = parts(&gpu, &model, (None, &self.row_mover), tables)?;
        let buffers = ActivatedBuffers::new(&gpu, model.len(), sh_degree(&model), 0)?;
        let network_time = network_time(&model, at);
        let deforms = network_time.is_some();
        let activation = self.kernels.record(&gpu, &parts, &buffers, deforms)?;
        let moment = Moment {
            at: *at,
            network_time,
        };
        for part in &parts {
            part.set_moment(&gpu, &moment);
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
