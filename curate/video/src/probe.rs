//! Metadata of a video file.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::path::Path;

use ffmpeg::{color::Space, ffi, format::stream::Disposition};
use ffmpeg_next as ffmpeg;
use omnilife_schemas::{
    records::{Probe, SphereTurn, SphericalMetadata},
    store::StoreError,
};

use super::{
    decode::VideoReader,
    matrix::Matrix,
    raw_fields::{self, CodecId, SideData},
    spherical_boxes::{self, Extent, SphericalBoxes, Statement},
};
use crate::error::VideoError;

/// Probes a video: its container and the parameters of its best video stream.
///
/// Nothing is decoded; the measured entries (`decoded_frames`, `variable_frame_rate`) are `None`
/// until an analysis pass fills them in.
///
/// # Errors
/// [`VideoError::Unusable`] when the file cannot be opened as a video.
pub fn probe(path: &Path) -> Result<Probe, VideoError> {
    describe(&VideoReader::open(path)?)
}

/// Returns the probe of an open video.
///
/// # Errors
/// [`VideoError::Unusable`] when its stream has no size, or is stored mirrored, askew or as half a sphere. Also when the
/// file has a larger video stream than its default one.
pub fn describe(reader: &VideoReader) -> Result<Probe, VideoError> {
    let path = reader.path();
    let stream = reader
        .stream()
        .ok_or_else(|| VideoError::internal(path, "the video stream is gone"))?;
    let decoder = reader.decoder();
    let (width, height) = (decoder.width(), decoder.height());
    if width == 0 || height == 0 {
        return Err(VideoError::unusable(path, "its video stream has no size"));
    }
    refuse_other_halves(reader, &stream)?;
    refuse_larger_stream(reader, &stream)?;
    let format = raw_fields::pixel_format(decoder);
    let matrix = display_matrix(&stream);
    if matrix.is_some_and(|matrix| mirrors(&matrix)) {
        let reason =
            "its display matrix mirrors it, and frames are taken as they are stored or turned";
        let advice = "have it applied: ffmpeg -i IN OUT";
        return Err(VideoError::mendable(path, reason, advice));
    }
    let rotation_degrees = matrix.map_or(0.0, |matrix| rotation_degrees(&matrix));
    if rotation_degrees.rem_euclid(90.0) != 0.0 {
        return Err(VideoError::unusable(
            path,
            format!("display rotation of {rotation_degrees} degrees is not a quarter turn"),
        ));
    }
    let frame_rate = [stream.avg_frame_rate(), stream.rate()]
        .into_iter()
        .find(|rate| rate.numerator() > 0 && rate.denominator() > 0);
    Ok(Probe {
        container: reader.input().format().name().to_owned(),
        codec: CodecId::of(&stream).name().to_owned(),
        width,
        height,
        pixel_format: format.name().to_owned(),
        bit_depth: format.bit_depth(),
        frames_per_second: frame_rate.map_or(0.0, f64::from),
        duration_seconds: duration_seconds(reader, &stream),
        decoded_frames: None,
        variable_frame_rate: None,
        longest_interval_seconds: None,
        rotation_degrees,
        pixel_aspect_ratio: pixel_aspect_ratio(decoder),
        transfer: raw_fields::transfer_name(decoder).to_owned(),
        primaries: raw_fields::primaries_name(decoder).to_owned(),
        assumed_matrix: (format.has_matrix() && raw_fields::matrix(decoder) == Space::Unspecified)
            .then(|| Matrix::assumed(width, height).name().to_owned()),
        spherical: spherical(path, reader.input().format().name(), &stream)?,
    })
}

/// Returns the stream's duration, else the container's, else 0.
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

/// Refuses a file with further video streams of the same size as the read one: it holds a sphere in several parts.
fn refuse_other_halves(
    reader: &VideoReader,
    stream: &ffmpeg::Stream<'_>,
) -> Result<(), VideoError> {
    let size = raw_fields::video_size(stream);
    let is_alike = |other: &ffmpeg::Stream<'_>| {
        let is_cover = other.disposition().contains(Disposition::ATTACHED_PIC);
        raw_fields::video_size(other) == size && !is_cover
    };
    let alike = reader.input().streams().filter(is_alike).count();
    let (Some([width, height]), 2..) = (size, alike) else {
        return Ok(());
    };
    Err(VideoError::mendable(
        reader.path(),
        format!(
            "has {alike} video streams of {width}x{height} pixels, as cameras store halves of the sphere (GoPro \
             .360) or one lens each (Insta360 .insv), and one alone is half a sphere"
        ),
        "make one equirectangular video of it with the program of the camera's maker",
    ))
}

/// Refuses a file with a video stream larger than the one that it marks as its default, which is read: a preview.
fn refuse_larger_stream(
    reader: &VideoReader,
    stream: &ffmpeg::Stream<'_>,
) -> Result<(), VideoError> {
    let pixels = |[width, height]: [i32; 2]| i64::from(width).saturating_mul(height.into());
    let Some(size) = raw_fields::video_size(stream) else {
        return Ok(());
    };
    let others = reader.input().streams().filter_map(|other| {
        let is_cover = other.disposition().contains(Disposition::ATTACHED_PIC);
        let size = raw_fields::video_size(&other).filter(|_| !is_cover)?;
        Some((other.index(), size))
    });
    let larger = others.max_by_key(|(_, size)| pixels(*size));
    let larger = larger.filter(|(_, other)| pixels(*other) > pixels(size));
    let (Some((number, [width, height])), [own_width, own_height]) = (larger, size) else {
        return Ok(());
    };
    let reason = format!(
        "has video streams of several sizes: the default one, 0:{}, of {own_width}x{own_height} pixels, and 0:{number} \
         of {width}x{height}",
        stream.index()
    );
    let advice = "keep the one that you mean: ffmpeg -i IN -map 0:NUMBER -c copy OUT";
    Err(VideoError::mendable(reader.path(), reason, advice))
}

/// Returns the display matrix, row by row, if the stream has one.
fn display_matrix(stream: &ffmpeg::Stream<'_>) -> Option<[i32; 9]> {
    let data = raw_fields::side_data(stream, SideData::DisplayMatrix)?;
    let values = data.as_chunks::<4>().0.first_chunk::<9>()?;
    Some(values.map(i32::from_ne_bytes))
}

/// Returns true if a display matrix mirrors the image: its determinant is negative.
fn mirrors(&[a, b, _, c, d, ..]: &[i32; 9]) -> bool {
    let [a, b, c, d] = [a, b, c, d].map(f64::from);
    a * d - b * c < 0.0
}

/// Returns the clockwise display rotation in [0, 360), rounded to a hundredth of a degree.
fn rotation_degrees(matrix: &[i32; 9]) -> f64 {
    // SAFETY: the function reads nine integers.
    let counter_clockwise = unsafe { ffi::av_display_rotation_get(matrix.as_ptr()) };
    if counter_clockwise.is_finite() {
        (-counter_clockwise * 100.0).round().rem_euclid(36000.0) / 100.0
    } else {
        0.0
    }
}

/// Returns spherical metadata: the file's own boxes if it has some, else FFmpeg's.
fn spherical(
    path: &Path,
    container: &str,
    stream: &ffmpeg::Stream<'_>,
) -> Result<Option<SphericalMetadata>, VideoError> {
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

/// Merges both versions; version 2 wins, entry by entry.
fn resolved(SphericalBoxes { v1, v2 }: SphericalBoxes) -> Option<SphericalMetadata> {
    let words = |statement: &Statement| {
        format!(
            "{}{}, {}",
            match statement.extent {
                Extent::Whole => "",
                Extent::FrontHalf => "half of ",
                Extent::Part => "cropped ",
            },
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
    let extent = if newer.projection.is_some() {
        newer.extent
    } else {
        older.extent
    };
    let (pose, pose_fault) = turn("a pose", newer.turn);
    let (initial_view, view_fault) = turn("an initial view", older.turn);
    let faults: Vec<String> = [pose_fault, view_fault].into_iter().flatten().collect();
    Some(SphericalMetadata {
        is_cropped: extent != Extent::Whole,
        is_front_half: extent == Extent::FrontHalf,
        pose,
        initial_view,
        turn_fault: (!faults.is_empty()).then(|| faults.join("; ")),
        origin: if v2.is_some() { "v2" } else { "v1" }.to_owned(),
        projection: newer.projection.or(older.projection)?,
        stereo: newer.stereo.or(older.stereo),
        is_right_eye_first: false,
        conflict,
    })
}

/// Returns the rotation of these yaw, pitch and roll in 16.16 degrees, unless they are zero. If they are out of range,
/// a line that calls it `name` says so. The ranges are those of `prhd` in `docs/spherical-video-v2-rfc.md` of
/// `google/spatial-media`.
fn turn(name: &str, stated: Option<[i32; 3]>) -> (Option<SphereTurn>, Option<String>) {
    let Some(numbers) = stated.filter(|numbers| *numbers != [0; 3]) else {
        return (None, None);
    };
    let [yaw_degrees, pitch_degrees, roll_degrees] =
        numbers.map(|number| f64::from(number) / 65536.0);
    if yaw_degrees.abs() > 180.0 || pitch_degrees.abs() > 90.0 || roll_degrees.abs() > 180.0 {
        let fault = format!(
            "{name} of yaw {yaw_degrees}, pitch {pitch_degrees} and roll {roll_degrees} degrees is out of range \
             (180, 90 and 180 either way) and not taken"
        );
        return (None, Some(fault));
    }
    let turn = SphereTurn {
        yaw_degrees,
        pitch_degrees,
        roll_degrees,
    };
    (Some(turn), None)
}

/// Returns spherical and stereo side data as FFmpeg parses them.
fn side_data_of(stream: &ffmpeg::Stream<'_>) -> Option<SphericalMetadata> {
    let mapping = raw_fields::side_data(stream, SideData::Spherical)?;
    let projection = raw_fields::projection_name(&mapping)?;
    let extent = match projection {
        "tiled equirectangular" => {
            raw_fields::bounds(&mapping).map_or(Extent::Part, Extent::of_bounds)
        }
        _ => Extent::Whole,
    };
    let layout = raw_fields::side_data(stream, SideData::Stereo);
    let stereo = layout.as_deref().and_then(raw_fields::stereo_name);
    let has_padding = raw_fields::padding(&mapping).is_none_or(|pixels| pixels > 0);
    let name = match projection {
        // A single tile.
        _ if extent == Extent::FrontHalf => "equirectangular",
        spherical_boxes::CUBEMAP if has_padding => spherical_boxes::OTHER_CUBEMAP,
        _ => projection,
    };
    let (pose, turn_fault) = turn("a pose", raw_fields::pose(&mapping));
    Some(SphericalMetadata {
        is_cropped: extent != Extent::Whole,
        is_front_half: extent == Extent::FrontHalf,
        pose,
        initial_view: None,
        turn_fault,
        projection: name.to_owned(),
        stereo: stereo.map(str::to_owned),
        is_right_eye_first: layout
            .as_deref()
            .is_some_and(raw_fields::is_right_eye_first),
        origin: "container".to_owned(),
        conflict: None,
    })
}
