//! Rasterization on the CPU: one tile per task, 8 pixels of a row per vector step.
//!
//! A footprint is evaluated on all vectors of the tile that its rectangle touches. For small footprints this
//! is faster than finding the pixels of each row.

use std::{cell::RefCell, ops::Range};

use fearless_simd::{Level, dispatch};
use rayon::prelude::*;

use crate::render::raster::{
    EntryGradients, Raster, RasterGradient,
    composite::{TileComposite, composite},
    gradient::{FeatureScratch, TileEntries, tile_gradients},
    tile::{Plane, Scene, Tile},
};
use crate::{
    camera::rays::Rays,
    gaussians::ActivatedGaussians,
    render::{
        bin::{TileLists, learning::LearningEntries},
        project::{SplatGradient, Splats},
        settings::TILE,
    },
};

thread_local! {
    static FEATURE_PLANES: RefCell<Vec<Plane>> = const { RefCell::new(Vec::new()) };
    static FEATURE_SCRATCH: RefCell<FeatureScratch> = RefCell::default();
}

/// Input of the rasterizer: a projected view.
#[derive(Debug, Clone, Copy)]
pub struct Input<'a> {
    /// Splats, one per Gaussian.
    pub splats: &'a Splats,
    /// The Gaussians, for their features.
    pub gaussians: &'a ActivatedGaussians,
    /// Splats of the tiles.
    pub lists: &'a TileLists,
    /// Rays through the pixels.
    pub rays: &'a Rays,
    /// Background colour.
    pub background: [f32; 3],
}

impl<'a> Input<'a> {
    fn scene(&self) -> Scene<'a> {
        Scene {
            splats: self.splats,
            features: &self.gaussians.features,
            feature_count: self.gaussians.feature_count,
            lists: self.lists,
            rays: self.rays,
            background: self.background,
        }
    }
}

/// Renders colours and features.
pub fn forward(input: Input<'_>, out: &mut Raster) {
    let scene = input.scene();
    let (width, height) = (scene.width(), scene.height());
    out.width = width;
    out.height = height;
    out.colour.resize(width * height * 3, 0.0);
    out.transmittance.resize(width * height, 0.0);
    out.features
        .resize(width * height * scene.feature_count, 0.0);
    let level = Level::new();
    // A row of tiles owns contiguous rows of every image.
    let mut bands = Vec::with_capacity(scene.lists.rows);
    let mut planes: Vec<_> = out
        .features
        .chunks_mut((width * height).max(1))
        .map(|plane| plane.chunks_mut(TILE * width))
        .collect();
    for (colour, transmittance) in out
        .colour
        .chunks_mut(TILE * width * 3)
        .zip(out.transmittance.chunks_mut(TILE * width))
    {
        bands.push(Band {
            colour,
            transmittance,
            features: planes.iter_mut().filter_map(Iterator::next).collect(),
        });
    }
    bands
        .into_par_iter()
        .enumerate()
        .with_max_len(1)
        .for_each(|(row, mut band)| {
            FEATURE_PLANES.with_borrow_mut(|features| {
                for column in 0..scene.lists.columns {
                    let tile = Tile::new(&scene, row * scene.lists.columns + column);
                    features.clear();
                    features.resize(scene.feature_count, Plane::filled(0.0));
                    let state = dispatch!(level, simd => composite(simd, &scene, &tile, features));
                    band.write(&scene, &tile, &state, features);
                }
            });
        });
}

/// Rows of all images that belong to a row of tiles.
struct Band<'a> {
    colour: &'a mut [f32],
    transmittance: &'a mut [f32],
    features: Vec<&'a mut [f32]>,
}

impl Band<'_> {
    fn write(&mut self, scene: &Scene<'_>, tile: &Tile, state: &TileComposite, features: &[Plane]) {
        for row in 0..tile.rows {
            let first = row * scene.width() + tile.left;
            let pixels = first..first + tile.columns;
            let colour = &mut self.colour[first * 3..(first + tile.columns) * 3];
            let rows = colour
                .as_chunks_mut::<3>()
                .0
                .iter_mut()
                .zip(&mut self.transmittance[pixels.clone()]);
            for (column, (rgb, transmittance)) in rows.enumerate() {
                let at = row * TILE + column;
                *transmittance = state.transmittance.0[at].abs();
                for (channel, value) in rgb.iter_mut().enumerate() {
                    *value =
                        state.colour[channel].0[at] + *transmittance * scene.background[channel];
                }
            }
            for (image, plane) in self.features.iter_mut().zip(features) {
                image[pixels.clone()].copy_from_slice(&plane.0[row * TILE..][..tile.columns]);
            }
        }
    }
}

/// Computes gradients by the splats of the trained entries, from the gradient by the images. `raster` must be
/// the output of [`forward`] for the same input.
pub fn backward(
    input: Input<'_>,
    learning: &LearningEntries,
    raster: &Raster,
    gradient: &RasterGradient<'_>,
    out: &mut EntryGradients,
) {
    let scene = input.scene();
    let entries = learning.len();
    out.splats.resize(entries, SplatGradient::default());
    out.cones.resize(entries, [0.0; 10]);
    out.features.resize(entries * scene.feature_count, 0.0);
    let level = Level::new();
    let all = TileEntries {
        splats: &mut out.splats,
        cones: &mut out.cones,
        features: &mut out.features,
    };
    let tiles = 0..scene.lists.columns * scene.lists.rows;
    let features = scene.feature_count;
    for_each_tile((learning, features), tiles, all, &|index, mut out| {
        let tile = Tile::new(&scene, index);
        FEATURE_SCRATCH.with_borrow_mut(|scratch| {
            dispatch!(level, simd => {
                tile_gradients(simd, &scene, &tile, learning, raster, gradient, &mut out, scratch);
            });
        });
    });
}

/// Calls `work` in parallel for every tile that shows a trained Gaussian, with the tile's part of `out`.
fn for_each_tile<F>(
    (learning, features): (&LearningEntries, usize),
    tiles: Range<usize>,
    out: TileEntries<'_>,
    work: &F,
) where
    F: Fn(usize, TileEntries<'_>) + Sync,
{
    match tiles.len() {
        _ if out.splats.is_empty() => {}
        1 => work(tiles.start, out),
        _ => {
            let middle = usize::midpoint(tiles.start, tiles.end);
            let begin = learning.tile(tiles.start).start;
            let count = learning.tile(middle).start - begin;
            let (left, right) = out.splats.split_at_mut(count);
            let (left_cones, right_cones) = out.cones.split_at_mut(count);
            let (left_features, right_features) = out.features.split_at_mut(count * features);
            rayon::join(
                || {
                    let out = TileEntries {
                        splats: left,
                        cones: left_cones,
                        features: left_features,
                    };
                    for_each_tile((learning, features), tiles.start..middle, out, work);
                },
                || {
                    let out = TileEntries {
                        splats: right,
                        cones: right_cones,
                        features: right_features,
                    };
                    for_each_tile((learning, features), middle..tiles.end, out, work);
                },
            );
        }
    }
}
