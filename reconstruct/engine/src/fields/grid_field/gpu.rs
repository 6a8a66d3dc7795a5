//! Fields on a GPU: parameters, the buffers of their passes, and Adam; the twin of `grid_field.rs`.

use super::GridField;
use crate::{
    device::{Buffer, DeviceBuffer, Gpu, GpuError, Program, Rows},
    fields::{
        hash_grid::{
            HashGrid,
            gpu::{DeviceGrid, GridKernels, GridScratch, PositionGradients},
        },
        mlp::{
            blocks_gpu::{Block, BlockPass},
            gpu::{NetworkBuffers, Passes, Recording},
            network::NetworkShape,
        },
    },
    parameters::{
        adam::{
            SecondMomentDecay,
            gpu::{Adam, TableStep},
        },
        device_table::TableBuffers,
    },
};

#[derive(Debug)]
pub(crate) struct FieldKernels {
    grid: GridKernels,
    passes: Passes,
    adam: Adam,
}

impl FieldKernels {
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        Ok(Self {
            grid: GridKernels::new(gpu)?,
            passes: Passes::new(gpu)?,
            adam: Adam::new(gpu)?,
        })
    }
}

/// Step of a field's optimizer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldStep {
    /// Its number, from 1, of the table and of the network.
    pub numbers: [u64; 2],
    /// Step sizes of table and network.
    pub rates: [f32; 2],
}

/// A field in GPU memory, with room for a number of positions.
#[derive(Debug)]
pub(crate) struct DeviceField {
    grid: DeviceGrid,
    network: NetworkBuffers,
    table: TableBuffers,
    weights: TableBuffers,
    steps: [TableStep; 2],
    /// 1 if the next step moves the parameters, otherwise 0.
    moves: Rows,
    /// Counter of refused gradients.
    counter: usize,
    pub(crate) positions: DeviceBuffer<f32>,
}

impl DeviceField {
    /// Uploads a field, without positions. `network` has the buffers of its network for `room` rows; `counter` is
    /// the number of its counter in the status of steps.
    pub(crate) fn new(
        gpu: &Gpu,
        (field, network): (&GridField, NetworkBuffers),
        (room, counter): (usize, usize),
        by_positions: &PositionGradients,
    ) -> Result<Self, GpuError> {
        let upload = |array| TableBuffers::new(gpu, std::slice::from_ref(array), [1; 2]);
        let step = || TableStep::new(gpu, vec![Some(counter)]);
        let dimensions = field.shape.grid.dimensions;
        Ok(Self {
            grid: DeviceGrid::new(gpu, &field.grid, by_positions)?,
            network,
            table: upload(&field.table.array)?,
            weights: upload(&field.weights.array)?,
            steps: [step()?, step()?],
            moves: Rows::new(0),
            counter,
            positions: DeviceBuffer::zeros(gpu, "positions in a field", room * dimensions)?,
        })
    }

    pub(crate) fn outputs(&self) -> &Buffer {
        &self.network.outputs.raw
    }

    /// Returns the buffer of the gradients by the outputs.
    pub(crate) fn upstream(&self) -> &Buffer {
        &self.network.upstream.raw
    }

    /// Sets the number of positions, and that of the features in use, for everything that is submitted later.
    pub(crate) fn place(&mut self, gpu: &Gpu, rows: usize, used: usize) {
        self.grid.place(gpu, rows, used);
        self.network.place(gpu, rows);
    }

    /// Sets the next step on the parameters; without one they stay as they are.
    pub(crate) fn set_step(&self, gpu: &Gpu, step: Option<&FieldStep>) {
        self.moves.set(usize::from(step.is_some()));
        let Some(step) = step else {
            return;
        };
        let tables = [&self.table, &self.weights];
        for (number, (table, settings)) in tables.into_iter().zip(&self.steps).enumerate() {
            let rates = vec![step.rates[number]; self.counter + 1];
            let at = (step.numbers[number], SecondMomentDecay::PUBLISHED);
            settings.set(gpu, (table, 1), at, &rates);
        }
    }

    fn pass(
        &self,
        (gpu, kernels): (&Gpu, &FieldKernels),
        program: &mut Program,
        record: impl FnOnce(&mut Recording<'_>) -> Result<(), GpuError>,
    ) -> Result<(), GpuError> {
        let encode = |program: &mut Program, at: (&Block, &BlockPass), inputs: &Buffer| {
            let buffers = [&self.positions.raw, &self.table.values.raw, inputs];
            self.grid.encode((gpu, &kernels.grid), program, at, buffers);
            Ok(())
        };
        record(&mut Recording {
            gpu,
            program,
            weights: &self.weights.values.raw,
            encode: &encode,
        })
    }

    /// Records the outputs at the positions.
    pub(crate) fn forward(
        &self,
        at: (&Gpu, &FieldKernels),
        program: &mut Program,
    ) -> Result<(), GpuError> {
        self.pass(at, program, |recording| {
            at.1.passes.forward(recording, &self.network)
        })
    }

    /// Records the gradients by table and weights, after [`DeviceField::forward`], and adds those by the
    /// positions to `by_positions`.
    pub(crate) fn backward(
        &self,
        (gpu, kernels): (&Gpu, &FieldKernels),
        program: &mut Program,
        scratch: &GridScratch,
        by_positions: &Buffer,
    ) -> Result<(), GpuError> {
        self.pass((gpu, kernels), program, |recording| {
            kernels.passes.backward(
                recording,
                &self.network,
                &self.weights.gradients.raw,
                Some(&scratch.by_features.raw),
            )
        })?;
        let at = (gpu, &kernels.grid);
        let (positions, table) = (&self.positions.raw, &self.table);
        let buffers = [positions, &table.gradients.raw];
        self.grid.backward_table(at, program, scratch, buffers);
        let buffers = [positions, &table.values.raw, by_positions];
        self.grid.backward_positions(at, program, scratch, buffers);
        Ok(())
    }

    /// Records a step of Adam on table and weights, which [`DeviceField::set_step`] sets.
    pub(crate) fn step(
        &self,
        (gpu, kernels): (&Gpu, &FieldKernels),
        program: &mut Program,
        status: &Buffer,
    ) {
        let tables = [&self.table, &self.weights];
        for (table, settings) in tables.into_iter().zip(&self.steps) {
            let moved = (settings, table, &self.moves);
            kernels.adam.record(gpu, program, moved, status);
        }
    }

    /// Copies parameters and moments back.
    pub(crate) fn read(&self, gpu: &Gpu, field: &mut GridField) -> Result<(), GpuError> {
        let table = std::slice::from_mut(&mut field.table.array);
        self.table.read(gpu, table)?;
        let weights = std::slice::from_mut(&mut field.weights.array);
        self.weights.read(gpu, weights)
    }

    /// Copies gradients back, for tests.
    #[cfg(test)]
    fn read_gradients(&self, gpu: &Gpu, field: &mut GridField) -> Result<(), GpuError> {
        let table = std::slice::from_mut(&mut field.table.array);
        self.table.read_gradients(gpu, table)?;
        let weights = std::slice::from_mut(&mut field.weights.array);
        self.weights.read_gradients(gpu, weights)
    }
}

impl GridField {
    pub(crate) fn network(&self) -> NetworkShape {
        self.network
    }

    pub(crate) fn grid(&self) -> &HashGrid {
        &self.grid
    }
}

#[cfg(test)]
mod tests;
