//! Gaussians that depend on time: the arrays of [`static_gaussians`] and those of a motion.
//!
//! The motion is that of [`periodic`](super::periodic); its velocity is free (PVG) or composed as in
//! [`omni4dgs`](super::omni4dgs). A component that a model lacks has no array: no lifespans without temporal
//! opacity, no velocities without motion. A model without both has no peak times either: the table is that of
//! static Gaussians.

mod columns;
pub(crate) mod gpu;

use std::ops::Range;

use glam::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use self::columns::Columns;
pub use self::columns::{CentreGradient, RawGradient, add_gradients};
use crate::{
    gaussians::{
        ActivatedGaussians,
        omni4dgs::{Decomposition, Observer},
        periodic::{FrameTime, TemporalGradient, TemporalParameters, TemporalState},
        static_gaussians::{self, InitialGaussians, OPACITY_LOGITS, POSITIONS, sigmoid},
    },
    parameters::{ArrayShape, ParameterTable},
};

/// Name of the array of peak times, frames (1 value).
pub const PEAK_TIMES: &str = "peak_times";
/// Name of the array of logarithms of lifespans in frames (1 value).
pub const LOG_LIFESPANS: &str = "log_lifespans";
/// Name of the array of velocities, units per frame (3 values).
pub const VELOCITIES: &str = "velocities";
/// Name of the array of radial velocities, units per frame (3 values).
pub const RADIAL_VELOCITIES: &str = "radial_velocities";
/// Name of the array of tangential velocities, units per frame (3 values).
pub const TANGENTIAL_VELOCITIES: &str = "tangential_velocities";

/// Dependence of Gaussians on time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TimeModel {
    /// Cycle length `l`, frames.
    pub cycle_frames: f32,
    /// Bounds of the lifespans; `None` for opacities that do not depend on time.
    pub lifespans: Option<LifespanRange>,
    /// Model of velocities.
    pub velocity: VelocityModel,
    /// Share of its peak opacity at or below which a Gaussian is not drawn.
    pub least_marginal: f32,
}

impl TimeModel {
    /// Validates numbers that may come from a file.
    ///
    /// # Errors
    /// Returns a line with the invalid number and its value.
    pub fn check(&self) -> Result<(), String> {
        if !(self.cycle_frames.is_finite() && self.cycle_frames > 0.0) {
            return Err(format!("cycle_frames is {}", self.cycle_frames));
        }
        if let Some(LifespanRange {
            least_frames,
            largest_frames,
        }) = self.lifespans
        {
            let is_range = least_frames > 0.0 && least_frames <= largest_frames;
            if !is_range || !largest_frames.is_finite() {
                return Err(format!(
                    "lifespans are {least_frames} to {largest_frames} frames"
                ));
            }
        }
        Ok(())
    }
}

/// Bounds of lifespans, frames.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LifespanRange {
    /// Least lifespan, positive: below it gradients grow with the inverse square.
    pub least_frames: f32,
    /// Largest lifespan: beyond it opacities do not change over any clip.
    pub largest_frames: f32,
}

/// Model of velocities.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VelocityModel {
    /// No motion.
    None,
    /// One free vector (PVG).
    Free,
    /// A radial and a tangential vector (Omni4DGS).
    Decomposed(Decomposition),
}

/// Time and observer of a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewContext {
    /// Time in frames.
    pub frame_time: FrameTime,
    /// Observer; used if velocities are decomposed.
    pub observer: Observer,
}

/// Feature channels into which temporal parameters are rendered, in this order.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct TemporalFeatures {
    /// Three channels: the mean velocity divided by this unit, units per frame.
    pub velocity_unit: Option<f32>,
    /// One channel: the lifespan.
    pub lifespan: Option<LifespanFeature>,
}

/// A lifespan as a feature: `min(beta, largest) / unit`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LifespanFeature {
    /// Lifespan that gives 1, frames.
    pub unit_frames: f32,
    /// Upper bound of the lifespan, frames.
    pub largest_frames: f32,
}

impl LifespanFeature {
    /// Returns the channel's value.
    pub fn value(&self, lifespan: f32) -> f32 {
        lifespan.min(self.largest_frames) / self.unit_frames
    }
}

impl TemporalFeatures {
    /// Returns the number of channels.
    pub fn count(&self) -> usize {
        3 * usize::from(self.velocity_unit.is_some()) + usize::from(self.lifespan.is_some())
    }

    /// Writes the channels of a Gaussian into `out`, [`Self::count`] values.
    pub fn write(&self, mean_velocity: Vec3, lifespan: f32, out: &mut [f32]) {
        let mut at = 0;
        if let Some(unit) = self.velocity_unit {
            out[..3].copy_from_slice(&(mean_velocity / unit).to_array());
            at = 3;
        }
        if let Some(feature) = self.lifespan {
            out[at] = feature.value(lifespan);
        }
    }

    /// Writes the channels of Gaussians without times of their own, which have this lifespan in frames and no mean
    /// velocity, into their rows of `out`.
    pub(crate) fn write_untimed(&self, lifespan: f32, rows: Range<usize>, out: &mut [f32]) {
        let count = self.count();
        if count > 0 {
            for row in out[rows.start * count..rows.end * count].chunks_mut(count) {
                self.write(Vec3::ZERO, lifespan, row);
            }
        }
    }

    /// Returns gradients by the mean velocity and by the logarithm of the lifespan from those by the
    /// channels.
    fn vjp(&self, lifespan: f32, gradient: &[f32]) -> (Vec3, f32) {
        let (mut by_velocity, mut by_log_lifespan, mut at) = (Vec3::ZERO, 0.0, 0);
        if let Some(unit) = self.velocity_unit {
            by_velocity = Vec3::from_slice(gradient) / unit;
            at = 3;
        }
        if let Some(feature) = self.lifespan
            && lifespan < feature.largest_frames
        {
            by_log_lifespan = gradient[at] * lifespan / feature.unit_frames;
        }
        (by_velocity, by_log_lifespan)
    }
}

/// Initial temporal parameters, one entry per Gaussian in each array.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct InitialTimes {
    /// Peak times, frames.
    pub peaks: Vec<f32>,
    /// Lifespans, frames.
    pub lifespans: Vec<f32>,
    /// Velocities, units per frame.
    pub velocities: Vec<[f32; 3]>,
}

impl InitialTimes {
    /// Returns the same parameters for `len` Gaussians that do not move.
    pub fn constant(len: usize, peak: f32, lifespan: f32) -> Self {
        Self {
            peaks: vec![peak; len],
            lifespans: vec![lifespan; len],
            velocities: vec![[0.0; 3]; len],
        }
    }

    /// Appends other parameters.
    pub fn extend(&mut self, others: Self) {
        self.peaks.extend(others.peaks);
        self.lifespans.extend(others.lifespans);
        self.velocities.extend(others.velocities);
    }
}

impl TimeModel {
    /// Returns the arrays in addition to those of static Gaussians, in their order.
    pub fn shapes(&self) -> Vec<ArrayShape> {
        let mut shapes = Vec::new();
        let mut add = |name, width| shapes.push(ArrayShape { name, width });
        if self.lifespans.is_some() || self.velocity != VelocityModel::None {
            add(PEAK_TIMES, 1);
        }
        if self.lifespans.is_some() {
            add(LOG_LIFESPANS, 1);
        }
        match self.velocity {
            VelocityModel::None => {}
            VelocityModel::Free => add(VELOCITIES, 3),
            VelocityModel::Decomposed(_) => {
                add(RADIAL_VELOCITIES, 3);
                add(TANGENTIAL_VELOCITIES, 3);
            }
        }
        shapes
    }

    /// Creates a table with all arrays; parameters in `times` that the model lacks are ignored.
    pub fn table(
        &self,
        initial: &InitialGaussians,
        times: &InitialTimes,
        sh_degree: usize,
    ) -> ParameterTable {
        let mut table = static_gaussians::table(initial, sh_degree);
        let velocities: Vec<f32> = times.velocities.as_flattened().to_vec();
        for ArrayShape { name, width } in self.shapes() {
            let values = match name {
                PEAK_TIMES => times.peaks.clone(),
                LOG_LIFESPANS => times.lifespans.iter().map(|beta| beta.ln()).collect(),
                _ => velocities.clone(),
            };
            table.add(name, width, values, 0.0);
        }
        self.keep_within_bounds(&mut table);
        table
    }

    /// Clamps lifespans to their bounds.
    pub fn keep_within_bounds(&self, table: &mut ParameterTable) {
        if let Some(range) = self.lifespans
            && let Some(array) = table.position(LOG_LIFESPANS)
        {
            let (low, high) = range.logarithms();
            for value in &mut table.arrays[array].values {
                *value = value.clamp(low, high);
            }
        }
    }

    /// Reads the temporal parameters of a table of this model.
    pub fn temporal_table<'a>(
        &'a self,
        table: &'a ParameterTable,
        observer: Observer,
    ) -> TemporalTable<'a> {
        TemporalTable {
            model: self,
            table,
            columns: Columns::of(table),
            observer,
        }
    }

    /// Activates a table at a moment into the entries of `out` from `first` on.
    pub fn activate_from(
        &self,
        table: &ParameterTable,
        look: &ViewContext,
        features: &TemporalFeatures,
        first: usize,
        out: &mut ActivatedGaussians,
    ) {
        static_gaussians::activate_from(table, first, out);
        let temporal_table = self.temporal_table(table, look.observer);
        let (entries, channels) = (first..first + table.len(), out.feature_count);
        let positions = out.positions[entries.clone()].par_iter_mut();
        let opacities = out.opacities[entries.clone()].par_iter_mut();
        let each = |index: usize, position: &mut [f32; 3], opacity: &mut f32, row: &mut [f32]| {
            let temporal_parameters = temporal_table.temporal_parameters(index);
            let state = temporal_parameters.at(look.frame_time, self.cycle_frames);
            *position = (Vec3::from_array(*position) + state.displacement).to_array();
            *opacity *= self.drawn_marginal(state.marginal);
            features.write(state.mean_velocity, temporal_parameters.lifespan, row);
        };
        let both = positions.zip(opacities).enumerate().with_min_len(1024);
        if channels == 0 {
            both.for_each(|(index, (position, opacity))| each(index, position, opacity, &mut []));
        } else {
            both.zip(
                out.features[entries.start * channels..entries.end * channels]
                    .par_chunks_mut(channels),
            )
            .for_each(|((index, (position, opacity)), row)| each(index, position, opacity, row));
        }
    }

    /// Computes the VJP of [`TimeModel::activate_from`]: overwrites the table's gradients.
    pub fn activate_from_vjp(
        &self,
        table: &mut ParameterTable,
        look: &ViewContext,
        features: &TemporalFeatures,
        first: usize,
        instant: &ActivatedGaussians,
        gradient: &ActivatedGaussians,
    ) {
        static_gaussians::activate_from_vjp(table, first, instant, gradient);
        let channels = gradient.feature_count;
        let temporal_table = self.temporal_table(table, look.observer);
        let each = |index: usize| {
            let entry = first + index;
            let temporal_parameters = temporal_table.temporal_parameters(index);
            let marginal = self.drawn_marginal(
                temporal_parameters
                    .at(look.frame_time, self.cycle_frames)
                    .marginal,
            );
            let opacity = sigmoid(temporal_table.table.arrays[OPACITY_LOGITS].values[index]);
            let by_opacity = gradient.opacities[entry];
            let (by_velocity, by_log_lifespan) = features.vjp(
                temporal_parameters.lifespan,
                &gradient.features[entry * channels..(entry + 1) * channels],
            );
            let upstream = TemporalState {
                displacement: Vec3::from_array(gradient.positions[entry]),
                marginal: if marginal > 0.0 {
                    by_opacity * opacity
                } else {
                    0.0
                },
                mean_velocity: by_velocity,
            };
            let mut by_temporal =
                temporal_parameters.at_vjp(look.frame_time, self.cycle_frames, &upstream);
            by_temporal.log_lifespan += by_log_lifespan;
            (
                by_opacity * marginal * opacity * (1.0 - opacity),
                temporal_table.raw_vjp(index, &by_temporal),
            )
        };
        let gradients: Vec<(f32, RawGradient)> = (0..temporal_table.table.len())
            .into_par_iter()
            .with_min_len(1024)
            .map(each)
            .collect();
        let columns = temporal_table.columns;
        columns.clear_gradients(table);
        for (index, (by_logit, raw)) in gradients.iter().enumerate() {
            table.arrays[OPACITY_LOGITS].gradients[index] = *by_logit;
            columns.add(table, index, raw);
        }
    }

    fn drawn_marginal(&self, marginal: f32) -> f32 {
        if marginal > self.least_marginal {
            marginal
        } else {
            0.0
        }
    }
}

impl LifespanRange {
    pub(crate) fn logarithms(&self) -> (f32, f32) {
        (self.least_frames.ln(), self.largest_frames.ln())
    }
}

/// Temporal parameters of a table, seen by an observer.
#[derive(Debug, Clone, Copy)]
pub struct TemporalTable<'a> {
    model: &'a TimeModel,
    table: &'a ParameterTable,
    columns: Columns,
    observer: Observer,
}

impl TemporalTable<'_> {
    /// Returns the parameters of one Gaussian.
    pub fn temporal_parameters(&self, index: usize) -> TemporalParameters {
        let scalar = |array: usize| self.table.arrays[array].values[index];
        let vector = |array: usize| Vec3::from_slice(self.table.row(array, index));
        let lifespan = match (self.model.lifespans, self.columns.log_lifespans) {
            (Some(range), Some(array)) => {
                let (low, high) = range.logarithms();
                scalar(array).clamp(low, high).exp()
            }
            _ => f32::INFINITY,
        };
        let velocity = match (self.model.velocity, self.columns.decomposed) {
            (VelocityModel::Decomposed(decomposition), Some([radial, tangential])) => decomposition
                .at(&self.observer, self.centre(index))
                .combine(vector(radial), vector(tangential)),
            _ => self.columns.velocities.map_or(Vec3::ZERO, vector),
        };
        TemporalParameters {
            peak: self.columns.peaks.map_or(0.0, scalar),
            lifespan,
            velocity,
        }
    }

    /// Returns the observer.
    pub fn observer(&self) -> &Observer {
        &self.observer
    }

    /// Returns the centre at the peak time.
    pub fn centre(&self, index: usize) -> Vec3 {
        Vec3::from_slice(self.table.row(POSITIONS, index))
    }

    /// Returns `rho` of one Gaussian.
    pub fn staticness(&self, index: usize) -> f32 {
        self.temporal_parameters(index)
            .staticness(self.model.cycle_frames)
    }

    /// Returns gradients by raw parameters from those by [`TemporalTable::temporal_parameters`].
    pub fn raw_vjp(&self, index: usize, gradient: &TemporalGradient) -> RawGradient {
        let is_within = match (self.model.lifespans, self.columns.log_lifespans) {
            (Some(range), Some(array)) => {
                let (low, high) = range.logarithms();
                (low..=high).contains(&self.table.arrays[array].values[index])
            }
            _ => false,
        };
        let velocities = match self.model.velocity {
            VelocityModel::None => [Vec3::ZERO; 2],
            VelocityModel::Free => [gradient.velocity, Vec3::ZERO],
            VelocityModel::Decomposed(decomposition) => decomposition
                .at(&self.observer, self.centre(index))
                .combine_vjp(gradient.velocity),
        };
        RawGradient {
            peak: gradient.peak,
            log_lifespan: if is_within {
                gradient.log_lifespan
            } else {
                0.0
            },
            velocities,
        }
    }
}

#[cfg(test)]
mod tests;
