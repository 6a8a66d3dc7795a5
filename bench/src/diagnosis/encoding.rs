//! Encodings of values that are mistaken for sRGB in the full range of bytes.

use std::fmt;

use omnilife_schemas::srgb;

/// An encoding of values other than sRGB in the full range of bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    /// Linear light, without the transfer function of sRGB.
    Linear,
    /// The transfer function of sRGB applied twice.
    SrgbTwice,
    /// Raised to the power of 2.2.
    Gamma,
    /// Raised to the power of 1 / 2.2.
    InverseGamma,
    /// Limited range, 16 to 235.
    LimitedRange,
    /// Expanded from 16 to 235 though they were in the full range.
    ExpandedTwice,
    /// Half as bright.
    Halved,
    /// Twice as bright.
    Doubled,
    /// x / 2 + 1 / 2, as if they had been in [-1, 1].
    Raised,
    /// 2 x - 1: in [-1, 1], cut at 0.
    Signed,
    /// 1 - x.
    Inverted,
    /// Less the mean of `ImageNet`, by its deviation, cut at 0 and 1.
    ImageNet,
}

impl fmt::Display for Encoding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Linear => "linear light; apply the transfer function of sRGB before writing",
            Self::SrgbTwice => {
                "under the transfer function of sRGB twice; images as decoded are sRGB already"
            }
            Self::Gamma => "to the power of 2.2; write them as sRGB",
            Self::InverseGamma => {
                "to the power of 1 / 2.2; images as decoded are sRGB already, apply no gamma"
            }
            Self::LimitedRange => "in the limited range 16 to 235; write them in 0 to 255",
            Self::ExpandedTwice => {
                "expanded from the range 16 to 235 though they were in 0 to 255; write them as they are"
            }
            Self::Halved => "half as bright; write 255 times a value in [0, 1]",
            Self::Doubled => "twice as bright; write 255 times a value in [0, 1]",
            Self::Raised => {
                "x / 2 + 1 / 2 of the right ones; they are in [0, 1] already and not in [-1, 1]"
            }
            Self::Signed => "in [-1, 1] and cut at 0; write x / 2 + 1 / 2",
            Self::Inverted => "inverted; write x instead of 1 - x",
            Self::ImageNet => {
                "normalized by mean and deviation of ImageNet and cut; undo that before writing"
            }
        })
    }
}

impl Encoding {
    pub(super) const ALL: [Self; 12] = [
        Self::Linear,
        Self::SrgbTwice,
        Self::Gamma,
        Self::InverseGamma,
        Self::LimitedRange,
        Self::ExpandedTwice,
        Self::Halved,
        Self::Doubled,
        Self::Raised,
        Self::Signed,
        Self::Inverted,
        Self::ImageNet,
    ];

    /// Encodes a right pixel of values in [0, 1], cut at 0 and 1.
    pub(super) fn encoded(self, pixel: [f64; 3]) -> [f64; 3] {
        let encoded = match self.form() {
            Form::Affine { gain, offset } => [0, 1, 2].map(|at| gain[at] * pixel[at] + offset[at]),
            Form::Curve { forward, .. } => pixel.map(forward),
        };
        encoded.map(|value| value.clamp(0.0, 1.0))
    }

    /// Decodes a pixel in this encoding to the right one, unless it was cut.
    pub(super) fn decoded(self, pixel: [f64; 3]) -> [f64; 3] {
        let decoded = match self.form() {
            Form::Affine { gain, offset } => {
                [0, 1, 2].map(|at| (pixel[at] - offset[at]) / gain[at])
            }
            Form::Curve { inverse, .. } => pixel.map(inverse),
        };
        decoded.map(|value| value.clamp(0.0, 1.0))
    }

    /// Returns gain and offset of values in [0, 1] if the encoding is another range of a video.
    pub(super) fn range(self) -> Option<(f64, f64)> {
        match (self, self.form()) {
            (Self::LimitedRange | Self::ExpandedTwice, Form::Affine { gain, offset }) => {
                Some((gain[0], offset[0]))
            }
            _ => None,
        }
    }

    fn form(self) -> Form {
        let same = |gain: f64, offset: f64| Form::Affine {
            gain: [gain; 3],
            offset: [offset; 3],
        };
        match self {
            Self::Linear => Form::Curve {
                forward: linear_of_srgb,
                inverse: srgb_of_linear,
            },
            Self::SrgbTwice => Form::Curve {
                forward: srgb_of_linear,
                inverse: linear_of_srgb,
            },
            Self::Gamma => Form::Curve {
                forward: |value| value.powf(2.2),
                inverse: |value| value.powf(1.0 / 2.2),
            },
            Self::InverseGamma => Form::Curve {
                forward: |value| value.powf(1.0 / 2.2),
                inverse: |value| value.powf(2.2),
            },
            Self::LimitedRange => same(219.0 / 255.0, 16.0 / 255.0),
            Self::ExpandedTwice => same(255.0 / 219.0, -16.0 / 219.0),
            Self::Halved => same(0.5, 0.0),
            Self::Doubled => same(2.0, 0.0),
            Self::Raised => same(0.5, 0.5),
            Self::Signed => same(2.0, -1.0),
            Self::Inverted => same(-1.0, 1.0),
            Self::ImageNet => {
                // Those of torchvision.
                const MEAN: [f64; 3] = [0.485, 0.456, 0.406];
                const DEVIATION: [f64; 3] = [0.229, 0.224, 0.225];
                Form::Affine {
                    gain: DEVIATION.map(f64::recip),
                    offset: [0, 1, 2].map(|at| -MEAN[at] / DEVIATION[at]),
                }
            }
        }
    }
}

/// The curve of an encoding over values in [0, 1].
enum Form {
    /// Gain and offset of every channel.
    Affine { gain: [f64; 3], offset: [f64; 3] },
    /// The same curve for all channels.
    Curve {
        forward: fn(f64) -> f64,
        inverse: fn(f64) -> f64,
    },
}

fn linear_of_srgb(level: f64) -> f64 {
    f64::from(srgb::to_linear(level as f32))
}

fn srgb_of_linear(light: f64) -> f64 {
    f64::from(srgb::from_linear(light as f32))
}
