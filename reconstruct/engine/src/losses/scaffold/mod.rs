//! A surface that attracts the centres of Gaussians: a truncated signed distance field (TSDF) of all views
//! (PanoGS, Section 3.4), and the loss on it (Eq. 9).
//!
//! * [`fuse`]: the field from distance images. Here: its values, gradients and the loss. [`gpu`]: the loss on a
//!   GPU.
//!
//! The field is stored in blocks of 8 x 8 x 8 voxels around surfaces. Every voxel sums integers, so that its
//! bits do not depend on the order of the views.

pub mod fuse;
pub mod gpu;

use std::collections::HashMap;

use glam::{IVec3, Vec3, ivec3};
use rayon::prelude::*;

/// Voxels along the side of a block.
pub const BLOCK_SIDE: i32 = 8;
const BLOCK_VOXELS: usize = (BLOCK_SIDE * BLOCK_SIDE * BLOCK_SIDE) as usize;
/// Quantization steps of a stored distance per truncation.
const STEPS: f32 = 4096.0;
/// The loss is quadratic up to this many voxels from the surface, linear beyond.
const HUBER_VOXELS: f32 = 0.5;

/// Sums over the views at a voxel.
#[derive(Debug, Clone, Copy, Default)]
struct Voxel {
    /// Weighted sum of distances, in steps of the truncation.
    sum: i32,
    weight: u32,
}

impl Voxel {
    /// Returns the mean distance in a field of this truncation, scene units; `None` if no view observed it.
    fn distance(&self, truncation: f32) -> Option<f32> {
        let mean = || (f64::from(self.sum) / f64::from(self.weight)) as f32 / STEPS * truncation;
        (self.weight > 0).then(mean)
    }
}

type Block = Box<[Voxel; BLOCK_VOXELS]>;

/// A truncated signed distance field, positive in front of surfaces.
#[derive(Debug)]
pub struct Scaffold {
    /// Side of a voxel, scene units.
    pub voxel: f32,
    /// Truncation of distances, scene units.
    pub truncation: f32,
    origin: Vec3,
    blocks: HashMap<IVec3, Block>,
}

/// Field at a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldValue {
    /// Signed distance, scene units.
    pub distance: f32,
    /// Gradient by the point.
    pub gradient: Vec3,
}

impl Scaffold {
    /// Returns the bytes of the blocks.
    pub fn bytes(&self) -> u64 {
        (self.blocks.len() * (BLOCK_VOXELS * size_of::<Voxel>() + size_of::<(IVec3, Block)>()))
            as u64
    }

    /// Returns the field at a point, trilinear between the eight voxels around it; `None` if one of them was
    /// not observed.
    pub fn value(&self, place: Vec3) -> Option<FieldValue> {
        let scaled = (place - self.origin) / self.voxel - 0.5;
        let floor = scaled.floor();
        // Beyond this, f32 cannot resolve voxels and i32 cannot count them.
        let has_voxels = floor.abs().max_element() < 1e8;
        if !has_voxels {
            return None;
        }
        let (base, fraction) = (floor.as_ivec3(), scaled - floor);
        let mut corners = [0.0; 8];
        for (number, corner) in corners.iter_mut().enumerate() {
            let step = ivec3(
                number as i32 & 1,
                number as i32 >> 1 & 1,
                number as i32 >> 2,
            );
            *corner = self.voxel_distance(base + step)?;
        }
        Some(trilinear(&corners, fraction, self.voxel))
    }

    /// Returns the mean distance at a voxel, scene units; `None` if no view observed it.
    fn voxel_distance(&self, voxel: IVec3) -> Option<f32> {
        let block = voxel.div_euclid(IVec3::splat(BLOCK_SIDE));
        self.blocks.get(&block)?[index_in_block(voxel)].distance(self.truncation)
    }

    /// Returns the loss `sum_i w_i Huber(|Phi(mu_i)|)` of some centres, and adds its gradient by the centres to
    /// `gradient`. Huber is quadratic within half a voxel of the surface: half the square over that width.
    /// Centres where the field has no value have neither loss nor gradient.
    ///
    /// `weight` returns `w_i`, per scene unit, by the number of the centre. Published is `lambda / N` (PanoGS,
    /// Eq. 9), under which one centre's gradient falls with their number `N` and has the scale of the scene.
    pub fn loss(
        &self,
        centres: &[[f32; 3]],
        weight: impl Fn(usize) -> f32 + Sync,
        gradient: &mut [[f32; 3]],
    ) -> f64 {
        let width = HUBER_VOXELS * self.voxel;
        (centres.par_iter(), gradient.par_iter_mut())
            .into_par_iter()
            .with_min_len(1024)
            .enumerate()
            .map(|(number, (&centre, gradient))| {
                let factor = weight(number);
                if factor == 0.0 {
                    return 0.0;
                }
                let Some(field) = self.value(Vec3::from_array(centre)) else {
                    return 0.0;
                };
                let [value, slope] = huber(field.distance, width);
                let by_centre = field.gradient * (factor * slope);
                for (sum, by) in gradient.iter_mut().zip(by_centre.to_array()) {
                    *sum += by;
                }
                f64::from(factor) * f64::from(value)
            })
            .sum()
    }
}

/// Returns Huber's loss of a signed distance, and its derivative: `d^2 / (2 w)` within `w` of 0,
/// `|d| - w / 2` beyond.
fn huber(distance: f32, width: f32) -> [f32; 2] {
    if distance.abs() <= width {
        [0.5 * distance * distance / width, distance / width]
    } else {
        [distance.abs() - 0.5 * width, distance.signum()]
    }
}

/// Interpolates values at the corners of a cube (x fastest), and returns the gradient by the position.
fn trilinear(corners: &[f32; 8], at: Vec3, side: f32) -> FieldValue {
    let mix = |a: f32, b: f32, share: f32| a + share * (b - a);
    let along_x = |row: usize| mix(corners[2 * row], corners[2 * row + 1], at.x);
    let [a, b, c, d] = [0, 1, 2, 3].map(along_x);
    let (near, far) = (mix(a, b, at.y), mix(c, d, at.y));
    let by_x = |row: usize| corners[2 * row + 1] - corners[2 * row];
    let by_x = mix(
        mix(by_x(0), by_x(1), at.y),
        mix(by_x(2), by_x(3), at.y),
        at.z,
    );
    let by_y = mix(b - a, d - c, at.z);
    FieldValue {
        distance: mix(near, far, at.z),
        gradient: Vec3::new(by_x, by_y, far - near) / side,
    }
}

fn index_in_block(voxel: IVec3) -> usize {
    let local = voxel.rem_euclid(IVec3::splat(BLOCK_SIDE));
    (local.x + BLOCK_SIDE * (local.y + BLOCK_SIDE * local.z)) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the trilinear form in f64.
    fn reference(corners: &[f32; 8], at: [f64; 3]) -> f64 {
        (0..8)
            .map(|number| {
                let weight = (0..3).map(|axis| {
                    if number >> axis & 1 == 1 {
                        at[axis]
                    } else {
                        1.0 - at[axis]
                    }
                });
                f64::from(corners[number]) * weight.product::<f64>()
            })
            .sum()
    }

    #[test]
    fn values_and_gradients_are_those_of_the_trilinear_form() {
        let corners = [0.3, -0.1, 0.7, 0.2, -0.6, 0.5, 0.1, -0.9];
        for at in [[0.2, 0.7, 0.4], [0.0, 0.5, 0.99], [0.5; 3]] {
            let found = trilinear(&corners, Vec3::from_array(at.map(|x| x as f32)), 0.02);
            assert!((f64::from(found.distance) - reference(&corners, at)).abs() < 1e-6);
            for axis in 0..3 {
                let step = 1e-4;
                let [mut before, mut after] = [at; 2];
                before[axis] -= step;
                after[axis] += step;
                let difference = reference(&corners, after) - reference(&corners, before);
                let expected = difference / (2.0 * step) / 0.02;
                let found = f64::from(found.gradient[axis]);
                assert!((found - expected).abs() < 1e-3 * expected.abs().max(1.0));
            }
        }
    }

    #[test]
    fn hubers_loss_is_smooth_where_its_parts_meet() {
        let width = 0.01;
        for distance in [-0.03, -0.01, -0.004, 0.0, 0.004, 0.01, 0.03] {
            let step = 1e-4;
            let [before, after] = [distance - step, distance + step].map(|d| huber(d, width)[0]);
            let slope = (after - before) / (2.0 * step);
            assert!(
                (huber(distance, width)[1] - slope).abs() < 2e-2,
                "{distance}"
            );
        }
    }
}
