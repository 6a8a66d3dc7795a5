//! Copy of a slice's sound.

use std::path::Path;

use ffmpeg::{
    Packet, Rational, codec, encoder,
    format::context::{Input, Output},
    media,
};
use ffmpeg_next as ffmpeg;
use omnilife_schemas::records::TimeRange;

use crate::{decode::open_container, error::VideoError, raw_fields::CodecId};

/// Codecs of sound that mp4 holds and players expect in it.
const MP4_CODECS: &[codec::Id] = &[
    codec::Id::AAC,
    codec::Id::MP3,
    codec::Id::AC3,
    codec::Id::EAC3,
    codec::Id::OPUS,
    codec::Id::FLAC,
    codec::Id::ALAC,
];

/// Returns true if a file has sound.
///
/// # Errors
/// When the file cannot be read as a video.
pub fn has_audio(path: &Path) -> Result<bool, VideoError> {
    Ok(open_container(path)?
        .streams()
        .best(media::Type::Audio)
        .is_some())
}

/// The sound of one segment of a video, read beside its images.
pub struct AudioTrack {
    input: Input,
    index: usize,
    time_base: Rational,
    range: TimeRange,
    source: std::path::PathBuf,
}

impl AudioTrack {
    /// Opens the best sound track of `video` in `range`. `None` if it has none; a codec that mp4 cannot hold is an
    /// `Err` with the reason.
    ///
    /// # Errors
    /// When the file cannot be read as a video.
    pub fn open(
        video: &Path,
        range: TimeRange,
    ) -> Result<Result<Option<Self>, String>, VideoError> {
        let mut input = open_container(video)?;
        let Some(stream) = input.streams().best(media::Type::Audio) else {
            return Ok(Ok(None));
        };
        let id = CodecId::of(&stream);
        if !id.is_among(MP4_CODECS) {
            return Ok(Err(format!("mp4 holds no {} sound", id.name())));
        }
        let (index, time_base) = (stream.index(), stream.time_base());
        let begin = (range.begin_seconds * f64::from(ffmpeg::ffi::AV_TIME_BASE)) as i64;
        // If seeking fails, reading starts at the beginning of the file, which only takes longer.
        if input.seek(begin, ..begin).is_err() {
            input = open_container(video)?;
        }
        Ok(Ok(Some(Self {
            input,
            index,
            time_base,
            range,
            source: video.to_owned(),
        })))
    }

    /// Returns the next packet that starts inside the segment, with timestamps from the segment's start.
    fn next(&mut self) -> Option<(f64, Packet)> {
        loop {
            let mut packet = Packet::empty();
            packet.read(&mut self.input).ok()?;
            if packet.stream() != self.index {
                continue;
            }
            let Some(pts) = packet.pts() else { continue };
            let seconds = pts as f64 * f64::from(self.time_base);
            if seconds >= self.range.end_seconds {
                return None;
            }
            if seconds >= self.range.begin_seconds {
                let offset = (self.range.begin_seconds / f64::from(self.time_base)).round() as i64;
                packet.set_pts(Some(pts - offset));
                packet.set_dts(packet.dts().map(|dts| dts - offset));
                return Some((seconds - self.range.begin_seconds, packet));
            }
        }
    }
}

/// A track that is being copied into an output, as its second stream.
pub struct AudioCopy {
    track: AudioTrack,
    waiting: Option<(f64, Packet)>,
}

impl AudioCopy {
    /// Adds the stream to an output whose header is not written yet.
    ///
    /// # Errors
    /// When FFmpeg cannot add it.
    pub fn attach(mut track: AudioTrack, output: &mut Output) -> Result<Self, ffmpeg::Error> {
        let parameters = track
            .input
            .stream(track.index)
            .ok_or(ffmpeg::Error::StreamNotFound)?
            .parameters();
        let mut stream = output.add_stream(encoder::find(codec::Id::None))?;
        stream.set_parameters(parameters);
        stream.set_time_base(track.time_base);
        clear_codec_tag(&mut stream);
        let waiting = track.next();
        Ok(Self { track, waiting })
    }

    /// Writes all packets up to `seconds` after the start of the slice.
    ///
    /// # Errors
    /// When the output cannot be written.
    pub fn write_until(&mut self, seconds: f64, output: &mut Output) -> Result<(), VideoError> {
        let base = output
            .stream(1)
            .map_or(self.track.time_base, |stream| stream.time_base());
        while let Some((begin, mut packet)) = self.waiting.take() {
            if begin > seconds {
                self.waiting = Some((begin, packet));
                break;
            }
            packet.rescale_ts(self.track.time_base, base);
            packet.set_position(-1);
            packet.set_stream(1);
            packet
                .write_interleaved(output)
                .map_err(|error| VideoError::unwritable(&self.track.source, error))?;
            self.waiting = self.track.next();
        }
        Ok(())
    }
}

/// Clears the codec tag: that of another container may mean nothing, or something else, in mp4.
pub fn clear_codec_tag(stream: &mut ffmpeg::StreamMut<'_>) {
    // SAFETY: the stream belongs to an output that is being set up; nothing else refers to it.
    unsafe {
        (*(*stream.as_mut_ptr()).codecpar).codec_tag = 0;
    }
}
