//! Density control of a model on a GPU. The host decides on what it reads of the Gaussians: places, sizes,
//! opacities, times and what views said of them. The device copies, removes and orders whole rows, colours
//! and moments among them, which never leave it.

use super::device_model::{DevicePart, PartTables};
use crate::{
    EngineError,
    device::Gpu,
    gaussians::static_gaussians::{SH_CONSTANT_NAME, SH_REST_NAME},
    model::{Model, Part},
    parameters::{
        ParameterArray, ParameterTable,
        rows::{MovedArray, RowMover, RowSource},
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
        };
        on_device.read_statistics(gpu, &mut outline.statistics)?;
        for (number, array) in outline.table.arrays.iter_mut().enumerate() {
            if array.name != ROWS && array.width > 0 {
                array.values = on_device.table.read_array(gpu, number)?;
            }
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

/// Does on the device what was done to an outline, and gives the model there that many rows. What the model
/// of the host holds in them is not what it was.
pub(super) fn follow(
    gpu: &Gpu,
    mover: &RowMover,
    outline: &Model,
    model: &mut Model,
    on_device: Vec<DevicePart>,
) -> Result<Vec<PartTables>, EngineError> {
    let mut moved = Vec::with_capacity(on_device.len());
    let parts = model.parts.iter_mut().zip(&outline.parts).zip(on_device);
    for ((part, outline), old) in parts {
        let arrays: Vec<MovedArray> = part
            .table
            .arrays
            .iter()
            .zip(&outline.table.arrays)
            .map(|(array, outlined)| MovedArray {
                width: array.width,
                forgets: !outlined.first_moments.is_empty()
                    && outlined.first_moments.iter().all(|&moment| moment == 0.0),
            })
            .collect();
        let table = (&old.table, old.entries.len);
        let table = mover.moved(gpu, table, &arrays, &sources(&outline.table))?;
        for (number, array) in outline.table.arrays.iter().enumerate() {
            if array.name != ROWS && array.width > 0 {
                table
                    .values
                    .write(gpu, table.begin(number) as usize, &array.values);
            }
        }
        part.table.resize(outline.table.len());
        part.statistics = outline.statistics.clone();
        moved.push(PartTables {
            table,
            weights: old.into_weights(),
        });
    }
    Ok(moved)
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
