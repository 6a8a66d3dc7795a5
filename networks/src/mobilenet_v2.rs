//! Blocks of MobileNetV2 (Sandler et al., "MobileNetV2: Inverted Residuals and Linear Bottlenecks", 2018),
//! with their normalizations folded in.
//!
//! An image is a matrix of pixels by channels, so that a 1x1 convolution is a matrix product.

use fearless_simd::{Level, Simd, dispatch, f32x16, prelude::*};

use crate::{LeftFactor, Matrix, PackedMatrix};

/// Activation after a sum.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activation {
    /// Identity.
    None,
    /// Negative values become zero.
    Relu,
    /// Clamped to [0, 6].
    Relu6,
}

impl Activation {
    #[inline(always)]
    fn of(self, value: f32) -> f32 {
        match self {
            Self::None => value,
            Self::Relu => value.max(0.0),
            Self::Relu6 => value.clamp(0.0, 6.0),
        }
    }
}

/// A 1x1 convolution; or one of [`windows`] that are laid out beforehand.
#[derive(Debug)]
pub struct Pointwise {
    /// Channels in by channels out.
    weights: PackedMatrix,
    offsets: Vec<f32>,
    activation: Activation,
}

impl Pointwise {
    /// Creates a convolution from its weights, rows of channels in by columns of channels out, and the offset of each
    /// channel out.
    ///
    /// # Panics
    /// When the weights do not fill whole rows.
    pub fn new(weights: &[f32], offsets: Vec<f32>, activation: Activation) -> Self {
        Self {
            weights: PackedMatrix::new(weights, offsets.len()),
            offsets,
            activation,
        }
    }

    /// Applies it to every pixel separately.
    ///
    /// # Panics
    /// When the input has other channels.
    pub fn apply(&self, input: &Matrix) -> Matrix {
        self.apply_with_offsets(input, &self.offsets)
    }

    /// Applies it with other offsets of the channels out.
    ///
    /// # Panics
    /// When the input or the offsets have other channels.
    pub fn apply_with_offsets(&self, input: &Matrix, offsets: &[f32]) -> Matrix {
        let mut output = Matrix::zeros(input.rows, self.offsets.len());
        self.apply_into(&input.data, input.columns, offsets, &mut output.data);
        output
    }

    fn apply_into(&self, input: &[f32], channels: usize, offsets: &[f32], output: &mut [f32]) {
        assert_eq!(offsets.len(), self.offsets.len(), "offsets");
        let input = LeftFactor::row_major(input, channels);
        self.weights.multiply_into(&input, output);
        dispatch!(Level::new(), simd => self.activate(simd, offsets, output));
    }

    /// Adds the offsets and activates. The instruction set affects the speed alone.
    #[inline(always)]
    fn activate<S: Simd>(&self, _: S, offsets: &[f32], output: &mut [f32]) {
        for pixel in output.chunks_exact_mut(offsets.len()) {
            for (value, offset) in pixel.iter_mut().zip(offsets) {
                *value = self.activation.of(*value + offset);
            }
        }
    }
}

/// A 3x3 convolution of every channel separately, clamped to [0, 6].
#[derive(Debug)]
pub struct Depthwise {
    /// Nine taps by channels.
    pub taps: Vec<f32>,
    /// Offset of each channel.
    pub offsets: Vec<f32>,
    /// Pixels from one output to the next.
    pub stride: usize,
    /// Pixels from one tap to the next.
    pub dilation: usize,
}

/// Channels filtered at once.
const LANES: usize = 16;

impl Depthwise {
    /// Returns the place that a tap (0, 1 or 2 along an axis) of an output reads; `None` outside of the image.
    #[inline(always)]
    fn place(&self, out: usize, tap: usize, side: usize) -> Option<usize> {
        (out * self.stride + tap * self.dilation)
            .checked_sub(self.dilation)
            .filter(|&place| place < side)
    }

    /// Filters one row of outputs. `rows` are the rows of `side` pixels that the taps of a column read; outside of the
    /// image is zero.
    #[inline(always)]
    fn filter_row<S: Simd>(
        &self,
        simd: S,
        rows: [Option<&[f32]>; 3],
        side: usize,
        output: &mut [f32],
    ) {
        let channels = self.offsets.len();
        for (x, pixel) in output.chunks_exact_mut(channels).enumerate() {
            let mut taps: [(&[f32], &[f32]); 9] = [(&[], &[]); 9];
            let mut count = 0;
            for tap in 0..9 {
                let column = self.place(x, tap % 3, side);
                if let (Some(row), Some(column)) = (rows[tap / 3], column) {
                    taps[count] = (
                        &row[column * channels..][..channels],
                        &self.taps[tap * channels..][..channels],
                    );
                    count += 1;
                }
            }
            let taps = &taps[..count];
            let whole = channels / LANES * LANES;
            for first in (0..whole).step_by(LANES) {
                let at = |values: &[f32]| f32x16::from_slice(simd, &values[first..first + LANES]);
                let mut sum = at(&self.offsets);
                for (values, weights) in taps {
                    sum = at(values).mul_add(at(weights), sum);
                }
                let clamped = sum.max(0.0).min(6.0);
                clamped.store_slice(&mut pixel[first..first + LANES]);
            }
            for channel in whole..channels {
                let sum = taps
                    .iter()
                    .fold(self.offsets[channel], |sum, (values, weights)| {
                        values[channel].mul_add(weights[channel], sum)
                    });
                pixel[channel] = Activation::Relu6.of(sum);
            }
        }
    }
}

/// Sizes of an inverted residual: expanded six times, filtered per channel, projected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BlockShape {
    /// Input and output channels.
    pub channels: [usize; 2],
    /// True if channels are expanded before they are filtered; false for the first block.
    pub expands: bool,
    /// Pixels from one output to the next.
    pub stride: usize,
    /// Pixels from one tap to the next.
    pub dilation: usize,
}

impl BlockShape {
    /// Returns the shape of a block that expands.
    pub const fn new(channels: [usize; 2], stride: usize, dilation: usize) -> Self {
        Self {
            channels,
            expands: true,
            stride,
            dilation,
        }
    }

    /// Returns true if the input is added to the output.
    pub fn is_residual(&self) -> bool {
        self.stride == 1 && self.channels[0] == self.channels[1]
    }

    /// Returns the number of filtered channels.
    pub fn inner(&self) -> usize {
        self.channels[0] * if self.expands { 6 } else { 1 }
    }
}

/// An inverted residual.
#[derive(Debug)]
pub struct Block {
    /// Expansion; `None` for the first block.
    pub expand: Option<Pointwise>,
    /// Filter of every channel separately.
    pub filter: Depthwise,
    /// Projection.
    pub project: Pointwise,
    /// True if the input is added to the output.
    pub is_residual: bool,
}

/// Rows of outputs that a block computes together: what is expanded for them stays in the cache.
const STRIP: usize = 8;

impl Block {
    /// Applies it to `side * side` pixels.
    ///
    /// # Panics
    /// When the input has other sizes.
    pub fn apply(&self, input: &Matrix, side: usize) -> Matrix {
        assert_eq!(input.rows, side * side, "pixels of a block");
        let (filter, channels) = (&self.filter, self.filter.offsets.len());
        let (out_side, out_channels) = (side.div_ceil(filter.stride), self.project.offsets.len());
        let mut expanded = self.expand.as_ref().map(|expand| ExpandedRows {
            expand,
            input,
            side,
            row_count: STRIP * filter.stride + 2 * filter.dilation,
            rows: Vec::new(),
            done: 0,
        });
        let mut output = Matrix::zeros(out_side * out_side, out_channels);
        let mut filtered = vec![0.0; STRIP * out_side * channels];
        let strips = output.data.chunks_mut(STRIP * out_side * out_channels);
        for (index, strip) in strips.enumerate() {
            let first = index * STRIP;
            let filtered = &mut filtered[..strip.len() / out_channels * channels];
            let last = first + filtered.len() / (out_side * channels) - 1;
            if let Some(expanded) = &mut expanded {
                expanded.go_on_to((last * filter.stride + filter.dilation + 1).min(side));
            }
            let row_at = |row: usize| match &expanded {
                Some(expanded) => expanded.row(row),
                None => &input.data[row * side * channels..][..side * channels],
            };
            let rows = filtered.chunks_exact_mut(out_side * channels);
            for (row, filtered) in rows.enumerate() {
                let read = [0, 1, 2].map(|tap| filter.place(first + row, tap, side).map(row_at));
                dispatch!(Level::new(), simd => filter.filter_row(simd, read, side, filtered));
            }
            self.project
                .apply_into(filtered, channels, &self.project.offsets, strip);
        }
        if self.is_residual {
            for (sum, value) in output.data.iter_mut().zip(&input.data) {
                *sum += value;
            }
        }
        output
    }
}

/// Expanded rows of an image, the last few of those that were asked for.
struct ExpandedRows<'a> {
    expand: &'a Pointwise,
    input: &'a Matrix,
    side: usize,
    /// Rows that are kept.
    row_count: usize,
    /// Row `y` at `y % row_count`.
    rows: Vec<f32>,
    /// Rows expanded so far.
    done: usize,
}

impl ExpandedRows<'_> {
    fn row_len(&self) -> usize {
        self.side * self.expand.offsets.len()
    }

    /// Expands the rows up to `end`.
    fn go_on_to(&mut self, end: usize) {
        let (row_len, input_len) = (self.row_len(), self.side * self.input.columns);
        self.rows.resize(self.row_count * row_len, 0.0);
        while self.done < end {
            let place = self.done % self.row_count;
            let count = (end - self.done).min(self.row_count - place);
            self.expand.apply_into(
                &self.input.data[self.done * input_len..][..count * input_len],
                self.input.columns,
                &self.expand.offsets,
                &mut self.rows[place * row_len..][..count * row_len],
            );
            self.done += count;
        }
    }

    /// Returns row `y`.
    fn row(&self, y: usize) -> &[f32] {
        &self.rows[y % self.row_count * self.row_len()..][..self.row_len()]
    }
}

/// Returns the 3x3 windows of every other pixel of an image of `side * side` pixels, 27 values each; outside is zero.
pub fn windows(side: usize, pixel: impl Fn(usize) -> [f32; 3]) -> Matrix {
    let out_side = side.div_ceil(2);
    let mut windows = Matrix::zeros(out_side * out_side, 27);
    for (at, window) in windows.data.chunks_exact_mut(27).enumerate() {
        for (tap, values) in window.chunks_exact_mut(3).enumerate() {
            let place = |out: usize, step: usize| {
                (2 * out + step)
                    .checked_sub(1)
                    .filter(|&place| place < side)
            };
            let (y, x) = (at / out_side, at % out_side);
            if let (Some(y), Some(x)) = (place(y, tap / 3), place(x, tap % 3)) {
                values.copy_from_slice(&pixel(y * side + x));
            }
        }
    }
    windows
}

/// Returns the mean over all pixels.
pub fn mean(input: &Matrix) -> Matrix {
    let shares = Matrix {
        rows: 1,
        columns: input.rows,
        data: vec![1.0 / input.rows as f32; input.rows],
    };
    shares.times(input)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(at: usize) -> f32 {
        ((at * 37 + 11) % 101) as f32 / 50.0 - 1.0
    }

    fn values(count: usize, begin: usize) -> Vec<f32> {
        (begin..begin + count).map(value).collect()
    }

    /// The definition, one loop per index.
    fn plain(block: &Block, weights: [&[f32]; 2], input: &Matrix, side: usize) -> Vec<f64> {
        let [expanding, projecting] = weights;
        let (from, inner) = (input.columns, block.filter.offsets.len());
        let to = block.project.offsets.len();
        let expanded = |pixel: usize, channel: usize| match &block.expand {
            None => f64::from(input.data[pixel * from + channel]),
            Some(expand) => {
                let product = |at: usize| {
                    f64::from(input.data[pixel * from + at])
                        * f64::from(expanding[at * inner + channel])
                };
                let sum: f64 = (0..from).map(product).sum();
                (sum + f64::from(expand.offsets[channel])).clamp(0.0, 6.0)
            }
        };
        let filter = &block.filter;
        let filtered = |row: usize, column: usize, channel: usize| {
            let mut sum = f64::from(filter.offsets[channel]);
            for tap in 0..9 {
                let [y, x] = [(row, tap / 3), (column, tap % 3)].map(|(at, tap)| {
                    (at * filter.stride + tap * filter.dilation) as isize - filter.dilation as isize
                });
                let inside = 0..side as isize;
                if inside.contains(&y) && inside.contains(&x) {
                    sum += expanded(y as usize * side + x as usize, channel)
                        * f64::from(filter.taps[tap * inner + channel]);
                }
            }
            sum.clamp(0.0, 6.0)
        };
        let out_side = side.div_ceil(filter.stride);
        let mut output = Vec::new();
        for pixel in 0..out_side * out_side {
            let inner_values: Vec<f64> = (0..inner)
                .map(|channel| filtered(pixel / out_side, pixel % out_side, channel))
                .collect();
            for channel in 0..to {
                let products = inner_values.iter().enumerate();
                let sum: f64 = products
                    .map(|(at, value)| value * f64::from(projecting[at * to + channel]))
                    .sum();
                let residual = match block.is_residual {
                    true => f64::from(input.data[pixel * from + channel]),
                    false => 0.0,
                };
                output.push(sum + f64::from(block.project.offsets[channel]) + residual);
            }
        }
        output
    }

    /// Sizes of one strip and of several, with channels that fill vectors and some that do not.
    #[test]
    fn blocks_are_what_plain_loops_compute() {
        for (side, [from, inner, to], stride, dilation, expands) in [
            (7, [3, 3, 5], 1, 1, false),
            (8, [3, 20, 3], 2, 1, true),
            (23, [4, 19, 4], 1, 1, true),
            (21, [4, 16, 6], 2, 1, true),
            (27, [4, 35, 4], 1, 4, true),
        ] {
            let (expanding, projecting) = (values(from * inner, 3), values(inner * to, 8));
            let block = Block {
                expand: expands
                    .then(|| Pointwise::new(&expanding, values(inner, 40), Activation::Relu6)),
                filter: Depthwise {
                    taps: values(9 * inner, 5),
                    offsets: values(inner, 60),
                    stride,
                    dilation,
                },
                project: Pointwise::new(&projecting, values(to, 2), Activation::None),
                is_residual: stride == 1 && from == to,
            };
            let input = Matrix {
                rows: side * side,
                columns: from,
                data: values(side * side * from, 0),
            };
            let output = block.apply(&input, side);
            let expected = plain(&block, [&expanding, &projecting], &input, side);
            assert_eq!(output.data.len(), expected.len());
            for (found, expected) in output.data.iter().zip(expected) {
                let error = (f64::from(*found) - expected).abs();
                assert!(error < 1e-4, "{side} {inner}: {found} for {expected}");
            }
        }
    }

    #[test]
    fn windows_hold_the_neighbours_of_every_other_pixel() {
        let windows = windows(4, |at| [at as f32 + 1.0; 3]);
        assert_eq!((windows.rows, windows.columns), (4, 27));
        let first: Vec<f32> = windows.row(0).iter().copied().step_by(3).collect();
        assert_eq!(first, [0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 0.0, 5.0, 6.0]);
        let last: Vec<f32> = windows.row(3).iter().copied().step_by(3).collect();
        assert_eq!(last, [6.0, 7.0, 8.0, 10.0, 11.0, 12.0, 14.0, 15.0, 16.0]);
        assert!((mean(&windows).data[12] - (1.0 + 3.0 + 9.0 + 11.0) / 4.0).abs() < 1e-6);
    }
}
