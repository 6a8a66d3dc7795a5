//! Gaussians: a table of named parameter arrays, and parameterizations that activate it for the renderer.
//!
//! A parameterization reads raw (unconstrained) parameters and gives [`ActivatedGaussians`]; its VJP writes
//! the gradients of the raw parameters. Renderers know neither time nor method.
//!
//! * [`parameterization`]: the trait that each implements, and how to add one. [`device_twin`]: its kernels on a
//!   GPU. [`activated_buffers`]: activated Gaussians there.
//! * [`static_gaussians`]: independent of time. [`subset`]: a selection of Gaussians.
//! * [`temporal`]: a static table with the arrays of a motion, at one moment. The motion itself is in
//!   [`periodic`] (PVG), the velocity of Omni4DGS in [`omni4dgs`].
//! * [`deformable`]: a static table deformed by a network.
//! * [`tracked`]: Gaussians of rigid objects on paths.
//! * [`dropout`]: training steps that leave out a share of the Gaussians.

use std::ops::Range;

pub mod activated_buffers;
pub mod deformable;
pub mod device_twin;
pub mod dropout;
pub mod omni4dgs;
pub mod parameterization;
pub mod periodic;
pub mod static_gaussians;
pub mod subset;
pub mod temporal;
pub mod temporal_gaussians;
pub mod tracked;

/// Value of the constant spherical harmonic, `1 / (2 sqrt(pi))`.
pub const SH_C0: f32 = 0.282_094_8;

/// Highest degree of spherical harmonics.
pub const MAX_SH_DEGREE: usize = 3;

/// Returns the number of coefficients up to `degree` except the constant one: `(degree + 1)^2 - 1`.
pub const fn sh_rest_count(degree: usize) -> usize {
    (degree + 1) * (degree + 1) - 1
}

/// Activated Gaussians at one instant, the renderer's input: one entry per Gaussian in each array (a run of
/// entries in `sh_rest` and `features`).
///
/// Colour towards a Gaussian in the world direction `d` (unit, from the camera to its centre):
/// `max(1/2 + sum_k Y_k(d) c_k, 0)` with the real spherical harmonics `Y_k` of 3DGS (see
/// [`crate::render::project`]).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ActivatedGaussians {
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
    /// Number of feature channels per Gaussian.
    pub feature_count: usize,
    /// `feature_count` values per Gaussian, composited like colours over a background of 0. A feature of 1
    /// renders the opacity map; the distance from the camera renders the radial depth.
    pub features: Vec<f32>,
}

impl ActivatedGaussians {
    /// Returns the number of Gaussians.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Returns true if there are no Gaussians.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Resizes to `len` Gaussians with harmonics up to `sh_degree` and `feature_count` features. Existing
    /// entries have arbitrary values afterwards.
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

    /// Replaces the contents by the entries of `other` in a range.
    pub fn copy_entries(&mut self, other: &Self, entries: Range<usize>) {
        self.reshape(entries.len(), other.sh_degree, other.feature_count);
        let rest = sh_rest_count(other.sh_degree);
        let rows = |width: usize| width * entries.start..width * entries.end;
        self.positions.copy_from_slice(&other.positions[rows(1)]);
        self.scales.copy_from_slice(&other.scales[rows(1)]);
        self.rotations.copy_from_slice(&other.rotations[rows(1)]);
        self.opacities.copy_from_slice(&other.opacities[rows(1)]);
        self.sh_constant
            .copy_from_slice(&other.sh_constant[rows(1)]);
        self.sh_rest.copy_from_slice(&other.sh_rest[rows(rest)]);
        let features = &other.features[rows(other.feature_count)];
        self.features.copy_from_slice(features);
    }

    /// Takes the shape of `other` with every entry zero: the initial state of a gradient.
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
