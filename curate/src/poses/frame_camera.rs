//! The camera of frames: distorted, and as a scene shows them.

use std::path::Path;

use omnilife_schemas::{
    RgbImage,
    camera::{Camera, PinholeCamera},
    image_file::ImageFile,
    store::StoreError,
};

use super::lens::{Distortion, Lens, Projection, Straightening};

/// The camera of frame files, which may have a lens that a scene does not support.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FrameCamera {
    /// Frames of a camera without a lens.
    Straight(Camera),
    /// A lens that moves no pixel by more than a quarter of one, and stays in the frames.
    Weak(Lens),
    /// A lens that is removed from the frames.
    Distorted {
        /// Size, intrinsics and distortion of the original frames.
        lens: Lens,
        /// The camera of the undistorted frames, of the same size.
        straight: PinholeCamera,
    },
}

impl From<Camera> for FrameCamera {
    fn from(camera: Camera) -> Self {
        Self::Straight(camera)
    }
}

impl FrameCamera {
    /// Returns the camera of frames with this lens.
    ///
    /// # Errors
    /// When the lens has no undistorted image, with the reason.
    pub fn behind(lens: Lens) -> Result<Self, String> {
        if lens.distortion == Distortion::default() {
            return Ok(Self::Straight(lens.camera.into()));
        }
        if lens.is_negligible() {
            return Ok(Self::Weak(lens));
        }
        match lens.straight() {
            Some(straight) => Ok(Self::Distorted { lens, straight }),
            None => {
                let terms = lens
                    .distortion
                    .numbers()
                    .skip(3)
                    .filter(|term| *term != 0.0);
                let terms: Vec<String> = terms.map(|term| term.to_string()).collect();
                Err(format!(
                    "no straight image is within a lens with the terms {}",
                    terms.join(", ")
                ))
            }
        }
    }

    /// Returns the camera of the frames in a scene, without a lens.
    pub fn camera(&self) -> Camera {
        match self {
            Self::Straight(camera) => *camera,
            Self::Weak(lens) => lens.camera.into(),
            Self::Distorted { straight, .. } => (*straight).into(),
        }
    }

    /// Returns the lens that must be removed from the frames; `None` if they stay unchanged.
    pub fn lens(&self) -> Option<Lens> {
        match self {
            Self::Distorted { lens, .. } => Some(*lens),
            Self::Straight(_) | Self::Weak(_) => None,
        }
    }

    /// Returns the same camera with frames of another size.
    #[must_use]
    pub fn resized(&self, width: u32, height: u32) -> Self {
        match self {
            Self::Straight(camera) => Self::Straight(camera.resized(width, height)),
            Self::Weak(lens) => Self::Weak(lens.resized(width, height)),
            Self::Distorted { lens, straight } => {
                let resized =
                    |&camera: &PinholeCamera| Lens { camera, ..*lens }.resized(width, height);
                Self::Distorted {
                    lens: resized(&lens.camera),
                    straight: resized(straight).camera,
                }
            }
        }
    }

    /// Returns a line on the lens, if there is one.
    pub(crate) fn remark(&self) -> Option<String> {
        match self {
            Self::Straight(_) => None,
            Self::Weak(lens) => Some(format!(
                "the lens moves no pixel by more than {:.2} and stays in the frames",
                lens.largest_shift_pixels()
            )),
            Self::Distorted { lens, straight } => {
                Some(if lens.distortion.projection == Projection::Perspective {
                    format!(
                        "the lens, which moves pixels by up to {:.1}, is taken out of the frames",
                        lens.largest_shift_pixels()
                    )
                } else {
                    format!(
                        "the frames of a wide lens are made perspective: {:.0} degrees across, what is outside is \
                         cut off",
                        Lens::angle_across_degrees(straight)
                    )
                })
            }
        }
    }

    /// Prepares the undistortion of frames; `None` if the files need none.
    pub(crate) fn straightening(&self) -> Option<Straightening> {
        match self {
            Self::Distorted { lens, straight } => Some(lens.straightening(straight)),
            Self::Straight(_) | Self::Weak(_) => None,
        }
    }
}

/// Writes an undistorted frame as a PNG.
///
/// # Errors
/// When the frame cannot be read, differs in size from its camera, or the PNG cannot be written.
pub(crate) fn write_straight(
    straightening: &Straightening,
    frame: &Path,
    to: &Path,
) -> Result<(), StoreError> {
    let file = ImageFile::open(frame)?.expect_size(straightening.size())?;
    straightening.image(&RgbImage::decode(file)?).write_png(to)
}
