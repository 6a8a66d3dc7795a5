//! Buffers and programs of density control for one part, sized for the capacity of its table.

use super::{Child, DensityKernels, DensityStep};
use crate::{
    device::{DeviceBuffer, Gpu, GpuError, Program, Rows, Uniform, Workgroups},
    gaussians::{
        static_gaussians::{LOG_SCALES, OPACITY_LOGITS, POSITIONS, QUATERNIONS},
        temporal::{
            LOG_LIFESPANS, PEAK_TIMES,
            gpu::{DeviceTime, NONE, TemporalView},
        },
    },
    parameters::{ParameterTable, device_table::TableBuffers, rows::RowMoves},
    render::sort::gpu::{BLOCK, PairCount, Pairs},
};

/// Bits of the sort keys.
const KEY_BITS: u32 = 32;

/// Input of density control: a part on the device.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WorkInputs<'a> {
    /// The same table in memory.
    pub(crate) host: &'a ParameterTable,
    pub(crate) table: &'a TableBuffers,
    /// Moves rows within the table.
    pub(crate) moves: &'a RowMoves,
    /// Statistics per Gaussian: sum of gradients, number of views that saw it, and sum of gradients by its
    /// peak time.
    pub(crate) gradient_sums: &'a DeviceBuffer<f32>,
    pub(crate) view_counts: &'a DeviceBuffer<u32>,
    pub(crate) time_gradients: &'a DeviceBuffer<f32>,
    /// Set if Gaussians have their own times.
    pub(crate) time: Option<&'a DeviceTime>,
}

/// Working buffers of the kernels.
#[derive(Debug)]
struct WorkBuffers {
    step: Uniform<DensityStep>,
    pairs: Pairs,
    pair_count: DeviceBuffer<u32>,
    growth: DeviceBuffer<u32>,
    grown: DeviceBuffer<u32>,
    /// Clones per Gaussian, children per Gaussian, and the sum of both; 2 capacity + 1 values.
    copies: DeviceBuffer<u32>,
    /// Parents of the extended rows.
    origins: DeviceBuffer<u32>,
    children: DeviceBuffer<Child>,
    stays: DeviceBuffer<u32>,
}

/// Numbers of rows: before, with copies, and after.
#[derive(Debug)]
struct RowCounts {
    rows: Rows,
    extended: Rows,
    new: Rows,
}

/// Programs that write the decided rows into a table.
#[derive(Debug)]
struct Placement {
    step: Uniform<DensityStep>,
    /// Offsets of the table's arrays.
    places: DensityStep,
    sources: Program,
    children: Program,
}

/// Density control of one part.
#[derive(Debug)]
pub(crate) struct DensityWork {
    buffers: WorkBuffers,
    counts: RowCounts,
    /// Parameters of the last call.
    step: DensityStep,
    /// Index of the array of peak times and of that of lifespans.
    time_arrays: [Option<usize>; 2],
    grow_in_space: Program,
    /// Set if Gaussians have their own times.
    grow_in_time: Option<Program>,
    append: Program,
    judge: Program,
    order: Program,
    forget: Program,
    within: Placement,
}

impl WorkBuffers {
    fn new(gpu: &Gpu, capacity: usize, most_siblings: usize) -> Result<Self, GpuError> {
        let numbers = |label, len| DeviceBuffer::zeros(gpu, label, len);
        let most_children = most_siblings * capacity;
        // A Gaussian is either cloned or split.
        let extended = capacity + most_children;
        Ok(Self {
            step: Uniform::of(gpu, "densification", &DensityStep::default())?,
            pairs: Pairs::new(gpu, extended)?,
            pair_count: numbers("rows to sort", 1)?,
            growth: numbers("growth", capacity)?,
            grown: numbers("Gaussians that grow", 1)?,
            copies: numbers("copies", 2 * capacity + 1)?,
            origins: numbers("origins of rows", extended)?,
            children: DeviceBuffer::zeros(gpu, "children", most_children)?,
            stays: numbers("rows that stay", extended + 1)?,
        })
    }

    fn sort(
        &self,
        gpu: &Gpu,
        kernels: &DensityKernels,
        program: &mut Program,
        rows: &Rows,
    ) -> Result<(), GpuError> {
        let of = PairCount {
            count: &self.pair_count,
            blocks: Workgroups::ForRows(rows, BLOCK),
        };
        (kernels.sort).record(gpu, program, &self.pairs, of, KEY_BITS)
    }
}

/// Returns the offsets of a table's arrays.
fn places(table: &TableBuffers, time_arrays: [Option<usize>; 2]) -> DensityStep {
    let [peaks, log_lifespans] =
        time_arrays.map(|array| array.map_or(NONE, |array| table.begin(array)));
    DensityStep {
        capacity: table.capacity as u32,
        positions: table.begin(POSITIONS),
        log_scales: table.begin(LOG_SCALES),
        quaternions: table.begin(QUATERNIONS),
        opacity_logits: table.begin(OPACITY_LOGITS),
        peaks,
        log_lifespans,
        ..DensityStep::default()
    }
}

/// Returns the parameters with the offsets of another table.
fn placed(asked: &DensityStep, places: &DensityStep) -> DensityStep {
    DensityStep {
        capacity: places.capacity,
        positions: places.positions,
        log_scales: places.log_scales,
        quaternions: places.quaternions,
        opacity_logits: places.opacity_logits,
        peaks: places.peaks,
        log_lifespans: places.log_lifespans,
        ..*asked
    }
}

impl Placement {
    fn new(
        gpu: &Gpu,
        kernels: &DensityKernels,
        (buffers, new_rows): (&WorkBuffers, &Rows),
        (table, moves): (&TableBuffers, &RowMoves),
        time_arrays: [Option<usize>; 2],
    ) -> Result<Self, GpuError> {
        let places = places(table, time_arrays);
        let step = Uniform::of(gpu, "placement", &places)?;
        let order = &buffers.pairs.sorted(KEY_BITS).items.raw;
        let (mut sources, mut children) = (Program::default(), Program::default());
        let origins = &buffers.origins.raw;
        let to_sources = [&step.raw, order, origins, &moves.sources.raw];
        sources.run(gpu, &kernels.own.write_sources, new_rows, &to_sources);
        let to_values = [&step.raw, order, &buffers.children.raw, &table.values.raw];
        children.run(gpu, &kernels.own.write_children, new_rows, &to_values);
        Ok(Self {
            step,
            places,
            sources,
            children,
        })
    }

    fn run(&self, gpu: &Gpu, step: &DensityStep, moves: &RowMoves) {
        self.step.write(gpu, &placed(step, &self.places));
        self.sources.submit(gpu);
        moves.run(gpu, step.new_rows as usize);
        self.children.submit(gpu);
    }
}

/// Returns the temporal parameters of Gaussians without times.
fn without_times(table: &TableBuffers) -> TemporalView {
    TemporalView {
        positions: table.begin(POSITIONS),
        opacity_logits: table.begin(OPACITY_LOGITS),
        peaks: NONE,
        log_lifespans: NONE,
        velocities: NONE,
        tangential_velocities: NONE,
        ..TemporalView::default()
    }
}

impl DensityWork {
    /// Creates buffers and programs for a part.
    pub(crate) fn new(
        gpu: &Gpu,
        kernels: &DensityKernels,
        of: &WorkInputs<'_>,
    ) -> Result<Self, GpuError> {
        let siblings = if of.time.is_some() { 3 } else { 2 };
        let buffers = WorkBuffers::new(gpu, of.table.capacity, siblings)?;
        let counts = RowCounts {
            rows: Rows::new(0),
            extended: Rows::new(0),
            new: Rows::new(0),
        };
        let time = match of.time {
            Some(time) => time.uniform.raw.clone(),
            None => Uniform::of(gpu, "no times", &without_times(of.table))?.raw,
        };
        let time_arrays = [PEAK_TIMES, LOG_LIFESPANS].map(|name| of.host.position(name));
        let recorder = Recorder {
            gpu,
            kernels,
            of,
            buffers: &buffers,
            counts: &counts,
            time: &time,
        };
        let mut forget = Program::default();
        forget.clear(&of.gradient_sums.raw);
        forget.clear(&of.view_counts.raw);
        forget.clear(&of.time_gradients.raw);
        let work = (&buffers, &counts.new);
        Ok(Self {
            step: DensityStep::default(),
            time_arrays,
            grow_in_space: recorder.grow_in_space()?,
            grow_in_time: (of.time.is_some())
                .then(|| recorder.grow_in_time())
                .transpose()?,
            append: recorder.append()?,
            judge: recorder.judge()?,
            order: recorder.order()?,
            forget,
            within: Placement::new(gpu, kernels, work, (of.table, of.moves), time_arrays)?,
            buffers,
            counts,
        })
    }

    /// Returns true if the times of a split's children are drawn.
    pub(crate) fn draws_times(&self) -> bool {
        self.time_arrays.iter().all(Option::is_some)
    }

    /// Selects the clones and splits among the first `rows` rows. Returns the number of clones, and that of
    /// clones and children together.
    pub(crate) fn grow(
        &mut self,
        gpu: &Gpu,
        rows: usize,
        asked: &DensityStep,
        in_time: bool,
    ) -> Result<[usize; 2], GpuError> {
        let asked = DensityStep {
            rows: rows as u32,
            ..*asked
        };
        self.step = placed(&asked, &self.within.places);
        self.buffers.step.write(gpu, &self.step);
        self.counts.rows.set(rows);
        self.buffers.pair_count.write(gpu, 0, &[self.step.rows]);
        self.grow_in_space.submit(gpu);
        if let Some(program) = self.grow_in_time.as_ref().filter(|_| in_time) {
            program.submit(gpu);
        }
        self.append.submit(gpu);
        let copies = &self.buffers.copies;
        let capacity = self.step.capacity as usize;
        let sums = [capacity, 2 * capacity].map(|place| (copies, place..place + 1));
        let read = DeviceBuffer::read_ranges(gpu, &sums)?;
        let sum = |number: usize| read[number][0] as usize;
        Ok([sum(0), sum(1)])
    }

    /// Places the children of splits from their random draws and decides which rows stay. Returns the number
    /// that do.
    pub(crate) fn judge(
        &mut self,
        gpu: &Gpu,
        [clones, added]: [usize; 2],
        drawn: &[Child],
    ) -> Result<usize, GpuError> {
        self.step.clones = clones as u32;
        self.step.extended_rows = self.step.rows + added as u32;
        self.buffers.step.write(gpu, &self.step);
        self.counts.extended.set(self.step.extended_rows as usize);
        self.buffers.children.write(gpu, 0, drawn);
        self.judge.submit(gpu);
        let stays = &self.buffers.stays;
        let left = stays.read_range(gpu, stays.len() - 1..stays.len())?[0];
        self.step.new_rows = left;
        Ok(left as usize)
    }

    /// Orders the rows that stay.
    fn order(&self, gpu: &Gpu) {
        self.buffers.step.write(gpu, &self.step);
        self.counts.new.set(self.step.new_rows as usize);
        self.buffers.pair_count.write(gpu, 0, &[self.step.new_rows]);
        self.order.submit(gpu);
    }

    /// Applies the decision within the table, whose capacity must suffice, and resets the statistics.
    pub(crate) fn follow(&self, gpu: &Gpu, moves: &RowMoves) {
        self.order(gpu);
        self.within.run(gpu, &self.step, moves);
        self.forget.submit(gpu);
    }

    /// Applies the decision into another table.
    pub(crate) fn follow_into(
        &self,
        gpu: &Gpu,
        kernels: &DensityKernels,
        (table, moves): (&TableBuffers, &RowMoves),
    ) -> Result<(), GpuError> {
        self.order(gpu);
        let work = (&self.buffers, &self.counts.new);
        let placement = Placement::new(gpu, kernels, work, (table, moves), self.time_arrays)?;
        placement.run(gpu, &self.step, moves);
        Ok(())
    }
}

/// Records the programs of a part.
struct Recorder<'a> {
    gpu: &'a Gpu,
    kernels: &'a DensityKernels,
    of: &'a WorkInputs<'a>,
    buffers: &'a WorkBuffers,
    counts: &'a RowCounts,
    time: &'a wgpu::Buffer,
}

impl Recorder<'_> {
    fn grow_in_space(&self) -> Result<Program, GpuError> {
        let Self { kernels, of, .. } = self;
        let buffers = self.buffers;
        let mut program = Program::default();
        program.clear(&buffers.growth.raw);
        program.clear(&buffers.grown.raw);
        program.run(
            self.gpu,
            &kernels.own.find_candidates,
            &self.counts.rows,
            &[
                self.time,
                &of.table.values.raw,
                &buffers.step.raw,
                &kernels.views.raw,
                &of.gradient_sums.raw,
                &of.view_counts.raw,
                &buffers.pairs.keys.raw,
                &buffers.pairs.items.raw,
            ],
        );
        buffers.sort(self.gpu, kernels, &mut program, &self.counts.rows)?;
        let sorted = buffers.pairs.sorted(KEY_BITS);
        program.run(
            self.gpu,
            &kernels.own.grow_in_space,
            &self.counts.rows,
            &[
                self.time,
                &of.table.values.raw,
                &buffers.step.raw,
                &kernels.views.raw,
                &sorted.keys.raw,
                &sorted.items.raw,
                &buffers.growth.raw,
                &buffers.grown.raw,
            ],
        );
        Ok(program)
    }

    fn grow_in_time(&self) -> Result<Program, GpuError> {
        let Self { kernels, of, .. } = self;
        let buffers = self.buffers;
        let mut program = Program::default();
        program.run(
            self.gpu,
            &kernels.own.find_restless,
            &self.counts.rows,
            &[
                &buffers.step.raw,
                &of.view_counts.raw,
                &of.time_gradients.raw,
                &buffers.pairs.keys.raw,
                &buffers.pairs.items.raw,
            ],
        );
        buffers.sort(self.gpu, kernels, &mut program, &self.counts.rows)?;
        let sorted = buffers.pairs.sorted(KEY_BITS);
        program.run(
            self.gpu,
            &kernels.own.grow_in_time,
            &self.counts.rows,
            &[
                self.time,
                &of.table.values.raw,
                &buffers.step.raw,
                &sorted.keys.raw,
                &sorted.items.raw,
                &buffers.grown.raw,
                &buffers.growth.raw,
            ],
        );
        Ok(program)
    }

    fn append(&self) -> Result<Program, GpuError> {
        let buffers = self.buffers;
        let [step, growth, copies] = [&buffers.step.raw, &buffers.growth.raw, &buffers.copies.raw];
        let mut program = Program::default();
        program.clear(copies);
        let capacity = self.of.table.capacity;
        let counted = [step, growth, copies];
        program.run(self.gpu, &self.kernels.own.count_copies, capacity, &counted);
        (self.kernels.scan).record(self.gpu, &mut program, &buffers.copies)?;
        let appended = [step, growth, copies, &buffers.origins.raw];
        let rows = &self.counts.rows;
        program.run(self.gpu, &self.kernels.own.append_copies, rows, &appended);
        Ok(program)
    }

    fn judge(&self) -> Result<Program, GpuError> {
        let Self { kernels, of, .. } = self;
        let buffers = self.buffers;
        let mut program = Program::default();
        program.clear(&buffers.stays.raw);
        program.run(
            self.gpu,
            &kernels.own.judge_rows,
            &self.counts.extended,
            &[
                self.time,
                &of.table.values.raw,
                &buffers.step.raw,
                &kernels.views.raw,
                &buffers.growth.raw,
                &buffers.origins.raw,
                &buffers.children.raw,
                &buffers.stays.raw,
            ],
        );
        (kernels.scan).record(self.gpu, &mut program, &buffers.stays)?;
        Ok(program)
    }

    fn order(&self) -> Result<Program, GpuError> {
        let Self { kernels, of, .. } = self;
        let buffers = self.buffers;
        let mut program = Program::default();
        program.run(
            self.gpu,
            &kernels.own.keep_rows,
            &self.counts.extended,
            &[
                self.time,
                &of.table.values.raw,
                &buffers.step.raw,
                &buffers.stays.raw,
                &buffers.children.raw,
                &buffers.origins.raw,
                &buffers.pairs.keys.raw,
                &buffers.pairs.items.raw,
            ],
        );
        buffers.sort(self.gpu, kernels, &mut program, &self.counts.new)?;
        Ok(program)
    }
}
