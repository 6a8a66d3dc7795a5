//! The pixels of FFmpeg's frames, with every length checked.
//!
//! The distance from one row to the next may be negative: an image that is stored from its bottom up
//! is decoded so that its first row is the last in memory.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{ffi::c_int, marker::PhantomData, slice};

use ffmpeg::{ffi, frame::Video};
use ffmpeg_next as ffmpeg;

use super::PixelFormat;

/// Rows begin at multiples of this many bytes.
const ALIGNMENT: c_int = 32;

/// One plane of a frame, from the image's top to its bottom.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plane<'a> {
    first_row: *const u8,
    /// Bytes from a row to the one below it.
    step: isize,
    row_bytes: usize,
    rows: usize,
    frame: PhantomData<&'a Video>,
}

impl<'a> Plane<'a> {
    /// Returns a plane of a frame; `None` if the frame has no such plane, its format is unknown, or its stated plane
    /// does not fit its format.
    pub(super) fn of(frame: &'a Video, plane: usize) -> Option<Self> {
        let format = PixelFormat::of(frame);
        // SAFETY: the frame is live; the fields are integers and pointers.
        let (width, height, first_row, step) = unsafe {
            let frame = frame.as_ptr();
            (
                (*frame).width,
                (*frame).height,
                (*frame).data.get(plane)?.cast_const(),
                *(*frame).linesize.get(plane)?,
            )
        };
        let row_bytes = format.row_bytes(plane, usize::try_from(width).ok()?)?;
        let rows = format.plane_rows(plane, usize::try_from(height).ok()?);
        let is_stored = !first_row.is_null() && step.unsigned_abs() as usize >= row_bytes;
        is_stored.then_some(Self {
            first_row,
            step: step as isize,
            row_bytes,
            rows,
            frame: PhantomData,
        })
    }

    pub(super) fn rows(&self) -> usize {
        self.rows
    }

    /// Returns the bytes of a row; empty below the last row.
    #[expect(
        clippy::arithmetic_side_effects,
        reason = "the row is one of the plane's"
    )]
    pub(super) fn row(&self, y: usize) -> &'a [u8] {
        if y >= self.rows {
            return &[];
        }
        // SAFETY: FFmpeg's frames hold `rows` rows of at least `row_bytes` bytes that begin `step`
        // bytes apart, and live as long as the frame that is borrowed.
        unsafe {
            let row = self.first_row.offset(y as isize * self.step);
            slice::from_raw_parts(row, self.row_bytes)
        }
    }
}

/// Allocates a frame with undefined pixels of its own.
///
/// # Errors
/// When the format is unknown, a side is zero or too large, or there is not enough memory.
pub(crate) fn allocated(
    format: PixelFormat,
    width: u32,
    height: u32,
) -> Result<Video, ffmpeg::Error> {
    let side = |pixels: u32| c_int::try_from(pixels).map_err(|_| ffmpeg::Error::InvalidData);
    let mut frame = Video::empty();
    // SAFETY: the frame is live and borrowed exclusively; its fields are integers.
    let code = unsafe {
        let raw = frame.as_mut_ptr();
        if raw.is_null() {
            return Err(out_of_memory());
        }
        (*raw).format = format.raw();
        (*raw).width = side(width)?;
        (*raw).height = side(height)?;
        ffi::av_frame_get_buffer(raw, ALIGNMENT)
    };
    if code < 0 {
        return Err(ffmpeg::Error::from(code));
    }
    Ok(frame)
}

fn out_of_memory() -> ffmpeg::Error {
    ffmpeg::Error::Other {
        errno: ffmpeg::util::error::ENOMEM,
    }
}

/// Returns the rows of a plane of a frame from [`allocated`], for writing.
///
/// # Errors
/// Those of [`Plane::of`].
#[expect(
    clippy::arithmetic_side_effects,
    reason = "rows are those of the plane"
)]
pub(crate) fn rows_mut(
    frame: &mut Video,
    plane: usize,
) -> Result<impl Iterator<Item = &mut [u8]>, ffmpeg::Error> {
    let Plane {
        first_row,
        step,
        row_bytes,
        rows,
        ..
    } = Plane::of(frame, plane).ok_or(ffmpeg::Error::InvalidData)?;
    let first_row = first_row.cast_mut();
    // SAFETY: as in `Plane::row`; rows do not overlap, and each is handed out once, for as long as
    // the frame is borrowed exclusively.
    Ok((0..rows).map(move |y| unsafe {
        let row = first_row.offset(y as isize * step);
        slice::from_raw_parts_mut(row, row_bytes)
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbered(rows: u32) -> Result<Video, ffmpeg::Error> {
        let mut frame = allocated(PixelFormat::YUV420P, 16, rows)?;
        for plane in 0..3 {
            for (y, row) in rows_mut(&mut frame, plane)?.enumerate() {
                row.fill((100 * plane + y) as u8);
            }
        }
        Ok(frame)
    }

    #[test]
    fn planes_have_the_rows_of_their_format() -> Result<(), ffmpeg::Error> {
        let frame = numbered(7)?;
        let sizes: Vec<_> = (0..5)
            .map(|plane| Plane::of(&frame, plane).map(|plane| (plane.rows(), plane.row(0).len())))
            .collect();
        let chroma = Some((4, 8));
        assert_eq!(sizes, [Some((7, 16)), chroma, chroma, None, None]);
        let luma = Plane::of(&frame, 0).ok_or(ffmpeg::Error::InvalidData)?;
        assert_eq!(luma.row(6), [6; 16]);
        assert!(luma.row(7).is_empty());
        Ok(())
    }

    #[test]
    fn a_frame_stored_from_its_bottom_up_is_read_from_its_top() -> Result<(), ffmpeg::Error> {
        let mut frame = numbered(4)?;
        // SAFETY: the first row becomes the last one in memory, and the step leads back.
        unsafe {
            let raw = frame.as_mut_ptr();
            let step = (*raw).linesize[0];
            (*raw).data[0] = (*raw).data[0].offset(3 * step as isize);
            (*raw).linesize[0] = -step;
        }
        let plane = Plane::of(&frame, 0).ok_or(ffmpeg::Error::InvalidData)?;
        let rows: Vec<u8> = (0..4).map(|y| plane.row(y)[0]).collect();
        assert_eq!(rows, [3, 2, 1, 0]);
        Ok(())
    }

    #[test]
    fn frames_that_cannot_be_allocated_are_errors() {
        for (format, width, height) in [
            (PixelFormat::RGB24, u32::MAX, 16),
            (PixelFormat::RGB24, 0, 16),
            (PixelFormat::RGB24, 2_000_000_000, 2_000_000_000),
            (PixelFormat::from_raw(-1), 16, 16),
            (PixelFormat::from_raw(100_000), 16, 16),
        ] {
            assert!(allocated(format, width, height).is_err(), "{format:?}");
        }
    }

    #[test]
    fn frames_of_unknown_formats_have_no_planes() {
        let mut frame = Video::empty();
        // SAFETY: the field is an integer.
        unsafe { (*frame.as_mut_ptr()).format = 123_456 };
        assert!(Plane::of(&frame, 0).is_none());
        assert_eq!(PixelFormat::of(&frame).name(), "unknown");
    }
}
