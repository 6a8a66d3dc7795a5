//! Model in GPU memory, and the programs of a training step on it.

use crate::{
    camera::View,
    density::gpu::DensityWork,
    device::{DeviceBuffer, Gpu, GpuError, Program},
    gaussians::{
        activated_buffers::ActivatedBuffers,
        device_twin::{
            CompiledKernels, DeviceEntries, DeviceParameterization, DeviceRows, NewDevicePart,
            PartBuffers,
        },
        dropout::gpu::DropoutPrograms,
        parameterization::Viewpoint,
        static_gaussians,
    },
    model::{Model, Part, Statistics, TrainedArray, dynamic_settings::DynamicSettings},
    parameters::{
        ParameterArray,
        adam::{SecondMomentDecay, gpu::TableStep},
        device_table::TableBuffers,
        rows::{RowMover, RowMoves},
    },
    render::{gpu::Chain, project::by_camera::gpu::DevicePoseGradient, settings::RenderSettings},
    schedule::StepSchedule,
    step::gpu::{activation::Activation, dynamic_losses::DeviceAlone, kernels::StatisticsView},
};

/// Statistics for density control, on the device.
#[derive(Debug)]
pub(super) struct DeviceStatistics {
    pub(super) gradient_sums: DeviceBuffer<f32>,
    pub(super) view_counts: DeviceBuffer<u32>,
    /// Allocated only for Gaussians with peak times.
    pub(super) time_gradients: DeviceBuffer<f32>,
}

impl DeviceStatistics {
    /// Uploads statistics with a capacity of `capacity` Gaussians.
    fn new(gpu: &Gpu, of: &Statistics, capacity: usize) -> Result<Self, GpuError> {
        let timed = if of.time_gradients.is_empty() {
            0
        } else {
            capacity
        };
        let statistics = Self {
            gradient_sums: DeviceBuffer::zeros(gpu, "gradient statistics", capacity)?,
            view_counts: DeviceBuffer::zeros(gpu, "view statistics", capacity)?,
            time_gradients: DeviceBuffer::zeros(gpu, "statistics of time", timed)?,
        };
        statistics.write(gpu, of);
        Ok(statistics)
    }

    /// Uploads the statistics for everything that is submitted later.
    pub(super) fn write(&self, gpu: &Gpu, of: &Statistics) {
        self.gradient_sums.write(gpu, 0, &of.sums);
        self.view_counts.write(gpu, 0, &of.views);
        self.time_gradients.write(gpu, 0, &of.time_gradients);
    }
}

/// Parameters shared by all Gaussians of a part, such as the weights of a network.
#[derive(Debug)]
pub(super) struct DeviceShared {
    /// The values as a table of one array and one row.
    pub(super) table: TableBuffers,
    pub(super) next_step: TableStep,
}

/// Gaussians of one kind on the device.
#[derive(Debug)]
pub(super) struct DevicePart {
    pub(super) entries: DeviceEntries,
    /// The rows for programs of the parameterization.
    pub(super) rows: DeviceRows,
    pub(super) table: TableBuffers,
    /// Moves of rows within the table.
    pub(super) moves: RowMoves,
    pub(super) next_step: TableStep,
    pub(super) statistics: DeviceStatistics,
    /// Created when the number of Gaussians changes for the first time.
    pub(super) density: Option<Box<DensityWork>>,
    pub(super) shared: Option<DeviceShared>,
    /// Feature channels of a Gaussian without its own time.
    untimed_features: Vec<f32>,
    pub(super) parameterization: Box<dyn DeviceParameterization>,
}

#[derive(Debug)]
pub(super) struct PartTables {
    pub(super) table: TableBuffers,
    /// Parameters shared by all its Gaussians, if any.
    pub(super) shared: Option<TableBuffers>,
}

/// Uploads the parameters of a model, without spare capacity.
pub(super) fn copies(gpu: &Gpu, model: &Model) -> Result<Vec<PartTables>, GpuError> {
    copies_with_room(gpu, model, |_| 0)
}

/// Uploads the parameters of a model, with spare capacity by the number of the part, in Gaussians.
pub(super) fn copies_with_room(
    gpu: &Gpu,
    model: &Model,
    spare: impl Fn(usize) -> usize,
) -> Result<Vec<PartTables>, GpuError> {
    let copy = |(number, part): (usize, &Part)| {
        let shared = part.parameterization.shared();
        let shared = shared
            .map(|shared| TableBuffers::new(gpu, std::slice::from_ref(&shared.array), [1; 2]));
        let rows = part.table.len();
        Ok(PartTables {
            table: TableBuffers::new(gpu, &part.table.arrays, [rows, rows + spare(number)])?,
            shared: shared.transpose()?,
        })
    };
    model.parts.iter().enumerate().map(copy).collect()
}

/// Creates the parts of a model whose parameters are on the device.
pub(super) fn parts(
    gpu: &Gpu,
    model: &Model,
    (dynamics, mover, kernels): (Option<&DynamicSettings>, &RowMover, &CompiledKernels),
    tables: Vec<PartTables>,
) -> Result<Vec<DevicePart>, GpuError> {
    let of_model = OfModel {
        trained: model.trained_arrays(),
        first_alone: first_with_times(model),
        sh_degree: sh_degree(model),
        dynamics,
        mover,
        kernels,
    };
    let parts = model.parts.iter().zip(tables).zip(entries(model));
    parts
        .map(|(part, entries)| DevicePart::new(gpu, part, entries, &of_model))
        .collect()
}

/// Context shared by the parts of a model.
struct OfModel<'a> {
    trained: Vec<TrainedArray>,
    first_alone: usize,
    sh_degree: usize,
    dynamics: Option<&'a DynamicSettings>,
    mover: &'a RowMover,
    kernels: &'a CompiledKernels,
}

/// Returns the highest degree of harmonics stored by a part.
pub(super) fn sh_degree(model: &Model) -> usize {
    let degrees = model.parts.iter();
    let degrees = degrees.map(|part| static_gaussians::sh_degree(&part.table));
    degrees.max().unwrap_or(0)
}

/// Returns the range of each part among all activated Gaussians, part after part.
fn entries(model: &Model) -> impl Iterator<Item = DeviceEntries> {
    let mut first = 0;
    model.parts.iter().map(move |part| {
        let len = part.table.len();
        first += len;
        DeviceEntries {
            first: first - len,
            len,
        }
    })
}

/// Returns the index of the first Gaussian with its own time.
pub(super) fn first_with_times(model: &Model) -> usize {
    let static_parts = model
        .parts
        .iter()
        .take_while(|part| part.parameterization.temporal().is_none());
    static_parts.map(|part| part.table.len()).sum()
}

/// Returns the indices of arrays among the trained ones.
fn numbers(arrays: &[ParameterArray], trained: &[TrainedArray]) -> Vec<Option<usize>> {
    let number = |array: &ParameterArray| {
        let learns = !array.is_frozen();
        let known = trained.iter().position(|known| known.name == array.name);
        known.filter(|_| learns)
    };
    arrays.iter().map(number).collect()
}

impl DevicePart {
    fn new(
        gpu: &Gpu,
        (part, tables): (&Part, PartTables),
        entries: DeviceEntries,
        of_model: &OfModel<'_>,
    ) -> Result<Self, GpuError> {
        let PartTables { table, shared } = tables;
        let host = &part.parameterization;
        let Some(twin) = host.device_twin() else {
            return Err(gpu.failed(&format!("{} Gaussians have no kernels on it", host.id())));
        };
        let stored = static_gaussians::sh_degree(&part.table);
        let rows = DeviceRows::new(gpu, &table, entries, [of_model.sh_degree, stored])?;
        let features = of_model.dynamics.map(|dynamics| dynamics.features);
        let features = features.unwrap_or_default();
        let mut untimed_features = vec![0.0; features.count()];
        features.write_untimed(host.untimed_lifespan(), 0..1, &mut untimed_features);
        let parameterization = twin.open(&NewDevicePart {
            gpu,
            kernels: of_model.kernels,
            host: &part.table,
            table: &table,
            rows: &rows,
            entries,
            features: &features,
            first_alone: of_model.first_alone,
        })?;
        let next_step =
            |arrays: &[ParameterArray]| TableStep::new(gpu, numbers(arrays, &of_model.trained));
        let shared = shared.zip(host.shared()).map(|(table, shared)| {
            Ok(DeviceShared {
                table,
                next_step: next_step(std::slice::from_ref(&shared.array))?,
            })
        });
        Ok(Self {
            entries,
            next_step: next_step(&part.table.arrays)?,
            moves: of_model.mover.between(gpu, &table, &table)?,
            statistics: DeviceStatistics::new(gpu, &part.statistics, table.capacity)?,
            density: None,
            rows,
            table,
            shared: shared.transpose()?,
            untimed_features,
            parameterization,
        })
    }

    /// Changes the entries of its Gaussians, for everything that is submitted later.
    fn place(&mut self, gpu: &Gpu, entries: DeviceEntries, first_alone: usize) {
        self.entries = entries;
        self.rows.place(gpu, entries);
        self.parameterization.place(gpu, entries, first_alone);
    }

    /// Returns the buffers for kernels of its parameterization.
    pub(super) fn buffers<'a>(
        &'a self,
        activated: &'a ActivatedBuffers,
        uses_shared: bool,
    ) -> PartBuffers<'a> {
        let shared = self.shared.as_ref().filter(|_| uses_shared);
        PartBuffers {
            table: &self.table,
            rows: &self.rows,
            shared: shared.map(|shared| &shared.table),
            activated,
        }
    }

    /// Copies gradients to the host.
    pub(super) fn read_gradients(&self, gpu: &Gpu, part: &mut Part) -> Result<(), GpuError> {
        self.table.read_gradients(gpu, &mut part.table.arrays)?;
        if let (Some(shared), Some(host)) = (&self.shared, part.parameterization.shared_mut()) {
            let array = std::slice::from_mut(&mut host.array);
            shared.table.read_gradients(gpu, array)?;
        }
        Ok(())
    }

    /// Copies everything but gradients to the host.
    pub(super) fn read(&self, gpu: &Gpu, part: &mut Part) -> Result<(), GpuError> {
        self.table.read(gpu, &mut part.table.arrays)?;
        if let (Some(shared), Some(host)) = (&self.shared, part.parameterization.shared_mut()) {
            let array = std::slice::from_mut(&mut host.array);
            shared.table.read(gpu, array)?;
        }
        self.read_statistics(gpu, &mut part.statistics)
    }

    /// Copies the statistics for density control to the host.
    pub(super) fn read_statistics(&self, gpu: &Gpu, out: &mut Statistics) -> Result<(), GpuError> {
        let on_device = &self.statistics;
        let timed = out.time_gradients.len();
        let mut sums = DeviceBuffer::read_ranges(
            gpu,
            &[
                (&on_device.gradient_sums, 0..out.sums.len()),
                (&on_device.time_gradients, 0..timed),
            ],
        )?;
        out.time_gradients = sums.pop().unwrap_or_default();
        out.sums = sums.pop().unwrap_or_default();
        out.views = on_device.view_counts.read_range(gpu, 0..out.views.len())?;
        Ok(())
    }

    /// Returns its shared parameters and drops the rest.
    pub(super) fn into_shared(self) -> Option<TableBuffers> {
        self.shared.map(|shared| shared.table)
    }
}

/// Returns true if the model has shared parameters that are used and trained at a viewpoint.
pub(super) fn uses_shared(model: &Model, at: &Viewpoint) -> bool {
    model.parts.iter().any(|part| {
        let twin = part.parameterization.device_twin();
        part.parameterization.shared().is_some() && twin.is_some_and(|twin| twin.uses_shared(at))
    })
}

/// Optional components of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct StepUses {
    /// Shared parameters are used and trained.
    pub(super) shared: bool,
    /// Dynamic Gaussians are drawn alone.
    pub(super) alone: bool,
    /// The pose of the view is refined.
    pub(super) pose: bool,
}

/// Sum of the gradients by the pose of the view.
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
    /// Activation without shared parameters.
    pub(super) canonical: Activation,
    /// Activation with the shared parameters, if any, and their update.
    pub(super) with_shared: Option<(Activation, Program)>,
    /// Dropout, if any.
    pub(super) dropout: Option<DropoutPrograms>,
    /// Rendering and losses.
    pub(super) losses: Program,
    pub(super) alone: Option<DeviceAlone>,
    /// Backward pass from the losses to the Gaussians.
    pub(super) backward: Program,
    pub(super) pose: Option<DevicePose>,
    /// Update of the parameters, after their gradients.
    pub(super) update: Program,
    pub(super) opacity_reset: Program,
    /// Inputs of the statistics of each part.
    pub(super) statistics: Vec<StatisticsView>,
}

impl DeviceModel {
    /// Returns true if the capacity suffices for a model with as many Gaussians in each part.
    pub(super) fn has_room(&self, model: &Model) -> bool {
        let mut parts = self.parts.iter().zip(&model.parts);
        parts.all(|(on_device, part)| part.table.len() <= on_device.table.capacity)
    }

    /// Sets the number of Gaussians of its parts to those of a model, within the capacity, for everything
    /// that is submitted later.
    pub(super) fn place(&mut self, gpu: &Gpu, model: &Model) {
        let first_alone = first_with_times(model);
        for (part, entries) in self.parts.iter_mut().zip(entries(model)) {
            part.place(gpu, entries, first_alone);
        }
        self.chain.buffers.set_rows(gpu, model.len());
        if let Some(alone) = &self.alone {
            let is_timed = |part: &&DevicePart| part.parameterization.time().is_some();
            let last = self.parts.iter().rfind(is_timed);
            let end = last.map_or(first_alone, |part| part.entries.first + part.entries.len);
            alone.chain.buffers.set_rows(gpu, end - first_alone);
        }
        for (statistics, part) in self.statistics.iter_mut().zip(&self.parts) {
            statistics.place(gpu, part.entries);
        }
        self.write_untimed_features(gpu);
    }

    /// Writes the feature channels of Gaussians without their own times, which no kernel writes.
    pub(super) fn write_untimed_features(&self, gpu: &Gpu) {
        let buffer = &self.chain.buffers.activated.features;
        for part in &self.parts {
            let row = &part.untimed_features;
            if !row.is_empty() && part.parameterization.time().is_none() {
                let entries = part.entries;
                buffer.write(gpu, entries.first * row.len(), &row.repeat(entries.len));
            }
        }
    }

    /// Sets the view and the moment for everything that is submitted later.
    pub(super) fn set_view(
        &self,
        gpu: &Gpu,
        view: &View,
        at: &Viewpoint,
        settings: &RenderSettings,
    ) {
        self.chain.buffers.set_view(gpu, view, settings);
        if let Some(alone) = &self.alone {
            alone.chain.buffers.set_view(gpu, view, settings);
        }
        for part in &self.parts {
            part.parameterization.set_moment(gpu, at);
        }
    }

    /// Sets the optimizer's step for everything that is submitted later. Steps on shared parameters and on
    /// shards, if any, are counted separately; a shard without a number takes none.
    pub(super) fn set_step(
        &self,
        gpu: &Gpu,
        schedule: &StepSchedule,
        (shared_step, shards): (u64, &[Option<u64>]),
    ) {
        if let Some(dropout) = &self.dropout {
            dropout.set(gpu, schedule.iteration, schedule.scheduled);
        }
        let rates = &schedule.learning_rates;
        for (number, part) in self.parts.iter().enumerate() {
            let of_shard = shards.get(number).copied();
            let step = of_shard.unwrap_or(Some(schedule.iteration));
            let rows = step.map_or(0, |_| part.entries.len);
            let step = (step.unwrap_or(1), schedule.second_moments);
            part.next_step.set(gpu, (&part.table, rows), step, rates);
            if let Some(shared) = &part.shared {
                let step = (shared_step, SecondMomentDecay::PUBLISHED);
                shared.next_step.set(gpu, (&shared.table, 1), step, rates);
            }
        }
    }

    /// Returns the activation with or without shared parameters.
    pub(super) fn activation(&self, uses_shared: bool) -> &Activation {
        match &self.with_shared {
            Some((activation, _)) if uses_shared => activation,
            _ => &self.canonical,
        }
    }

    pub(super) fn programs(&self, uses: StepUses) -> impl Iterator<Item = &Program> {
        let activation = self.activation(uses.shared);
        let of_shared = self.with_shared.as_ref().filter(|_| uses.shared);
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
            of_shared.map(|(_, update)| update),
        ];
        programs.into_iter().flatten()
    }
}
