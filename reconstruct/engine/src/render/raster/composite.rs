//! Forward pass over one tile.

use fearless_simd::{Simd, prelude::*};

use crate::render::project::{Shape, Splat};
use crate::render::raster::{
    lanes::{alpha, blend, load, store},
    shapes::Walk,
    tile::{Batch, Plane, Scene, Tile, has_stopped},
};

/// Composited colours and transmittances of a tile's pixels.
pub(super) struct TileComposite {
    pub(super) colour: [Plane; 3],
    /// Negative if the pixel stopped early.
    pub(super) transmittance: Plane,
}

/// Composites a tile's splats; `features` holds one zeroed plane per feature.
#[inline(always)]
pub(super) fn composite<S: Simd>(
    simd: S,
    scene: &Scene<'_>,
    tile: &Tile,
    features: &mut [Plane],
) -> TileComposite {
    let mut state = TileComposite {
        colour: [Plane::filled(0.0); 3],
        transmittance: tile.full_transmittance(),
    };
    let mut places = scene.lists.tile(tile.index);
    let mut batch = Batch::new();
    while !places.is_empty() && !has_stopped(&state.transmittance) {
        batch.fill(scene, &mut places);
        for (index, splat) in batch.iter() {
            let values = scene.features_of(index);
            match &splat.shape {
                Shape::Ellipse(shape) => {
                    add_splat(
                        simd, scene, tile, shape, splat, values, &mut state, features,
                    );
                }
                Shape::Cone => {
                    let shape = &scene.splats.cones[index];
                    add_splat(
                        simd, scene, tile, shape, splat, values, &mut state, features,
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
    state: &mut TileComposite,
    features: &mut [Plane],
) {
    shape.walk(
        simd,
        tile,
        scene.rays,
        splat,
        #[inline(always)]
        |block| {
            let transmittance = load(simd, &state.transmittance.0, block.at);
            if !transmittance.simd_gt(0.0).any_true() {
                return;
            }
            let alpha = alpha(simd, block.log2_alpha);
            let blend = blend(simd, alpha.value, transmittance);
            store(blend.transmittance, &mut state.transmittance.0, block.at);
            for (plane, colour) in state.colour.iter_mut().zip(splat.colour) {
                let sum = load(simd, &plane.0, block.at);
                store(blend.weights.mul_add(colour, sum), &mut plane.0, block.at);
            }
            for (plane, &feature) in features.iter_mut().zip(values) {
                let sum = load(simd, &plane.0, block.at);
                store(blend.weights.mul_add(feature, sum), &mut plane.0, block.at);
            }
        },
    );
}
