//! Density control of a model on a GPU. The host decides on what it reads of the Gaussians: places, sizes,
//! opacities, times and what views said of them. The device copies, removes and orders whole rows, colours
//! and moments among them, which never leave it. Tables, buffers and programs stay as long as there is room.

use super::device_model::{DeviceModel, DevicePart, DevicePartKind, PartTables};
use crate::{
    EngineError,
    device::{DeviceBuffer, Gpu, GpuError},
    gaussians::static_gaussians::{SH_CONSTANT_NAME, SH_REST_NAME},
    model::{Model, Part},
    parameters::{
        ParameterArray, ParameterTable,
        device_table::TableBuffers,
        rows::{RowMover, RowSource},
    },
};

/// The array that numbers the rows of a copy. An f32 numbers them up to 2^24.
const ROWS: &str = "rows";
/// Rows that can be numbered.
pub(super) const MOST_ROWS: usize = 1 << f32::MANTISSA_DIGITS;

/// Whether density control has no reason to look at an array.
fn stays_on_device(array: &ParameterArray) -> bool {
    [SH_CONSTANT_NAME, SH_REST_NAME].contains(&array.name)
}

/// The model as density control sees it: values without colours, rows that are numbered, and ones in place
/// of moments, which become zeros where moments are forgotten.
pub(super) fn outline(
    gpu: &Gpu,
    model: &Model,
    on_device: &[DevicePart],
) -> Result<Model, EngineError> {
    let mut parts = Vec::with_capacity(model.parts.len());
    for (part, on_device) in model.parts.iter().zip(on_device) {
        let mut outline = Part {
            parameterization: part.parameterization.clone(),
            table: outlined(&part.table),
            statistics: part.statistics.clone(),
            steps: part.steps,
        };
        on_device.read_statistics(gpu, &mut outline.statistics)?;
        let rows = outline.table.len();
        let table = &on_device.table;
        let asked = |array: &ParameterArray| array.name != ROWS && array.width > 0;
        let ranges: Vec<_> = (0..)
            .zip(&outline.table.arrays)
            .filter(|(_, array)| asked(array))
            .map(|(number, _)| (&table.values, table.range(number, rows)))
            .collect();
        let read = DeviceBuffer::read_ranges(gpu, &ranges)?;
        let arrays = outline.table.arrays.iter_mut();
        for (array, values) in arrays.filter(|array| asked(array)).zip(read) {
            array.values = values;
        }
        parts.push(outline);
    }
    Ok(Model::new(parts))
}

fn outlined(table: &ParameterTable) -> ParameterTable {
    let len = table.len();
    let mut outline = ParameterTable::new(len);
    for array in &table.arrays {
        let width = if stays_on_device(array) {
            0
        } else {
            array.width
        };
        outline.add(array.name, width, vec![0.0; len * width], 0.0);
    }
    let rows = (0..len).map(|row| row as f32).collect();
    outline.add(ROWS, 1, rows, 0.0);
    for array in &mut outline.arrays {
        array.first_moments.fill(1.0);
    }
    outline
}

/// Gives the host's model as many rows as an outline has. What it holds in them is not what it was.
pub(super) fn resize(model: &mut Model, outline: &Model) {
    for (part, outline) in model.parts.iter_mut().zip(&outline.parts) {
        part.table.resize(outline.table.len());
        part.statistics = outline.statistics.clone();
    }
}

/// Does within the tables of a model on the device, which have room for it, what was done to its outline.
pub(super) fn follow(gpu: &Gpu, outline: &Model, model: &mut DeviceModel) {
    for (outline, on_device) in outline.parts.iter().zip(&model.parts) {
        let table = &outline.table;
        on_device.moves.run(gpu, &sources(table), &forgets(table));
        write_decided(gpu, table, &on_device.table);
        on_device.statistics.write(gpu, &outline.statistics);
    }
}

/// The same in larger tables.
pub(super) fn follow_larger(
    gpu: &Gpu,
    (mover, maximum): (&RowMover, usize),
    outline: &Model,
    parts: Vec<DevicePart>,
) -> Result<Vec<PartTables>, GpuError> {
    let mut moved = Vec::with_capacity(parts.len());
    for (outline, old) in outline.parts.iter().zip(parts) {
        let outline = &outline.table;
        let capacity = larger_capacity(&old, outline.len(), maximum);
        let table = TableBuffers::zeros(gpu, old.table.widths.clone(), capacity)?;
        let moves = mover.between(gpu, &old.table, &table)?;
        moves.run(gpu, &sources(outline), &forgets(outline));
        write_decided(gpu, outline, &table);
        moved.push(PartTables {
            table,
            weights: old.into_weights(),
        });
    }
    Ok(moved)
}

/// Twice the last room where that is not enough, but no more than there may be Gaussians.
fn larger_capacity(old: &DevicePart, needed: usize, maximum: usize) -> usize {
    let last = old.table.capacity;
    match old.kind {
        // What a network works on is made for a number of Gaussians.
        DevicePartKind::Deformable(_) => needed,
        _ if needed <= last => last,
        _ => needed.max((2 * last).min(maximum)),
    }
}

/// Which arrays of an outline forget the moments of all rows.
fn forgets(outline: &ParameterTable) -> Vec<bool> {
    let forgets = |array: &ParameterArray| {
        let moments = &array.first_moments;
        !moments.is_empty() && moments.iter().all(|&moment| moment == 0.0)
    };
    let arrays = outline.arrays.iter();
    let arrays = arrays.filter(|array| array.name != ROWS);
    arrays.map(forgets).collect()
}

/// Writes the values that density control may have changed.
fn write_decided(gpu: &Gpu, outline: &ParameterTable, table: &TableBuffers) {
    for (number, array) in outline.arrays.iter().enumerate() {
        if array.name != ROWS && array.width > 0 {
            let first = table.begin(number) as usize;
            table.values.write(gpu, first, &array.values);
        }
    }
}

/// Where the rows of an outline come from.
fn sources(outline: &ParameterTable) -> Vec<RowSource> {
    let Some(rows) = outline.arrays.last() else {
        return Vec::new();
    };
    let source = |(&row, &moment): (&f32, &f32)| RowSource {
        row: row as usize,
        is_copy: moment == 0.0,
    };
    rows.values
        .iter()
        .zip(&rows.first_moments)
        .map(source)
        .collect()
}
