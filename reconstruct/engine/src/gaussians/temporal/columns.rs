//! Arrays of temporal parameters in a table, and gradients by them.

use glam::Vec3;

use super::{LOG_LIFESPANS, PEAK_TIMES, RADIAL_VELOCITIES, TANGENTIAL_VELOCITIES, VELOCITIES};
use crate::{gaussians::static_gaussians::POSITIONS, parameters::ParameterTable};

/// Indices of the temporal arrays of a table.
#[derive(Debug, Clone, Copy)]
pub(super) struct Columns {
    pub(super) peaks: Option<usize>,
    pub(super) log_lifespans: Option<usize>,
    pub(super) velocities: Option<usize>,
    /// Radial and tangential velocities.
    pub(super) decomposed: Option<[usize; 2]>,
}

impl Columns {
    pub(super) fn of(table: &ParameterTable) -> Self {
        let radial = table.position(RADIAL_VELOCITIES);
        Self {
            peaks: table.position(PEAK_TIMES),
            log_lifespans: table.position(LOG_LIFESPANS),
            velocities: table.position(VELOCITIES),
            decomposed: radial
                .zip(table.position(TANGENTIAL_VELOCITIES))
                .map(<[usize; 2]>::from),
        }
    }

    pub(super) fn clear_gradients(&self, table: &mut ParameterTable) {
        let decomposed = self.decomposed.into_iter().flatten();
        let others = [self.peaks, self.log_lifespans, self.velocities];
        for array in others.into_iter().flatten().chain(decomposed) {
            table.arrays[array].gradients.fill(0.0);
        }
    }

    pub(super) fn add(&self, table: &mut ParameterTable, index: usize, raw: &RawGradient) {
        let mut add_three = |array: usize, by: Vec3| {
            let row = &mut table.arrays[array].gradients[3 * index..3 * index + 3];
            for (sum, value) in row.iter_mut().zip(by.to_array()) {
                *sum += value;
            }
        };
        if let Some(array) = self.velocities {
            add_three(array, raw.velocities[0]);
        }
        if let Some([radial, tangential]) = self.decomposed {
            add_three(radial, raw.velocities[0]);
            add_three(tangential, raw.velocities[1]);
        }
        if let Some(array) = self.peaks {
            table.arrays[array].gradients[index] += raw.peak;
        }
        if let Some(array) = self.log_lifespans {
            table.arrays[array].gradients[index] += raw.log_lifespan;
        }
    }
}

/// Gradients by the raw temporal parameters of one Gaussian.
#[derive(Debug, Clone, Copy, Default)]
pub struct RawGradient {
    pub(super) peak: f32,
    pub(super) log_lifespan: f32,
    /// By the free velocity, or by the radial and the tangential one.
    pub(super) velocities: [Vec3; 2],
}

/// Index of a Gaussian, and gradients by its raw temporal parameters and by its centre.
pub type CentreGradient = (usize, RawGradient, Vec3);

/// Adds gradients by raw temporal parameters and by the centre to a table's.
pub fn add_gradients(table: &mut ParameterTable, gradients: &[CentreGradient]) {
    let columns = Columns::of(table);
    for (index, raw, by_centre) in gradients {
        columns.add(table, *index, raw);
        let row = &mut table.arrays[POSITIONS].gradients[3 * index..3 * index + 3];
        for (sum, value) in row.iter_mut().zip(by_centre.to_array()) {
            *sum += value;
        }
    }
}
