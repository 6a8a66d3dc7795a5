//! Fusion of all views' distance images into the field.

use std::collections::HashMap;

use fearless_simd::{Level, Simd, dispatch, f32x8, prelude::*};
use glam::{IVec3, Vec3, ivec3};
use omnilife_schemas::distances::DistanceImage;
use rayon::prelude::*;

use super::{BLOCK_SIDE, BLOCK_VOXELS, Block, STEPS, Scaffold, Voxel, index_in_block};
use crate::camera::{
    CameraLanes, View,
    lanes::{LANES, Vec3x8},
    rays::Rays,
};

/// One vector looks up a row of a block.
const _: () = assert!(BLOCK_SIDE as usize == LANES);

/// Truncation in voxels.
pub const TRUNCATION_VOXELS: f32 = 4.0;
/// Largest weight of a view at a voxel; a sum can hold those of some thousand views.
const LARGEST_WEIGHT: f32 = 255.0;

/// Input of the fusion: one view.
#[derive(Debug, Clone, Copy)]
pub struct FusedView<'a> {
    /// Camera of the images' size.
    pub view: &'a View,
    /// Distances along the rays, scene units; 0 where unknown.
    pub distances: &'a DistanceImage,
    /// `|n . r|` of normal and ray at each pixel; 0 for pixels to leave out: depth edges, masked pixels,
    /// pixels without a normal.
    pub incidence: &'a [f32],
}

/// Indices of the blocks that the surfaces of a view reach.
type ReachedBlocks = Vec<IVec3>;

impl Scaffold {
    /// Fuses views into a field of this voxel size around `origin`.
    ///
    /// At a voxel `x` a view gives `d = (D - |x - c|) |n . r|`, the distance from the surface plane at its
    /// pixel. The distance along the ray is too large by `1 / |n . r|` on slanted surfaces. A voxel behind
    /// the surface by more than the truncation gets no value. The weight is `|n . r| / D^2`.
    ///
    /// A view contributes to the blocks that its own surfaces reach.
    pub fn fuse(views: &[FusedView<'_>], voxel: f32, origin: Vec3) -> Self {
        let mut scaffold = Self {
            voxel,
            truncation: TRUNCATION_VOXELS * voxel,
            origin,
            blocks: HashMap::new(),
        };
        let reached: Vec<ReachedBlocks> = views.iter().map(|view| scaffold.reached(view)).collect();
        let mut by_block: HashMap<IVec3, Vec<usize>> = HashMap::new();
        for (number, blocks) in reached.into_iter().enumerate() {
            for block in blocks {
                by_block.entry(block).or_default().push(number);
            }
        }
        let near = near_distance(views);
        let fuser = |view| Fuser { view, near };
        let fusers: Vec<Fuser<'_>> = views.iter().map(fuser).collect();
        let blocks: Vec<(IVec3, Block)> = by_block
            .into_par_iter()
            .map(|(block, numbers)| {
                let mut voxels: Block = Box::new([Voxel::default(); BLOCK_VOXELS]);
                for number in numbers {
                    scaffold.add(&fusers[number], block, &mut voxels);
                }
                (block, voxels)
            })
            .collect();
        scaffold.blocks = blocks.into_iter().collect();
        scaffold
    }

    /// Returns the blocks within the truncation of a view's surfaces.
    fn reached(&self, view: &FusedView<'_>) -> ReachedBlocks {
        let rays = Rays::new(view.view.camera);
        let to_world = view.view.rotation.transpose();
        let width = view.distances.width;
        let side = self.voxel * BLOCK_SIDE as f32;
        let of_row = |(row, distances): (usize, &[f32])| {
            let mut blocks: Vec<IVec3> = Vec::new();
            let mut last = None;
            for (column, &distance) in distances.iter().enumerate() {
                if distance <= 0.0 || view.incidence[row * width + column] <= 0.0 {
                    continue;
                }
                let ray = to_world * rays.ray(column, row).normalize();
                let place = (view.view.centre + ray * distance - self.origin) / side;
                let reach = self.truncation / side;
                let (low, high) = ((place - reach).floor(), (place + reach).floor());
                if high.abs().max(low.abs()).max_element() > 1e7 || last == Some((low, high)) {
                    continue;
                }
                let before = last.replace((low, high));
                let is_new = |block: &IVec3| {
                    let block = block.as_vec3();
                    before.is_none_or(|(low, high): (Vec3, Vec3)| {
                        block.cmplt(low).any() || block.cmpgt(high).any()
                    })
                };
                let (low, high) = (low.as_ivec3(), high.as_ivec3());
                for z in low.z..=high.z {
                    for y in low.y..=high.y {
                        let row = (low.x..=high.x).map(|x| ivec3(x, y, z));
                        blocks.extend(row.filter(is_new));
                    }
                }
            }
            blocks.sort_unstable_by_key(IVec3::to_array);
            blocks.dedup();
            blocks
        };
        let rows = view.distances.values.par_chunks(width.max(1)).enumerate();
        let mut all: ReachedBlocks = rows.flat_map_iter(of_row).collect();
        all.par_sort_unstable_by_key(IVec3::to_array);
        all.dedup();
        all
    }

    /// Adds a view's observations of the voxels of a block.
    fn add(&self, fuser: &Fuser<'_>, block: IVec3, voxels: &mut Block) {
        dispatch!(Level::new(), simd => self.add_rows(simd, fuser, block, voxels));
    }

    #[inline(always)]
    fn add_rows<S: Simd>(&self, simd: S, fuser: &Fuser<'_>, block: IVec3, voxels: &mut Block) {
        let first = block * BLOCK_SIDE;
        let columns: [f32; LANES] = std::array::from_fn(|x| {
            self.origin.x + ((first.x + x as i32) as f32 + 0.5) * self.voxel
        });
        let columns = f32x8::simd_from(simd, columns);
        let steps_per_unit = STEPS / self.truncation;
        for z in 0..BLOCK_SIDE {
            for y in 0..BLOCK_SIDE {
                let row = first + ivec3(0, y, z);
                let place = self.origin + (row.as_vec3() + 0.5) * self.voxel;
                let places = Vec3x8 {
                    x: columns,
                    y: f32x8::splat(simd, place.y),
                    z: f32x8::splat(simd, place.z),
                };
                let row = index_in_block(row);
                for (voxel, seen) in voxels[row..row + LANES].iter_mut().zip(fuser.seen(places)) {
                    let observed = seen.and_then(|seen| fuser.observed(seen, self.truncation));
                    if let Some((distance, weight)) = observed {
                        let steps = (distance * steps_per_unit + 0.5).floor() as i32;
                        voxel.sum = voxel.sum.saturating_add(steps * weight as i32);
                        voxel.weight = voxel.weight.saturating_add(weight);
                    }
                }
            }
        }
    }
}

/// A view prepared for many voxels.
struct Fuser<'a> {
    view: &'a FusedView<'a>,
    /// Distance up to which a surface seen from the front has the largest weight, scene units.
    near: f32,
}

impl Fuser<'_> {
    /// Returns the pixels that show some points (row-major index), and the points' distances from the camera.
    #[inline(always)]
    fn seen<S: Simd>(&self, places: Vec3x8<S>) -> [Option<(usize, f32)>; LANES] {
        let View {
            camera,
            rotation,
            centre,
            ..
        } = self.view.view;
        let points = Vec3x8 {
            x: places.x - centre.x,
            y: places.y - centre.y,
            z: places.z - centre.z,
        };
        let points = points.transformed(rotation);
        let distances = points.length_squared().sqrt();
        let sees = camera.see(points, distances, 0.0);
        let [u, v]: [[f32; LANES]; 2] = camera.pixels(points).map(Into::into);
        let [width, height] = camera.size();
        let distances: [f32; LANES] = distances.into();
        std::array::from_fn(|lane| {
            let (u, v) = (u[lane], v[lane]);
            let is_inside = u >= 0.0 && v >= 0.0 && u < width as f32 && v < height as f32;
            // On the far edges, the last column of a panorama wraps to the first, and the last row is
            // clamped.
            let pixel = (v as usize).min(height - 1) * width + u as usize % width;
            (sees.test(lane) && (is_inside || camera.wraps())).then_some((pixel, distances[lane]))
        })
    }

    /// Returns the truncated distance of a point from the surface plane of its pixel, and its weight. `away`
    /// is the point's distance from the camera.
    fn observed(&self, (pixel, away): (usize, f32), truncation: f32) -> Option<(f32, u32)> {
        let (surface, incidence) = (
            self.view.distances.values[pixel],
            self.view.incidence[pixel],
        );
        if surface <= 0.0 || incidence <= 0.0 {
            return None;
        }
        let distance = (surface - away) * incidence;
        if distance < -truncation {
            return None;
        }
        let nearness = (self.near / surface).min(1.0);
        let weight = (LARGEST_WEIGHT * incidence * nearness * nearness).max(1.0);
        Some((distance.min(truncation), weight as u32))
    }
}

/// Returns the tenth percentile of the known distances of all views, independent of their order.
fn near_distance(views: &[FusedView<'_>]) -> f32 {
    let of_view = |view: &FusedView<'_>| {
        let step = (view.distances.values.len() / 4096).max(1);
        let some = view.distances.values.iter().step_by(step).copied();
        some.filter(|&distance| distance > 0.0)
            .collect::<Vec<f32>>()
    };
    let mut known: Vec<f32> = views.iter().flat_map(of_view).collect();
    known.sort_by(f32::total_cmp);
    known.get(known.len() / 10).copied().unwrap_or(1.0)
}
