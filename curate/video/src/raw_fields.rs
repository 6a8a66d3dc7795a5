//! Fields of FFmpeg's structures whose values a file controls.
//!
//! FFmpeg declares them as C enums and copies whatever integer a container or a bit stream states. A Rust enum with an
//! unknown value is undefined behaviour, so they are read here as integers, and nowhere as enums; unknown values become
//! "unknown".
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    ffi::{CStr, c_char, c_int, c_uint},
    mem::offset_of,
    ptr::{addr_of, addr_of_mut},
};

use ffmpeg::{color, ffi};
use ffmpeg_next as ffmpeg;

use super::PixelFormat;

/// Name of values that FFmpeg's tables do not know.
const UNKNOWN: &str = "unknown";

// Declared again with integers in place of enums, as the C functions take.
unsafe extern "C" {
    fn avcodec_find_decoder(id: c_uint) -> *const ffi::AVCodec;
    fn avcodec_get_name(id: c_uint) -> *const c_char;
    fn av_color_transfer_name(transfer: c_uint) -> *const c_char;
    fn av_color_primaries_name(primaries: c_uint) -> *const c_char;
    fn av_spherical_projection_name(projection: c_uint) -> *const c_char;
    fn av_stereo3d_type_name(layout: c_uint) -> *const c_char;
}

/// Colour description of a frame; unknown values become unspecified.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Colour {
    /// Matrix.
    pub space: color::Space,
    /// Limited or full range.
    pub range: color::Range,
    /// Primaries.
    pub primaries: color::Primaries,
    /// Transfer function.
    pub transfer: color::TransferCharacteristic,
}

impl Colour {
    /// Returns the description that a decoded frame carries.
    pub fn of(frame: &ffmpeg::frame::Video) -> Self {
        // SAFETY: the frame is live; the fields have the size of a C enum, an integer of 32 bits, and
        // are read as such.
        let [space, range, primaries, transfer] = unsafe {
            let frame = frame.as_ptr();
            [
                addr_of!((*frame).colorspace).cast::<c_uint>().read(),
                addr_of!((*frame).color_range).cast::<c_uint>().read(),
                addr_of!((*frame).color_primaries).cast::<c_uint>().read(),
                addr_of!((*frame).color_trc).cast::<c_uint>().read(),
            ]
        };
        Self {
            space: space_of(space),
            range: range_of(range),
            primaries: primaries_of(primaries),
            transfer: transfer_of(transfer),
        }
    }
}

fn space_of(value: c_uint) -> color::Space {
    use color::Space;
    [
        Space::RGB,
        Space::BT709,
        Space::FCC,
        Space::BT470BG,
        Space::SMPTE170M,
        Space::SMPTE240M,
        Space::YCGCO,
        Space::BT2020NCL,
        Space::BT2020CL,
        Space::SMPTE2085,
        Space::ChromaDerivedNCL,
        Space::ChromaDerivedCL,
        Space::ICTCP,
    ]
    .into_iter()
    .find(|&known| ffi::AVColorSpace::from(known) as c_uint == value)
    .unwrap_or(Space::Unspecified)
}

fn range_of(value: c_uint) -> color::Range {
    [color::Range::MPEG, color::Range::JPEG]
        .into_iter()
        .find(|&known| ffi::AVColorRange::from(known) as c_uint == value)
        .unwrap_or(color::Range::Unspecified)
}

fn primaries_of(value: c_uint) -> color::Primaries {
    use color::Primaries;
    [
        Primaries::BT709,
        Primaries::BT470M,
        Primaries::BT470BG,
        Primaries::SMPTE170M,
        Primaries::SMPTE240M,
        Primaries::Film,
        Primaries::BT2020,
        Primaries::SMPTE428,
        Primaries::SMPTE431,
        Primaries::SMPTE432,
        Primaries::JEDEC_P22,
    ]
    .into_iter()
    .find(|&known| ffi::AVColorPrimaries::from(known) as c_uint == value)
    .unwrap_or(Primaries::Unspecified)
}

fn transfer_of(value: c_uint) -> color::TransferCharacteristic {
    use color::TransferCharacteristic as Transfer;
    [
        Transfer::BT709,
        Transfer::GAMMA22,
        Transfer::GAMMA28,
        Transfer::SMPTE170M,
        Transfer::SMPTE240M,
        Transfer::Linear,
        Transfer::Log,
        Transfer::LogSqrt,
        Transfer::IEC61966_2_4,
        Transfer::BT1361_ECG,
        Transfer::IEC61966_2_1,
        Transfer::BT2020_10,
        Transfer::BT2020_12,
        Transfer::SMPTE2084,
        Transfer::SMPTE428,
        Transfer::ARIB_STD_B67,
    ]
    .into_iter()
    .find(|&known| ffi::AVColorTransferCharacteristic::from(known) as c_uint == value)
    .unwrap_or(Transfer::Unspecified)
}

/// Returns FFmpeg's name of the transfer function that a decoder states.
pub(super) fn transfer_name(decoder: &ffmpeg::decoder::Video) -> &'static str {
    // SAFETY: the decoder is live; the field is an integer of 32 bits and read as such. The function
    // takes any integer and returns null or a string of a static table.
    unsafe {
        let transfer = addr_of!((*decoder.as_ptr()).color_trc).cast::<c_uint>();
        static_name(av_color_transfer_name(transfer.read()))
    }
    .unwrap_or(UNKNOWN)
}

/// Returns FFmpeg's name of the colour primaries that a decoder states.
pub(super) fn primaries_name(decoder: &ffmpeg::decoder::Video) -> &'static str {
    // SAFETY: the decoder is live; the field is an integer of 32 bits and read as such. The function
    // takes any integer and returns null or a string of a static table.
    unsafe {
        let primaries = addr_of!((*decoder.as_ptr()).color_primaries).cast::<c_uint>();
        static_name(av_color_primaries_name(primaries.read()))
    }
    .unwrap_or(UNKNOWN)
}

/// Returns the matrix between RGB and YUV that a decoder states.
pub(super) fn matrix(decoder: &ffmpeg::decoder::Video) -> color::Space {
    // SAFETY: the decoder is live; the field is an integer of 32 bits and read as such.
    let value = unsafe {
        addr_of!((*decoder.as_ptr()).colorspace)
            .cast::<c_uint>()
            .read()
    };
    space_of(value)
}

/// Returns the format of the frames that a decoder expects to output.
pub(super) fn pixel_format(decoder: &ffmpeg::decoder::Video) -> PixelFormat {
    // SAFETY: the decoder is live; the field is an integer of 32 bits and read as such.
    PixelFormat::from_raw(unsafe { addr_of!((*decoder.as_ptr()).pix_fmt).cast::<c_int>().read() })
}

/// The codec of a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct CodecId(c_uint);

impl CodecId {
    /// Returns the codec that the container states for the stream.
    pub(crate) fn of(stream: &ffmpeg::Stream<'_>) -> Self {
        let parameters = stream.parameters();
        // SAFETY: the parameters are live; the field is an integer of 32 bits and read as such.
        Self(unsafe {
            addr_of!((*parameters.as_ptr()).codec_id)
                .cast::<c_uint>()
                .read()
        })
    }

    pub(crate) fn is_among(self, known: &[ffmpeg::codec::Id]) -> bool {
        known
            .iter()
            .any(|&id| ffi::AVCodecID::from(id) as c_uint == self.0)
    }

    pub(crate) fn name(self) -> &'static str {
        // SAFETY: the function takes any integer and returns a static string.
        unsafe { static_name(avcodec_get_name(self.0)) }.unwrap_or(UNKNOWN)
    }

    /// Returns FFmpeg's decoder of it, if there is one.
    pub(super) fn decoder(self) -> Option<ffmpeg::Codec> {
        // SAFETY: the function takes any integer and returns null or one of FFmpeg's static codecs.
        unsafe {
            let codec = avcodec_find_decoder(self.0);
            (!codec.is_null()).then(|| ffmpeg::Codec::wrap(codec.cast_mut()))
        }
    }
}

/// Returns width and height that a container states of a stream, pixels; `None` unless it is video.
pub(super) fn video_size(stream: &ffmpeg::Stream<'_>) -> Option<[c_int; 2]> {
    let parameters = stream.parameters();
    // SAFETY: the parameters are live; the kind is an integer of 32 bits and read as such.
    let (kind, size) = unsafe {
        let parameters = parameters.as_ptr();
        let kind = addr_of!((*parameters).codec_type).cast::<c_int>().read();
        (kind, [(*parameters).width, (*parameters).height])
    };
    (kind == ffi::AVMediaType::AVMEDIA_TYPE_VIDEO as c_int).then_some(size)
}

/// Supported kinds of side data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SideData {
    /// Nine integers, see `av_display_rotation_get`.
    DisplayMatrix,
    /// An `AVSphericalMapping`.
    Spherical,
    /// An `AVStereo3D`.
    Stereo,
}

/// Bytes of the first side data of a kind that a stream has.
pub(super) fn side_data(stream: &ffmpeg::Stream<'_>, kind: SideData) -> Option<Vec<u8>> {
    use ffi::AVPacketSideDataType::{
        AV_PKT_DATA_DISPLAYMATRIX, AV_PKT_DATA_SPHERICAL, AV_PKT_DATA_STEREO3D,
    };
    let wanted = match kind {
        SideData::DisplayMatrix => AV_PKT_DATA_DISPLAYMATRIX,
        SideData::Spherical => AV_PKT_DATA_SPHERICAL,
        SideData::Stereo => AV_PKT_DATA_STEREO3D,
    } as c_uint;
    stream
        .side_data()
        .find(|data| {
            // SAFETY: the side data is live; the field is an integer of 32 bits and read as such.
            wanted == unsafe { addr_of!((*data.as_ptr()).type_).cast::<c_uint>().read() }
        })
        .map(|data| data.data().to_vec())
}

/// Returns FFmpeg's name of the projection in the bytes of an `AVSphericalMapping`.
pub(super) fn projection_name(mapping: &[u8]) -> Option<&'static str> {
    let projection = integer_at(mapping, offset_of!(ffi::AVSphericalMapping, projection))?;
    // SAFETY: the function takes any integer and returns a static string.
    unsafe { static_name(av_spherical_projection_name(projection)) }
}

/// Returns the cropped shares of the sphere in the bytes of an `AVSphericalMapping`: on the left, at the top, on the
/// right and at the bottom, in 0.32.
pub(super) fn bounds(mapping: &[u8]) -> Option<[u32; 4]> {
    let at = |offset| integer_at(mapping, offset);
    Some([
        at(offset_of!(ffi::AVSphericalMapping, bound_left))?,
        at(offset_of!(ffi::AVSphericalMapping, bound_top))?,
        at(offset_of!(ffi::AVSphericalMapping, bound_right))?,
        at(offset_of!(ffi::AVSphericalMapping, bound_bottom))?,
    ])
}

/// Returns the padding of cube faces in the bytes of an `AVSphericalMapping`, pixels.
pub(super) fn padding(mapping: &[u8]) -> Option<u32> {
    integer_at(mapping, offset_of!(ffi::AVSphericalMapping, padding))
}

/// Returns yaw, pitch and roll in the bytes of an `AVSphericalMapping`, degrees in 16.16.
pub(super) fn pose(mapping: &[u8]) -> Option<[i32; 3]> {
    let at = |offset| {
        let bits = integer_at(mapping, offset)?;
        Some(c_int::from_ne_bytes(bits.to_ne_bytes()))
    };
    Some([
        at(offset_of!(ffi::AVSphericalMapping, yaw))?,
        at(offset_of!(ffi::AVSphericalMapping, pitch))?,
        at(offset_of!(ffi::AVSphericalMapping, roll))?,
    ])
}

/// Returns FFmpeg's name of the layout in the bytes of an `AVStereo3D`.
pub(super) fn stereo_name(stereo: &[u8]) -> Option<&'static str> {
    let layout = integer_at(stereo, offset_of!(ffi::AVStereo3D, type_))?;
    // SAFETY: the function takes any integer and returns a static string.
    unsafe { static_name(av_stereo3d_type_name(layout)) }
}

/// Returns true if the bytes of an `AVStereo3D` state that the right eye's image is the first.
pub(super) fn is_right_eye_first(stereo: &[u8]) -> bool {
    let flags = integer_at(stereo, offset_of!(ffi::AVStereo3D, flags));
    flags.is_some_and(|flags| flags & ffi::AV_STEREO3D_FLAG_INVERT as c_uint != 0)
}

fn integer_at(bytes: &[u8], offset: usize) -> Option<c_uint> {
    let bytes = bytes.get(offset..offset.checked_add(size_of::<c_uint>())?)?;
    bytes.try_into().ok().map(c_uint::from_ne_bytes)
}

/// Clears the kind of image of a frame for an encoder.
pub(crate) fn clear_image_kind(frame: &mut ffmpeg::frame::Video) {
    // SAFETY: the frame is live and borrowed exclusively; 0 is `AV_PICTURE_TYPE_NONE`.
    unsafe {
        addr_of_mut!((*frame.as_mut_ptr()).pict_type)
            .cast::<c_uint>()
            .write(0);
    }
}

/// # Safety
/// `pointer` is null or a string that is never freed.
unsafe fn static_name(pointer: *const c_char) -> Option<&'static str> {
    if pointer.is_null() {
        return None;
    }
    // SAFETY: as the caller promises.
    unsafe { CStr::from_ptr(pointer) }.to_str().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_that_no_table_knows_are_unspecified() {
        assert_eq!(space_of(1), color::Space::BT709);
        assert_eq!(range_of(2), color::Range::JPEG);
        assert_eq!(primaries_of(9), color::Primaries::BT2020);
        assert_eq!(transfer_of(16), color::TransferCharacteristic::SMPTE2084);
        for value in [3, 100, 255, 0x7fff_ffff, c_uint::MAX] {
            assert_eq!(space_of(value), color::Space::Unspecified);
            assert_eq!(range_of(value), color::Range::Unspecified);
            assert_eq!(primaries_of(value), color::Primaries::Unspecified);
            assert_eq!(
                transfer_of(value),
                color::TransferCharacteristic::Unspecified
            );
        }
    }

    #[test]
    fn side_data_that_is_too_short_or_of_unknown_values_names_nothing_known() {
        assert_eq!(projection_name(&[]), None);
        assert_eq!(stereo_name(&[0; 3]), None);
        assert_eq!(projection_name(&[0; 64]), Some("equirectangular"));
        for bytes in [[255; 64], [0x7f; 64]] {
            assert!(projection_name(&bytes).is_none_or(|name| name == UNKNOWN));
            assert!(stereo_name(&bytes).is_none_or(|name| name == UNKNOWN));
        }
    }

    #[test]
    fn codecs_that_are_not_known_have_no_decoder() {
        assert!(CodecId(c_uint::MAX).decoder().is_none());
        assert!(CodecId(27).is_among(&[ffmpeg::codec::Id::H264]));
        assert_eq!(CodecId(27).name(), "h264");
        assert!(!CodecId(c_uint::MAX).name().is_empty());
    }
}
