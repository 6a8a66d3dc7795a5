//! Rasterization on the processor: one tile per task, half a row of a tile per vector step.
//!
//! Most footprints are a few pixels wide, so a row of a tile is walked as two *blocks* of
//! [`LANES`] pixels, and blocks beside the footprint are left out. The arithmetic is written once
//! over lanes and compiled twice: for the baseline and for AVX2. No operation is fused, so both
//! give the same bits.
#![expect(
    clippy::needless_range_loop,
    reason = "lanes, blocks and channels index several arrays at once"
)]

use std::ops::Range;

use rayon::prelude::*;

use super::Raster;
use crate::kernels::{
    ALPHA_MAX, ALPHA_MIN, TILE, TRANSMITTANCE_MIN,
    bin::{TileItem, TileLists},
    project::{Splat, SplatGradient},
};

/// Pixels per vector step.
const LANES: usize = 8;
/// Vector steps per row of a tile.
const BLOCKS: usize = TILE / LANES;

type Lanes = [f32; LANES];
/// One value per pixel of a tile: rows of blocks of lanes.
type Plane = [[Lanes; BLOCKS]; TILE];

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

fn tile_range(lists: &TileLists, tile: usize) -> Range<usize> {
    lists.tile_starts[tile] as usize..lists.tile_starts[tile + 1] as usize
}

/// A tile's place in the image and its list.
struct Tile<'a> {
    /// First column of pixels.
    left: usize,
    /// First row of pixels.
    top: usize,
    /// Columns inside the image.
    columns: usize,
    /// Rows inside the image.
    rows: usize,
    image_width: f32,
    items: &'a [TileItem],
}

/// A splat seen from a tile: where its footprint can be.
struct Footprint {
    /// Column offsets from the splat's centre to the pixel centres, the short way around the seam.
    offsets: [Lanes; BLOCKS],
    /// Blocks with a pixel inside the footprint's width.
    blocks: Range<usize>,
    /// Rows with a pixel inside the footprint's height.
    rows: Range<usize>,
}

impl<'a> Tile<'a> {
    fn new(
        size: (usize, usize),
        lists: &'a TileLists,
        tile_row: usize,
        tile_column: usize,
    ) -> Self {
        let (left, top) = (tile_column * TILE, tile_row * TILE);
        Self {
            left,
            top,
            columns: TILE.min(size.0 - left),
            rows: TILE.min(size.1 - top),
            image_width: size.0 as f32,
            items: &lists.items[tile_range(lists, tile_row * lists.columns + tile_column)],
        }
    }

    #[inline(always)]
    fn footprint(&self, splat: &Splat) -> Footprint {
        let (offsets, blocks) = self.column_offsets(splat);
        // Row centres are at row + 1/2.
        let reach = splat.extent[1] + MARGIN;
        let centre = splat.centre[1] - self.top as f32 - 0.5;
        let first_row = (centre - reach).ceil().max(0.0) as usize;
        let end_row = ((centre + reach).floor() + 1.0).max(0.0) as usize;
        Footprint {
            offsets,
            blocks,
            rows: first_row..end_row.min(self.rows).max(first_row),
        }
    }
}

impl Tile<'_> {
    /// Offsets from the splat's centre to the columns, and the blocks its footprint can touch.
    #[inline(always)]
    fn column_offsets(&self, splat: &Splat) -> ([Lanes; BLOCKS], Range<usize>) {
        let half = 0.5 * self.image_width;
        let reach = splat.extent[0] + MARGIN;
        let lane_offsets: [Lanes; BLOCKS] =
            std::array::from_fn(|block| std::array::from_fn(|lane| (block * LANES + lane) as f32));
        let mut first = self.left as f32 + 0.5 - splat.centre[0];
        if reach + TILE as f32 >= half {
            // So wide a footprint can reach one tile from both sides: every column wraps alone.
            let offsets = lane_offsets.map(|lanes| {
                lanes.map(|lane| {
                    let distance = first + lane;
                    distance
                        - self.image_width
                            * (f32::from(distance > half) - f32::from(distance < -half))
                })
            });
            return (offsets, 0..BLOCKS);
        }
        // The whole tile lies on one side of the splat's antipode as far as the splat can reach.
        let middle = first + 0.5 * TILE as f32;
        if middle > half {
            first -= self.image_width;
        } else if middle < -half {
            first += self.image_width;
        }
        let offsets = lane_offsets.map(|lanes| lanes.map(|lane| first + lane));
        let touched = |block: usize| {
            let begin = first + (block * LANES) as f32;
            begin <= reach && begin + (LANES - 1) as f32 >= -reach
        };
        let begin = usize::from(!touched(0));
        let end = BLOCKS - usize::from(!touched(BLOCKS - 1));
        (offsets, begin..end.max(begin))
    }
}

// `column_offsets` looks at the first and the last block only.
const _: () = assert!(BLOCKS == 2);

/// Widening of footprints in pixels, against rounding in the extents.
const MARGIN: f32 = 0.01;

/// Per-pixel state of a tile.
struct TileState {
    colour: [Plane; 3],
    transmittance: Plane,
}

/// Which pixels still take splats: 1 or 0.
struct Alive {
    pixels: Plane,
    blocks: [[bool; BLOCKS]; TILE],
    count: usize,
}

impl Alive {
    #[inline(always)]
    fn new(tile: &Tile<'_>) -> Self {
        Self {
            pixels: [[[1.0; LANES]; BLOCKS]; TILE],
            blocks: [[true; BLOCKS]; TILE],
            count: tile.rows * BLOCKS,
        }
    }

    /// Notes that a block may have lost its last pixel.
    #[inline(always)]
    fn update(&mut self, row: usize, block: usize) {
        if all_zero(&self.pixels[row][block]) {
            self.blocks[row][block] = false;
            self.count -= 1;
        }
    }
}

/// `exp(x)` for `x <= 0`, relative error below 1e-6 down to -6 and 1e-5 down to -80, where it stays;
/// branch-free so that it vectorizes.
#[inline(always)]
fn exp_negative(x: f32) -> f32 {
    let x = x.max(-80.0);
    let scaled = x * std::f32::consts::LOG2_E;
    // Rounds to the nearest integer by pushing the fraction out of the mantissa.
    const ROUNDER: f32 = 12_582_912.0; // 1.5 * 2^23
    let shifted = scaled + ROUNDER;
    let f = scaled - (shifted - ROUNDER);
    // 2^f on [-1/2, 1/2], Taylor coefficients of exp(f ln 2) up to the sixth power.
    let mut p = 1.540_353e-4;
    p = p * f + 1.333_355_8e-3;
    p = p * f + 9.618_129e-3;
    p = p * f + 5.550_411e-2;
    p = p * f + 2.402_265e-1;
    p = p * f + 6.931_472e-1;
    p = p * f + 1.0;
    // The integer stands in the low bits of the shifted sum.
    let exponent = shifted
        .to_bits()
        .wrapping_sub(ROUNDER.to_bits())
        .wrapping_add(127)
        << 23;
    p * f32::from_bits(exponent)
}

/// `alpha` and the falloff `exp(-q/2)` of one splat on one block at row offset `y`.
#[inline(always)]
fn block_alpha(splat: &Splat, offsets: &Lanes, y: f32, alive: &Lanes) -> (Lanes, Lanes) {
    let [a, b, c] = splat.conic;
    let (half_a, by, half_cyy) = (-0.5 * a, -b * y, -0.5 * c * y * y);
    let mut alpha = [0.0; LANES];
    let mut falloff = [0.0; LANES];
    for lane in 0..LANES {
        let x = offsets[lane];
        // Rounding can push the exponent of a needle above zero.
        let power = (half_a * x * x + by * x + half_cyy).min(0.0);
        falloff[lane] = exp_negative(power);
        let opacity = (splat.opacity * falloff[lane]).min(ALPHA_MAX) * alive[lane];
        alpha[lane] = if opacity >= ALPHA_MIN { opacity } else { 0.0 };
    }
    (alpha, falloff)
}

/// One step of compositing on one block: blends `alpha` unless a pixel has to stop before it.
/// Returns the weights `T alpha`; `alpha` is zeroed where the pixel stopped.
#[inline(always)]
fn block_blend(alpha: &mut Lanes, transmittance: &mut Lanes, alive: &mut Lanes) -> Lanes {
    let mut weights = [0.0; LANES];
    for lane in 0..LANES {
        let next = transmittance[lane] * (1.0 - alpha[lane]);
        let go_on = if next < TRANSMITTANCE_MIN { 0.0 } else { 1.0 };
        alpha[lane] *= go_on;
        alive[lane] *= go_on;
        weights[lane] = transmittance[lane] * alpha[lane];
        transmittance[lane] *= 1.0 - alpha[lane];
    }
    weights
}

/// Whether every lane is +0.
#[inline(always)]
fn all_zero(lanes: &Lanes) -> bool {
    lanes.iter().fold(0, |bits, lane| bits | lane.to_bits()) == 0
}

#[inline(always)]
fn sum(lanes: &Lanes) -> f32 {
    let half: [f32; 4] = std::array::from_fn(|lane| lanes[lane] + lanes[lane + 4]);
    (half[0] + half[2]) + (half[1] + half[3])
}

#[inline(always)]
fn sum_blocks(blocks: &[Lanes; BLOCKS]) -> f32 {
    blocks.iter().map(sum).sum()
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fast_exponential_is_the_exponential() {
        for step in 0..8000 {
            let x = -(step as f32) * 0.01;
            let exact = f64::from(x).exp();
            let error = (f64::from(exp_negative(x)) - exact).abs() / exact;
            assert!(error < 1e-5, "exp({x}) is off by {error}");
        }
        for step in 0..600 {
            let x = -(step as f32) * 0.01;
            let exact = f64::from(x).exp();
            let error = (f64::from(exp_negative(x)) - exact).abs() / exact;
            assert!(error < 1e-6, "exp({x}) is off by {error}");
        }
        assert!(exp_negative(f32::NEG_INFINITY) < 1e-30);
        assert_eq!(exp_negative(0.0), 1.0);
    }
}
