//! FFmpeg's scaler, for frames whose formats and sizes a file controls.

use std::{
    ffi::{c_double, c_int},
    ptr,
};

use ffmpeg::{ffi, frame::Video, software::scaling::Flags};
use ffmpeg_next as ffmpeg;

use super::{PixelFormat, matrix::Matrix, planes};

// Declared again with integers in place of enums, as the C function takes.
unsafe extern "C" {
    fn sws_getContext(
        source_width: c_int,
        source_height: c_int,
        source_format: c_int,
        target_width: c_int,
        target_height: c_int,
        target_format: c_int,
        flags: c_int,
        source_filter: *mut ffi::SwsFilter,
        target_filter: *mut ffi::SwsFilter,
        parameters: *const c_double,
    ) -> *mut ffi::SwsContext;
}

/// Format and size of frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct FrameShape {
    pub(crate) format: PixelFormat,
    pub(crate) width: u32,
    pub(crate) height: u32,
}

impl FrameShape {
    pub(crate) fn of(frame: &Video) -> Self {
        Self {
            format: PixelFormat::of(frame),
            width: frame.width(),
            height: frame.height(),
        }
    }
}

/// Turns frames of one shape into frames of another.
pub(crate) struct Scaler {
    /// Never null.
    context: *mut ffi::SwsContext,
    source: FrameShape,
    target: FrameShape,
}

impl Scaler {
    /// # Errors
    /// When FFmpeg cannot convert between the formats, a side is too large, or there is not enough
    /// memory.
    pub(crate) fn new(
        source: FrameShape,
        target: FrameShape,
        flags: Flags,
    ) -> Result<Self, ffmpeg::Error> {
        let side = |pixels: u32| c_int::try_from(pixels).map_err(|_| ffmpeg::Error::InvalidData);
        // SAFETY: the function takes any integers and refuses those that it does not know; filters
        // and parameters may be null.
        let context = unsafe {
            sws_getContext(
                side(source.width)?,
                side(source.height)?,
                source.format.raw(),
                side(target.width)?,
                side(target.height)?,
                target.format.raw(),
                flags.bits(),
                ptr::null_mut(),
                ptr::null_mut(),
                ptr::null(),
            )
        };
        if context.is_null() {
            return Err(ffmpeg::Error::InvalidData);
        }
        Ok(Self {
            context,
            source,
            target,
        })
    }

    /// Sets the matrix of both sides, and whether each is of full range. Formats without a matrix (RGB, grey) need none
    /// and stay unchanged.
    pub(crate) fn set_colours(
        &mut self,
        matrix: Matrix,
        source_is_full: bool,
        target_is_full: bool,
    ) {
        // SAFETY: the context is live, and `sws_getCoefficients` returns a pointer to a static table
        // of four integers, which is what `sws_setColorspaceDetails` reads. The last three arguments
        // are the neutral brightness, contrast and saturation in 16.16 fixed point. The call fails
        // for formats without a matrix.
        unsafe {
            let coefficients = ffi::sws_getCoefficients(matrix.scaler_number());
            ffi::sws_setColorspaceDetails(
                self.context,
                coefficients,
                c_int::from(source_is_full),
                coefficients,
                c_int::from(target_is_full),
                0,
                1 << 16,
                1 << 16,
            );
        }
    }

    /// # Errors
    /// When the frame is of another shape, its content does not match its shape, or there is not enough memory.
    pub(crate) fn run(&mut self, frame: &Video) -> Result<Video, ffmpeg::Error> {
        if FrameShape::of(frame) != self.source {
            return Err(ffmpeg::Error::InputChanged);
        }
        // Every format has a first plane; further ones are FFmpeg's to fill.
        planes::Plane::of(frame, 0).ok_or(ffmpeg::Error::InvalidData)?;
        let FrameShape {
            format,
            width,
            height,
        } = self.target;
        let mut scaled = planes::allocated(format, width, height)?;
        // SAFETY: the context is live and was made for frames of these shapes; the planes of the
        // source are FFmpeg's own, those of the target were just allocated for its shape. Distances
        // between rows may be negative.
        let code = unsafe {
            let (from, to) = (frame.as_ptr(), scaled.as_mut_ptr());
            ffi::sws_scale(
                self.context,
                (*from).data.as_ptr().cast(),
                (*from).linesize.as_ptr(),
                0,
                (*from).height,
                (*to).data.as_ptr(),
                (*to).linesize.as_ptr(),
            )
        };
        if code < 0 {
            return Err(ffmpeg::Error::from(code));
        }
        Ok(scaled)
    }
}

impl Drop for Scaler {
    fn drop(&mut self) {
        // SAFETY: the context is live and freed once.
        unsafe { ffi::sws_freeContext(self.context) };
    }
}
