//! Matrices between RGB and YUV.

use ffmpeg::{color::Space, ffi};
use ffmpeg_next as ffmpeg;

/// A matrix that FFmpeg's scaler has coefficients of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Matrix {
    Bt601,
    Bt709,
    Bt2020,
    Fcc,
    Smpte240m,
}

impl Matrix {
    /// Returns the matrix of a stream's statement; `None` for other matrices, and without a statement.
    pub(crate) fn stated(space: Space) -> Option<Self> {
        match space {
            Space::BT709 => Some(Self::Bt709),
            Space::BT2020NCL => Some(Self::Bt2020),
            Space::BT470BG | Space::SMPTE170M => Some(Self::Bt601),
            Space::FCC => Some(Self::Fcc),
            Space::SMPTE240M => Some(Self::Smpte240m),
            _ => None,
        }
    }

    /// Returns the matrix that players take for a stream of this size, pixels, without a statement.
    pub(crate) fn assumed(width: u32, height: u32) -> Self {
        if height > 576 || width > 1024 {
            Self::Bt709
        } else {
            Self::Bt601
        }
    }

    /// Returns its usual name.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Bt601 => "BT.601",
            Self::Bt709 => "BT.709",
            Self::Bt2020 => "BT.2020",
            Self::Fcc => "FCC",
            Self::Smpte240m => "SMPTE 240M",
        }
    }

    /// Returns the number of its coefficients in FFmpeg's scaler.
    pub(crate) fn scaler_number(self) -> i32 {
        match self {
            Self::Bt601 => ffi::SWS_CS_ITU601,
            Self::Bt709 => ffi::SWS_CS_ITU709,
            Self::Bt2020 => ffi::SWS_CS_BT2020,
            Self::Fcc => ffi::SWS_CS_FCC,
            Self::Smpte240m => ffi::SWS_CS_SMPTE240M,
        }
    }
}

/// Returns the name of a stated matrix that the scaler has no coefficients of: it would take others.
pub(crate) fn unknown_matrix(space: Space) -> Option<&'static str> {
    match space {
        Space::YCGCO => Some("YCgCo"),
        Space::SMPTE2085 => Some("SMPTE 2085"),
        Space::ChromaDerivedNCL | Space::ChromaDerivedCL => Some("derived from primaries"),
        Space::ICTCP => Some("ICtCp"),
        Space::BT2020CL => Some("BT.2020 with constant luminance"),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scaler::{FrameShape, Scaler};
    use crate::{PixelFormat, planes::Plane};

    /// Weights of red and blue in luma (ITU-T H.273, table 4).
    fn weights(matrix: Matrix) -> [f64; 2] {
        match matrix {
            Matrix::Bt601 => [0.299, 0.114],
            Matrix::Bt709 => [0.2126, 0.0722],
            Matrix::Bt2020 => [0.2627, 0.0593],
            Matrix::Fcc => [0.30, 0.11],
            Matrix::Smpte240m => [0.212, 0.087],
        }
    }

    /// Colours of full range, coded by the equations of the standard, come back.
    #[test]
    fn colours_of_every_stated_matrix_come_back() -> Result<(), ffmpeg::Error> {
        for space in [
            Space::BT709,
            Space::BT2020NCL,
            Space::BT470BG,
            Space::SMPTE170M,
            Space::FCC,
            Space::SMPTE240M,
        ] {
            let Some(matrix) = Matrix::stated(space) else {
                panic!("{space:?} is converted")
            };
            let [red, blue] = weights(matrix);
            for colour in [
                [200.0, 60.0, 30.0],
                [40.0, 190.0, 80.0],
                [10.0, 20.0, 250.0],
            ] {
                let [r, g, b] = colour;
                let y: f64 = red * r + (1.0 - red - blue) * g + blue * b;
                let coded = [
                    y,
                    128.0 + (b - y) / (2.0 - 2.0 * blue),
                    128.0 + (r - y) / (2.0 - 2.0 * red),
                ];
                let shape = |format| FrameShape {
                    format,
                    width: 16,
                    height: 2,
                };
                let mut frame = ffmpeg::frame::Video::new(ffmpeg::format::Pixel::YUV444P, 16, 2);
                for (plane, value) in coded.iter().enumerate() {
                    frame.data_mut(plane).fill(value.round() as u8);
                }
                let target = shape(PixelFormat::RGB24);
                let source = shape(PixelFormat::YUV444P);
                let flags = ffmpeg::software::scaling::Flags::ACCURATE_RND;
                let mut scaler = Scaler::new(source, target, flags)?;
                scaler.set_colours(matrix, true, true);
                let rgb = scaler.run(&frame)?;
                let plane = Plane::of(&rgb, 0).ok_or(ffmpeg::Error::InvalidData)?;
                for (value, expected) in plane.row(0).iter().zip(colour) {
                    let error = (f64::from(*value) - expected).abs();
                    // Half a level of each coded value, and of the result.
                    assert!(error <= 1.5, "{matrix:?}: {value} for {expected}");
                }
            }
        }
        Ok(())
    }
}
