//! Gradient of a loss by a camera's pose, from that by the Gaussians.
//!
//! Moving the camera is equivalent to moving the Gaussians the other way, including footprints and low-pass
//! filter. Turn the camera of a view by the small world rotation `w` about its centre `c` and move it by `t`:
//!
//! ```text
//! c' = c + t        R' = exp(w^) R     (camera to world)
//! ```
//!
//! Its image equals that of the old camera after turning the Gaussians about `c` by `-w` and moving them by
//! `-t`. With the gradients `g` by a centre `mu`, `h` by a unit quaternion `q`, and `s` the part of `g` that
//! comes from the direction in which harmonics are evaluated:
//!
//! ```text
//! dL/dt   = - sum g
//! dL/dw   = - sum ((mu - c) x (g - s) + k),       k_i = <h, e_i (x) q> / 2
//! ```
//!
//! A rotation of the camera does not change the direction of harmonics, hence without `s`; a shift does. The
//! vectors `mu - c` and `g` are in the world frame, and so are `w` and `t`.

pub(crate) mod gpu;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::render::project::sh;
use crate::{
    camera::View,
    gaussians::{ActivatedGaussians, SH_C0, sh_rest_count},
};

/// Gaussians per partial sum. Adding partial sums in order makes the result independent of the number of
/// threads.
const BATCH: usize = 2048;

/// Gradient of the loss by a pose.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PoseGradient {
    /// By a small rotation about the camera's centre, world frame, per radian.
    pub rotation: DVec3,
    /// By the centre, per normalized unit.
    pub centre: DVec3,
}

/// Returns the gradient by the pose of `view` from that by `gaussians`, drawn with harmonics up to
/// `sh_degree`. Gaussians whose gradient is not finite are skipped here; they are counted where the gradient
/// is applied to them.
pub fn gradient(
    view: &View,
    gaussians: &ActivatedGaussians,
    sh_degree: usize,
    by_gaussians: &ActivatedGaussians,
) -> PoseGradient {
    let degree = sh_degree.min(gaussians.sh_degree);
    let sums: Vec<PoseGradient> = (0..gaussians.len().div_ceil(BATCH))
        .into_par_iter()
        .map(|batch| {
            let end = gaussians.len().min((batch + 1) * BATCH);
            (batch * BATCH..end)
                .map(|index| of_one(view, gaussians, degree, by_gaussians, index))
                .filter(|one| one.rotation.is_finite() && one.centre.is_finite())
                .fold(PoseGradient::default(), PoseGradient::plus)
        })
        .collect();
    sums.into_iter()
        .fold(PoseGradient::default(), PoseGradient::plus)
}

impl PoseGradient {
    fn plus(self, other: Self) -> Self {
        Self {
            rotation: self.rotation + other.rotation,
            centre: self.centre + other.centre,
        }
    }
}

fn of_one(
    view: &View,
    gaussians: &ActivatedGaussians,
    degree: usize,
    by_gaussians: &ActivatedGaussians,
    index: usize,
) -> PoseGradient {
    let offset = Vec3::from_array(gaussians.positions[index]) - view.centre;
    let by_position = Vec3::from_array(by_gaussians.positions[index]);
    let mut geometric = by_position;
    if degree > 0 && by_gaussians.sh_constant[index] != [0.0; 3] {
        let by_colour = by_gaussians.sh_constant[index].map(|value| value / SH_C0);
        let count = sh_rest_count(gaussians.sh_degree);
        let rest = &gaussians.sh_rest[index * count..(index + 1) * count];
        geometric -= sh::position_vjp(degree, offset, rest, by_colour);
    }
    let torque = offset.as_dvec3().cross(geometric.as_dvec3());
    let [w, x, y, z] = gaussians.rotations[index].map(f64::from);
    let [by_w, by_x, by_y, by_z] = by_gaussians.rotations[index].map(f64::from);
    // Products e_i (x) q, component by component.
    let twist = 0.5
        * DVec3::new(
            -x * by_w + w * by_x - z * by_y + y * by_z,
            -y * by_w + z * by_x + w * by_y - x * by_z,
            -z * by_w - y * by_x + x * by_y + w * by_z,
        );
    PoseGradient {
        rotation: -(torque + twist),
        centre: -by_position.as_dvec3(),
    }
}
