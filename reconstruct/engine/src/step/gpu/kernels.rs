//! Kernels of a training step, which do not depend on the number of Gaussians, and the programs composed of
//! them for a model.

use std::sync::Arc;

use crate::{
    density::gpu::DensityKernels,
    device::{
        DeviceBuffer, Gpu, GpuError, Kernel, Program, Rows, Uniform,
        shader::{Shader, wgsl_struct},
    },
    gaussians::{
        device_twin::{CompiledKernels, DeviceEntries},
        dropout::{Dropout, gpu::DropoutKernels},
        temporal::gpu::{DeviceTime, NONE},
    },
    losses::photometric::gpu::{Loss, LossWeights, packed_len},
    model::Model,
    parameters::{adam::gpu::Adam, rows::RowMover},
    render::{
        buffers::RenderShape,
        gpu::{Chain, Chains},
        project::by_camera::gpu::PoseGradients,
    },
    step::{
        gpu::{
            activation::Activation,
            device_model::{DeviceModel, DevicePart, DevicePose},
            dynamic_losses::DynamicKernels,
            fused_adam::FusedAdam,
            opacity_reset::OpacityResets,
            size_limit::SizeLimits,
        },
        settings::TrainSettings,
        size_limit::SizeLimit,
    },
    training_view::InputViews,
};

wgsl_struct! {
    /// Inputs of the statistics.
    pub(crate) struct StepView {
        gaussians: u32,
        first: u32,
        half_size: [f32; 2],
        peaks: u32,
        pad: u32,
    }
}

pub(crate) fn shader(shape: &RenderShape) -> Shader {
    Shader {
        file: "step.wgsl",
        constants: shape.constants(),
        parts: &[
            include_str!("../../device/common.wgsl"),
            include_str!("../../device/workgroup_sum.wgsl"),
            include_str!("../../device/status.wgsl"),
            include_str!("../step.wgsl"),
        ],
    }
}

/// Inputs of the statistics of a part.
#[derive(Debug)]
pub(super) struct StatisticsView {
    uniform: Uniform<StepView>,
    view: StepView,
}

impl StatisticsView {
    /// Changes the entries of the part's Gaussians, for everything that is submitted later.
    pub(super) fn place(&mut self, gpu: &Gpu, entries: DeviceEntries) {
        self.view.gaussians = entries.len as u32;
        self.view.first = entries.first as u32;
        self.uniform.write(gpu, &self.view);
    }
}

/// Sum on the device of a step's losses other than the photometric one.
#[derive(Debug)]
pub(super) struct Terms {
    add_term: Kernel,
    add_alone: Kernel,
    sum: DeviceBuffer<f32>,
}

impl Terms {
    /// Records the addition of a loss from its partial sums.
    pub(super) fn record(&self, gpu: &Gpu, program: &mut Program, partials: &DeviceBuffer<f32>) {
        let buffers = [&partials.raw, &self.sum.raw];
        program.run_workgroups(gpu, &self.add_term, 1, &buffers);
    }

    /// Records the addition of the losses of the dynamic Gaussians drawn alone, if there are any.
    pub(super) fn record_alone(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        partials: &DeviceBuffer<f32>,
        photometric: &DeviceBuffer<[f32; 4]>,
        member_count: &DeviceBuffer<u32>,
    ) {
        let buffers = [
            &partials.raw,
            &photometric.raw,
            &member_count.raw,
            &self.sum.raw,
        ];
        program.run_workgroups(gpu, &self.add_alone, 1, &buffers);
    }
}

/// Kernels that do not depend on the number of Gaussians, and the state shared by all steps.
#[derive(Debug)]
pub(super) struct StepKernels {
    gpu: Arc<Gpu>,
    chains: Chains,
    pub(super) parameterizations: CompiledKernels,
    pub(super) loss: Loss,
    pub(super) dynamic: Option<DynamicKernels>,
    pose_gradients: Option<PoseGradients>,
    dropout: Option<(Dropout, DropoutKernels)>,
    adam: Adam,
    /// The kernel that stands for those from the gradients by splats to Adam, if chosen.
    fused: Option<FusedAdam>,
    /// The limit of sizes, where the renderer leaves some out.
    size_limits: Option<SizeLimits>,
    opacity_resets: OpacityResets,
    pub(super) density: DensityKernels,
    pub(super) row_mover: RowMover,
    judge_loss: Kernel,
    add_statistics: Kernel,
    terms: Terms,
    /// The image that a step is compared with.
    pub(super) target: DeviceBuffer<u32>,
    /// Losses of the steps since the host last read them.
    pub(super) losses: DeviceBuffer<[f32; 4]>,
}

impl StepKernels {
    /// Compiles the kernels for images of the input views' size.
    pub(super) fn new(
        gpu: Arc<Gpu>,
        inputs: &InputViews<'_>,
        (model, settings): (&Model, &TrainSettings),
        look_interval: usize,
    ) -> Result<Self, GpuError> {
        let features = settings.dynamics.as_ref();
        let shape = RenderShape {
            gaussians: 0,
            sh_degree: 0,
            features: features.map_or(0, |dynamics| dynamics.features.count()),
            width: inputs.size()[0],
            height: inputs.size()[1],
            entries: 0,
        };
        let [judge_loss, add_statistics, add_term, add_alone] = Kernel::compile(
            &gpu,
            &shader(&shape),
            ["judge_loss", "add_statistics", "add_term", "add_alone"],
        )?;
        let parameterizations = CompiledKernels::default();
        let twins = model
            .parts
            .iter()
            .map(|part| part.parameterization.device_twin());
        for twin in twins.flatten() {
            twin.compile(&gpu, &parameterizations)?;
        }
        let weights = LossWeights {
            ssim: settings.ssim_weight,
            total: 1.0,
            masked: false,
        };
        Ok(Self {
            chains: Chains::default(),
            parameterizations,
            loss: Loss::new(&gpu, &inputs.camera, 1 + shape.features, weights)?,
            dynamic: settings
                .dynamics
                .as_ref()
                .map(|dynamics| DynamicKernels::new(&gpu, dynamics, &inputs.camera))
                .transpose()?,
            pose_gradients: settings
                .pose_refinement
                .map(|_| PoseGradients::new(&gpu, &shape))
                .transpose()?,
            dropout: settings
                .dropout
                .map(|dropout| Ok((dropout, DropoutKernels::new(&gpu)?)))
                .transpose()?,
            adam: Adam::new(&gpu)?,
            fused: match gpu.choices().fused_adam {
                true => Some(FusedAdam::new(&gpu, &shape)?),
                false => None,
            },
            size_limits: SizeLimit::of(model, settings)
                .map(|_| SizeLimits::new(&gpu, &shape))
                .transpose()?,
            opacity_resets: OpacityResets::new(&gpu)?,
            density: DensityKernels::new(&gpu, inputs.views)?,
            row_mover: RowMover::new(&gpu)?,
            judge_loss,
            add_statistics,
            terms: Terms {
                add_term,
                add_alone,
                sum: DeviceBuffer::zeros(&gpu, "further losses", 1)?,
            },
            target: DeviceBuffer::zeros(&gpu, "image of the view", packed_len(shape.pixels()))?,
            losses: DeviceBuffer::zeros(&gpu, "losses", look_interval)?,
            gpu,
        })
    }

    /// Records the programs of a step on a model, for any number of Gaussians within the capacity.
    pub(super) fn device_model(
        &mut self,
        parts: Vec<DevicePart>,
        shape: RenderShape,
    ) -> Result<DeviceModel, GpuError> {
        let gpu = Arc::clone(&self.gpu);
        let status = DeviceBuffer::zeros(&gpu, "status", 1)?;
        let gaussians = parts.iter().map(|part| part.entries.len).sum();
        let chain = self.chains.chain(&gpu, (shape, gaussians), status)?;
        let activated = &chain.buffers.activated;
        let activation = |uses_shared| Activation::record(&gpu, &parts, activated, uses_shared);
        let mut canonical = activation(false)?;
        let with_shared = match parts.iter().any(|part| part.shared.is_some()) {
            true => Some((activation(true)?, self.record_shared_update(&parts, &chain))),
            false => None,
        };
        let dropout = self.dropout.as_ref();
        let rows = &chain.buffers.rows;
        let dropout =
            dropout.map(|(dropout, kernels)| kernels.record(&gpu, *dropout, (activated, rows)));
        let losses = self.record_losses(&parts, &chain)?;
        let alone = match &mut self.dynamic {
            Some(dynamic) => dynamic.alone(&gpu, (&parts, &chain), &self.target, &self.terms)?,
            None => None,
        };
        let mut backward = Program::default();
        let (upstream, buffers) = (&self.loss.gradient, &chain.buffers);
        if self.fused.is_some() {
            let chains = &mut self.chains;
            chains.backward_to_splats(&gpu, &mut backward, buffers, upstream)?;
            canonical.backward = Program::default();
        } else {
            self.chains
                .backward(&gpu, &mut backward, buffers, upstream)?;
        }
        let (update, statistics) = self.record_update(&parts, &chain)?;
        let model = DeviceModel {
            pose: self.record_pose(&chain)?,
            update,
            opacity_reset: self.opacity_resets.record(&gpu, &parts)?,
            statistics,
            parts,
            chain,
            canonical,
            with_shared,
            dropout: dropout.transpose()?,
            losses,
            alone,
            backward,
        };
        model.write_untimed_features(&gpu);
        Ok(model)
    }

    /// Records the limit of sizes, rendering, and the losses on the image.
    fn record_losses(&self, parts: &[DevicePart], chain: &Chain) -> Result<Program, GpuError> {
        let gpu = &*self.gpu;
        let mut program = Program::default();
        program.clear(&self.terms.sum.raw);
        if let Some(limits) = &self.size_limits {
            limits.record(gpu, &mut program, parts, &chain.buffers);
        }
        program.append(&chain.forward);
        let image = &chain.buffers.image;
        program.begin_stage("loss");
        self.loss.record(gpu, &mut program, image, &self.target);
        if let Some(dynamic) = &self.dynamic {
            let images = [image, &self.loss.gradient];
            dynamic.record_maps(gpu, &mut program, images, &self.target, &self.terms)?;
        }
        Ok(program)
    }

    fn record_pose(&self, chain: &Chain) -> Result<Option<DevicePose>, GpuError> {
        let record = |kernels: &PoseGradients| {
            let mut program = Program::default();
            program.begin_stage("pose");
            let parts = kernels.record(&self.gpu, &mut program, &chain.buffers)?;
            Ok(DevicePose { program, parts })
        };
        self.pose_gradients.as_ref().map(record).transpose()
    }

    /// Records the work after the gradients by parameters: the loss on them, statistics, Adam, bounds.
    fn record_update(
        &self,
        parts: &[DevicePart],
        chain: &Chain,
    ) -> Result<(Program, Vec<StatisticsView>), GpuError> {
        let gpu = &*self.gpu;
        let mut statistics = Vec::with_capacity(parts.len());
        let mut program = Program::default();
        program.begin_stage("motion");
        if let Some(dynamic) = &self.dynamic {
            for part in parts {
                dynamic.record_motion(gpu, &mut program, part, &self.terms)?;
            }
        }
        program.begin_stage("adam");
        let status = &chain.buffers.status.raw;
        let judged = [
            &self.loss.value.raw,
            status,
            &self.losses.raw,
            &self.terms.sum.raw,
        ];
        program.run_workgroups(gpu, &self.judge_loss, 1, &judged);
        for part in parts {
            if let Some(fused) = &self.fused {
                fused.record(gpu, &mut program, part, &chain.buffers);
            }
            statistics.push(self.record_statistics(&mut program, part, chain)?);
            if self.fused.is_none() {
                let table = (&part.next_step, &part.table, &part.rows.rows);
                self.adam.record(gpu, &mut program, table, status);
            }
            let bounded = (&part.table, &part.rows);
            let twin = &part.parameterization;
            twin.keep_within_bounds(gpu, &mut program, bounded, status);
        }
        Ok((program, statistics))
    }

    /// Records Adam on shared parameters, and their bounds.
    fn record_shared_update(&self, parts: &[DevicePart], chain: &Chain) -> Program {
        let mut program = Program::default();
        program.begin_stage("adam");
        let status = &chain.buffers.status.raw;
        for part in parts {
            if let Some(shared) = &part.shared {
                let table = (&shared.next_step, &shared.table, &Rows::new(1));
                self.adam.record(&self.gpu, &mut program, table, status);
                let twin = &part.parameterization;
                twin.keep_shared_within_bounds(&self.gpu, &mut program, &shared.table, status);
            }
        }
        program
    }

    fn record_statistics(
        &self,
        program: &mut Program,
        part: &DevicePart,
        chain: &Chain,
    ) -> Result<StatisticsView, GpuError> {
        let gpu = &*self.gpu;
        let buffers = &chain.buffers;
        let shape = &buffers.shape;
        let view = StepView {
            gaussians: part.entries.len as u32,
            first: part.entries.first as u32,
            half_size: [0.5 * shape.width as f32, 0.5 * shape.height as f32],
            peaks: part.parameterization.time().map_or(NONE, DeviceTime::peaks),
            pad: 0,
        };
        let uniform = Uniform::of(gpu, "statistics", &view)?;
        let statistics = &part.statistics;
        program.run(
            gpu,
            &self.add_statistics,
            &part.rows.rows,
            &[
                &uniform.raw,
                &buffers.status.raw,
                &buffers.splat_gradients.raw,
                &statistics.gradient_sums.raw,
                &statistics.view_counts.raw,
                &part.table.gradients.raw,
                &statistics.time_gradients.raw,
            ],
        );
        Ok(StatisticsView { uniform, view })
    }
}
