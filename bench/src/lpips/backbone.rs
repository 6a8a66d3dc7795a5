//! The two backbones of LPIPS, up to the last of its five stages.

use omnilife_networks::{Convolution, Kernel, Weights, WeightsError};

/// A network whose features are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Backbone {
    /// `AlexNet` (Krizhevsky 2014, "One weird trick", torchvision's `alexnet`).
    Alex,
    /// VGG of 16 layers (Simonyan and Zisserman 2015, torchvision's `vgg16`).
    Vgg,
}

/// Convolutions after which features are compared.
#[derive(Debug)]
pub(super) struct Stage {
    pub(super) convolutions: Vec<Convolution>,
    /// Weights of the channels' squared differences.
    pub(super) linear: Vec<f32>,
    keeps_size: bool,
}

impl Stage {
    /// Returns true if all convolutions are 3x3 with a pixel of padding, so that a row of output depends on as many
    /// rows above and below as there are convolutions.
    pub(super) fn keeps_size(&self) -> bool {
        self.keeps_size
    }
}

/// Side, stride and padding.
type Geometry = [usize; 3];

/// 3x3 with a pixel of padding.
const THREE: Geometry = [3, 1, 1];

/// Geometries and channels of the convolutions of every stage.
const ALEX: [&[(Geometry, usize)]; 5] = [
    &[([11, 4, 2], 64)],
    &[([5, 1, 2], 192)],
    &[(THREE, 384)],
    &[(THREE, 256)],
    &[(THREE, 256)],
];
const VGG: [&[(Geometry, usize)]; 5] = [
    &[(THREE, 64); 2],
    &[(THREE, 128); 2],
    &[(THREE, 256); 3],
    &[(THREE, 512); 3],
    &[(THREE, 512); 3],
];

impl Backbone {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Alex, Self::Vgg];

    /// Returns the name of the weights; `scripts/setup --models` knows it too.
    pub fn weights(self) -> &'static str {
        match self {
            Self::Alex => "lpips-alex",
            Self::Vgg => "lpips-vgg",
        }
    }

    /// Returns the SHA-256 of the converted weights.
    pub(crate) fn weights_sha256(self) -> &'static str {
        match self {
            Self::Alex => "81f8da78ffa7638f7b2b46a791d52fc3cf68d88e0b618efd70b963a773970ebb",
            Self::Vgg => "58611dc96c9956a84638e2ff95cc56ac97287acc7d87525d42f8616b038f4709",
        }
    }

    /// Returns the published weights, as `scripts/setup --models` leaves them.
    ///
    /// # Errors
    /// When they are missing or differ from the published ones.
    pub fn published_weights(self) -> Result<Weights, WeightsError> {
        Weights::load_published(self.weights(), self.weights_sha256())
    }

    /// Returns the least rows and columns for which every stage has a pixel.
    pub fn smallest_side(self) -> usize {
        match self {
            Self::Alex => 31,
            Self::Vgg => 16,
        }
    }

    /// Returns side and stride of the pooling before a stage, counted from 0; `None` without pooling.
    pub(super) fn pooling(self, stage: usize) -> Option<[usize; 2]> {
        match self {
            Self::Alex => [1, 2].contains(&stage).then_some([3, 2]),
            Self::Vgg => (1..5).contains(&stage).then_some([2, 2]),
        }
    }

    pub(super) fn stages(self, weights: &Weights) -> Result<Vec<Stage>, WeightsError> {
        let layers = match self {
            Self::Alex => ALEX,
            Self::Vgg => VGG,
        };
        let mut inputs = 3;
        let mut layer = 0;
        let mut stages = Vec::new();
        for (index, layers) in layers.into_iter().enumerate() {
            let mut convolutions = Vec::new();
            for &([side, stride, padding], outputs) in layers {
                let kernel = Kernel {
                    side,
                    stride,
                    padding,
                    inputs,
                    outputs,
                };
                let name = format!("convolution.{layer}");
                convolutions.push(Convolution::load(weights, &name, kernel)?);
                (inputs, layer) = (outputs, layer + 1);
            }
            stages.push(Stage {
                convolutions,
                linear: weights.tensor(&format!("linear.{index}.weight"), &[inputs])?,
                keeps_size: layers.iter().all(|&(geometry, _)| geometry == THREE),
            });
        }
        Ok(stages)
    }
}
