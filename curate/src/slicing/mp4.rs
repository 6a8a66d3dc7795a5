//! Encoding frames as H.264 in mp4, the same on every machine.

use std::{
    collections::VecDeque,
    fs::File,
    io,
    path::{Path, PathBuf},
};

use ffmpeg::{
    Dictionary, Packet, Rational, codec, encoder,
    format::{self, Pixel, context::Output},
    frame,
    software::scaling::Flags,
};
use ffmpeg_next as ffmpeg;
use omnilife_schemas::store::{self, StoreError, Unfinished};

use super::{
    audio::{AudioCopy, AudioTrack},
    spherical_boxes::{self, Orientation},
};
use crate::{
    error::CurateError,
    video::{Colour, FrameShape, PixelFormat, Scaler, begin_ffmpeg, clear_image_kind},
};

/// FFmpeg's name of the encoder.
const ENCODER: &str = "libx264";
/// Encoder and settings, for the record. No B-frames, so that timestamps start at 0 without edit lists; a fixed number
/// of threads, because x264's output depends on it.
pub const ENCODER_SETTINGS: &str = "libx264 crf 16, preset fast, no B-frames, 4 threads";

/// Frame rate for computing the level; frames are shown at their own times.
const USUAL_FRAME_RATE: Rational = Rational(60, 1);

/// Quality of the images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quality {
    /// Visually lossless: [`ENCODER_SETTINGS`].
    VisuallyLossless,
    /// A preview: few bits, and key frames close together, so that a player can jump to any frame.
    Proxy,
}

impl Quality {
    /// Frames from one key frame to the next, at most.
    fn key_frame_distance(self) -> u32 {
        match self {
            Self::VisuallyLossless => 60,
            Self::Proxy => 24,
        }
    }

    /// Returns x264's constant rate factor and preset.
    fn rate_and_preset(self) -> [(&'static str, &'static str); 2] {
        match self {
            Self::VisuallyLossless => [("crf", "16"), ("preset", "fast")],
            Self::Proxy => [("crf", "31"), ("preset", "faster")],
        }
    }
}

/// Parameters of an encoder, before its first frame.
#[derive(Debug, Clone, Copy)]
pub struct VideoFormat {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Format of the frames that will be pushed.
    pub pixel: PixelFormat,
    /// Seconds per tick of their timestamps.
    pub time_base: Rational,
    /// Width of a pixel over its height.
    pub pixel_aspect: Rational,
    /// Meaning of the numbers.
    pub colour: Colour,
    /// Rotation that players apply to the frames.
    pub orientation: Orientation,
    /// Projection of the frames.
    pub projection: Projection,
    /// Quality of the encoding.
    pub quality: Quality,
}

impl VideoFormat {
    fn shape(&self) -> FrameShape {
        FrameShape {
            format: self.pixel,
            width: self.width,
            height: self.height,
        }
    }
}

/// Projection of frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Projection {
    /// The whole sphere, equirectangular: stated in the file's spherical metadata.
    Equirectangular,
    /// A part of the scene through a lens.
    Flat,
}

/// Writes one mp4 from frames with increasing timestamps.
///
/// The file appears under its name only when [`finish`](Self::finish) succeeds.
pub struct Mp4Encoder {
    path: PathBuf,
    /// `None` once the file is ended.
    output: Option<Output>,
    encoder: encoder::video::Encoder,
    video: VideoFormat,
    /// Converts frames to a pixel format of the encoder if it does not support theirs.
    scaler: Option<Scaler>,
    audio: Option<AudioCopy>,
    /// The frame pushed last, which waits for its duration to be known.
    waiting: Option<(frame::Video, i64)>,
    /// Timestamps and durations of the frames inside the encoder, in order.
    inside: VecDeque<(i64, i64)>,
    /// Behind the output, which is closed before this is removed.
    temporary: Unfinished,
}

impl Mp4Encoder {
    /// Creates the file at `path`, with a copy of `audio` if there is some.
    ///
    /// # Errors
    /// [`CurateError::Internal`] when FFmpeg was built without x264 or refuses the format,
    /// [`CurateError::Store`] when the file cannot be created.
    pub fn create(
        path: &Path,
        video: VideoFormat,
        audio: Option<AudioTrack>,
    ) -> Result<Self, CurateError> {
        let internal = |error: ffmpeg::Error| CurateError::internal(path, error);
        begin_ffmpeg(path)?;
        let codec = encoder::find_by_name(ENCODER).ok_or_else(|| {
            CurateError::internal(
                path,
                format!(
                    "cannot be encoded: the FFmpeg libraries have no {ENCODER} encoder; \
                     install an FFmpeg that has it (Debian's libavcodec does)"
                ),
            )
        })?;
        let temporary = Unfinished::beside(path);
        let mut output = create_output(temporary.path())?;
        let pixel = accepted_format(codec, video.pixel);
        let mut context = codec::context::Context::new_with_codec(codec)
            .encoder()
            .video()
            .map_err(internal)?;
        context.set_width(video.width);
        context.set_height(video.height);
        context.set_format(pixel);
        context.set_time_base(video.time_base);
        // x264 derives the level from it, else from a frame per tick: then many players refuse the file.
        context.set_frame_rate(Some(USUAL_FRAME_RATE));
        context.set_aspect_ratio(video.pixel_aspect);
        context.set_colorspace(video.colour.space);
        context.set_color_range(video.colour.range);
        context.set_color_primaries(video.colour.primaries);
        context.set_color_transfer_characteristic(video.colour.transfer);
        context.set_gop(video.quality.key_frame_distance());
        context.set_flags(codec::Flags::GLOBAL_HEADER);
        let mut options = Dictionary::new();
        let [rate, preset] = video.quality.rate_and_preset();
        for (key, value) in [rate, preset, ("bf", "0"), ("threads", "4")] {
            options.set(key, value);
        }
        let encoder = context.open_with(options).map_err(internal)?;
        let mut stream = output.add_stream(codec).map_err(internal)?;
        stream.set_parameters(&encoder);
        stream.set_time_base(video.time_base);
        let audio = audio
            .map(|track| AudioCopy::attach(track, &mut output))
            .transpose()
            .map_err(internal)?;
        output
            .write_header()
            .map_err(|error| unwritable(path, error))?;
        let target = FrameShape {
            format: pixel.into(),
            ..video.shape()
        };
        let scaler = (target != video.shape())
            .then(|| {
                let flags = Flags::BICUBIC | Flags::ACCURATE_RND;
                Scaler::new(video.shape(), target, flags)
            })
            .transpose()
            .map_err(internal)?;
        Ok(Self {
            path: path.to_owned(),
            output: Some(output),
            encoder,
            video,
            scaler,
            audio,
            waiting: None,
            inside: VecDeque::new(),
            temporary,
        })
    }

    /// Adds a frame shown from `ticks` on.
    ///
    /// # Errors
    /// When the frame has another size than the first, `ticks` does not increase, or the file
    /// cannot be written.
    pub fn push(&mut self, frame: frame::Video, ticks: i64) -> Result<(), CurateError> {
        let shape = FrameShape::of(&frame);
        if shape != self.video.shape() {
            return Err(CurateError::internal(
                &self.path,
                format!("its frames change to {}x{}", shape.width, shape.height),
            ));
        }
        if let Some((waiting, since)) = self.waiting.take() {
            if ticks <= since {
                return Err(CurateError::internal(
                    &self.path,
                    "its timestamps do not increase",
                ));
            }
            self.encode(waiting, since, ticks - since)?;
        }
        self.waiting = Some((frame, ticks));
        Ok(())
    }

    /// Ends the last frame at `end_ticks` and puts the file under its name.
    ///
    /// # Errors
    /// When no frame was pushed or the file cannot be written.
    pub fn finish(mut self, end_ticks: i64) -> Result<(), CurateError> {
        let Some((waiting, since)) = self.waiting.take() else {
            return Err(CurateError::internal(&self.path, "it has no frames"));
        };
        self.encode(waiting, since, (end_ticks - since).max(1))?;
        let internal = |error: ffmpeg::Error| CurateError::internal(&self.path, error);
        self.encoder.send_eof().map_err(internal)?;
        self.drain()?;
        let Some(mut output) = self.output.take() else {
            return Err(CurateError::internal(&self.path, "it is ended already"));
        };
        if let Some(audio) = &mut self.audio {
            audio.write_until(f64::INFINITY, &mut output)?;
        }
        close_output(
            output,
            self.temporary.path(),
            &self.path,
            self.video.projection,
            self.video.orientation,
        )
    }

    fn encode(
        &mut self,
        frame: frame::Video,
        ticks: i64,
        duration: i64,
    ) -> Result<(), CurateError> {
        let internal = |error: ffmpeg::Error| CurateError::internal(&self.path, error);
        let mut frame = match &mut self.scaler {
            None => frame,
            Some(scaler) => scaler.run(&frame).map_err(internal)?,
        };
        frame.set_pts(Some(ticks));
        // Key frames are the encoder's decision, not the source's.
        clear_image_kind(&mut frame);
        self.encoder.send_frame(&frame).map_err(internal)?;
        self.inside.push_back((ticks, duration));
        self.drain()
    }

    /// Writes the encoder's finished packets.
    fn drain(&mut self) -> Result<(), CurateError> {
        let Some(output) = &mut self.output else {
            return Ok(());
        };
        let stream_base = output
            .stream(0)
            .map_or(self.video.time_base, |stream| stream.time_base());
        loop {
            let mut packet = Packet::empty();
            if self.encoder.receive_packet(&mut packet).is_err() {
                return Ok(());
            }
            if let Some((ticks, duration)) = self.inside.pop_front() {
                debug_assert_eq!(packet.pts(), Some(ticks), "frames leave in order");
                packet.set_duration(duration);
                if let Some(audio) = &mut self.audio {
                    let seconds = ticks as f64 * f64::from(self.video.time_base);
                    audio.write_until(seconds, output)?;
                }
            }
            packet.set_stream(0);
            packet.rescale_ts(self.video.time_base, stream_base);
            packet
                .write_interleaved(output)
                .map_err(|error| unwritable(&self.path, error))?;
        }
    }
}

/// The frames' own format where the encoder takes it, else 8-bit 4:2:0.
fn accepted_format(codec: ffmpeg::Codec, wanted: PixelFormat) -> Pixel {
    let formats = codec.video().ok().and_then(|video| video.formats());
    formats
        .and_then(|mut formats| formats.find(|&format| PixelFormat::from(format) == wanted))
        .unwrap_or(Pixel::YUV420P)
}

/// Opens an mp4 file for writing.
pub(super) fn create_output(path: &Path) -> Result<Output, CurateError> {
    let text = path
        .to_str()
        .filter(|text| !text.contains('\0'))
        .ok_or_else(|| CurateError::input(path, "its path is not valid UTF-8"))?;
    format::output_as(&format!("file:{text}"), "mp4").map_err(|error| unwritable(path, error))
}

fn mark(path: &Path, projection: Projection, orientation: Orientation) -> io::Result<()> {
    match projection {
        Projection::Equirectangular => spherical_boxes::mark_equirectangular(path, orientation),
        Projection::Flat => Ok(()),
    }
}

/// Ends an mp4 file, marks whole spheres in its metadata and gives the file its final name.
pub(super) fn close_output(
    mut output: Output,
    temporary: &Path,
    path: &Path,
    projection: Projection,
    orientation: Orientation,
) -> Result<(), CurateError> {
    let ended = output.write_trailer();
    drop(output);
    let published = match ended {
        Ok(()) => mark(temporary, projection, orientation)
            .and_then(|()| File::open(temporary)?.sync_all())
            .and_then(|()| store::rename(temporary, path)),
        Err(error) => Err(io::Error::other(error)),
    };
    published.map_err(|error| StoreError::write(path, error).into())
}

/// Returns the error of FFmpeg's writer: in all likelihood the disk's.
pub(super) fn unwritable(path: &Path, error: ffmpeg::Error) -> CurateError {
    StoreError::write(path, io::Error::other(error)).into()
}
