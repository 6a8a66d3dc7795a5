//! Slices that are decoded and re-encoded.

use ffmpeg::{Rational, frame};
use ffmpeg_next as ffmpeg;
use omnilife_schemas::progress::Progress;
use omnilife_video::{
    Colour, PixelFormat, Projection, Quality, VideoReader,
    writing::{
        audio::AudioTrack,
        mp4::{Mp4Encoder, VideoFormat},
    },
};

use super::{SliceRequest, SliceSettings, SliceSource};
use crate::error::CurateError;

/// Encodes the requests named by `which` (in order of time), in one pass over the source.
pub(super) fn encode_slices(
    source: &SliceSource<'_>,
    requests: &[SliceRequest],
    which: &[usize],
    settings: SliceSettings,
    progress: &dyn Progress,
) -> Result<(), CurateError> {
    let mut reader = VideoReader::open(source.video)?;
    let seconds_per_tick = reader.seconds_per_tick();
    let time_base = reader
        .stream()
        .map(|stream| stream.time_base())
        .ok_or_else(|| CurateError::internal(source.video, "the video stream is gone"))?;
    let ticks = |seconds: f64| (seconds / seconds_per_tick).round() as i64;
    let total: usize = which
        .iter()
        .map(|&index| source.times_in(requests[index].range).len())
        .sum();
    progress.begin("encoding slices", Some(total as u64));
    let encoded = (|| {
        let mut due = which.iter().map(|&index| &requests[index]);
        let Some(mut request) = due.next() else {
            return Ok(());
        };
        let mut open: Option<Mp4Encoder> = None;
        while let Some(frame) = reader.next_frame()? {
            // A slice ends with the frame before the first that lies behind it.
            while frame.time_seconds >= request.range.end_seconds - 0.5 * seconds_per_tick {
                let end = ticks(request.range.end_seconds) - ticks(request.range.begin_seconds);
                if let Some(encoder) = open.take() {
                    encoder.finish(end)?;
                }
                let Some(next) = due.next() else {
                    return Ok(());
                };
                request = next;
            }
            if frame.time_seconds < request.range.begin_seconds - 0.5 * seconds_per_tick {
                continue;
            }
            let mut encoder = match open.take() {
                Some(encoder) => encoder,
                None => {
                    let audio = audio_for(source, request, settings, progress)?;
                    let video = format_of(source, &frame.image, time_base);
                    Mp4Encoder::create(&request.path, video, audio)?
                }
            };
            let offset = ticks(frame.time_seconds) - ticks(request.range.begin_seconds);
            encoder.push(frame.image, offset)?;
            open = Some(encoder);
            progress.advance(1);
        }
        if let Some(encoder) = open {
            encoder
                .finish(ticks(request.range.end_seconds) - ticks(request.range.begin_seconds))?;
        }
        Ok(())
    })();
    progress.end();
    encoded
}

fn format_of(source: &SliceSource<'_>, first: &frame::Video, time_base: Rational) -> VideoFormat {
    VideoFormat {
        width: first.width(),
        height: first.height(),
        pixel: PixelFormat::of(first),
        time_base,
        pixel_aspect: first.aspect_ratio(),
        colour: Colour::of(first),
        orientation: source.orientation,
        projection: Projection::Equirectangular,
        quality: Quality::VisuallyLossless,
    }
}

/// Returns the sound of a slice, if wanted, present and allowed in mp4; otherwise a note gives the reason.
pub(super) fn audio_for(
    source: &SliceSource<'_>,
    request: &SliceRequest,
    settings: SliceSettings,
    progress: &dyn Progress,
) -> Result<Option<AudioTrack>, CurateError> {
    if !settings.audio {
        return Ok(None);
    }
    let without = |reason: &str| {
        progress.note(&format!(
            "{}: {}: no sound: {reason}",
            source.video.display(),
            request.name
        ));
        None
    };
    Ok(match AudioTrack::open(source.video, request.range)? {
        Ok(Some(track)) => Some(track),
        Ok(None) => without("the source has none"),
        Err(reason) => without(&reason),
    })
}
