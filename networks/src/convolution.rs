//! Convolutions of images, followed by a bias and a rectifier.
//!
//! 3x3 kernels of stride one go through Winograd's transform, everything else (and inputs of a few
//! channels, such as colours) through products of patches with one matrix.

use std::borrow::Cow;

use rayon::prelude::*;

use crate::{
    Features, LeftFactor, PackedMatrix, Weights, WeightsError,
    winograd::{self, PATCH, POSITIONS, TILE},
};

/// Sizes of a convolution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Kernel {
    /// Rows and columns of the kernel.
    pub side: usize,
    /// Pixels from one output to the next.
    pub stride: usize,
    /// Rows and columns of zeros around the image.
    pub padding: usize,
    /// Channels of the input.
    pub inputs: usize,
    /// Channels of the output.
    pub outputs: usize,
}

/// A convolution with a bias and a rectifier.
#[derive(Debug)]
pub struct Convolution {
    kernel: Kernel,
    bias: Vec<f32>,
    matrices: Matrices,
}

#[derive(Debug)]
enum Matrices {
    /// Rows are (row, column, input) of the kernel, columns the outputs.
    Direct(PackedMatrix),
    /// One matrix of inputs by outputs for each position of Winograd's transform.
    Winograd(Vec<PackedMatrix>),
}

/// Channels come in eights for Winograd's transform.
const LANES: usize = 8;

impl Convolution {
    /// Reads `<name>.kernel` (row, column, input, output) and `<name>.bias`.
    ///
    /// # Errors
    /// When the weights hold no such tensors.
    pub fn load(weights: &Weights, name: &str, kernel: Kernel) -> Result<Self, WeightsError> {
        let Kernel {
            side,
            inputs,
            outputs,
            ..
        } = kernel;
        let shape = [side, side, inputs, outputs];
        Ok(Self::new(
            kernel,
            weights.tensor(&format!("{name}.kernel"), &shape)?,
            weights.tensor(&format!("{name}.bias"), &[outputs])?,
        ))
    }

    /// Creates a convolution from values in the order (row, column, input, output).
    ///
    /// # Panics
    /// When the number of values does not fit the sizes.
    pub fn new(kernel: Kernel, values: Vec<f32>, bias: Vec<f32>) -> Self {
        let Kernel {
            side,
            inputs,
            outputs,
            ..
        } = kernel;
        assert_eq!(values.len(), side * side * inputs * outputs, "kernel");
        assert_eq!(bias.len(), outputs, "bias");
        let is_winograd = (side, kernel.stride, kernel.padding) == (3, 1, 1)
            && inputs.is_multiple_of(LANES)
            && outputs.is_multiple_of(LANES);
        Self {
            kernel,
            bias,
            matrices: if is_winograd {
                Matrices::Winograd(winograd_matrices(&values, [inputs, outputs]))
            } else {
                Matrices::Direct(PackedMatrix::new(&values, outputs))
            },
        }
    }

    /// Returns the convolution of all images; negative values become zero.
    ///
    /// # Panics
    /// When the images have other channels, or are smaller than the kernel with its padding.
    pub fn apply_rectified(&self, input: &Features) -> Features {
        let mut output = Features::zeros(0, 0, 0, 0);
        self.apply_rectified_into(input, &mut output);
        output
    }

    /// Writes the result into existing images, whose content is overwritten: their memory is reused.
    ///
    /// # Panics
    /// Those of [`Self::apply_rectified`].
    pub fn apply_rectified_into(&self, input: &Features, output: &mut Features) {
        assert_eq!(input.channels, self.kernel.inputs, "channels of the input");
        let Kernel {
            side,
            stride,
            padding,
            outputs,
            ..
        } = self.kernel;
        let length = |length: usize| (length + 2 * padding - side) / stride + 1;
        let (height, width) = (length(input.height), length(input.width));
        output.reshape(input.images, height, width, outputs);
        match &self.matrices {
            Matrices::Direct(matrix) => self.direct(matrix, input, output),
            Matrices::Winograd(matrices) => self.winograd(matrices, input, output),
        }
    }

    /// Computes every row of outputs as a product: the patches of its pixels lie in their input rows, one pixel from
    /// the next.
    fn direct(&self, matrix: &PackedMatrix, input: &Features, output: &mut Features) {
        let Kernel {
            side,
            stride,
            padding,
            inputs,
            outputs,
        } = self.kernel;
        let padded = with_border(input, padding);
        let (height, row_len, padded_row_len) = (output.height, output.row_len(), padded.row_len());
        if row_len == 0 {
            return;
        }
        output
            .data
            .par_chunks_exact_mut(row_len)
            .enumerate()
            .for_each(|(index, row)| {
                let (image, y) = (index / height, index % height);
                let patches = LeftFactor {
                    values: &padded.image(image)[y * stride * padded_row_len..],
                    row_spacing: stride * inputs,
                    segments: side,
                    segment_len: side * inputs,
                    segment_spacing: padded_row_len,
                };
                matrix.multiply_into(&patches, row);
                for pixel in row.chunks_exact_mut(outputs) {
                    for (value, bias) in pixel.iter_mut().zip(&self.bias) {
                        *value = (*value + bias).max(0.0);
                    }
                }
            });
    }

    fn winograd(&self, matrices: &[PackedMatrix], input: &Features, output: &mut Features) {
        let (height, width, row_len) = (output.height, output.width, output.row_len());
        if height * row_len == 0 {
            return;
        }
        let columns = width.div_ceil(TILE);
        let mut rows: Vec<TileRow<'_>> = Vec::new();
        for (image, values) in output.data.chunks_exact_mut(height * row_len).enumerate() {
            let tile_rows = values.chunks_mut(TILE * row_len).enumerate();
            rows.extend(tile_rows.map(|(index, values)| TileRow {
                image,
                top: index * TILE,
                lines: values.chunks_exact_mut(row_len).collect(),
            }));
        }
        let together = tiles_together(self.kernel);
        rows.par_chunks_mut(together.div_ceil(columns))
            .for_each_init(Buffers::default, |buffers, rows| {
                let tiles = rows.len() * columns;
                for first in (0..tiles).step_by(together) {
                    let tiles = first..tiles.min(first + together);
                    self.winograd_tiles(matrices, input, rows, tiles, buffers);
                }
            });
    }

    /// Computes the tiles `tiles`, counted along the rows of tiles.
    fn winograd_tiles(
        &self,
        matrices: &[PackedMatrix],
        input: &Features,
        rows: &mut [TileRow<'_>],
        tiles: std::ops::Range<usize>,
        buffers: &mut Buffers,
    ) {
        let Kernel {
            inputs, outputs, ..
        } = self.kernel;
        let columns = input.width.div_ceil(TILE);
        let count = tiles.len();
        let Buffers {
            patches,
            products,
            border,
        } = buffers;
        let patches_spacing = count * inputs + SET_SHIFT;
        let products_spacing = count * outputs + SET_SHIFT;
        patches.resize(POSITIONS * patches_spacing, 0.0);
        products.resize(POSITIONS * products_spacing, 0.0);
        for (at, tile) in tiles.clone().enumerate() {
            let row = &rows[tile / columns];
            let transformed = &mut patches[at * inputs..];
            let (top, left) = (row.top, tile % columns * TILE);
            match inside(input, row.image, top, left) {
                Some(values) => {
                    let layout = [input.row_len(), inputs];
                    winograd::transform_patch(values, layout, transformed, patches_spacing);
                }
                None => {
                    border.resize(POSITIONS * inputs, 0.0);
                    for (dy, values) in border.chunks_exact_mut(PATCH * inputs).enumerate() {
                        let (row_of, left) = ((top + dy) as isize - 1, left as isize - 1);
                        input.copy_row(row.image, row_of, left, values);
                    }
                    let layout = [PATCH * inputs, inputs];
                    winograd::transform_patch(border, layout, transformed, patches_spacing);
                }
            }
        }
        for ((patches, products), matrix) in patches
            .chunks_exact(patches_spacing)
            .zip(products.chunks_exact_mut(products_spacing))
            .zip(matrices)
        {
            let patches = LeftFactor::row_major(&patches[..count * inputs], inputs);
            matrix.multiply_into(&patches, &mut products[..count * outputs]);
        }
        for (at, tile) in tiles.enumerate() {
            let lines = &mut rows[tile / columns].lines;
            let left = tile % columns * TILE * outputs;
            let products = &products[at * outputs..];
            winograd::transform_tile_rectified(products, products_spacing, &self.bias, lines, left);
        }
    }
}

/// Returns values from the first pixel of the patch around the tile at `top` and `left`; `None` if the patch leaves the
/// image.
fn inside(input: &Features, image: usize, top: usize, left: usize) -> Option<&[f32]> {
    let (top, left) = (top.checked_sub(1)?, left.checked_sub(1)?);
    let is_inside = top + PATCH <= input.height && left + PATCH <= input.width;
    is_inside.then(|| &input.image(image)[top * input.row_len() + left * input.channels..])
}

/// Offset between positions, in values: with a power of two between them, all would compete for the same places in the
/// cache.
const SET_SHIFT: usize = 16;

/// Rows of outputs of one row of tiles.
struct TileRow<'a> {
    image: usize,
    /// The first of the rows.
    top: usize,
    /// Four rows, or the rest of the image.
    lines: Vec<&'a mut [f32]>,
}

/// Transformed values of the tiles of one batch, by position.
#[derive(Default)]
struct Buffers {
    patches: Vec<f32>,
    products: Vec<f32>,
    /// A patch that leaves the image, with the zeros around it.
    border: Vec<f32>,
}

/// Returns few enough tiles for the cache, and enough to amortize fetching the matrices.
fn tiles_together(kernel: Kernel) -> usize {
    (kernel.inputs / 2).clamp(64, 192)
}

/// Images with so many pixels of zeros around them.
fn with_border(input: &Features, padding: usize) -> Cow<'_, Features> {
    if padding == 0 {
        return Cow::Borrowed(input);
    }
    let [height, width] = [input.height, input.width].map(|length| length + 2 * padding);
    let mut padded = Features::zeros(input.images, height, width, input.channels);
    let row_len = padded.row_len();
    for (index, row) in padded.data.chunks_exact_mut(row_len).enumerate() {
        let (image, y) = (index / height, (index % height) as isize);
        let padding = padding as isize;
        input.copy_row(image, y - padding, -padding, row);
    }
    Cow::Owned(padded)
}

fn winograd_matrices(values: &[f32], [inputs, outputs]: [usize; 2]) -> Vec<PackedMatrix> {
    let pairs = inputs * outputs;
    let transformed: Vec<[f64; POSITIONS]> = (0..pairs)
        .into_par_iter()
        .map(|pair| {
            let kernel = std::array::from_fn(|at| f64::from(values[at * pairs + pair]));
            winograd::transform_kernel(kernel)
        })
        .collect();
    (0..POSITIONS)
        .into_par_iter()
        .map(|position| {
            let values = transformed.iter();
            let values: Vec<f32> = values.map(|kernel| kernel[position] as f32).collect();
            PackedMatrix::new(&values, outputs)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(at: usize) -> f32 {
        ((at * 37 + 11) % 101) as f32 / 50.0 - 1.0
    }

    fn features(images: usize, height: usize, width: usize, channels: usize) -> Features {
        let mut features = Features::zeros(images, height, width, channels);
        for (at, entry) in features.data.iter_mut().enumerate() {
            *entry = value(at);
        }
        features
    }

    /// Evaluates the definition, one loop per index, in f64.
    fn direct(kernel: Kernel, values: &[f32], bias: &[f32], input: &Features) -> Vec<f64> {
        let Kernel {
            side,
            stride,
            padding,
            inputs,
            outputs,
        } = kernel;
        let length = |length: usize| (length + 2 * padding - side) / stride + 1;
        let mut expected = Vec::new();
        for image in 0..input.images {
            for y in 0..length(input.height) {
                for x in 0..length(input.width) {
                    for (output, &bias) in bias.iter().enumerate() {
                        let mut sum = f64::from(bias);
                        for (dy, dx) in (0..side * side).map(|at| (at / side, at % side)) {
                            let (row, column) = (y * stride + dy, x * stride + dx);
                            let pixel = input.pixel(
                                image,
                                row as isize - padding as isize,
                                column as isize - padding as isize,
                            );
                            for (channel, &entry) in pixel.into_iter().flatten().enumerate() {
                                let at = ((dy * side + dx) * inputs + channel) * outputs + output;
                                sum += f64::from(entry) * f64::from(values[at]);
                            }
                        }
                        expected.push(sum.max(0.0));
                    }
                }
            }
        }
        expected
    }

    /// Both algorithms, strides, paddings, odd sizes, images of less than a tile.
    #[test]
    fn convolutions_are_what_plain_loops_give() {
        let kernel = |side, stride, padding, inputs, outputs| Kernel {
            side,
            stride,
            padding,
            inputs,
            outputs,
        };
        for (kernel, [images, height, width]) in [
            (kernel(3, 1, 1, 8, 16), [2, 9, 14]),
            (kernel(3, 1, 1, 16, 8), [1, 2, 3]),
            (kernel(3, 1, 1, 24, 8), [1, 70, 40]),
            (kernel(3, 1, 1, 3, 8), [2, 7, 5]),
            (kernel(11, 4, 2, 3, 8), [2, 31, 40]),
            (kernel(5, 1, 2, 8, 4), [1, 6, 9]),
        ] {
            let count = kernel.side * kernel.side * kernel.inputs * kernel.outputs;
            let values: Vec<f32> = (0..count).map(|at| value(3 * at + 5)).collect();
            let bias: Vec<f32> = (0..kernel.outputs).map(|at| value(at + 700)).collect();
            let input = features(images, height, width, kernel.inputs);
            let expected = direct(kernel, &values, &bias, &input);
            let found = Convolution::new(kernel, values, bias).apply_rectified(&input);
            assert_eq!(found.data.len(), expected.len());
            for (found, expected) in found.data.iter().zip(expected) {
                let tolerance = 1e-4 * (1.0 + expected);
                assert!(
                    (f64::from(*found) - expected).abs() < tolerance,
                    "{kernel:?}: {found}, expected {expected}"
                );
            }
        }
    }
}
