//! Blocks of MobileNetV2 (Sandler et al., "MobileNetV2: Inverted Residuals and Linear Bottlenecks", 2018),
//! with their normalizations folded in.
//!
//! An image is a matrix of pixels by channels, so that a 1x1 convolution is a matrix product.

use crate::Matrix;

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
    pub weights: Matrix,
    /// Offset of each channel.
    pub offsets: Vec<f32>,
    /// Activation afterwards.
    pub activation: Activation,
}

impl Pointwise {
    /// Applies it to every pixel separately.
    ///
    /// # Panics
    /// When the input has other channels.
    pub fn apply(&self, input: &Matrix) -> Matrix {
        let mut output = input.times(&self.weights);
        for pixel in output.data.chunks_exact_mut(self.offsets.len()) {
            for (value, offset) in pixel.iter_mut().zip(&self.offsets) {
                *value = self.activation.of(*value + offset);
            }
        }
        output
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

impl Depthwise {
    /// Applies it to `side * side` pixels; outside of the image is zero.
    ///
    /// # Panics
    /// When the input has fewer pixels.
    pub fn apply(&self, input: &Matrix, side: usize) -> Matrix {
        let channels = self.offsets.len();
        let out_side = side.div_ceil(self.stride);
        let mut output = Matrix::zeros(out_side * out_side, channels);
        for (at, pixel) in output.data.chunks_exact_mut(channels).enumerate() {
            pixel.copy_from_slice(&self.offsets);
            for (tap, weights) in self.taps.chunks_exact(channels).enumerate() {
                let place = |out: usize, step: usize| {
                    (out * self.stride + step * self.dilation)
                        .checked_sub(self.dilation)
                        .filter(|&place| place < side)
                };
                let (Some(y), Some(x)) =
                    (place(at / out_side, tap / 3), place(at % out_side, tap % 3))
                else {
                    continue;
                };
                let values = input.row(y * side + x);
                for ((sum, value), weight) in pixel.iter_mut().zip(values).zip(weights) {
                    *sum += value * weight;
                }
            }
            for value in pixel {
                *value = Activation::Relu6.of(*value);
            }
        }
        output
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

impl Block {
    /// Applies it to `side * side` pixels.
    ///
    /// # Panics
    /// When the input has other sizes.
    pub fn apply(&self, input: &Matrix, side: usize) -> Matrix {
        let filtered = match &self.expand {
            Some(expand) => self.filter.apply(&expand.apply(input), side),
            None => self.filter.apply(input, side),
        };
        let mut output = self.project.apply(&filtered);
        if self.is_residual {
            for (sum, value) in output.data.iter_mut().zip(&input.data) {
                *sum += value;
            }
        }
        output
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

    /// The definition, one loop per index.
    #[test]
    fn channels_are_filtered_as_plain_loops_do() {
        const CHANNELS: usize = 3;
        for (side, stride, dilation) in [(7, 1, 1), (8, 2, 1), (7, 2, 1), (9, 1, 2)] {
            let input = Matrix {
                rows: side * side,
                columns: CHANNELS,
                data: (0..side * side * CHANNELS).map(value).collect(),
            };
            let filter = Depthwise {
                taps: (0..9 * CHANNELS).map(|at| value(at + 5)).collect(),
                offsets: vec![0.5, -0.25, 1.0],
                stride,
                dilation,
            };
            let output = filter.apply(&input, side);
            let out_side = side.div_ceil(stride);
            assert_eq!(output.rows, out_side * out_side);
            for row in 0..out_side {
                for column in 0..out_side {
                    for channel in 0..CHANNELS {
                        let mut sum = f64::from(filter.offsets[channel]);
                        for tap in 0..9 {
                            let y =
                                (row * stride + tap / 3 * dilation) as isize - dilation as isize;
                            let x =
                                (column * stride + tap % 3 * dilation) as isize - dilation as isize;
                            let inside = 0..side as isize;
                            if inside.contains(&y) && inside.contains(&x) {
                                let at = y as usize * side + x as usize;
                                sum += f64::from(input.data[at * CHANNELS + channel])
                                    * f64::from(filter.taps[tap * CHANNELS + channel]);
                            }
                        }
                        let found = output.data[(row * out_side + column) * CHANNELS + channel];
                        assert!((f64::from(found) - sum.clamp(0.0, 6.0)).abs() < 1e-5);
                    }
                }
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
