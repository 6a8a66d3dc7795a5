//! A model in the device's memory, and the programs of a training step on it.

use std::sync::Arc;

use crate::gaussians::parameterization::{DeviceKind, DeviceParameterization, DeviceTwin};
use crate::{
    device::{
        DeviceBuffer, Gpu, GpuError, Kernel, Program, Uniform,
        shader::{Shader, wgsl_struct},
    },
    parameters::device_table::TableBuffers,
    render::{
        buffers::RenderShape,
        gpu::{Chain, Chains},
    },
};
use crate::{
    gaussians::{
        deformable::{
            DeformationModel,
            gpu::{DeformableGaussians, DeformationBuffers, DeformationKernels},
        },
        static_gaussians::gpu::StaticGaussians,
    },
    losses::photometric::gpu::Loss,
    model::Part,
    parameters::adam::{SecondMomentDecay, gpu::Adam},
};

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
            include_str!("../device/common.wgsl"),
            include_str!("../device/status.wgsl"),
            include_str!("step.wgsl"),
        ],
    }
}

/// Kernels that do not depend on the number of Gaussians, and what all steps share.
#[derive(Debug)]
pub(super) struct StepKernels {
    gpu: Arc<Gpu>,
    chains: Chains,
    static_gaussians: StaticGaussians,
    deformation: Option<NetworkKernels>,
    loss: Loss,
    pub(super) adam: Adam,
    judge_loss: Kernel,
    add_statistics: Kernel,
    /// The image that a step is compared with.
    pub(super) target: DeviceBuffer<u32>,
    /// Of the steps since the host looked.
    pub(super) losses: DeviceBuffer<[f32; 4]>,
}

/// Of a network that deforms Gaussians.
#[derive(Debug)]
struct NetworkKernels {
    model: DeformationModel,
    deformation: DeformationKernels,
    adam: Adam,
}

/// The arrays of a model on the device.
#[derive(Debug)]
pub(super) struct DeviceArrays {
    pub(super) table: TableBuffers,
    pub(super) gradient_sums: DeviceBuffer<f32>,
    pub(super) view_counts: DeviceBuffer<u32>,
    /// The weights of a network.
    pub(super) weights: Option<TableBuffers>,
}

impl DeviceArrays {
    /// A copy of the host's.
    pub(super) fn upload(gpu: &Gpu, part: &Part) -> Result<Self, GpuError> {
        let statistics = &part.statistics;
        let weights = part.parameterization.shared();
        Ok(Self {
            table: TableBuffers::new(gpu, &part.table.arrays)?,
            gradient_sums: DeviceBuffer::of(gpu, "gradient statistics", &statistics.sums)?,
            view_counts: DeviceBuffer::of(gpu, "view statistics", &statistics.views)?,
            weights: weights
                .map(|weights| DeformationBuffers::upload(gpu, weights))
                .transpose()?,
        })
    }
}

/// What draws the Gaussians, and what trains them.
#[derive(Debug, Default)]
pub(super) struct Programs {
    pub(super) activate: Program,
    pub(super) step: Program,
}

/// The network's part of a model.
#[derive(Debug)]
struct DeviceNetwork {
    buffers: DeformationBuffers,
    programs: Programs,
}

/// The network's part in a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct NetworkStep {
    /// In [0, 1].
    pub(super) time: f32,
    /// Number of the optimizer's step on the weights, from 1.
    pub(super) number: u64,
    /// Step size of the weights.
    pub(super) learning_rate: f32,
}

/// The model on the device, and the programs of a step on it.
#[derive(Debug)]
pub(super) struct DeviceModel {
    pub(super) table: TableBuffers,
    pub(super) gradient_sums: DeviceBuffer<f32>,
    pub(super) view_counts: DeviceBuffer<u32>,
    pub(super) chain: Chain,
    /// Of the Gaussians as they are.
    canonical: Programs,
    network: Option<DeviceNetwork>,
}

impl DeviceModel {
    /// The weights of a network.
    pub(super) fn weights(&self) -> Option<&TableBuffers> {
        self.network
            .as_ref()
            .map(|network| &network.buffers.weights)
    }

    /// The arrays alone: the buffers of the renderer are given up.
    pub(super) fn into_arrays(self) -> DeviceArrays {
        DeviceArrays {
            table: self.table,
            gradient_sums: self.gradient_sums,
            view_counts: self.view_counts,
            weights: self.network.map(|network| network.buffers.weights),
        }
    }

    /// The programs of the canonical Gaussians, or with the network at a time, which is set for
    /// everything that is submitted later.
    pub(super) fn programs(&self, gpu: &Gpu, network_time: Option<f32>) -> &Programs {
        match (network_time, &self.network) {
            (Some(time), Some(network)) => {
                network.buffers.set_time(gpu, time);
                &network.programs
            }
            _ => &self.canonical,
        }
    }
}

impl StepKernels {
    /// Compiles the kernels for images of a size.
    pub(super) fn new(
        gpu: Arc<Gpu>,
        size: (u32, u32),
        ssim_weight: f32,
        part: &Part,
        look_interval: usize,
    ) -> Result<Self, GpuError> {
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
        let network = match part.parameterization.device_twin() {
            Some(DeviceTwin(DeviceKind::Deformable(deformable))) => Some(NetworkKernels {
                model: deformable.settings.model,
                deformation: DeformationKernels::new(&gpu)?,
                adam: Adam::new(&gpu, part.table.arrays.len())?,
            }),
            _ => None,
        };
        Ok(Self {
            chains: Chains::default(),
            static_gaussians: StaticGaussians::new(&gpu)?,
            deformation: network,
            loss: Loss::new(&gpu, size, true, ssim_weight)?,
            adam: Adam::new(&gpu, 0)?,
            judge_loss,
            add_statistics,
            target: DeviceBuffer::zeros(&gpu, "image of the view", shape.pixels())?,
            losses: DeviceBuffer::zeros(&gpu, "losses", look_interval)?,
            gpu,
        })
    }

    /// Records the programs of a step on a model.
    pub(super) fn device_model(
        &mut self,
        arrays: DeviceArrays,
        shape: RenderShape,
    ) -> Result<DeviceModel, GpuError> {
        let gpu = Arc::clone(&self.gpu);
        let chain = self.chains.chain(&gpu, shape)?;
        let mut model = DeviceModel {
            table: arrays.table,
            gradient_sums: arrays.gradient_sums,
            view_counts: arrays.view_counts,
            chain,
            canonical: Programs::default(),
            network: None,
        };
        model.canonical = self.programs(&model, None)?;
        let network = self.deformation.as_ref().zip(arrays.weights);
        if let Some((kernels, weights)) = network {
            let buffers = DeformationBuffers::new(&gpu, kernels.model, weights, shape.gaussians)?;
            model.network = Some(DeviceNetwork {
                programs: self.programs(&model, Some(&buffers))?,
                buffers,
            });
        }
        Ok(model)
    }

    fn programs(
        &mut self,
        model: &DeviceModel,
        network: Option<&DeformationBuffers>,
    ) -> Result<Programs, GpuError> {
        let gpu = Arc::clone(&self.gpu);
        let canonical = &self.static_gaussians;
        let deformable;
        let (parameterization, network): (&dyn DeviceParameterization, _) =
            match (&self.deformation, network) {
                (Some(kernels), Some(buffers)) => {
                    deformable = DeformableGaussians {
                        canonical,
                        kernels: &kernels.deformation,
                        buffers,
                    };
                    (&deformable, Some((&kernels.adam, &buffers.weights)))
                }
                _ => (canonical, None),
            };
        let DeviceModel { table, chain, .. } = model;
        let buffers = &chain.buffers;
        let status = &buffers.status.raw;
        let mut activate = Program::default();
        parameterization.activate(&gpu, &mut activate, table, &buffers.activated)?;
        let mut step = Program::default();
        step.append(&activate);
        step.append(&chain.forward);
        self.loss
            .record(&gpu, &mut step, &buffers.image, &self.target);
        let judged = [&self.loss.value.raw, status, &self.losses.raw];
        step.run_workgroups(&gpu, &self.judge_loss, 1, &judged);
        self.chains
            .backward(&gpu, &mut step, buffers, &self.loss.gradient)?;
        parameterization.activate_vjp(&gpu, &mut step, table, &buffers.activated)?;
        self.record_statistics(&mut step, model)?;
        self.adam.record(&gpu, &mut step, table, status);
        if let Some((adam, weights)) = network {
            adam.record(&gpu, &mut step, weights, status);
        }
        Ok(Programs { activate, step })
    }

    fn record_statistics(&self, step: &mut Program, model: &DeviceModel) -> Result<(), GpuError> {
        let gpu = &*self.gpu;
        let buffers = &model.chain.buffers;
        let shape = &buffers.shape;
        let view = StepView {
            gaussians: shape.gaussians as u32,
            pad: 0,
            half_size: [0.5 * shape.width as f32, 0.5 * shape.height as f32],
        };
        let view = Uniform::of(gpu, "statistics", &view)?;
        step.run(
            gpu,
            &self.add_statistics,
            shape.gaussians,
            &[
                &view.raw,
                &buffers.status.raw,
                &buffers.splat_gradients.raw,
                &model.gradient_sums.raw,
                &model.view_counts.raw,
            ],
        );
        Ok(())
    }

    /// Sets the optimizer's step on the weights for everything that is submitted later.
    pub(super) fn set_network_step(&self, model: &DeviceModel, step: &NetworkStep) {
        if let (Some(kernels), Some(weights)) = (&self.deformation, model.weights()) {
            let rates = [step.learning_rate];
            let step = (step.number, SecondMomentDecay::PUBLISHED);
            kernels.adam.set_step(&self.gpu, weights, step, &rates);
        }
    }
}
