//! Decoding as a stream: one frame in memory at a time, with the source's timestamps.

use std::{
    num::NonZero,
    path::{Path, PathBuf},
    thread,
};

use ffmpeg::{
    codec,
    codec::threading,
    format::context,
    media,
    util::error::{EAGAIN, EMFILE, ENFILE, ENOMEM},
};
use ffmpeg_next as ffmpeg;

use crate::{error::VideoError, raw_fields::CodecId};

/// Maximum number of threads. Every thread holds frames; more do not decode faster.
const MOST_THREADS: usize = 16;

/// FFmpeg's names of supported containers. None refers to other files: no playlist, no list of images, no device.
const CONTAINERS: &str = "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mpegts,mpeg,mpegvideo,flv,ogg,asf,\
                          mxf,ivf,yuv4mpegpipe,h264,hevc,av1,obu,nut,gif,dv,rm,swf,m4v,wtv";
/// Supported codecs: those in which video is recorded and distributed today.
const CODECS: &[codec::Id] = &[
    codec::Id::H264,
    codec::Id::HEVC,
    codec::Id::AV1,
    codec::Id::VP8,
    codec::Id::VP9,
    codec::Id::MPEG1VIDEO,
    codec::Id::MPEG2VIDEO,
    codec::Id::MPEG4,
    codec::Id::MSMPEG4V3,
    codec::Id::H263,
    codec::Id::FLV1,
    codec::Id::WMV2,
    codec::Id::WMV3,
    codec::Id::VC1,
    codec::Id::THEORA,
    codec::Id::MJPEG,
    codec::Id::JPEG2000,
    codec::Id::PRORES,
    codec::Id::DNXHD,
    codec::Id::CFHD,
    codec::Id::DVVIDEO,
    codec::Id::FFV1,
    codec::Id::HUFFYUV,
    codec::Id::FFVHUFF,
    codec::Id::UTVIDEO,
    codec::Id::MAGICYUV,
    codec::Id::QTRLE,
    codec::Id::PNG,
    codec::Id::GIF,
    codec::Id::RAWVIDEO,
];

/// Reads the best video stream of a file from its first frame to its last.
///
/// Memory does not grow with the length of the video: packets and frames are dropped as they are
/// consumed.
pub struct VideoReader {
    path: PathBuf,
    input: context::Input,
    decoder: ffmpeg::decoder::Video,
    stream_index: usize,
    seconds_per_tick: f64,
    last_seconds: Option<f64>,
    packet_times: Option<[f64; 2]>,
    frames: u64,
    damaged: u64,
    out_of_time: u64,
    interlaced: u64,
    last_packet_is_partial: bool,
    draining: bool,
    only_key_frames: bool,
}

/// A decoded frame in the source's pixel format.
pub struct Frame {
    /// Presentation timestamp in seconds, as the source states it.
    pub time_seconds: f64,
    /// The pixels.
    pub image: ffmpeg::frame::Video,
}

impl VideoReader {
    /// Opens a file and its best video stream.
    ///
    /// # Errors
    /// [`VideoError::Unusable`] when the file is missing, empty, of no known container, without a
    /// video stream or in a codec that FFmpeg cannot decode.
    pub fn open(path: &Path) -> Result<Self, VideoError> {
        let input = open_container(path)?;
        let stream = input
            .streams()
            .best(media::Type::Video)
            .ok_or_else(|| VideoError::unusable(path, "has no video stream"))?;
        let id = stream.parameters().id();
        if !CODECS.contains(&id) {
            return Err(VideoError::unusable(
                path,
                format!(
                    "its video stream is {}, a codec that is not read",
                    id.name()
                ),
            ));
        }
        let mut codec = codec::Context::from_parameters(stream.parameters())
            .map_err(|error| VideoError::internal(path, error))?;
        // One more than there are cores, as in FFmpeg's default: threads wait for rows of frames that theirs depend on.
        let cores = thread::available_parallelism().map_or(1, NonZero::get);
        codec.set_threading(threading::Config {
            kind: threading::Type::Frame,
            count: (cores + 1).min(MOST_THREADS),
            ..threading::Config::default()
        });
        let id = CodecId::of(&stream);
        let opened = id
            .decoder()
            .ok_or(ffmpeg::Error::DecoderNotFound)
            .and_then(|found| codec.decoder().open_as(found)?.video());
        let decoder = opened.map_err(|error| {
            let reason = format!(
                "its video stream ({}) cannot be decoded: {error}",
                id.name()
            );
            failure(path, error, reason)
        })?;
        Ok(Self {
            stream_index: stream.index(),
            seconds_per_tick: f64::from(stream.time_base()),
            path: path.to_owned(),
            decoder,
            last_seconds: None,
            packet_times: None,
            frames: 0,
            damaged: 0,
            out_of_time: 0,
            interlaced: 0,
            last_packet_is_partial: false,
            draining: false,
            only_key_frames: false,
            input,
        })
    }

    /// Leaves out all but key frames, which decode by themselves, from here on. Damage and the end of the video
    /// are not reported reliably then.
    pub fn choose_key_frames(&mut self) {
        self.only_key_frames = true;
    }

    /// Returns the container, for [`probe`](mod@super::probe).
    pub(super) fn input(&self) -> &context::Input {
        &self.input
    }

    /// Returns the decoder, for [`probe`](mod@super::probe).
    pub(super) fn decoder(&self) -> &ffmpeg::decoder::Video {
        &self.decoder
    }

    /// Returns the stream being read.
    pub fn stream(&self) -> Option<ffmpeg::Stream<'_>> {
        self.input.stream(self.stream_index)
    }

    /// Returns the file being read.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the number of damaged frames and packets so far: patched up by the decoder, or left out because they are
    /// undecodable.
    pub fn damaged(&self) -> u64 {
        self.damaged
    }

    /// Returns the number of frames so far that were left out because they have no timestamp, or one that is not after
    /// that of the frame before.
    pub fn out_of_time(&self) -> u64 {
        self.out_of_time
    }

    /// Returns the number of frames so far that are marked as interlaced: rows of two moments alternate in them.
    pub fn interlaced(&self) -> u64 {
        self.interlaced
    }

    /// Returns the unit of the source's timestamps, seconds.
    pub fn seconds_per_tick(&self) -> f64 {
        self.seconds_per_tick
    }

    /// Returns the times of the earliest and the latest packet so far, seconds, those of sound and other streams among
    /// them.
    pub fn packet_times(&self) -> Option<[f64; 2]> {
        self.packet_times
    }

    /// Returns true if the last packet of the stream was cut off, as in a truncated file.
    pub fn ends_in_partial_packet(&self) -> bool {
        self.last_packet_is_partial
    }

    /// Returns the next frame in order of presentation, or `None` after the last.
    ///
    /// # Errors
    /// [`VideoError::Unusable`] when the container breaks off or the decoder gives up.
    pub fn next_frame(&mut self) -> Result<Option<Frame>, VideoError> {
        let mut image = ffmpeg::frame::Video::empty();
        loop {
            match self.decoder.receive_frame(&mut image) {
                Ok(()) => {
                    if let Some(time_seconds) = self.accept(&image) {
                        return Ok(Some(Frame {
                            time_seconds,
                            image,
                        }));
                    }
                }
                Err(ffmpeg::Error::Eof) => return Ok(None),
                Err(ffmpeg::Error::Other { errno: EAGAIN }) => self.feed()?,
                // One undecodable frame is not a reason to give up the rest; it is counted.
                Err(ffmpeg::Error::InvalidData) => self.damaged += 1,
                Err(error) => return Err(self.broken(&error)),
            }
        }
    }

    /// Hands the decoder its next packet, or the end of the stream.
    fn feed(&mut self) -> Result<(), VideoError> {
        let packet = loop {
            // A new one every time: reading into a filled packet would leak what it holds.
            let mut packet = ffmpeg::Packet::empty();
            let read = packet.read(&mut self.input);
            if read.is_ok() {
                self.note_time(&packet);
            }
            match read {
                Ok(())
                    if packet.stream() == self.stream_index
                        && (packet.is_key() || !self.only_key_frames) =>
                {
                    break packet;
                }
                Ok(()) => {}
                Err(ffmpeg::Error::Eof) if self.draining => {
                    return Err(self.broken(&ffmpeg::Error::Eof));
                }
                Err(ffmpeg::Error::Eof) => return self.drain(),
                Err(error) => return Err(self.broken(&error)),
            }
        };
        self.last_packet_is_partial = packet.is_corrupt();
        match self.decoder.send_packet(&packet) {
            Ok(()) => Ok(()),
            Err(ffmpeg::Error::InvalidData) => {
                self.damaged += 1;
                Ok(())
            }
            Err(error) => Err(self.broken(&error)),
        }
    }

    /// Takes the time of a packet of any stream into account.
    fn note_time(&mut self, packet: &ffmpeg::Packet) {
        let stream = self.input.stream(packet.stream());
        let ticks = packet.pts().or_else(|| packet.dts());
        if let (Some(stream), Some(ticks)) = (stream, ticks) {
            let seconds = ticks as f64 * f64::from(stream.time_base());
            let [first, last] = self.packet_times.unwrap_or([seconds; 2]);
            self.packet_times = Some([first.min(seconds), last.max(seconds)]);
        }
    }

    /// Takes the remaining frames from the decoder.
    fn drain(&mut self) -> Result<(), VideoError> {
        self.draining = true;
        match self.decoder.send_eof() {
            // The decoder is at its end already; the error belongs to an earlier packet that is decoded only now.
            Err(ffmpeg::Error::InvalidData) => {
                self.damaged += 1;
                Ok(())
            }
            ended => ended.map_err(|error| self.broken(&error)),
        }
    }

    /// Returns the timestamp of a frame in seconds; frames without an increasing one are counted and left out.
    fn accept(&mut self, image: &ffmpeg::frame::Video) -> Option<f64> {
        let time_seconds = image
            .timestamp()
            .map(|ticks| ticks as f64 * self.seconds_per_tick)
            .filter(|&time| self.last_seconds.is_none_or(|last| time > last));
        let is_patched = image.is_corrupt() || image.has_decode_errors();
        self.damaged += u64::from(is_patched);
        self.out_of_time += u64::from(time_seconds.is_none() && !is_patched);
        if time_seconds.is_some() {
            self.last_seconds = time_seconds;
            self.frames += 1;
            self.interlaced += u64::from(image.is_interlaced());
        }
        time_seconds
    }

    fn broken(&self, error: &ffmpeg::Error) -> VideoError {
        let place = match self.last_seconds {
            Some(seconds) => format!("after frame {} at {seconds:.3} s", self.frames - 1),
            None => "at its first frame".to_owned(),
        };
        let reason = format!("breaks off {place} (truncated or damaged): {error}");
        failure(&self.path, *error, reason)
    }
}

/// Returns the error of an FFmpeg failure: the video's fault, unless the machine is out of resources.
fn failure(path: &Path, error: ffmpeg::Error, reason: String) -> VideoError {
    match error {
        ffmpeg::Error::Other {
            errno: EAGAIN | EMFILE | ENFILE | ENOMEM,
        } => VideoError::internal(path, reason),
        _ => VideoError::unusable(path, reason),
    }
}

/// Prepares FFmpeg for work on a file, with its own log silenced.
pub(crate) fn begin_ffmpeg(path: &Path) -> Result<(), VideoError> {
    ffmpeg::init().map_err(|error| VideoError::internal(path, error))?;
    ffmpeg::log::set_level(ffmpeg::log::Level::Quiet);
    Ok(())
}

/// Opens a container of local data only.
///
/// # Errors
/// [`VideoError::Unusable`] when the file is missing, empty or of no known container.
pub fn open_container(path: &Path) -> Result<context::Input, VideoError> {
    omnilife_schemas::error_kind::reading(path);
    begin_ffmpeg(path)?;
    let metadata = std::fs::metadata(path)
        .map_err(|error| VideoError::unusable(path, format!("cannot be read: {error}")))?;
    if metadata.is_dir() {
        return Err(VideoError::unusable(path, "is a folder, not a video"));
    }
    if metadata.len() == 0 {
        return Err(VideoError::unusable(path, "is empty (0 bytes)"));
    }
    let text = path
        .to_str()
        .filter(|text| !text.contains('\0'))
        .ok_or_else(|| VideoError::unusable(path, "its path is not valid UTF-8"))?;
    // The prefix keeps FFmpeg from reading a protocol into the name. The whitelists keep it from
    // opening any other file: a playlist in disguise would be curated under the hash of the playlist.
    let mut options = ffmpeg::Dictionary::new();
    options.set("protocol_whitelist", "file");
    options.set("format_whitelist", CONTAINERS);
    ffmpeg::format::input_with_dictionary(&format!("file:{text}"), options).map_err(|error| {
        let reason = format!("is not a video that FFmpeg can read, or is truncated: {error}");
        failure(path, error, reason)
    })
}
