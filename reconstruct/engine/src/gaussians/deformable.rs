//! Canonical Gaussians deformed to a time by a network (Deformable-GS).
//!
//! Source: Yang et al., "Deformable 3D Gaussians for High-Fidelity Monocular Dynamic Scene Reconstruction",
//! 2024, and its repository (ingra14m/Deformable-3D-Gaussians, `utils/time_utils.py`,
//! `scene/deform_model.py`, `gaussian_renderer/__init__.py`). With the positional encodings `PE`, a length
//! `u` and the time `t` in [0, 1]:
//!
//! ```text
//! (dx, dq, ds) = f(PE(sg(mu) / u), PE(t))
//! mu(t) = mu + u dx        q(t) = normalize(q/|q| + dq)        s(t) = max(exp(s) + u ds, least)
//! ```
//!
//! `sg`: no gradient flows through the encoded position. Opacities and colours do not depend on time.
//! Departures: lengths are relative to `u`, because octaves up to `2^9 mu` alias in a scene hundreds of units
//! across. Quaternions are normalized again and scales stay positive, as the renderer expects. The output
//! layer starts at 0, so that the network sets in without a jump.

pub(crate) mod gpu;
pub mod settings;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use self::settings::DeformationSettings;
use crate::clock::TimeSpan;
use crate::fields::mlp::{
    encoding,
    network::NetworkShape,
    passes::{Activations, NetworkGradients},
};
use crate::gaussians::{
    device_twin::DeviceTwin,
    parameterization::{Parameterization, Viewpoint},
    temporal::TemporalFeatures,
};
use crate::parameters::SharedParameters;
use crate::{
    gaussians::{
        ActivatedGaussians,
        static_gaussians::{self, POSITIONS},
    },
    parameters::{ParameterArray, ParameterTable},
};

/// Name of the network's weights among the arrays of a model.
pub const DEFORMATION_WEIGHTS: &str = "deformation_weights";

/// Outputs: 3 added to the centre, 4 to the quaternion, 3 to the scales.
const OUTPUTS: usize = 10;
/// Least scale, relative to the length unit.
const LEAST_SCALE: f32 = 1e-7;
/// Lower bound of a quaternion's length when it is normalized.
const LEAST_QUATERNION_LENGTH: f32 = 1e-6;
/// Activations kept for the backward pass, bytes: those of about 130,000 Gaussians. The others are computed
/// twice.
const LARGEST_ACTIVATIONS_BYTES: usize = 1 << 30;

/// The network's sizes and its unit of length.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DeformationModel {
    /// Octaves in the encoding of a position.
    pub position_octaves: usize,
    /// Octaves in the encoding of the time.
    pub time_octaves: usize,
    /// Hidden layers.
    pub depth: usize,
    /// Width of each hidden layer.
    pub width: usize,
    /// Hidden layer, from 0, whose output is concatenated with the inputs again.
    pub skip_after: usize,
    /// Unit of length, normalized units: positions are divided by it, offsets of positions and scales are
    /// multiplied by it.
    pub length_unit: f32,
}

impl DeformationModel {
    /// Returns the published sizes for real scenes.
    pub fn published(length_unit: f32) -> Self {
        Self {
            position_octaves: 10,
            time_octaves: 10,
            depth: 8,
            width: 256,
            skip_after: 4,
            length_unit,
        }
    }

    /// Validates sizes that may come from a file.
    ///
    /// # Errors
    /// Returns a line with the invalid size and its value.
    pub fn check(&self) -> Result<(), String> {
        let sizes = [
            ("position_octaves", self.position_octaves, 0..=64),
            ("time_octaves", self.time_octaves, 0..=64),
            ("depth", self.depth, 1..=64),
            ("width", self.width, 1..=4096),
        ];
        for (name, size, allowed) in sizes {
            if !allowed.contains(&size) {
                let (least, most) = allowed.into_inner();
                return Err(format!(
                    "{name} of the deformation is {size}, expected {least} to {most}"
                ));
            }
        }
        if !(self.length_unit.is_finite() && self.length_unit > 0.0) {
            let unit = self.length_unit;
            return Err(format!("length_unit of the deformation is {unit}"));
        }
        Ok(())
    }

    /// Returns the shape of the network.
    pub fn network(&self) -> NetworkShape {
        NetworkShape {
            row_inputs: encoding::width(3, self.position_octaves),
            shared_inputs: encoding::width(1, self.time_octaves),
            depth: self.depth,
            width: self.width,
            skip_after: Some(self.skip_after),
            has_biases: true,
            outputs: OUTPUTS,
        }
    }

    /// Returns the bytes of training besides the Gaussians: weights with gradients, moments and partial sums,
    /// and the activations of `gaussians` Gaussians.
    pub fn training_bytes(&self, gaussians: u64) -> u64 {
        let network = self.network();
        let rows = usize::try_from(gaussians).unwrap_or(usize::MAX);
        let activations = network.activation_bytes(rows, LARGEST_ACTIVATIONS_BYTES);
        (20 * 4 * network.weight_count() + activations) as u64
    }

    fn encoded_time(&self, time: f32) -> Vec<f32> {
        let mut encoded = vec![0.0; encoding::width(1, self.time_octaves)];
        encoding::encode(&[time], self.time_octaves, &mut encoded);
        encoded
    }

    fn encode_position(&self, positions: &[[f32; 3]], index: usize, out: &mut [f32]) {
        let position = positions[index].map(|value| value / self.length_unit);
        encoding::encode(&position, self.position_octaves, out);
    }
}

/// Canonical Gaussians deformed by a network.
#[derive(Debug)]
pub struct Deformable {
    /// Network, start of its training, and clock of the clip.
    pub settings: DeformationSettings,
    /// The network's weights.
    pub weights: SharedParameters,
    evaluation: Deformation,
    /// True if the last activation evaluated the network.
    took_part: bool,
}

impl Deformable {
    /// Creates the parameterization with weights in the order of [`NetworkShape`].
    pub fn new(settings: DeformationSettings, weights: Vec<f32>) -> Self {
        Self {
            settings,
            weights: SharedParameters::new(DEFORMATION_WEIGHTS, weights),
            evaluation: Deformation::default(),
            took_part: false,
        }
    }

    /// Returns the network's time of a viewpoint in [0, 1], or `None` where the network is not evaluated. It
    /// is evaluated in training after its warm-up, and in images once it has been trained.
    pub fn network_time(&self, at: &Viewpoint) -> Option<f32> {
        let takes_part = match at.scheduled {
            Some(scheduled) => scheduled > self.settings.warm_up_iterations,
            None => self.weights.steps > 0,
        };
        takes_part.then(|| self.settings.unit_time(at.seconds, at.shift_frames))
    }
}

impl Parameterization for Deformable {
    fn id(&self) -> &'static str {
        "deformable"
    }

    fn activate(
        &mut self,
        table: &ParameterTable,
        at: &Viewpoint,
        features: &TemporalFeatures,
        first: usize,
        out: &mut ActivatedGaussians,
    ) {
        let time = self.network_time(at);
        self.took_part = time.is_some();
        static_gaussians::activate_from(table, first, out);
        let rows = first..first + table.len();
        features.write_untimed(self.untimed_lifespan(), rows, &mut out.features);
        if let Some(time) = time {
            // Images without a backward pass need no activations.
            self.evaluation.keep_activations(at.scheduled.is_some());
            let (model, weights) = (&self.settings.model, &self.weights.array.values);
            self.evaluation
                .deform(model, weights, table, time, first, out);
        }
    }

    fn activate_backward(
        &mut self,
        table: &mut ParameterTable,
        at: &Viewpoint,
        _: &TemporalFeatures,
        first: usize,
        activated: &mut ActivatedGaussians,
        gradient: &mut ActivatedGaussians,
    ) {
        if let Some(time) = self.network_time(at) {
            let (model, weights) = (&self.settings.model, &mut self.weights.array);
            self.evaluation
                .deform_vjp(model, weights, table, time, first, (activated, gradient));
        }
        static_gaussians::activate_from_vjp(table, first, activated, gradient);
    }

    fn shared(&self) -> Option<&SharedParameters> {
        Some(&self.weights)
    }

    fn shared_mut(&mut self) -> Option<&mut SharedParameters> {
        Some(&mut self.weights)
    }

    fn stepped_shared(&mut self) -> Option<&mut SharedParameters> {
        self.took_part.then_some(&mut self.weights)
    }

    fn time_span(&self) -> Option<TimeSpan> {
        Some(self.settings.clock.span())
    }

    fn tells_static_from_dynamic(&self) -> bool {
        false
    }

    fn device_twin(&self) -> Option<&dyn DeviceTwin> {
        Some(self)
    }

    fn boxed(&self) -> Box<dyn Parameterization> {
        Box::new(Self {
            settings: self.settings,
            weights: self.weights.clone(),
            evaluation: Deformation::default(),
            took_part: false,
        })
    }
}

/// State of an evaluation: the network's outputs, and the activations for their gradients.
#[derive(Debug)]
pub struct Deformation {
    activations: Activations,
    outputs: Vec<f32>,
    upstream: Vec<f32>,
    /// Activated scales of the canonical Gaussians.
    scales: Vec<[f32; 3]>,
    rotations: Vec<[f32; 4]>,
}

impl Default for Deformation {
    fn default() -> Self {
        Self {
            activations: Activations::new(LARGEST_ACTIVATIONS_BYTES),
            outputs: Vec::new(),
            upstream: Vec::new(),
            scales: Vec::new(),
            rotations: Vec::new(),
        }
    }
}

impl Deformation {
    /// Sets whether the next evaluation keeps its activations for the backward pass.
    fn keep_activations(&mut self, keeps: bool) {
        let bytes = if keeps { LARGEST_ACTIVATIONS_BYTES } else { 0 };
        self.activations.set_limit_bytes(bytes);
    }

    /// Activates canonical Gaussians and deforms them to a time in [0, 1].
    pub fn activate(
        &mut self,
        model: &DeformationModel,
        weights: &[f32],
        table: &ParameterTable,
        time: f32,
        out: &mut ActivatedGaussians,
    ) {
        static_gaussians::activate(table, out);
        self.deform(model, weights, table, time, 0, out);
    }

    /// Deforms the activated canonical Gaussians from entry `first` on.
    fn deform(
        &mut self,
        model: &DeformationModel,
        weights: &[f32],
        table: &ParameterTable,
        time: f32,
        first: usize,
        out: &mut ActivatedGaussians,
    ) {
        let entries = first..first + table.len();
        let positions = table.arrays[POSITIONS].values.as_chunks::<3>().0;
        self.outputs.resize(OUTPUTS * table.len(), 0.0);
        model.network().forward(
            weights,
            &model.encoded_time(time),
            &|index, out| model.encode_position(positions, index, out),
            &mut self.activations,
            &mut self.outputs,
        );
        self.scales.clear();
        self.scales.extend_from_slice(&out.scales[entries.clone()]);
        self.rotations.clear();
        self.rotations
            .extend_from_slice(&out.rotations[entries.clone()]);
        let unit = model.length_unit;
        (
            self.outputs.as_chunks::<OUTPUTS>().0.par_iter(),
            out.positions[entries.clone()].par_iter_mut(),
            out.scales[entries.clone()].par_iter_mut(),
            out.rotations[entries].par_iter_mut(),
        )
            .into_par_iter()
            .with_min_len(1024)
            .for_each(|(output, position, scale, rotation)| {
                for axis in 0..3 {
                    position[axis] += unit * output[axis];
                    scale[axis] += unit * output[7 + axis];
                    // `max` would replace a NaN scale by the least one, and draw it.
                    if scale[axis] < unit * LEAST_SCALE {
                        scale[axis] = unit * LEAST_SCALE;
                    }
                }
                let (sum, length) = deformed_quaternion(rotation, output);
                *rotation = sum.map(|value| value / length);
            });
    }

    /// Computes the VJP of [`Deformation::activate`] with the same arguments: overwrites the gradients of the
    /// table and of the weights. `instant` and `gradient` are consumed.
    ///
    /// A Gaussian whose gradient is not finite does not contribute to that of the weights.
    pub fn activate_vjp(
        &mut self,
        model: &DeformationModel,
        weights: &mut ParameterArray,
        table: &mut ParameterTable,
        time: f32,
        (instant, gradient): (&mut ActivatedGaussians, &mut ActivatedGaussians),
    ) {
        self.deform_vjp(model, weights, table, time, 0, (instant, gradient));
        static_gaussians::activate_vjp(table, instant, gradient);
    }

    /// Computes the VJP of [`Deformation::deform`]: leaves the canonical Gaussians, and the gradients by
    /// them, in the entries of `instant` and `gradient`.
    fn deform_vjp(
        &mut self,
        model: &DeformationModel,
        weights: &mut ParameterArray,
        table: &ParameterTable,
        time: f32,
        first: usize,
        (instant, gradient): (&mut ActivatedGaussians, &mut ActivatedGaussians),
    ) {
        let entries = first..first + table.len();
        let unit = model.length_unit;
        self.upstream.resize(self.outputs.len(), 0.0);
        (
            self.upstream.as_chunks_mut::<OUTPUTS>().0.par_iter_mut(),
            self.outputs.as_chunks::<OUTPUTS>().0.par_iter(),
            self.scales.par_iter(),
            self.rotations.par_iter(),
            gradient.positions[entries.clone()].par_iter(),
            gradient.scales[entries.clone()].par_iter_mut(),
            gradient.rotations[entries.clone()].par_iter_mut(),
        )
            .into_par_iter()
            .with_min_len(1024)
            .for_each(
                |(upstream, output, scale, rotation, by_position, by_scale, by_rotation)| {
                    for axis in 0..3 {
                        if scale[axis] + unit * output[7 + axis] < unit * LEAST_SCALE {
                            by_scale[axis] = 0.0;
                        }
                        upstream[axis] = unit * by_position[axis];
                        upstream[7 + axis] = unit * by_scale[axis];
                    }
                    // d(p/|p|): remove the part along p, divide by the length.
                    let (sum, length) = deformed_quaternion(rotation, output);
                    let along = (0..4)
                        .map(|axis| sum[axis] / length * by_rotation[axis])
                        .sum::<f32>();
                    for axis in 0..4 {
                        by_rotation[axis] =
                            (by_rotation[axis] - sum[axis] / length * along) / length;
                        upstream[3 + axis] = by_rotation[axis];
                    }
                    if !upstream.iter().all(|value| value.is_finite()) {
                        upstream.fill(0.0);
                    }
                },
            );
        let positions = table.arrays[POSITIONS].values.as_chunks::<3>().0;
        model.network().backward(
            &weights.values,
            &model.encoded_time(time),
            &|index, out| model.encode_position(positions, index, out),
            &self.activations,
            &self.upstream,
            NetworkGradients::by_weights(&mut weights.gradients),
        );
        instant.scales[entries.clone()].copy_from_slice(&self.scales);
        instant.rotations[entries].copy_from_slice(&self.rotations);
    }
}

/// Returns `q/|q| + dq` and its length.
fn deformed_quaternion(rotation: &[f32; 4], output: &[f32; OUTPUTS]) -> ([f32; 4], f32) {
    let sum = [0, 1, 2, 3].map(|axis| rotation[axis] + output[3 + axis]);
    let length = sum.iter().map(|value| value * value).sum::<f32>().sqrt();
    (sum, length.max(LEAST_QUATERNION_LENGTH))
}

#[cfg(test)]
mod tests;
