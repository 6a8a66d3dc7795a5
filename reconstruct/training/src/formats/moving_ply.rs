//! Gaussians that depend on time as a PLY: the properties of 3DGS, which its viewers read, and those
//! of their motion.
//!
//! Further properties are named as the arrays of [`temporal`](omnilife_engine::gaussians::temporal), numbered
//! where an array has several values. Peak times are in seconds from the clip's middle, lifespans are logarithms
//! of seconds, and velocities are in world units per second.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::path::Path;

use omnilife_schemas::{Similarity, records::InvalidGaussians, store::StoreError};

use crate::{error::ReconstructError, formats::ply};
use omnilife_engine::clock::Clock;
use omnilife_engine::{
    gaussians::temporal::{LOG_LIFESPANS, PEAK_TIMES, TimeModel},
    parameters::{ArrayShape, ParameterTable},
};

fn properties(shape: &ArrayShape) -> Vec<String> {
    if shape.width == 1 {
        vec![shape.name.to_owned()]
    } else {
        (0..shape.width)
            .map(|column| format!("{}_{column}", shape.name))
            .collect()
    }
}

/// Returns factor and offset of an array's unit in the file, from that in the table.
fn unit(name: &str, normalization: &Similarity, clock: &Clock) -> [f64; 2] {
    match name {
        PEAK_TIMES => [clock.frame_seconds, 0.0],
        LOG_LIFESPANS => [1.0, clock.frame_seconds.ln()],
        _ => [1.0 / (normalization.scale * clock.frame_seconds), 0.0],
    }
}

/// Writes moving Gaussians atomically.
///
/// # Errors
/// When the file cannot be written.
pub fn write(
    path: &Path,
    table: &ParameterTable,
    model: &TimeModel,
    normalization: &Similarity,
    clock: &Clock,
) -> Result<(), StoreError> {
    let shapes = model.shapes();
    let names: Vec<String> = shapes.iter().flat_map(properties).collect();
    let arrays: Vec<(usize, [f64; 2])> = shapes
        .iter()
        .filter_map(|shape| {
            let array = table.position(shape.name)?;
            Some((array, unit(shape.name, normalization, clock)))
        })
        .collect();
    ply::write_with(path, table, normalization, &names, |index, row| {
        for &(array, [factor, summand]) in &arrays {
            let values = table.row(array, index).iter();
            row.extend(values.map(|&value| (f64::from(value) * factor + summand) as f32));
        }
    })
}

/// Reads moving Gaussians of a model into normalized coordinates and frames; invalid values are counted in
/// `invalid`.
///
/// # Errors
/// Those of [`ply::read`].
#[expect(
    clippy::indexing_slicing,
    clippy::arithmetic_side_effects,
    reason = "columns are as long as the table, which was checked"
)]
pub fn read(
    path: &Path,
    model: &TimeModel,
    normalization: &Similarity,
    clock: &Clock,
    invalid: &mut InvalidGaussians,
) -> Result<ParameterTable, ReconstructError> {
    let shapes = model.shapes();
    let names: Vec<String> = shapes.iter().flat_map(properties).collect();
    let (mut table, columns) = ply::read_with(path, normalization, &names, invalid)?;
    let mut columns = columns.into_iter();
    for shape in shapes {
        let [factor, summand] = unit(shape.name, normalization, clock);
        let of_array: Vec<Vec<f32>> = columns.by_ref().take(shape.width).collect();
        let mut values = Vec::with_capacity(shape.width * table.len());
        for index in 0..table.len() {
            let row = of_array.iter().map(|column| f64::from(column[index]));
            values.extend(row.map(|value| ((value - summand) / factor) as f32));
        }
        table.add(shape.name, shape.width, values, 0.0);
    }
    Ok(table)
}

#[cfg(test)]
mod tests {
    use super::*;
    use omnilife_engine::gaussians::{
        static_gaussians::InitialGaussians,
        temporal::{InitialTimes, LifespanRange, VelocityModel},
    };

    #[test]
    fn what_is_written_in_seconds_is_read_back_in_frames() -> Result<(), Box<dyn std::error::Error>>
    {
        let model = TimeModel {
            cycle_frames: 10.0,
            lifespans: Some(LifespanRange {
                least_frames: 0.25,
                largest_frames: 1e6,
            }),
            velocity: VelocityModel::Free,
            least_marginal: 0.0,
        };
        let initial = InitialGaussians::isotropic(
            vec![[1.0, 2.0, 3.0], [-4.0, 0.5, 0.25]],
            &[0.25, 2.0],
            vec![[0.5; 3], [0.1, 0.2, 0.3]],
            vec![0.5, 0.9],
        );
        let times = InitialTimes {
            peaks: vec![3.0, -7.0],
            lifespans: vec![4.0, 0.5],
            velocities: vec![[0.1, 0.2, 0.3], [-1.0, 0.0, 0.5]],
        };
        let table = model.table(&initial, &times, 1);
        let normalization = Similarity::new([10.0, 20.0, 30.0], 0.5);
        let clock = Clock::new(100.0, 0.1, 60.0);
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("moving.ply");
        write(&path, &table, &model, &normalization, &clock)?;
        let mut invalid = InvalidGaussians::default();
        let read = read(&path, &model, &normalization, &clock, &mut invalid)?;
        assert_eq!(invalid, InvalidGaussians::default());
        for (a, b) in table.arrays.iter().zip(&read.arrays) {
            assert_eq!((a.name, a.width), (b.name, b.width));
            let error = a.values.iter().zip(&b.values).map(|(a, b)| (a - b).abs());
            assert!(error.fold(0.0, f32::max) < 1e-5, "{}", a.name);
        }
        // In the file: 0.1 units per frame are 0.2 world units in a tenth of a second.
        let names = ["peak_times", "log_lifespans", "velocities_0"].map(str::to_owned);
        let (_, columns) = ply::read_with(&path, &normalization, &names, &mut invalid)?;
        let first: Vec<f32> = columns.iter().map(|column| column[0]).collect();
        for (found, expected) in first.iter().zip([0.3, 0.4_f32.ln(), 2.0]) {
            assert!((found - expected).abs() < 1e-5, "{first:?}");
        }
        Ok(())
    }
}
