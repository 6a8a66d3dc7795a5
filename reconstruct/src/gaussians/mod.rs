//! Gaussians: a table of named parameter arrays, and parameterizations that turn it into what a
//! renderer sees.
//!
//! A parameterization reads raw (unconstrained) parameters and gives [`InstantGaussians`]; its VJP
//! writes the gradients of the raw parameters. Renderers know neither time nor method.
//!
//! * [`static_gaussians`]: nothing depends on time. [`subset`]: some Gaussians alone.
//! * [`temporal`]: a static table with the arrays of a motion, at one moment. The motion itself is in
//!   [`periodic`] (PVG), the velocity of Omni4DGS in [`omni4dgs`].
//! * [`deformable`]: a static table, and a network that moves it.

pub mod deformable;
pub mod deformation_file;
pub mod moving_ply;
pub mod omni4dgs;
pub mod periodic;
pub mod ply;
pub mod static_gaussians;
pub mod subset;
pub mod temporal;

/// Value of the constant spherical harmonic, `1 / (2 sqrt(pi))`.
pub const SH_C0: f32 = 0.282_094_8;

/// One raw parameter of every Gaussian, with what its optimization needs. The weights of a network are
/// one, too: a single row.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterArray {
    /// Name, unique in its table.
    pub name: &'static str,
    /// Values per Gaussian.
    pub width: usize,
    /// `len * width` values.
    pub values: Vec<f32>,
    /// `len * width` gradients of the loss.
    pub gradients: Vec<f32>,
    /// Adam's first moments.
    pub first_moments: Vec<f32>,
    /// Adam's second moments.
    pub second_moments: Vec<f32>,
    /// Step size of the next update.
    pub learning_rate: f32,
}

impl ParameterArray {
    /// Bytes of values, gradients and moments.
    pub fn bytes(&self) -> u64 {
        (4 * size_of::<f32>() * self.values.len()) as u64
    }
}

/// What a parameter array is, whatever the number of Gaussians.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ArrayShape {
    /// Name, unique in its table.
    pub name: &'static str,
    /// Values per Gaussian.
    pub width: usize,
}

/// Parameter arrays of equal length.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct GaussianTable {
    /// The arrays, in the order in which the parameterization added them.
    pub arrays: Vec<ParameterArray>,
    len: usize,
}

impl GaussianTable {
    /// A table of `len` Gaussians without parameters.
    pub fn new(len: usize) -> Self {
        Self {
            arrays: Vec::new(),
            len,
        }
    }

    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Adds an array and returns its position in [`GaussianTable::arrays`].
    ///
    /// # Panics
    /// When `values` does not hold `len * width` values.
    pub fn add(
        &mut self,
        name: &'static str,
        width: usize,
        values: Vec<f32>,
        learning_rate: f32,
    ) -> usize {
        assert_eq!(values.len(), self.len * width, "array {name}");
        let zeros = vec![0.0; values.len()];
        self.arrays.push(ParameterArray {
            name,
            width,
            values,
            gradients: zeros.clone(),
            first_moments: zeros.clone(),
            second_moments: zeros,
            learning_rate,
        });
        self.arrays.len() - 1
    }

    /// Values of one Gaussian in one array.
    pub fn row(&self, array: usize, index: usize) -> &[f32] {
        let array = &self.arrays[array];
        &array.values[index * array.width..(index + 1) * array.width]
    }

    /// Keeps the Gaussians whose flag is set, with their moments, in order.
    pub fn retain(&mut self, keep: &[bool]) {
        debug_assert_eq!(keep.len(), self.len);
        for array in &mut self.arrays {
            for column in [
                &mut array.values,
                &mut array.gradients,
                &mut array.first_moments,
                &mut array.second_moments,
            ] {
                retain_rows(column, array.width, keep);
            }
        }
        self.len = keep.iter().filter(|&&flag| flag).count();
    }

    /// Appends copies of the Gaussians `sources`, with zero moments and gradients (3DGS
    /// `densification_postfix`).
    pub fn append_copies(&mut self, sources: &[usize]) {
        for array in &mut self.arrays {
            let width = array.width;
            for &source in sources {
                array
                    .values
                    .extend_from_within(source * width..(source + 1) * width);
            }
            let total = array.values.len();
            array.gradients.resize(total, 0.0);
            array.first_moments.resize(total, 0.0);
            array.second_moments.resize(total, 0.0);
        }
        self.len += sources.len();
    }

    /// Brings the Gaussians, with their moments, into another order: row `i` becomes what row
    /// `order[i]` was.
    pub fn permute(&mut self, order: &[usize]) {
        debug_assert_eq!(order.len(), self.len);
        for array in &mut self.arrays {
            let width = array.width;
            for column in [
                &mut array.values,
                &mut array.gradients,
                &mut array.first_moments,
                &mut array.second_moments,
            ] {
                let rows = order.iter().map(|&row| row * width..(row + 1) * width);
                *column = rows.flat_map(|row| column[row].iter().copied()).collect();
            }
        }
    }

    /// Where the array of this name is in [`GaussianTable::arrays`].
    pub fn position(&self, name: &str) -> Option<usize> {
        self.arrays.iter().position(|array| array.name == name)
    }

    /// Names and widths of all arrays.
    pub fn shapes(&self) -> Vec<ArrayShape> {
        self.arrays
            .iter()
            .map(|array| ArrayShape {
                name: array.name,
                width: array.width,
            })
            .collect()
    }
}

fn retain_rows(column: &mut Vec<f32>, width: usize, keep: &[bool]) {
    let mut write = 0;
    for (read, &flag) in keep.iter().enumerate() {
        if flag {
            column.copy_within(read * width..(read + 1) * width, write * width);
            write += 1;
        }
    }
    column.truncate(write * width);
}

/// Highest degree of spherical harmonics.
pub const MAX_SH_DEGREE: usize = 3;

/// Coefficients beside the constant one up to `degree`: `(degree + 1)^2 - 1`.
pub const fn sh_rest_count(degree: usize) -> usize {
    (degree + 1) * (degree + 1) - 1
}

/// What a renderer sees: activated Gaussians at one instant, one entry per Gaussian in each array
/// (a run of entries in `sh_rest` and `features`).
///
/// Colour towards a Gaussian in the world direction `d` (unit, from the camera to its centre):
/// `max(1/2 + sum_k Y_k(d) c_k, 0)` with the real spherical harmonics `Y_k` of 3DGS (see
/// [`crate::kernels::project`]).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct InstantGaussians {
    /// Centres in normalized world units.
    pub positions: Vec<[f32; 3]>,
    /// Standard deviations along the axes, positive.
    pub scales: Vec<[f32; 3]>,
    /// Unit quaternions (w, x, y, z), axes to world.
    pub rotations: Vec<[f32; 4]>,
    /// Opacities in (0, 1).
    pub opacities: Vec<f32>,
    /// Coefficients of the constant harmonic for red, green, blue.
    pub sh_constant: Vec<[f32; 3]>,
    /// Degree of the stored harmonics, 0 to [`MAX_SH_DEGREE`].
    pub sh_degree: usize,
    /// The other coefficients: [`sh_rest_count`] entries per Gaussian, by degree and then by order
    /// (-l to l), each for red, green, blue.
    pub sh_rest: Vec<[f32; 3]>,
    /// Feature channels per Gaussian.
    pub feature_count: usize,
    /// `feature_count` values per Gaussian, rendered like colours over a background of 0. A feature
    /// of 1 renders the opacity map, one of the distance from the camera the radial depth.
    pub features: Vec<f32>,
}

impl InstantGaussians {
    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Makes room for `len` Gaussians with harmonics up to `sh_degree` and `feature_count`
    /// features. Entries that were there before keep arbitrary values.
    pub fn reshape(&mut self, len: usize, sh_degree: usize, feature_count: usize) {
        self.positions.resize(len, [0.0; 3]);
        self.scales.resize(len, [0.0; 3]);
        self.rotations.resize(len, [0.0; 4]);
        self.opacities.resize(len, 0.0);
        self.sh_constant.resize(len, [0.0; 3]);
        self.sh_degree = sh_degree;
        self.sh_rest
            .resize(len * sh_rest_count(sh_degree), [0.0; 3]);
        self.feature_count = feature_count;
        self.features.resize(len * feature_count, 0.0);
    }

    /// The shape of `other` with every entry zero: how a gradient begins.
    pub fn clear_to_zero(&mut self, other: &Self) {
        self.positions.clear();
        self.scales.clear();
        self.rotations.clear();
        self.opacities.clear();
        self.sh_constant.clear();
        self.sh_rest.clear();
        self.features.clear();
        self.reshape(other.len(), other.sh_degree, other.feature_count);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn retain_and_append_keep_rows_together() {
        let mut table = GaussianTable::new(3);
        table.add("a", 2, vec![0.0, 1.0, 2.0, 3.0, 4.0, 5.0], 0.1);
        table.arrays[0].first_moments = vec![1.0; 6];
        table.retain(&[true, false, true]);
        assert_eq!(table.arrays[0].values, [0.0, 1.0, 4.0, 5.0]);
        table.append_copies(&[1]);
        assert_eq!(table.len(), 3);
        assert_eq!(table.arrays[0].values, [0.0, 1.0, 4.0, 5.0, 4.0, 5.0]);
        assert_eq!(
            table.arrays[0].first_moments,
            [1.0, 1.0, 1.0, 1.0, 0.0, 0.0]
        );
    }
}
