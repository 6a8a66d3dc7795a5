//! A model in the device's memory, and the programs of a training step on it.

use crate::{
    camera::View,
    device::{DeviceBuffer, Gpu, GpuError, Program},
    gaussians::{
        deformable::gpu::DeformationBuffers,
        dropout::gpu::DropoutPrograms,
        parameterization::{DeviceEntries, DeviceKind, DeviceTwin, Viewpoint},
        temporal::gpu::DeviceTime,
    },
    model::{Model, Part, Statistics, TrainedArray, dynamic_settings::DynamicSettings},
    parameters::{
        ParameterArray,
        adam::{SecondMomentDecay, gpu::TableStep},
        device_table::TableBuffers,
    },
    render::{gpu::Chain, project::by_camera::gpu::DevicePoseGradient, settings::RenderSettings},
    schedule::StepSchedule,
    step::gpu::{activation::Activation, dynamic_losses::DeviceAlone},
};

/// What density control goes by, on the device.
#[derive(Debug)]
pub(super) struct DeviceStatistics {
    pub(super) gradient_sums: DeviceBuffer<f32>,
    pub(super) view_counts: DeviceBuffer<u32>,
    /// Of Gaussians with peak times alone.
    pub(super) time_gradients: DeviceBuffer<f32>,
}

/// What a part's parameterization is on the device.
#[derive(Debug)]
pub(super) enum DevicePartKind {
    Static,
    Temporal(Box<DeviceTime>),
    Deformable(Box<DeviceNetwork>),
}

/// A network that deforms Gaussians.
#[derive(Debug)]
pub(super) struct DeviceNetwork {
    pub(super) buffers: DeformationBuffers,
    /// On its weights.
    pub(super) next_step: TableStep,
}

/// Gaussians of one kind on the device.
#[derive(Debug)]
pub(super) struct DevicePart {
    pub(super) entries: DeviceEntries,
    pub(super) table: TableBuffers,
    pub(super) next_step: TableStep,
    pub(super) statistics: DeviceStatistics,
    pub(super) kind: DevicePartKind,
}

/// The parameters of a part.
#[derive(Debug)]
pub(super) struct PartTables {
    pub(super) table: TableBuffers,
    /// The weights of a network, where one deforms the Gaussians.
    pub(super) weights: Option<TableBuffers>,
}

/// Copies of the parameters of a model.
pub(super) fn copies(gpu: &Gpu, model: &Model) -> Result<Vec<PartTables>, GpuError> {
    let copy = |part: &Part| {
        let weights = part.parameterization.shared();
        let weights =
            weights.map(|weights| TableBuffers::new(gpu, std::slice::from_ref(&weights.array)));
        Ok(PartTables {
            table: TableBuffers::new(gpu, &part.table.arrays)?,
            weights: weights.transpose()?,
        })
    };
    model.parts.iter().map(copy).collect()
}

/// The parts of a model whose parameters are on the device.
pub(super) fn parts(
    gpu: &Gpu,
    model: &Model,
    dynamics: Option<&DynamicSettings>,
    tables: Vec<PartTables>,
) -> Result<Vec<DevicePart>, GpuError> {
    let trained = model.trained_arrays();
    let first_alone = first_with_times(model);
    let mut first = 0;
    let mut parts = Vec::with_capacity(model.parts.len());
    for (part, tables) in model.parts.iter().zip(tables) {
        let entries = DeviceEntries {
            first,
            len: part.table.len(),
        };
        first += entries.len;
        parts.push(DevicePart::new(
            gpu,
            (part, tables),
            entries,
            &trained,
            (dynamics, first_alone),
        )?);
    }
    Ok(parts)
}

/// The entry of the first Gaussian that has times of its own.
pub(super) fn first_with_times(model: &Model) -> usize {
    let static_parts = model
        .parts
        .iter()
        .take_while(|part| part.parameterization.temporal().is_none());
    static_parts.map(|part| part.table.len()).sum()
}

/// Numbers of arrays among those that learn.
fn numbers<'a>(
    arrays: impl Iterator<Item = &'a ParameterArray>,
    trained: &[TrainedArray],
) -> Vec<Option<usize>> {
    let number = |array: &ParameterArray| {
        let learns = !array.is_frozen();
        let known = trained.iter().position(|known| known.name == array.name);
        known.filter(|_| learns)
    };
    arrays.map(number).collect()
}

impl DevicePart {
    fn new(
        gpu: &Gpu,
        (part, tables): (&Part, PartTables),
        entries: DeviceEntries,
        trained: &[TrainedArray],
        (dynamics, first_alone): (Option<&DynamicSettings>, usize),
    ) -> Result<Self, GpuError> {
        let arrays = &part.table.arrays;
        let PartTables { table, weights } = tables;
        let statistics = &part.statistics;
        let twin = part.parameterization.device_twin();
        let kind = match (twin.map(|DeviceTwin(kind)| kind), weights) {
            (Some(DeviceKind::Temporal(temporal)), _) => {
                let features = dynamics.map(|dynamics| dynamics.features);
                let time = DeviceTime::new(
                    gpu,
                    *temporal,
                    &features.unwrap_or_default(),
                    (&part.table, &table),
                    entries,
                    first_alone,
                )?;
                DevicePartKind::Temporal(Box::new(time))
            }
            (Some(DeviceKind::Deformable(deformable)), Some(weights)) => {
                let array = std::slice::from_ref(&deformable.weights.array);
                let model = deformable.settings.model;
                DevicePartKind::Deformable(Box::new(DeviceNetwork {
                    buffers: DeformationBuffers::new(gpu, model, weights, entries.len)?,
                    next_step: TableStep::new(gpu, numbers(array.iter(), trained))?,
                }))
            }
            _ => DevicePartKind::Static,
        };
        Ok(Self {
            entries,
            next_step: TableStep::new(gpu, numbers(arrays.iter(), trained))?,
            table,
            statistics: DeviceStatistics {
                gradient_sums: DeviceBuffer::of(gpu, "gradient statistics", &statistics.sums)?,
                view_counts: DeviceBuffer::of(gpu, "view statistics", &statistics.views)?,
                time_gradients: DeviceBuffer::of(
                    gpu,
                    "statistics of time",
                    &statistics.time_gradients,
                )?,
            },
            kind,
        })
    }

    /// Copies gradients back.
    pub(super) fn read_gradients(&self, gpu: &Gpu, part: &mut Part) -> Result<(), GpuError> {
        self.table.read_gradients(gpu, &mut part.table.arrays)?;
        if let (DevicePartKind::Deformable(network), Some(weights)) =
            (&self.kind, part.parameterization.shared_mut())
        {
            let array = std::slice::from_mut(&mut weights.array);
            network.buffers.weights.read_gradients(gpu, array)?;
        }
        Ok(())
    }

    /// Copies everything back but gradients.
    pub(super) fn read(&self, gpu: &Gpu, part: &mut Part) -> Result<(), GpuError> {
        self.table.read(gpu, &mut part.table.arrays)?;
        if let (DevicePartKind::Deformable(network), Some(weights)) =
            (&self.kind, part.parameterization.shared_mut())
        {
            let array = std::slice::from_mut(&mut weights.array);
            network.buffers.weights.read(gpu, array)?;
        }
        self.read_statistics(gpu, &mut part.statistics)
    }

    /// Copies what density control goes by back.
    pub(super) fn read_statistics(&self, gpu: &Gpu, out: &mut Statistics) -> Result<(), GpuError> {
        let on_device = &self.statistics;
        out.sums = on_device.gradient_sums.read(gpu)?;
        out.views = on_device.view_counts.read(gpu)?;
        out.time_gradients = on_device.time_gradients.read(gpu)?;
        Ok(())
    }

    /// The weights of its network alone.
    pub(super) fn into_weights(self) -> Option<TableBuffers> {
        match self.kind {
            DevicePartKind::Deformable(network) => Some(network.buffers.weights),
            DevicePartKind::Static | DevicePartKind::Temporal(_) => None,
        }
    }

    pub(super) fn set_moment(&self, gpu: &Gpu, moment: &Moment) {
        match (&self.kind, moment.network_time) {
            (DevicePartKind::Temporal(time), _) => time.set(gpu, &moment.at),
            (DevicePartKind::Deformable(network), Some(time)) => {
                network.buffers.set_time(gpu, time);
            }
            _ => {}
        }
    }
}

/// When Gaussians are looked at.
#[derive(Debug, Clone, Copy)]
pub(super) struct Moment {
    pub(super) at: Viewpoint,
    /// In [0, 1], where a network takes part.
    pub(super) network_time: Option<f32>,
}

/// The network's time of a viewpoint, where there is one and it takes part.
pub(super) fn network_time(model: &Model, at: &Viewpoint) -> Option<f32> {
    let mut twins = model
        .parts
        .iter()
        .filter_map(|part| part.parameterization.device_twin());
    twins.find_map(|DeviceTwin(kind)| match kind {
        DeviceKind::Deformable(deformable) => deformable.network_time(at),
        DeviceKind::Static | DeviceKind::Temporal(_) => None,
    })
}

/// What a step has that others have not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct StepUses {
    /// A network takes part.
    pub(super) network: bool,
    /// Dynamic Gaussians are drawn alone.
    pub(super) alone: bool,
    /// The pose of the view moves.
    pub(super) pose: bool,
}

/// The sum of the gradients by the pose of the view.
#[derive(Debug)]
pub(super) struct DevicePose {
    pub(super) program: Program,
    pub(super) parts: DeviceBuffer<DevicePoseGradient>,
}

/// The model on the device, and the programs of a step on it.
#[derive(Debug)]
pub(super) struct DeviceModel {
    pub(super) parts: Vec<DevicePart>,
    pub(super) chain: Chain,
    /// Of the Gaussians as they are.
    pub(super) canonical: Activation,
    /// With the network, where there is one, and what moves its weights.
    pub(super) deformed: Option<(Activation, Program)>,
    /// Where steps leave Gaussians out.
    pub(super) dropout: Option<DropoutPrograms>,
    /// Image and losses.
    pub(super) losses: Program,
    pub(super) alone: Option<DeviceAlone>,
    /// From the losses to the Gaussians.
    pub(super) backward: Program,
    pub(super) pose: Option<DevicePose>,
    /// What follows the gradients by parameters.
    pub(super) update: Program,
}

impl DeviceModel {
    /// Sets the view and the moment for everything that is submitted later.
    pub(super) fn set_view(
        &self,
        gpu: &Gpu,
        view: &View,
        moment: &Moment,
        settings: &RenderSettings,
    ) {
        self.chain.buffers.set_view(gpu, view, settings);
        if let Some(alone) = &self.alone {
            alone.chain.buffers.set_view(gpu, view, settings);
        }
        for part in &self.parts {
            part.set_moment(gpu, moment);
        }
    }

    /// Sets the optimizer's step for everything that is submitted later. The weights of a network
    /// count steps of their own.
    pub(super) fn set_step(&self, gpu: &Gpu, schedule: &StepSchedule, network_step: u64) {
        if let Some(dropout) = &self.dropout {
            dropout.set(gpu, schedule.iteration, schedule.scheduled);
        }
        let rates = &schedule.learning_rates;
        for part in &self.parts {
            let step = (schedule.iteration, schedule.second_moments);
            part.next_step.set(gpu, &part.table, step, rates);
            if let DevicePartKind::Deformable(network) = &part.kind {
                let step = (network_step, SecondMomentDecay::PUBLISHED);
                let weights = &network.buffers.weights;
                network.next_step.set(gpu, weights, step, rates);
            }
        }
    }

    /// The Gaussians as they are, or with the network.
    pub(super) fn activation(&self, network: bool) -> &Activation {
        match &self.deformed {
            Some((deformed, _)) if network => deformed,
            _ => &self.canonical,
        }
    }

    /// The programs of a step, in their order.
    pub(super) fn programs(&self, uses: StepUses) -> impl Iterator<Item = &Program> {
        let activation = self.activation(uses.network);
        let of_network = self.deformed.as_ref().filter(|_| uses.network);
        let alone = self.alone.as_ref().filter(|_| uses.alone);
        let pose = self.pose.as_ref().filter(|_| uses.pose);
        let dropout = self.dropout.as_ref();
        let programs = [
            Some(&activation.forward),
            dropout.map(|dropout| &dropout.forward),
            Some(&self.losses),
            alone.map(|alone| &alone.forward),
            Some(&self.backward),
            alone.map(|alone| &alone.backward),
            pose.map(|pose| &pose.program),
            dropout.map(|dropout| &dropout.backward),
            Some(&activation.backward),
            Some(&self.update),
            of_network.map(|(_, update)| update),
        ];
        programs.into_iter().flatten()
    }
}
