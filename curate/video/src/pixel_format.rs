//! Pixel formats as FFmpeg numbers them.

use std::{
    ffi::{CStr, c_char, c_int},
    fmt,
};

use ffmpeg::ffi::{self, AVPixelFormat};
use ffmpeg_next as ffmpeg;

// Declared again with an integer in place of the enum, as the C functions take.
unsafe extern "C" {
    fn av_get_pix_fmt_name(format: c_int) -> *const c_char;
    fn av_pix_fmt_desc_get(format: c_int) -> *const ffi::AVPixFmtDescriptor;
    fn av_image_get_linesize(format: c_int, width: c_int, plane: c_int) -> c_int;
}

/// A pixel format by its number, whether it is known or not.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct PixelFormat(c_int);

macro_rules! known {
    ($($name:ident = $value:ident),* $(,)?) => {
        impl PixelFormat {
            $(
                #[doc = concat!("`", stringify!($value), "`.")]
                pub const $name: Self = Self(AVPixelFormat::$value as c_int);
            )*
        }
    };
}

known! {
    RGB24 = AV_PIX_FMT_RGB24,
    GRAY8 = AV_PIX_FMT_GRAY8,
    NV12 = AV_PIX_FMT_NV12,
    YUV420P = AV_PIX_FMT_YUV420P,
    YUV422P = AV_PIX_FMT_YUV422P,
    YUV444P = AV_PIX_FMT_YUV444P,
    YUVJ420P = AV_PIX_FMT_YUVJ420P,
    YUVJ422P = AV_PIX_FMT_YUVJ422P,
    YUVJ440P = AV_PIX_FMT_YUVJ440P,
    YUVJ444P = AV_PIX_FMT_YUVJ444P,
    YUV420P10LE = AV_PIX_FMT_YUV420P10LE,
    YUV422P10LE = AV_PIX_FMT_YUV422P10LE,
    YUV444P10LE = AV_PIX_FMT_YUV444P10LE,
}

impl From<ffmpeg::format::Pixel> for PixelFormat {
    fn from(known: ffmpeg::format::Pixel) -> Self {
        Self(AVPixelFormat::from(known) as c_int)
    }
}

impl PixelFormat {
    pub(super) fn from_raw(number: c_int) -> Self {
        Self(number)
    }

    pub(super) fn raw(self) -> c_int {
        self.0
    }

    /// Returns the format of a decoded frame.
    pub fn of(frame: &ffmpeg::frame::Video) -> Self {
        // SAFETY: the frame is live, and the field is an integer.
        Self(unsafe { (*frame.as_ptr()).format })
    }

    /// Returns FFmpeg's name of it, `unknown` if it has none.
    pub fn name(self) -> &'static str {
        // SAFETY: the function takes any integer and returns null or a static string.
        let name = unsafe {
            let name = av_get_pix_fmt_name(self.0);
            (!name.is_null()).then(|| CStr::from_ptr(name))
        };
        name.and_then(|name| name.to_str().ok())
            .unwrap_or("unknown")
    }

    /// Bits of the first component; 0 for an unknown format.
    pub(super) fn bit_depth(self) -> u32 {
        self.descriptor()
            .and_then(|descriptor| u32::try_from(descriptor.comp[0].depth).ok())
            .unwrap_or(0)
    }

    /// Returns true for YUV: RGB comes from it by a matrix. False for an unknown format.
    pub(super) fn has_matrix(self) -> bool {
        let others =
            ffi::AV_PIX_FMT_FLAG_RGB | ffi::AV_PIX_FMT_FLAG_PAL | ffi::AV_PIX_FMT_FLAG_BAYER;
        self.descriptor().is_some_and(|descriptor| {
            descriptor.nb_components >= 3 && descriptor.flags & others as u64 == 0
        })
    }

    /// Rows of a plane of a frame of this many rows.
    pub(super) fn plane_rows(self, plane: usize, height: usize) -> usize {
        let halvings = self
            .descriptor()
            .filter(|_| plane == 1 || plane == 2)
            .map_or(0, |descriptor| descriptor.log2_chroma_h);
        height.div_ceil(1 << halvings.min(31))
    }

    /// Returns the bytes of a row of a plane with this many pixels per row, without padding between rows. `None` for an
    /// unknown format, or a plane that it does not have.
    pub(super) fn row_bytes(self, plane: usize, width: usize) -> Option<usize> {
        const MOST_PLANES: usize = 4;
        if plane >= MOST_PLANES {
            return None;
        }
        let (width, plane) = (c_int::try_from(width).ok()?, c_int::try_from(plane).ok()?);
        // SAFETY: the function takes any integers and refuses formats that it does not know; it
        // has that many planes.
        let bytes = unsafe { av_image_get_linesize(self.0, width, plane) };
        usize::try_from(bytes).ok().filter(|&bytes| bytes > 0)
    }

    fn descriptor(self) -> Option<&'static ffi::AVPixFmtDescriptor> {
        // SAFETY: the function takes any integer and returns null or an entry of a static table.
        unsafe { av_pix_fmt_desc_get(self.0).as_ref() }
    }
}

impl fmt::Debug for PixelFormat {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}", self.name())
    }
}
