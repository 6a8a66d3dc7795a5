//! The forward pass over one tile.

use fearless_simd::{Simd, prelude::*};

use crate::render::raster::{
    lanes::{alpha, blend, load, store},
    shapes::Walk,
    spans::Spans,
    tile::{Batch, Plane, STRIDE, Scene, Tile, has_stopped},
};
use crate::render::{
    project::{Shape, Splat},
    settings::TILE,
};

/// What a tile's pixels have collected.
pub(super) struct Composited {
    pub(super) colour: [Plane; 3],
    /// Negative where the pixel stopped early.
    pub(super) transmittance: Plane,
}

/// Composites a tile's splats; `features` holds one zeroed plane per feature.
#[inline(always)]
pub(super) fn composite<S: Simd>(
    simd: S,
    scene: &Scene<'_>,
    tile: &Tile,
    features: &mut [Plane],
) -> Composited {
    let mut state = Composited {
        colour: [[0.0; TILE * STRIDE]; 3],
        transmittance: tile.full_transmittance(),
    };
    let mut places = scene.lists.tile(tile.index);
    let (mut batch, mut spans) = (Batch::new(), Spans::new());
    while !places.is_empty() && !has_stopped(&state.transmittance) {
        batch.fill(scene, &mut places);
        for (index, splat) in batch.iter() {
            let values = scene.features_of(index);
            match &splat.shape {
                Shape::Ellipse(shape) => {
                    add_splat(
                        simd, scene, tile, shape, splat, values, &mut spans, &mut state, features,
                    );
                }
                Shape::Cone(shape) => {
                    add_splat(
                        simd, scene, tile, shape, splat, values, &mut spans, &mut state, features,
                    );
                }
            }
        }
    }
    state
}

#[inline(always)]
#[expect(
    clippy::too_many_arguments,
    reason = "the innermost loop takes its operands one by one"
)]
fn add_splat<S: Simd>(
    simd: S,
    scene: &Scene<'_>,
    tile: &Tile,
    shape: &impl Walk<S>,
    splat: &Splat,
    values: &[f32],
    spans: &mut Spans,
    state: &mut Composited,
    features: &mut [Plane],
) {
    shape.walk(
        simd,
        tile,
        scene.rays,
        splat,
        spans,
        #[inline(always)]
        |block| {
            let transmittance = load(simd, &state.transmittance, block.at);
            if !transmittance.simd_gt(0.0).any_true() {
                return;
            }
            let alpha = alpha(simd, block.log2_alpha);
            let blend = blend(simd, alpha.value, transmittance);
            store(blend.transmittance, &mut state.transmittance, block.at);
            for (plane, colour) in state.colour.iter_mut().zip(splat.colour) {
                let sum = load(simd, plane, block.at);
                store(blend.weights.mul_add(colour, sum), plane, block.at);
            }
            for (plane, &feature) in features.iter_mut().zip(values) {
                let sum = load(simd, plane, block.at);
                store(blend.weights.mul_add(feature, sum), plane, block.at);
            }
        },
    );
}
