//! The static parameterization of 3DGS, independent of time.
//!
//! `scale = exp(raw)`, `opacity = sigmoid(raw)`, `rotation = raw / |raw|` (3DGS `scene/gaussian_model.py`).

pub(crate) mod gpu;

use rayon::prelude::*;

use crate::gaussians::{
    device_twin::DeviceTwin,
    parameterization::{Parameterization, Viewpoint},
    temporal::TemporalFeatures,
};
use crate::{
    gaussians::{ActivatedGaussians, MAX_SH_DEGREE, sh_rest_count},
    parameters::{ArrayShape, ParameterArray, ParameterTable},
};

/// Index of the array `positions` (3 values).
pub const POSITIONS: usize = 0;
/// Index of the array `log_scales` (3 values).
pub const LOG_SCALES: usize = 1;
/// Index of the array `quaternions` (4 values, not normalized).
pub const QUATERNIONS: usize = 2;
/// Index of the array `opacity_logits` (1 value).
pub const OPACITY_LOGITS: usize = 3;
/// Index of the array `sh_constant` (3 values).
pub const SH_CONSTANT: usize = 4;
/// Index of the array `sh_rest` of Gaussians of a degree above 0: 3 values for each of the degree's
/// [`sh_rest_count`] further coefficients.
pub const SH_REST: usize = 5;
pub(crate) const SH_REST_NAME: &str = "sh_rest";
/// Name of the array of constant harmonics.
pub(crate) const SH_CONSTANT_NAME: &str = "sh_constant";

/// Bounds of the raw logarithmic scale: neither `exp` nor its square overflows or vanishes.
const LOG_SCALE_RANGE: (f32, f32) = (-30.0, 20.0);
/// Least divisor in the normalization of a quaternion, so that a zero quaternion gives the identity, not NaN.
/// It must not lengthen a short quaternion, which would no longer be a rotation.
pub(crate) const LEAST_QUATERNION_LENGTH: f32 = 1e-12;

/// Quaternion (w, x, y, z) of the identity rotation.
pub const NO_ROTATION: [f32; 4] = [1.0, 0.0, 0.0, 0.0];

/// Initial values of static Gaussians, one entry per Gaussian in each array.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct InitialGaussians {
    /// Centres in normalized units.
    pub positions: Vec<[f32; 3]>,
    /// Standard deviations along the axes, positive.
    pub scales: Vec<[f32; 3]>,
    /// Unit quaternions (w, x, y, z), axes to world.
    pub rotations: Vec<[f32; 4]>,
    /// Colours in [0, 1].
    pub colours: Vec<[f32; 3]>,
    /// Opacities in (0, 1).
    pub opacities: Vec<f32>,
}

impl InitialGaussians {
    /// Creates isotropic Gaussians of these standard deviations.
    ///
    /// # Panics
    /// If the lists differ in length.
    pub fn isotropic(
        positions: Vec<[f32; 3]>,
        scales: &[f32],
        colours: Vec<[f32; 3]>,
        opacities: Vec<f32>,
    ) -> Self {
        let len = positions.len();
        assert_eq!([scales.len(), colours.len(), opacities.len()], [len; 3]);
        Self {
            positions,
            scales: scales.iter().map(|&scale| [scale; 3]).collect(),
            rotations: vec![NO_ROTATION; len],
            colours,
            opacities,
        }
    }

    /// Adds an isotropic Gaussian.
    pub fn push_isotropic(
        &mut self,
        position: [f32; 3],
        scale: f32,
        colour: [f32; 3],
        opacity: f32,
    ) {
        self.positions.push(position);
        self.scales.push([scale; 3]);
        self.rotations.push(NO_ROTATION);
        self.colours.push(colour);
        self.opacities.push(opacity);
    }

    /// Adds the Gaussians of another list.
    pub fn append(&mut self, mut other: Self) {
        self.positions.append(&mut other.positions);
        self.scales.append(&mut other.scales);
        self.rotations.append(&mut other.rotations);
        self.colours.append(&mut other.colours);
        self.opacities.append(&mut other.opacities);
    }

    /// Returns the Gaussians with these indices, in their order.
    #[must_use]
    pub fn selected(&self, indices: &[usize]) -> Self {
        fn of<T: Copy>(values: &[T], indices: &[usize]) -> Vec<T> {
            indices.iter().map(|&index| values[index]).collect()
        }
        Self {
            positions: of(&self.positions, indices),
            scales: of(&self.scales, indices),
            rotations: of(&self.rotations, indices),
            colours: of(&self.colours, indices),
            opacities: of(&self.opacities, indices),
        }
    }

    /// Returns the number of Gaussians.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Returns true if there are no Gaussians.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }
}

/// Returns the arrays of this parameterization with spherical harmonics up to `sh_degree`, in their order.
pub fn shapes(sh_degree: usize) -> Vec<ArrayShape> {
    let shape = |name, width| ArrayShape { name, width };
    let mut shapes = vec![
        shape("positions", 3),
        shape("log_scales", 3),
        shape("quaternions", 4),
        shape("opacity_logits", 1),
        shape(SH_CONSTANT_NAME, 3),
    ];
    if sh_degree > 0 {
        shapes.push(shape(SH_REST_NAME, 3 * sh_rest_count(sh_degree)));
    }
    shapes
}

/// Returns the array of the non-constant coefficients, if the table stores any. Tables of other
/// parameterizations have further arrays after those of this one.
fn sh_rest(table: &ParameterTable) -> Option<&ParameterArray> {
    let array = table.arrays.get(SH_REST)?;
    (array.name == SH_REST_NAME).then_some(array)
}

/// Returns the degree of the spherical harmonics stored in a table with this parameterization's arrays.
pub fn sh_degree(table: &ParameterTable) -> usize {
    let width = sh_rest(table).map_or(0, |array| array.width);
    (0..MAX_SH_DEGREE)
        .find(|&degree| 3 * sh_rest_count(degree) >= width)
        .unwrap_or(MAX_SH_DEGREE)
}

/// Creates a table with this parameterization's arrays; the initial colour of a Gaussian does not depend on
/// the direction. Learning rates are zero until a schedule sets them.
pub fn table(initial: &InitialGaussians, sh_degree: usize) -> ParameterTable {
    let len = initial.len();
    let columns = [
        initial.positions.iter().flatten().copied().collect(),
        initial
            .scales
            .iter()
            .flat_map(|scale| scale.map(f32::ln))
            .collect(),
        initial.rotations.iter().flatten().copied().collect(),
        initial.opacities.iter().map(|&o| logit(o)).collect(),
        initial
            .colours
            .iter()
            .flatten()
            .map(|colour| (colour - 0.5) / super::SH_C0)
            .collect(),
    ];
    let mut table = ParameterTable::new(len);
    let mut columns = columns.into_iter();
    for ArrayShape { name, width } in shapes(sh_degree) {
        let values: Vec<f32> = columns.next().unwrap_or_else(|| vec![0.0; len * width]);
        table.add(name, width, values, 0.0);
    }
    table
}

/// Parameterization of Gaussians that do not depend on time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StaticGaussians;

impl Parameterization for StaticGaussians {
    fn id(&self) -> &'static str {
        "static"
    }

    fn activate(
        &mut self,
        table: &ParameterTable,
        _: &Viewpoint,
        features: &TemporalFeatures,
        first: usize,
        out: &mut ActivatedGaussians,
    ) {
        activate_from(table, first, out);
        let rows = first..first + table.len();
        features.write_untimed(self.untimed_lifespan(), rows, &mut out.features);
    }

    fn activate_backward(
        &mut self,
        table: &mut ParameterTable,
        _: &Viewpoint,
        _: &TemporalFeatures,
        first: usize,
        activated: &mut ActivatedGaussians,
        gradient: &mut ActivatedGaussians,
    ) {
        activate_from_vjp(table, first, activated, gradient);
    }

    fn device_twin(&self) -> Option<&dyn DeviceTwin> {
        Some(self)
    }

    fn boxed(&self) -> Box<dyn Parameterization> {
        Box::new(*self)
    }
}

/// Returns the inverse of the sigmoid; the opacity is clamped to [1e-6, 1 - 1e-6] first.
pub fn logit(opacity: f32) -> f32 {
    let opacity = opacity.clamp(1e-6, 1.0 - 1e-6);
    (opacity / (1.0 - opacity)).ln()
}

/// Returns the logistic function, without overflow.
pub fn sigmoid(raw: f32) -> f32 {
    1.0 / (1.0 + (-raw).exp())
}

/// Activates the table's parameters.
pub fn activate(table: &ParameterTable, out: &mut ActivatedGaussians) {
    out.reshape(table.len(), sh_degree(table), 0);
    activate_from(table, 0, out);
}

/// Activates the table's parameters into the entries of `out` from `first` on, for which `out` has room and
/// harmonics of the table's degree.
pub fn activate_from(table: &ParameterTable, first: usize, out: &mut ActivatedGaussians) {
    let arrays = &table.arrays;
    let entries = first..first + table.len();
    out.positions[entries.clone()].copy_from_slice(arrays[POSITIONS].values.as_chunks().0);
    out.sh_constant[entries.clone()].copy_from_slice(arrays[SH_CONSTANT].values.as_chunks().0);
    if let Some(rest) = sh_rest(table) {
        let count = sh_rest_count(out.sh_degree);
        out.sh_rest[entries.start * count..entries.end * count]
            .copy_from_slice(rest.values.as_chunks().0);
    }
    let (scales, quaternions) = (
        arrays[LOG_SCALES].values.as_chunks::<3>().0,
        arrays[QUATERNIONS].values.as_chunks::<4>().0,
    );
    let logits = &arrays[OPACITY_LOGITS].values;
    (
        out.scales[entries.clone()].par_iter_mut(),
        out.rotations[entries.clone()].par_iter_mut(),
        out.opacities[entries].par_iter_mut(),
        scales.par_iter(),
        quaternions.par_iter(),
        logits.par_iter(),
    )
        .into_par_iter()
        .with_min_len(1024)
        .for_each(
            |(scale, rotation, opacity, raw_scale, raw_rotation, raw_opacity)| {
                *scale = raw_scale.map(|raw| raw.clamp(LOG_SCALE_RANGE.0, LOG_SCALE_RANGE.1).exp());
                let length = quaternion_length(raw_rotation);
                *rotation = raw_rotation.map(|raw| raw / length);
                *opacity = sigmoid(*raw_opacity);
            },
        );
}

fn quaternion_length(raw: &[f32; 4]) -> f32 {
    let length = raw.iter().map(|q| q * q).sum::<f32>().sqrt();
    length.max(LEAST_QUATERNION_LENGTH)
}

/// Computes the VJP of [`activate`]: overwrites the table's gradients from gradients by the activated
/// Gaussians. `instant` is the output of [`activate`].
pub fn activate_vjp(
    table: &mut ParameterTable,
    instant: &ActivatedGaussians,
    gradient: &ActivatedGaussians,
) {
    activate_from_vjp(table, 0, instant, gradient);
}

fn copy_unless_frozen(array: &mut ParameterArray, gradient: &[[f32; 3]]) {
    if !array.is_frozen() {
        array.gradients.copy_from_slice(gradient.as_flattened());
    }
}

/// Computes [`activate_from_vjp`] of the sizes, rotations and opacities of a table with frozen arrays.
fn activate_partly_from_vjp(
    table: &mut ParameterTable,
    first: usize,
    instant: &ActivatedGaussians,
    gradient: &ActivatedGaussians,
) {
    let entries = first..first + table.len();
    let scales = &mut table.arrays[LOG_SCALES];
    if !scales.is_frozen() {
        let by = gradient.scales[entries.clone()].as_flattened();
        let scale = instant.scales[entries.clone()].as_flattened();
        for ((to, by), scale) in scales.gradients.iter_mut().zip(by).zip(scale) {
            *to = by * scale;
        }
    }
    let quaternions = &mut table.arrays[QUATERNIONS];
    if !quaternions.is_frozen() {
        let raw = quaternions.values.as_chunks::<4>().0;
        let unit = &instant.rotations[entries.clone()];
        let by = &gradient.rotations[entries.clone()];
        let to = quaternions.gradients.as_chunks_mut::<4>().0;
        for (((to, raw), unit), by) in to.iter_mut().zip(raw).zip(unit).zip(by) {
            *to = quaternion_vjp(raw, unit, by);
        }
    }
    let logits = &mut table.arrays[OPACITY_LOGITS];
    if !logits.is_frozen() {
        let (opacities, by) = (
            &instant.opacities[entries.clone()],
            &gradient.opacities[entries],
        );
        for ((to, opacity), by) in logits.gradients.iter_mut().zip(opacities).zip(by) {
            *to = by * opacity * (1.0 - opacity);
        }
    }
}

/// Returns the VJP of `q/|q|`: removes the part along q and divides by the length.
fn quaternion_vjp(raw: &[f32; 4], unit: &[f32; 4], by: &[f32; 4]) -> [f32; 4] {
    let along: f32 = unit.iter().zip(by).map(|(u, g)| u * g).sum();
    let length = quaternion_length(raw);
    [0, 1, 2, 3].map(|axis| (by[axis] - unit[axis] * along) / length)
}

/// Computes the VJP of [`activate_from`].
pub fn activate_from_vjp(
    table: &mut ParameterTable,
    first: usize,
    instant: &ActivatedGaussians,
    gradient: &ActivatedGaussians,
) {
    let entries = first..first + table.len();
    let [positions, log_scales, quaternions, logits, sh, rest @ ..] = table.arrays.as_mut_slice()
    else {
        unreachable!("a table of static Gaussians has five arrays at least");
    };
    if let Some(rest) = rest.first_mut().filter(|array| array.name == SH_REST_NAME) {
        let count = sh_rest_count(gradient.sh_degree);
        let gradient = &gradient.sh_rest[entries.start * count..entries.end * count];
        rest.gradients.copy_from_slice(gradient.as_flattened());
    }
    copy_unless_frozen(positions, &gradient.positions[entries.clone()]);
    copy_unless_frozen(sh, &gradient.sh_constant[entries.clone()]);
    if log_scales.is_frozen() || quaternions.is_frozen() || logits.is_frozen() {
        activate_partly_from_vjp(table, first, instant, gradient);
        return;
    }
    (
        log_scales.gradients.as_chunks_mut::<3>().0.par_iter_mut(),
        quaternions.gradients.as_chunks_mut::<4>().0.par_iter_mut(),
        logits.gradients.par_iter_mut(),
        quaternions.values.as_chunks::<4>().0.par_iter(),
        instant.scales[entries.clone()].par_iter(),
        instant.rotations[entries.clone()].par_iter(),
        instant.opacities[entries.clone()].par_iter(),
        gradient.scales[entries.clone()].par_iter(),
        gradient.rotations[entries.clone()].par_iter(),
        gradient.opacities[entries].par_iter(),
    )
        .into_par_iter()
        .with_min_len(1024)
        .for_each(
            |(to_scale, to_rotation, to_opacity, raw, scale, unit, opacity, gs, gr, go)| {
                for axis in 0..3 {
                    to_scale[axis] = gs[axis] * scale[axis];
                }
                *to_rotation = quaternion_vjp(raw, unit, gr);
                *to_opacity = go * opacity * (1.0 - opacity);
            },
        );
}
