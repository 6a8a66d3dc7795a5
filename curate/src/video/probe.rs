//! What a file says about itself.

use std::{ffi::CStr, path::Path};

use ffmpeg::{codec::packet::side_data, ffi};
use ffmpeg_next as ffmpeg;
use omnilife_schemas::{
    records::{Probe, SphericalMetadata},
    store::StoreError,
};

use super::{
    decode::VideoReader,
    spherical_boxes::{self, SphericalBoxes, Statement},
};
use crate::error::CurateError;

/// Probes a video: its container and the parameters of its best video stream.
///
/// Nothing is decoded; the measured entries (`decoded_frames`, `variable_frame_rate`) are `None`
/// until an analysis pass fills them in.
///
/// # Errors
/// [`CurateError::Video`] when the file cannot be opened as a video.
pub fn probe(path: &Path) -> Result<Probe, CurateError> {
    describe(&VideoReader::open(path)?)
}

/// The probe of a video that is open already.
pub(crate) fn describe(reader: &VideoReader) -> Result<Probe, CurateError> {
    let path = reader.path();
    let stream = reader
        .stream()
        .ok_or_else(|| CurateError::internal(path, "the video stream is gone"))?;
    let decoder = reader.decoder();
    let (width, height) = (decoder.width(), decoder.height());
    if width == 0 || height == 0 {
        return Err(CurateError::video(path, "its video stream has no size"));
    }
    let format = decoder.format();
    let rotation_degrees = rotation_degrees(&stream);
    if rotation_degrees.rem_euclid(90.0) != 0.0 {
        return Err(CurateError::video(
            path,
            format!("display rotation of {rotation_degrees} degrees is not a quarter turn"),
        ));
    }
    let frame_rate = [stream.avg_frame_rate(), stream.rate()]
        .into_iter()
        .find(|rate| rate.numerator() > 0 && rate.denominator() > 0);
    Ok(Probe {
        container: reader.input().format().name().to_owned(),
        codec: stream.parameters().id().name().to_owned(),
        width,
        height,
        pixel_format: format
            .descriptor()
            .map_or("unknown", ffmpeg::format::pixel::Descriptor::name)
            .to_owned(),
        bit_depth: bit_depth(format),
        frames_per_second: frame_rate.map_or(0.0, f64::from),
        duration_seconds: duration_seconds(reader, &stream),
        decoded_frames: None,
        variable_frame_rate: None,
        longest_interval_seconds: None,
        rotation_degrees,
        pixel_aspect_ratio: pixel_aspect_ratio(decoder),
        transfer: decoder
            .color_transfer_characteristic()
            .name()
            .unwrap_or("unknown")
            .to_owned(),
        spherical: spherical(path, reader.input().format().name(), &stream)?,
    })
}

/// Bits of the first component; 0 for an unknown format.
fn bit_depth(format: ffmpeg::format::Pixel) -> u32 {
    format.descriptor().map_or(0, |descriptor| {
        // SAFETY: a descriptor points into FFmpeg's static table of pixel formats.
        unsafe { (*descriptor.as_ptr()).comp[0].depth as u32 }
    })
}

/// The stream's duration, else the container's, else 0.
fn duration_seconds(reader: &VideoReader, stream: &ffmpeg::Stream<'_>) -> f64 {
    if stream.duration() > 0 {
        return stream.duration() as f64 * f64::from(stream.time_base());
    }
    let container = reader.input().duration();
    if container > 0 {
        return container as f64 / f64::from(ffi::AV_TIME_BASE);
    }
    0.0
}

fn pixel_aspect_ratio(decoder: &ffmpeg::decoder::Video) -> f64 {
    let ratio = decoder.aspect_ratio();
    if ratio.numerator() > 0 && ratio.denominator() > 0 {
        f64::from(ratio)
    } else {
        1.0
    }
}

/// Clockwise display rotation in [0, 360), rounded to a hundredth of a degree.
fn rotation_degrees(stream: &ffmpeg::Stream<'_>) -> f64 {
    for data in stream.side_data() {
        if data.kind() == side_data::Type::DisplayMatrix
            && let Some(bytes) = data.data().get(..36)
        {
            let mut matrix = [0_i32; 9];
            for (value, bytes) in matrix.iter_mut().zip(bytes.as_chunks::<4>().0) {
                *value = i32::from_ne_bytes(*bytes);
            }
            // SAFETY: the function reads nine integers.
            let counter_clockwise = unsafe { ffi::av_display_rotation_get(matrix.as_ptr()) };
            if counter_clockwise.is_finite() {
                return (-counter_clockwise * 100.0).round().rem_euclid(36000.0) / 100.0;
            }
        }
    }
    0.0
}

/// Spherical metadata: the file's own boxes where it has such, else what FFmpeg finds.
fn spherical(
    path: &Path,
    container: &str,
    stream: &ffmpeg::Stream<'_>,
) -> Result<Option<SphericalMetadata>, CurateError> {
    if container.split(',').any(|name| name == "mp4") {
        let track = u32::try_from(stream.id()).unwrap_or(0);
        let boxes =
            spherical_boxes::read(path, track).map_err(|error| StoreError::read(path, error))?;
        if let Some(metadata) = resolved(boxes) {
            return Ok(Some(metadata));
        }
    }
    Ok(side_data_of(stream))
}

/// Version 2 wins, entry by entry.
fn resolved(SphericalBoxes { v1, v2 }: SphericalBoxes) -> Option<SphericalMetadata> {
    let words = |statement: &Statement| {
        format!(
            "{}{}, {}",
            if statement.is_cropped { "cropped " } else { "" },
            statement.projection.as_deref().unwrap_or("no projection"),
            statement.stereo.as_deref().unwrap_or("2D")
        )
    };
    let older = v1.clone().unwrap_or_default();
    let newer = v2.clone().unwrap_or_default();
    let conflict = match (&v1, &v2) {
        (Some(older), Some(newer)) if words(older) != words(newer) => Some(words(older)),
        _ => None,
    };
    Some(SphericalMetadata {
        is_cropped: if newer.projection.is_some() {
            newer.is_cropped
        } else {
            older.is_cropped
        },
        origin: if v2.is_some() { "v2" } else { "v1" }.to_owned(),
        projection: newer.projection.or(older.projection)?,
        stereo: newer.stereo.or(older.stereo),
        conflict,
    })
}

/// Spherical and stereo side data as FFmpeg parses them.
fn side_data_of(stream: &ffmpeg::Stream<'_>) -> Option<SphericalMetadata> {
    let mut projection = None;
    let mut stereo = None;
    for data in stream.side_data() {
        match data.kind() {
            side_data::Type::DataSpherical
                if data.data().len() >= size_of::<ffi::AVSphericalMapping>() =>
            {
                // SAFETY: FFmpeg stores an `AVSphericalMapping` in side data of this type, the
                // size was checked, and the projection is one of FFmpeg's own values.
                projection = name(unsafe {
                    let mapping = data.data().as_ptr().cast::<ffi::AVSphericalMapping>();
                    ffi::av_spherical_projection_name((*mapping).projection)
                });
            }
            side_data::Type::Stereo3d if data.data().len() >= size_of::<ffi::AVStereo3D>() => {
                // SAFETY: as above, for `AVStereo3D`.
                stereo = name(unsafe {
                    let layout = data.data().as_ptr().cast::<ffi::AVStereo3D>();
                    ffi::av_stereo3d_type_name((*layout).type_ as u32)
                });
            }
            _ => {}
        }
    }
    projection.map(|projection: String| SphericalMetadata {
        is_cropped: projection == "tiled equirectangular",
        projection,
        stereo,
        origin: "container".to_owned(),
        conflict: None,
    })
}

/// A name from one of FFmpeg's static tables.
fn name(pointer: *const std::ffi::c_char) -> Option<String> {
    // SAFETY: the callers pass what FFmpeg's name functions returned: null or a static string.
    (!pointer.is_null()).then(|| {
        unsafe { CStr::from_ptr(pointer) }
            .to_string_lossy()
            .into_owned()
    })
}
