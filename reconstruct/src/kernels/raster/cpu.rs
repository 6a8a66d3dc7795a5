//! Rasterization on the processor: one tile per task, half a row of a tile per vector step.
//!
//! Most footprints are a few pixels wide, so a row of a tile is walked as two *blocks* of
//! 8 pixels, and blocks beside the footprint are left out. The arithmetic is written once
//! over lanes and compiled twice: for the baseline and for AVX2. No operation is fused, so both
//! give the same bits.
#![expect(
    clippy::needless_range_loop,
    reason = "lanes, blocks and channels index several arrays at once"
)]

use rayon::prelude::*;

use super::{
    Raster,
    lanes::{BLOCKS, LANES, Lanes, Plane, all_zero, block_alpha, block_blend, sum_blocks},
    tile::{Alive, Tile, tile_range},
};
use crate::kernels::{
    TILE,
    bin::TileLists,
    project::{Splat, SplatGradient},
};

/// Renders `splats` with their tile `lists` over a background colour.
pub fn forward(
    size: (usize, usize),
    splats: &[Splat],
    lists: &TileLists,
    background: [f32; 3],
    out: &mut Raster,
) {
    let (width, height) = size;
    out.width = width;
    out.height = height;
    out.colour.resize(width * height * 3, 0.0);
    out.transmittance.resize(width * height, 0.0);
    // A row of tiles owns a contiguous stretch of the image.
    out.colour
        .par_chunks_mut(TILE * width * 3)
        .zip(out.transmittance.par_chunks_mut(TILE * width))
        .enumerate()
        .for_each(|(tile_row, (colour, transmittance))| {
            for tile_column in 0..lists.columns {
                let tile = Tile::new(size, lists, tile_row, tile_column);
                let state = composite(&tile, splats);
                for row in 0..tile.rows {
                    for column in 0..tile.columns {
                        let pixel = row * width + tile.left + column;
                        let left = state.transmittance[row].as_flattened()[column];
                        transmittance[pixel] = left;
                        for channel in 0..3 {
                            colour[pixel * 3 + channel] = state.colour[channel][row].as_flattened()
                                [column]
                                + left * background[channel];
                        }
                    }
                }
            }
        });
}

/// Gradients by the splats from the gradient by the image (`H * W * 3`). `order` is the order near
/// to far in which the tile lists were made; `out` receives one gradient per splat.
pub fn backward(
    raster: &Raster,
    splats: &[Splat],
    order: &[u32],
    lists: &TileLists,
    image_gradient: &[f32],
    out: &mut Vec<SplatGradient>,
) {
    let size = (raster.width, raster.height);
    let tile_count = lists.columns * lists.rows;
    let per_tile: Vec<Vec<SplatGradient>> = (0..tile_count)
        .into_par_iter()
        .map(|index| {
            let tile = Tile::new(size, lists, index / lists.columns, index % lists.columns);
            tile_gradients(&tile, splats, raster, image_gradient)
        })
        .collect();
    // Entries are numbered splat by splat: put every tile's gradients into that order ...
    let mut entries = vec![SplatGradient::default(); lists.items.len()];
    for (tile, gradients) in per_tile.into_iter().enumerate() {
        let items = &lists.items[tile_range(lists, tile)];
        for (item, gradient) in items.iter().zip(gradients) {
            entries[item.entry as usize] = gradient;
        }
    }
    // ... and sum them, always in the same order.
    out.clear();
    out.resize(splats.len(), SplatGradient::default());
    for (rank, &splat) in order.iter().enumerate() {
        let range = lists.entry_starts[rank] as usize..lists.entry_starts[rank + 1] as usize;
        let sum = &mut out[splat as usize];
        for entry in &entries[range] {
            sum.accumulate(entry);
        }
    }
}

impl SplatGradient {
    fn accumulate(&mut self, other: &Self) {
        for axis in 0..2 {
            self.centre[axis] += other.centre[axis];
        }
        for entry in 0..3 {
            self.conic[entry] += other.conic[entry];
            self.colour[entry] += other.colour[entry];
        }
        self.opacity += other.opacity;
    }
}

/// Per-pixel state of a tile.
struct TileState {
    colour: [Plane; 3],
    transmittance: Plane,
}

#[inline(always)]
fn composite_generic(tile: &Tile<'_>, splats: &[Splat]) -> TileState {
    let mut state = TileState {
        colour: [[[[0.0; LANES]; BLOCKS]; TILE]; 3],
        transmittance: [[[1.0; LANES]; BLOCKS]; TILE],
    };
    let mut alive = Alive::new(tile);
    for item in tile.items {
        if alive.count == 0 {
            break;
        }
        let splat = &splats[item.splat as usize];
        let footprint = tile.footprint(splat);
        for row in footprint.rows {
            let y = (tile.top + row) as f32 + 0.5 - splat.centre[1];
            for block in footprint.blocks.clone() {
                if !alive.blocks[row][block] {
                    continue;
                }
                let pixels = &mut alive.pixels[row][block];
                let (mut alpha, _) = block_alpha(splat, &footprint.offsets[block], y, pixels);
                if all_zero(&alpha) {
                    continue;
                }
                let transmittance = &mut state.transmittance[row][block];
                let weights = block_blend(&mut alpha, transmittance, pixels);
                for channel in 0..3 {
                    let colour = splat.colour[channel];
                    let sums = &mut state.colour[channel][row][block];
                    for lane in 0..LANES {
                        sums[lane] += weights[lane] * colour;
                    }
                }
                alive.update(row, block);
            }
        }
    }
    state
}

/// The image gradient and `S - P_i` of a tile's pixels.
struct Upstream {
    /// dL/dC by channel.
    colour: [Plane; 3],
    /// What the splats behind and the background contribute to `g . C`.
    behind: Plane,
}

impl Upstream {
    #[inline(always)]
    fn new(tile: &Tile<'_>, raster: &Raster, image_gradient: &[f32]) -> Self {
        let mut upstream = Self {
            colour: [[[[0.0; LANES]; BLOCKS]; TILE]; 3],
            behind: [[[0.0; LANES]; BLOCKS]; TILE],
        };
        for row in 0..tile.rows {
            for column in 0..tile.columns {
                let pixel = ((tile.top + row) * raster.width + tile.left + column) * 3;
                let (block, lane) = (column / LANES, column % LANES);
                for channel in 0..3 {
                    let g = image_gradient[pixel + channel];
                    upstream.colour[channel][row][block][lane] = g;
                    upstream.behind[row][block][lane] += g * raster.colour[pixel + channel];
                }
            }
        }
        upstream
    }
}

/// Sums over a splat's footprint in one tile, kept per lane until the end.
struct Sums {
    /// dL/d(-q/2), times 1, y and y^2.
    power: [[Lanes; BLOCKS]; 3],
    opacity: [Lanes; BLOCKS],
    colour: [[Lanes; BLOCKS]; 3],
}

/// One [`SplatGradient`] per item of the tile's list.
#[inline(always)]
fn tile_gradients_generic(
    tile: &Tile<'_>,
    splats: &[Splat],
    raster: &Raster,
    image_gradient: &[f32],
) -> Vec<SplatGradient> {
    let mut gradients = vec![SplatGradient::default(); tile.items.len()];
    let mut upstream = Upstream::new(tile, raster, image_gradient);
    let mut transmittance = [[[1.0; LANES]; BLOCKS]; TILE];
    let mut alive = Alive::new(tile);
    for (item, gradient) in tile.items.iter().zip(&mut gradients) {
        if alive.count == 0 {
            break;
        }
        let splat = &splats[item.splat as usize];
        let footprint = tile.footprint(splat);
        let mut sums = Sums {
            power: [[[0.0; LANES]; BLOCKS]; 3],
            opacity: [[0.0; LANES]; BLOCKS],
            colour: [[[0.0; LANES]; BLOCKS]; 3],
        };
        for row in footprint.rows.clone() {
            let y = (tile.top + row) as f32 + 0.5 - splat.centre[1];
            for block in footprint.blocks.clone() {
                if !alive.blocks[row][block] {
                    continue;
                }
                let before = transmittance[row][block];
                let pixels = &mut alive.pixels[row][block];
                let (mut alpha, falloff) = block_alpha(splat, &footprint.offsets[block], y, pixels);
                if all_zero(&alpha) {
                    continue;
                }
                let weights = block_blend(&mut alpha, &mut transmittance[row][block], pixels);
                let behind = &mut upstream.behind[row][block];
                for lane in 0..LANES {
                    let g: [f32; 3] =
                        std::array::from_fn(|channel| upstream.colour[channel][row][block][lane]);
                    let along =
                        g[0] * splat.colour[0] + g[1] * splat.colour[1] + g[2] * splat.colour[2];
                    for channel in 0..3 {
                        sums.colour[channel][block][lane] += weights[lane] * g[channel];
                    }
                    behind[lane] -= weights[lane] * along;
                    let by_alpha = before[lane] * along - behind[lane] / (1.0 - alpha[lane]);
                    let by_alpha = if alpha[lane] > 0.0 { by_alpha } else { 0.0 };
                    let by_opacity = by_alpha * falloff[lane];
                    let by_power = by_opacity * splat.opacity;
                    sums.opacity[block][lane] += by_opacity;
                    sums.power[0][block][lane] += by_power;
                    sums.power[1][block][lane] += by_power * y;
                    sums.power[2][block][lane] += by_power * y * y;
                }
                alive.update(row, block);
            }
        }
        *gradient = sums.assemble(splat, &footprint.offsets);
    }
    gradients
}

impl Sums {
    /// Moments of dL/d(-q/2) over the footprint become gradients of centre and conic.
    #[inline(always)]
    fn assemble(&self, splat: &Splat, offsets: &[Lanes; BLOCKS]) -> SplatGradient {
        let mut by_x = [[0.0; LANES]; BLOCKS];
        let mut by_xx = [[0.0; LANES]; BLOCKS];
        let mut by_xy = [[0.0; LANES]; BLOCKS];
        for block in 0..BLOCKS {
            for lane in 0..LANES {
                let x = offsets[block][lane];
                by_x[block][lane] = self.power[0][block][lane] * x;
                by_xx[block][lane] = by_x[block][lane] * x;
                by_xy[block][lane] = self.power[1][block][lane] * x;
            }
        }
        let (x, y) = (sum_blocks(&by_x), sum_blocks(&self.power[1]));
        let [a, b, c] = splat.conic;
        SplatGradient {
            centre: [a * x + b * y, b * x + c * y],
            conic: [
                -0.5 * sum_blocks(&by_xx),
                -sum_blocks(&by_xy),
                -0.5 * sum_blocks(&self.power[2]),
            ],
            opacity: sum_blocks(&self.opacity),
            colour: [
                sum_blocks(&self.colour[0]),
                sum_blocks(&self.colour[1]),
                sum_blocks(&self.colour[2]),
            ],
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn composite_avx2(tile: &Tile<'_>, splats: &[Splat]) -> TileState {
    composite_generic(tile, splats)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn tile_gradients_avx2(
    tile: &Tile<'_>,
    splats: &[Splat],
    raster: &Raster,
    image_gradient: &[f32],
) -> Vec<SplatGradient> {
    tile_gradients_generic(tile, splats, raster, image_gradient)
}

fn composite(tile: &Tile<'_>, splats: &[Splat]) -> TileState {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has AVX2.
        return unsafe { composite_avx2(tile, splats) };
    }
    composite_generic(tile, splats)
}

fn tile_gradients(
    tile: &Tile<'_>,
    splats: &[Splat],
    raster: &Raster,
    image_gradient: &[f32],
) -> Vec<SplatGradient> {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") {
        // SAFETY: the processor has AVX2.
        return unsafe { tile_gradients_avx2(tile, splats, raster, image_gradient) };
    }
    tile_gradients_generic(tile, splats, raster, image_gradient)
}
