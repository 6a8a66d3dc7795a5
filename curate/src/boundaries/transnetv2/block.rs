//! A block of dilated convolutions: four branches, each a 1x3x3 convolution per frame followed by
//! a 3x1x1 convolution over time with dilation 1, 2, 4 or 8, batch normalization, and a rectifier.
//!
//! Nothing non-linear stands between the two convolutions of a branch, so they are one kernel of
//! 3x3x3 with its time steps spread by the dilation. Products of all branches and time steps are
//! taken at once, then added up with their shifts in time. In space the products are taken in
//! Winograd's transform, apart from the first block, whose three channels are too few for it.

use omnilife_networks::{
    Weights, WeightsError, matrix,
    winograd::{self, PATCH, POSITIONS, TILE},
};
use rayon::prelude::*;

use super::clip::Clip;

/// Dilations of the branches, frames.
const DILATIONS: [usize; 4] = [1, 2, 4, 8];
/// Taps of a convolution over time.
const TAPS: usize = 3;
/// Added to the variance by batch normalization.
const EPSILON: f64 = 1e-3;
/// Pixels (direct) and tiles (Winograd) that are worked on together: intermediate values stay in
/// the cache.
const PIXELS_TOGETHER: usize = 8;
const TILES_TOGETHER: usize = 2;

/// Spatial convolution of a block.
enum Kernel {
    /// Nine pixels of all channels times one matrix.
    Direct(Vec<f32>),
    /// One matrix for each position.
    Winograd(Vec<Vec<f32>>),
}

pub(super) struct Block {
    inputs: usize,
    /// Channels of one branch.
    filters: usize,
    kernel: Kernel,
    /// Shifts of batch normalization; its scales are in the kernel.
    bias: Vec<f32>,
}

impl Block {
    pub(super) fn load(
        weights: &Weights,
        name: &str,
        inputs: usize,
        filters: usize,
    ) -> Result<Self, WeightsError> {
        let outputs = DILATIONS.len() * filters;
        let normalization = |part: &str| weights.tensor(&format!("{name}.bn.{part}"), &[outputs]);
        let (mean, variance) = (
            normalization("running_mean")?,
            normalization("running_var")?,
        );
        let (gain, shift) = (normalization("weight")?, normalization("bias")?);
        let scale: Vec<f64> = gain
            .iter()
            .zip(&variance)
            .map(|(&gain, &variance)| f64::from(gain) / (f64::from(variance) + EPSILON).sqrt())
            .collect();
        let bias = (0..outputs)
            .map(|at| (f64::from(shift[at]) - f64::from(mean[at]) * scale[at]) as f32)
            .collect();

        let columns = outputs * TAPS;
        // Kernels of 3x3 in space by input and (tap, output).
        let mut kernels = vec![[0.0_f64; 9]; inputs * columns];
        for (branch, dilation) in DILATIONS.iter().enumerate() {
            let part = |layer: usize| format!("{name}.Conv3D_{dilation}.layers.{layer}.weight");
            let middle = 2 * filters;
            let space = weights.tensor(&part(0), &[middle, inputs, 1, 3, 3])?;
            let time = weights.tensor(&part(1), &[filters, middle, TAPS, 1, 1])?;
            for filter in 0..filters {
                let output = branch * filters + filter;
                for tap in 0..TAPS {
                    for between in 0..middle {
                        let factor = scale[output]
                            * f64::from(time[(filter * middle + between) * TAPS + tap]);
                        for input in 0..inputs {
                            let from = &space[(between * inputs + input) * 9..][..9];
                            let kernel = &mut kernels[input * columns + tap * outputs + output];
                            for (sum, &value) in kernel.iter_mut().zip(from) {
                                *sum += factor * f64::from(value);
                            }
                        }
                    }
                }
            }
        }
        let kernel = if inputs.is_multiple_of(8) {
            Kernel::winograd(&kernels)
        } else {
            Kernel::direct(&kernels, columns)
        };
        Ok(Self {
            inputs,
            filters,
            kernel,
            bias,
        })
    }

    fn outputs(&self) -> usize {
        DILATIONS.len() * self.filters
    }

    pub(super) fn apply(&self, input: &Clip) -> Clip {
        assert_eq!(input.channels, self.inputs, "channels of a block's input");
        let mut output = Clip::zeros(input.height, input.width, input.frames, self.outputs());
        let row_len = output.width * output.pixel_len();
        match &self.kernel {
            Kernel::Direct(matrix) => output
                .data
                .par_chunks_mut(PIXELS_TOGETHER * input.frames * self.outputs())
                .enumerate()
                .for_each(|(index, pixels)| {
                    self.direct(matrix, input, index * PIXELS_TOGETHER, pixels);
                }),
            Kernel::Winograd(matrices) => output
                .data
                .par_chunks_mut(TILE * row_len)
                .enumerate()
                .for_each(|(tile_row, rows)| self.winograd(matrices, input, tile_row, rows)),
        }
        output
    }

    /// Pixels from `first` on.
    fn direct(&self, matrix: &[f32], input: &Clip, first: usize, pixels: &mut [f32]) {
        let (frames, inputs) = (input.frames, self.inputs);
        let pixel_len = frames * self.outputs();
        let count = pixels.len() / pixel_len;
        let depth = 9 * inputs;
        let mut patches = vec![0.0; count * frames * depth];
        for (at, patch) in patches.chunks_exact_mut(frames * depth).enumerate() {
            let (y, x) = ((first + at) / input.width, (first + at) % input.width);
            for neighbour in 0..9 {
                let (dy, dx) = (neighbour / 3, neighbour % 3);
                let values = input.pixel((y + dy) as isize - 1, (x + dx) as isize - 1);
                let Some(values) = values else { continue };
                for (row, value) in patch
                    .chunks_exact_mut(depth)
                    .zip(values.chunks_exact(inputs))
                {
                    row[neighbour * inputs..][..inputs].copy_from_slice(value);
                }
            }
        }
        let columns = TAPS * self.outputs();
        let mut products = vec![0.0; count * frames * columns];
        matrix::multiply(
            &patches,
            matrix,
            &mut products,
            [count * frames, depth, columns],
        );
        for (pixel, products) in pixels
            .chunks_exact_mut(pixel_len)
            .zip(products.chunks_exact(frames * columns))
        {
            self.add_shifted(products, pixel);
            for values in pixel.chunks_exact_mut(self.outputs()) {
                for (value, bias) in values.iter_mut().zip(&self.bias) {
                    *value = (*value + bias).max(0.0);
                }
            }
        }
    }

    /// Convolves the row of tiles `tile_row`; `rows` are its pixel rows, four or the rest of the image.
    fn winograd(&self, matrices: &[Vec<f32>], input: &Clip, tile_row: usize, rows: &mut [f32]) {
        let frames = input.frames;
        let pixel_len = frames * self.outputs();
        let columns = TAPS * self.outputs();
        let input_len = input.pixel_len();
        let tiles = input.width.div_ceil(TILE);
        for first in (0..tiles).step_by(TILES_TOGETHER) {
            let count = TILES_TOGETHER.min(tiles - first);
            let mut patches = vec![0.0; POSITIONS * count * input_len];
            let mut by_tile: Vec<Vec<&mut [f32]>> = (0..count).map(|_| Vec::new()).collect();
            for position in patches.chunks_exact_mut(count * input_len) {
                for (tile, values) in position.chunks_exact_mut(input_len).enumerate() {
                    by_tile[tile].push(values);
                }
            }
            for (tile, positions) in by_tile.iter_mut().enumerate() {
                let patch: [Option<&[f32]>; POSITIONS] = std::array::from_fn(|at| {
                    input.pixel(
                        (tile_row * TILE + at / PATCH) as isize - 1,
                        ((first + tile) * TILE + at % PATCH) as isize - 1,
                    )
                });
                winograd::transform_patches(&patch, positions);
            }
            let mut products = vec![0.0; count * frames * columns];
            let mut sums = vec![0.0; POSITIONS * count * pixel_len];
            for (position, sums) in sums.chunks_exact_mut(count * pixel_len).enumerate() {
                let patches = &patches[position * count * input_len..][..count * input_len];
                matrix::multiply(
                    patches,
                    &matrices[position],
                    &mut products,
                    [count * frames, self.inputs, columns],
                );
                for (sums, products) in sums
                    .chunks_exact_mut(pixel_len)
                    .zip(products.chunks_exact(frames * columns))
                {
                    self.add_shifted(products, sums);
                }
            }
            for tile in 0..count {
                let positions: Vec<&[f32]> = (0..POSITIONS)
                    .map(|position| &sums[(position * count + tile) * pixel_len..][..pixel_len])
                    .collect();
                let mut pixels: Vec<Option<&mut [f32]>> = (0..TILE * TILE).map(|_| None).collect();
                let left = (first + tile) * TILE;
                for (y, row) in rows.chunks_exact_mut(input.width * pixel_len).enumerate() {
                    let row = row.chunks_exact_mut(pixel_len).skip(left).take(TILE);
                    for (x, pixel) in row.enumerate() {
                        pixels[y * TILE + x] = Some(pixel);
                    }
                }
                winograd::transform_products_rectified(&positions, &self.bias, &mut pixels);
            }
        }
    }

    /// Adds up the products of the taps at their distances in time; outside the window they are
    /// zero. A row of `products` holds (tap, branch, filter), one of `sums` (branch, filter).
    fn add_shifted(&self, products: &[f32], sums: &mut [f32]) {
        let (outputs, filters) = (self.outputs(), self.filters);
        let frames = sums.len() / outputs;
        for (frame, sum) in sums.chunks_exact_mut(outputs).enumerate() {
            for (branch, &dilation) in DILATIONS.iter().enumerate() {
                let sum = &mut sum[branch * filters..(branch + 1) * filters];
                let taps = [
                    frame.checked_sub(dilation),
                    Some(frame),
                    Some(frame + dilation).filter(|&later| later < frames),
                ];
                sum.fill(0.0);
                for (tap, source) in taps.into_iter().enumerate() {
                    let Some(source) = source else { continue };
                    let from = (source * TAPS + tap) * outputs + branch * filters;
                    for (sum, value) in sum.iter_mut().zip(&products[from..from + filters]) {
                        *sum += value;
                    }
                }
            }
        }
    }
}

impl Kernel {
    fn winograd(kernels: &[[f64; 9]]) -> Self {
        let mut matrices = vec![Vec::new(); POSITIONS];
        for &kernel in kernels {
            let transformed = winograd::transform_kernel(kernel);
            for (matrix, value) in matrices.iter_mut().zip(transformed) {
                matrix.push(value as f32);
            }
        }
        Self::Winograd(matrices)
    }

    /// Rows are (pixel of the 3x3, input), columns as they come.
    fn direct(kernels: &[[f64; 9]], columns: usize) -> Self {
        let mut matrix = Vec::with_capacity(9 * kernels.len());
        for pixel in 0..9 {
            for row in kernels.chunks_exact(columns) {
                matrix.extend(row.iter().map(|kernel| kernel[pixel] as f32));
            }
        }
        Self::Direct(matrix)
    }
}
