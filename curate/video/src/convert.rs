//! From the decoder's pixel formats to 8-bit RGB.

use std::path::Path;

use ffmpeg::{color, software::scaling::Flags};
use ffmpeg_next as ffmpeg;

use super::{
    Colour, PixelFormat,
    matrix::{self, Matrix},
    planes::Plane,
    reduce::Reduction,
    scaler::{FrameShape, Scaler},
};
use crate::error::VideoError;

/// 8-bit interleaved RGB, row-major.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rgb8Image {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `height * width * 3` values.
    pub data: Vec<u8>,
}

impl Rgb8Image {
    /// Makes an image of `height * width * 3` values.
    pub fn new(width: usize, height: usize, data: Vec<u8>) -> Self {
        Self {
            width,
            height,
            data,
        }
    }

    /// Returns the pixel in column `x` and row `y`.
    #[inline]
    pub fn pixel(&self, x: usize, y: usize) -> [u8; 3] {
        let at = (y * self.width + x) * 3;
        [self.data[at], self.data[at + 1], self.data[at + 2]]
    }

    /// Turns the image clockwise by `quarters` quarter turns.
    pub fn turned(self, quarters: u32) -> Self {
        let quarters = quarters % 4;
        if quarters == 0 {
            return self;
        }
        let (width, height) = if quarters == 2 {
            (self.width, self.height)
        } else {
            (self.height, self.width)
        };
        let mut data = Vec::with_capacity(self.data.len());
        for y in 0..height {
            for x in 0..width {
                let (from_x, from_y) = match quarters {
                    1 => (y, self.height - 1 - x),
                    2 => (self.width - 1 - x, self.height - 1 - y),
                    _ => (self.width - 1 - y, x),
                };
                data.extend_from_slice(&self.pixel(from_x, from_y));
            }
        }
        Self {
            width,
            height,
            data,
        }
    }
}

/// Output size of a [`Converter`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scaling {
    /// The decoded size; chroma is interpolated to it.
    Native,
    /// At most this many pixels wide, aspect kept, by area averaging; of large frames only some rows are read
    /// (`reduce.rs`).
    MaxWidth(u32),
    /// This size regardless of the aspect ratio, bicubic, and BT.601 if the stream states no matrix: like the `ffmpeg`
    /// program from which TransNetV2 reads its images.
    Exactly {
        /// Pixels per row.
        width: u32,
        /// Rows.
        height: u32,
    },
}

/// Converts the frames of one video.
///
/// YUV is converted by the matrix and range that the stream states. Without a stated matrix, BT.709 is taken above 576
/// rows or 1024 columns and BT.601 below, as players do.
pub struct Converter {
    scaling: Scaling,
    scaler: Option<Scaler>,
    reduction: Option<Reduction>,
    configured: Option<Configuration>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Configuration {
    shape: FrameShape,
    space: color::Space,
    range: color::Range,
}

impl Converter {
    /// Creates a converter for one video.
    pub fn new(scaling: Scaling) -> Self {
        Self {
            scaling,
            scaler: None,
            reduction: None,
            configured: None,
        }
    }

    /// Converts a frame of the video at `path` (named in errors).
    ///
    /// # Errors
    /// [`VideoError::Unusable`] when the pixel format cannot be converted.
    pub fn convert(
        &mut self,
        path: &Path,
        image: &ffmpeg::frame::Video,
    ) -> Result<Rgb8Image, VideoError> {
        let colour = Colour::of(image);
        let configuration = Configuration {
            shape: FrameShape::of(image),
            space: colour.space,
            range: colour.range,
        };
        if let Some(name) = matrix::unknown_matrix(colour.space) {
            let reason = format!("its colours have the matrix {name}, which is not converted");
            let advice = "have them converted: ffmpeg -i IN -vf zscale=matrix=709 OUT";
            return Err(VideoError::mendable(path, reason, advice));
        }
        let unsupported = |error: ffmpeg::Error| {
            VideoError::unusable(
                path,
                format!(
                    "pixel format {} cannot be converted: {error}",
                    configuration.shape.format.name()
                ),
            )
        };
        // A stream may change its size or colours on the way.
        if self.configured != Some(configuration) {
            self.reduction = configuration.reduction(self.scaling);
            let scaler = configuration.scaler(self.scaling, self.reduction.as_ref());
            self.scaler = Some(scaler.map_err(unsupported)?);
            self.configured = Some(configuration);
        }
        let Some(scaler) = self.scaler.as_mut() else {
            return Err(VideoError::internal(path, "no scaler"));
        };
        let rgb = match &self.reduction {
            Some(reduction) => reduction
                .apply(image)
                .and_then(|reduced| scaler.run(&reduced)),
            None => scaler.run(image),
        };
        rgb.and_then(|rgb| packed(&rgb)).map_err(unsupported)
    }
}

impl Configuration {
    /// Returns the reduction of frames before they are scaled to size and converted.
    fn reduction(&self, scaling: Scaling) -> Option<Reduction> {
        match scaling {
            Scaling::MaxWidth(limit) => Reduction::new(self.shape, limit),
            Scaling::Native | Scaling::Exactly { .. } => None,
        }
    }

    fn scaler(
        &self,
        scaling: Scaling,
        reduction: Option<&Reduction>,
    ) -> Result<Scaler, ffmpeg::Error> {
        let FrameShape { width, height, .. } = self.shape;
        let (width, height, filter) = match scaling {
            Scaling::MaxWidth(limit) if width > limit => {
                let height = (f64::from(height) * f64::from(limit) / f64::from(width))
                    .round()
                    .max(1.0);
                (limit, height as u32, Flags::AREA | Flags::ACCURATE_RND)
            }
            Scaling::Exactly { width, height } => (width, height, Flags::BICUBIC),
            _ => (
                width,
                height,
                Flags::BICUBIC
                    | Flags::FULL_CHR_H_INT
                    | Flags::FULL_CHR_H_INP
                    | Flags::ACCURATE_RND,
            ),
        };
        let source = reduction.map_or(self.shape, |reduction| reduction.target);
        let target = FrameShape {
            format: PixelFormat::RGB24,
            width,
            height,
        };
        let mut scaler = Scaler::new(source, target, filter)?;
        scaler.set_colours(self.matrix(scaling), self.is_full_range(), true);
        Ok(scaler)
    }

    fn matrix(&self, scaling: Scaling) -> Matrix {
        let FrameShape { width, height, .. } = self.shape;
        let assumed = match scaling {
            Scaling::Exactly { .. } => Matrix::Bt601,
            Scaling::Native | Scaling::MaxWidth(_) => Matrix::assumed(width, height),
        };
        Matrix::stated(self.space).unwrap_or(assumed)
    }

    fn is_full_range(&self) -> bool {
        self.range == color::Range::JPEG
            || matches!(
                self.shape.format,
                PixelFormat::YUVJ420P
                    | PixelFormat::YUVJ422P
                    | PixelFormat::YUVJ444P
                    | PixelFormat::YUVJ440P
            )
    }
}

/// Returns the rows of an RGB24 frame without the padding between them.
fn packed(frame: &ffmpeg::frame::Video) -> Result<Rgb8Image, ffmpeg::Error> {
    let plane = Plane::of(frame, 0).ok_or(ffmpeg::Error::InvalidData)?;
    let (width, height) = (frame.width() as usize, plane.rows());
    let mut data = Vec::with_capacity(width * height * 3);
    for y in 0..height {
        data.extend_from_slice(plane.row(y));
    }
    Ok(Rgb8Image::new(width, height, data))
}
