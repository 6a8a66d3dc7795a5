//! Backward pass over one tile.

use fearless_simd::{Simd, f32x8, prelude::*};

use crate::render::raster::{
    Raster, RasterGradient,
    lanes::{Blend, LANES, alpha, blend, load, store},
    shapes::{EntrySums, Walk, cone_gradients},
    tile::{Batch, Plane, Scene, Tile, has_stopped},
};
use crate::render::{
    bin::learning::LearningEntries,
    project::{ConeGradient, Shape, Splat, SplatGradient},
    settings::TILE,
};

/// Memory for the features of one tile, reused from tile to tile.
#[derive(Default)]
pub(super) struct FeatureScratch {
    /// dL/d(feature image), one plane per feature.
    upstream: Vec<Plane>,
    /// dL/d(feature), per lane.
    sums: Vec<[f32; LANES]>,
}

/// Gradient by a tile's pixels, and the contributions behind the current splat.
struct Upstream {
    /// dL/dC per channel.
    colour: [Plane; 3],
    /// `S - P_i`: contribution of the splats behind and of the background to `g . C`.
    behind: Plane,
    transmittance: Plane,
}

impl Upstream {
    fn new(
        scene: &Scene<'_>,
        tile: &Tile,
        raster: &Raster,
        gradient: &RasterGradient<'_>,
        features: &mut FeatureScratch,
    ) -> Self {
        let mut upstream = Self {
            colour: [Plane::filled(0.0); 3],
            behind: Plane::filled(0.0),
            transmittance: tile.full_transmittance(),
        };
        let has_features = !gradient.features.is_empty();
        let planes = if has_features { scene.feature_count } else { 0 };
        features.upstream.clear();
        features.upstream.resize(planes, Plane::filled(0.0));
        features.sums.resize(planes, [0.0; LANES]);
        for row in 0..tile.rows {
            let first = (tile.top + row) * raster.width + tile.left;
            let pixels = first * 3..(first + tile.columns) * 3;
            let rgb = raster.colour[pixels.clone()].as_chunks::<3>().0;
            let by_rgb = gradient.colour[pixels].as_chunks::<3>().0;
            for (column, (rgb, by_rgb)) in rgb.iter().zip(by_rgb).enumerate() {
                let at = row * TILE + column;
                for channel in 0..3 {
                    upstream.colour[channel].0[at] = by_rgb[channel];
                    upstream.behind.0[at] += by_rgb[channel] * rgb[channel];
                }
            }
            for (feature, plane) in features.upstream.iter_mut().enumerate() {
                let first = feature * raster.width * raster.height + first;
                for column in 0..tile.columns {
                    let (at, by_value) = (row * TILE + column, gradient.features[first + column]);
                    plane.0[at] = by_value;
                    upstream.behind.0[at] += by_value * raster.features[first + column];
                }
            }
        }
        upstream
    }

    /// Returns dL/dC of 8 pixels.
    #[inline(always)]
    fn by_colour<S: Simd>(&self, simd: S, at: usize) -> [f32x8<S>; 3] {
        [
            load(simd, &self.colour[0].0, at),
            load(simd, &self.colour[1].0, at),
            load(simd, &self.colour[2].0, at),
        ]
    }

    /// Steps behind a splat with `g . c_i` in 8 pixels; returns the remaining contribution behind it.
    #[inline(always)]
    fn go_on<S: Simd>(&mut self, simd: S, at: usize, blend: Blend<S>, along: f32x8<S>) -> f32x8<S> {
        let behind = load(simd, &self.behind.0, at) - blend.weights * along;
        store(behind, &mut self.behind.0, at);
        store(blend.transmittance, &mut self.transmittance.0, at);
        behind
    }
}

/// Destination of the gradients of a tile's entries.
pub(super) struct TileEntries<'a> {
    /// One per entry.
    pub(super) splats: &'a mut [SplatGradient],
    /// One per entry; arbitrary if the shape is not a cone.
    pub(super) cones: &'a mut [ConeGradient],
    /// `feature_count` per entry.
    pub(super) features: &'a mut [f32],
}

/// Writes the gradients of a tile's trained entries; the others only occlude.
#[inline(always)]
#[expect(
    clippy::too_many_arguments,
    reason = "the loop over a tile takes its operands one by one"
)]
pub(super) fn tile_gradients<S: Simd>(
    simd: S,
    scene: &Scene<'_>,
    tile: &Tile,
    learning: &LearningEntries,
    raster: &Raster,
    gradient: &RasterGradient<'_>,
    out: &mut TileEntries<'_>,
    scratch: &mut FeatureScratch,
) {
    let mut upstream = Upstream::new(scene, tile, raster, gradient, scratch);
    let mut places = scene.lists.tile(tile.index);
    let mut batch = Batch::new();
    let mut done = 0;
    while done < out.splats.len() && !has_stopped(&upstream.transmittance) {
        batch.fill(scene, &mut places);
        for (index, splat) in batch.iter() {
            let values = scene.features_of(index);
            if !learning.learns(index) {
                match &splat.shape {
                    Shape::Ellipse(shape) => {
                        pass_one(
                            simd,
                            scene,
                            tile,
                            shape,
                            splat,
                            values,
                            &mut upstream,
                            scratch,
                        );
                    }
                    Shape::Cone => {
                        let shape = &scene.splats.cones[index];
                        pass_one(
                            simd,
                            scene,
                            tile,
                            shape,
                            splat,
                            values,
                            &mut upstream,
                            scratch,
                        );
                    }
                }
                continue;
            }
            match &splat.shape {
                Shape::Ellipse(shape) => {
                    let sums = one_splat(
                        simd,
                        scene,
                        tile,
                        shape,
                        splat,
                        values,
                        &mut upstream,
                        scratch,
                    );
                    out.splats[done] = shape.gradient(sums);
                }
                Shape::Cone => {
                    let shape = &scene.splats.cones[index];
                    let sums = one_splat(
                        simd,
                        scene,
                        tile,
                        shape,
                        splat,
                        values,
                        &mut upstream,
                        scratch,
                    );
                    (out.splats[done], out.cones[done]) = cone_gradients(sums);
                }
            }
            let features = &mut out.features[done * scene.feature_count..];
            for (feature, sum) in features.iter_mut().zip(&mut scratch.sums) {
                *feature = sum.iter().sum();
                *sum = [0.0; LANES];
            }
            done += 1;
        }
    }
    out.splats[done..].fill(SplatGradient::default());
    out.cones[done..].fill([0.0; 10]);
    let first_feature = if scratch.sums.is_empty() {
        0
    } else {
        done * scene.feature_count
    };
    out.features[first_feature..].fill(0.0);
}

/// Updates transmittance and remaining contribution behind an untrained splat, with the same bits as
/// [`one_splat`].
#[inline(always)]
#[expect(
    clippy::too_many_arguments,
    reason = "the innermost loop takes its operands one by one"
)]
fn pass_one<S: Simd, W: Walk<S>>(
    simd: S,
    scene: &Scene<'_>,
    tile: &Tile,
    shape: &W,
    splat: &Splat,
    values: &[f32],
    upstream: &mut Upstream,
    features: &FeatureScratch,
) {
    let colour = splat.colour.map(|value| f32x8::splat(simd, value));
    shape.walk(
        simd,
        tile,
        scene.rays,
        splat,
        #[inline(always)]
        |block| {
            let transmittance = load(simd, &upstream.transmittance.0, block.at);
            if !transmittance.simd_gt(0.0).any_true() {
                return;
            }
            let alpha = alpha(simd, block.log2_alpha);
            let blend = blend(simd, alpha.value, transmittance);
            let g = upstream.by_colour(simd, block.at);
            let mut along = g[0] * colour[0];
            along = g[1].mul_add(colour[1], along);
            along = g[2].mul_add(colour[2], along);
            for (plane, &value) in features.upstream.iter().zip(values) {
                along = load(simd, &plane.0, block.at).mul_add(value, along);
            }
            upstream.go_on(simd, block.at, blend, along);
        },
    );
}

#[inline(always)]
#[expect(
    clippy::too_many_arguments,
    reason = "the innermost loop takes its operands one by one"
)]
fn one_splat<S: Simd, W: Walk<S>>(
    simd: S,
    scene: &Scene<'_>,
    tile: &Tile,
    shape: &W,
    splat: &Splat,
    values: &[f32],
    upstream: &mut Upstream,
    features: &mut FeatureScratch,
) -> EntrySums<S, W::Sums> {
    let zero = f32x8::splat(simd, 0.0);
    let mut shape_sums = W::zero(simd);
    let mut by_log_sum = zero;
    let mut colour_sums = [zero; 3];
    let colour = splat.colour.map(|value| f32x8::splat(simd, value));
    shape.walk(
        simd,
        tile,
        scene.rays,
        splat,
        #[inline(always)]
        |block| {
            let transmittance = load(simd, &upstream.transmittance.0, block.at);
            if !transmittance.simd_gt(0.0).any_true() {
                return;
            }
            let alpha = alpha(simd, block.log2_alpha);
            let blend = blend(simd, alpha.value, transmittance);
            let g = upstream.by_colour(simd, block.at);
            let mut along = g[0] * colour[0];
            along = g[1].mul_add(colour[1], along);
            along = g[2].mul_add(colour[2], along);
            for (sum, g) in colour_sums.iter_mut().zip(g) {
                *sum = blend.weights.mul_add(g, *sum);
            }
            for ((plane, sum), &value) in
                features.upstream.iter().zip(&mut features.sums).zip(values)
            {
                let g = load(simd, &plane.0, block.at);
                along = g.mul_add(value, along);
                let added = blend.weights.mul_add(g, load(simd, sum, 0));
                store(added, sum, 0);
            }
            let counts = blend.weights.simd_gt(0.0);
            let behind = upstream.go_on(simd, block.at, blend, along);
            let by_alpha = transmittance * along - behind / (-alpha.value + 1.0);
            let by_log = counts.select(by_alpha * alpha.unclamped, zero);
            by_log_sum += by_log;
            shape.add(&mut shape_sums, &block.geometry, by_log);
        },
    );
    EntrySums {
        shape: shape_sums,
        by_log: by_log_sum,
        colour: colour_sums,
    }
}
