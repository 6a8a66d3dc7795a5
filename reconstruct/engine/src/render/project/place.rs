//! Gaussians in the camera frame, 8 at once.

use fearless_simd::{Simd, f32x8, mask32x8, prelude::*};
use glam::Vec3;

use crate::camera::{
    CameraLanes, View,
    lanes::{LANES, Vec3x8},
};
use crate::{
    gaussians::ActivatedGaussians,
    render::settings::{Footprint, RenderSettings},
};

/// Eight Gaussians with consecutive indices in the camera frame. The last one is repeated past the end.
pub(super) struct CameraGaussians8<S: Simd> {
    /// Centres in the camera frame.
    pub(super) point: Vec3x8<S>,
    /// Lengths of the points.
    pub(super) distance: f32x8<S>,
    pub(super) inverse_distance: f32x8<S>,
    /// `M = R S` in world coordinates.
    pub(super) axes: [Vec3x8<S>; 3],
    /// Columns of the rotation `R`.
    turn: [Vec3x8<S>; 3],
    rotation: [f32x8<S>; 4],
    scale: Vec3x8<S>,
}

/// A Gaussian in the camera frame.
pub(super) struct CameraGaussian {
    /// Centre in the camera frame.
    pub(super) point: Vec3,
    /// Length of the point.
    pub(super) distance: f32,
    /// `M = R S` in world coordinates.
    pub(super) axes: [Vec3; 3],
}

/// Returns 8 values from `first` on, with the last repeated past the end.
#[inline(always)]
pub(super) fn eight<T: Copy>(rows: &[T], first: usize) -> [T; LANES] {
    match rows[first..].first_chunk() {
        Some(rows) => *rows,
        None => std::array::from_fn(|lane| rows[(first + lane).min(rows.len() - 1)]),
    }
}

impl<S: Simd> CameraGaussians8<S> {
    /// Transforms the Gaussians from `first` on to the camera frame.
    #[inline(always)]
    pub(super) fn new(simd: S, view: &View, gaussians: &ActivatedGaussians, first: usize) -> Self {
        let centre = Vec3x8::gather(simd, &eight(&gaussians.positions, first));
        let scale = Vec3x8::gather(simd, &eight(&gaussians.scales, first));
        let quaternions = eight(&gaussians.rotations, first);
        let rotation: [f32x8<S>; 4] =
            std::array::from_fn(|at| f32x8::simd_from(simd, quaternions.map(|row| row[at])));
        let offset = Vec3x8 {
            x: centre.x - view.centre.x,
            y: centre.y - view.centre.y,
            z: centre.z - view.centre.z,
        };
        let point = offset.transformed(&view.rotation);
        let distance = point.length_squared().sqrt();
        let turn = columns(rotation);
        Self {
            point,
            distance,
            inverse_distance: f32x8::splat(simd, 1.0) / distance,
            axes: [
                turn[0].times(scale.x),
                turn[1].times(scale.y),
                turn[2].times(scale.z),
            ],
            turn,
            rotation,
            scale,
        }
    }

    /// Returns a mask of the Gaussians that the camera sees. NaN fails the comparisons and is culled; a NaN
    /// hidden by `max` is caught with the footprint.
    #[inline(always)]
    pub(super) fn is_seen(&self, view: &View, settings: &RenderSettings) -> mask32x8<S> {
        let is_seen = view.camera.see(self.point, self.distance, settings.near);
        if settings.footprint == Footprint::Ray {
            return is_seen;
        }
        let largest = self.scale.x.max(self.scale.y).max(self.scale.z);
        is_seen & largest.simd_lt(self.distance)
    }

    pub(super) fn lane(&self, lane: usize) -> CameraGaussian {
        CameraGaussian {
            point: self.point.lane(lane),
            distance: self.distance[lane],
            axes: [0, 1, 2].map(|axis: usize| self.axes[axis].lane(lane)),
        }
    }

    /// Computes the VJP of the axes: gradients by the scales and by the unit quaternions.
    #[inline(always)]
    pub(super) fn axes_vjp(&self, by_axes: &[Vec3x8<S>; 3]) -> (Vec3x8<S>, [f32x8<S>; 4]) {
        let by_scale = Vec3x8 {
            x: by_axes[0].dot(self.turn[0]),
            y: by_axes[1].dot(self.turn[1]),
            z: by_axes[2].dot(self.turn[2]),
        };
        let c0 = by_axes[0].times(self.scale.x);
        let c1 = by_axes[1].times(self.scale.y);
        let c2 = by_axes[2].times(self.scale.z);
        let [w, x, y, z] = self.rotation;
        let by_rotation = [
            z * (c0.y - c1.x) + y * (c2.x - c0.z) + x * (c1.z - c2.y),
            y * (c0.y + c1.x) + z * (c0.z + c2.x) + w * (c1.z - c2.y) - x * (c1.y + c2.z) * 2.0,
            x * (c0.y + c1.x) + z * (c1.z + c2.y) + w * (c2.x - c0.z) - y * (c0.x + c2.z) * 2.0,
            x * (c0.z + c2.x) + y * (c1.z + c2.y) + w * (c0.y - c1.x) - z * (c0.x + c1.y) * 2.0,
        ];
        (by_scale, by_rotation.map(|value| value * 2.0))
    }
}

/// Returns the columns of the rotations of unit quaternions (w, x, y, z), as in [`super::axes`].
#[inline(always)]
fn columns<S: Simd>([w, x, y, z]: [f32x8<S>; 4]) -> [Vec3x8<S>; 3] {
    let one_minus_twice = |sum: f32x8<S>| -(sum * 2.0) + 1.0;
    [
        Vec3x8 {
            x: one_minus_twice(y * y + z * z),
            y: (x * y + w * z) * 2.0,
            z: (x * z - w * y) * 2.0,
        },
        Vec3x8 {
            x: (x * y - w * z) * 2.0,
            y: one_minus_twice(x * x + z * z),
            z: (y * z + w * x) * 2.0,
        },
        Vec3x8 {
            x: (x * z + w * y) * 2.0,
            y: (y * z - w * x) * 2.0,
            z: one_minus_twice(x * x + y * y),
        },
    ]
}
