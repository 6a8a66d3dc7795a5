//! Slices as stream copies: the packets of the source, with timestamps from the slice's start.

use std::path::Path;

use ffmpeg::{Packet, Rational, codec, encoder, format::context::Output, media};
use ffmpeg_next as ffmpeg;
use omnilife_schemas::{progress::Progress, store::Unfinished};

use super::{
    SliceRequest, SliceSettings, SliceSource,
    audio::{AudioCopy, AudioTrack, clear_codec_tag},
    encode::audio_for,
    mp4::{Projection, close_output, create_output, unwritable},
    packets::{PacketTable, Run},
    spherical_boxes::Orientation,
};
use crate::{error::CurateError, video::open_container};

/// Copies runs of packets, in one pass over the source. `runs` are in order of time and name their request.
pub(super) fn copy_runs(
    source: &SliceSource<'_>,
    table: &PacketTable,
    runs: &[(usize, Run)],
    requests: &[SliceRequest],
    settings: SliceSettings,
    progress: &dyn Progress,
) -> Result<(), CurateError> {
    let mut input = open_container(source.video)?;
    let stream = input
        .streams()
        .best(media::Type::Video)
        .ok_or_else(|| CurateError::video(source.video, "has no video stream"))?;
    let index = stream.index();
    let parameters = stream.parameters();
    let time_base = stream.time_base();
    let total = runs.last().map_or(0, |(_, run)| run.end);
    progress.begin("copying slices", Some(total as u64));
    let copied = (|| {
        let mut due = runs.iter();
        let mut current = due.next();
        let mut open: Option<CopiedSlice> = None;
        for number in 0..total {
            let Some(mut packet) = next_of_stream(&mut input, index) else {
                break;
            };
            progress.advance(1);
            let Some(&(owner, run)) = current else { break };
            if number < run.first {
                continue;
            }
            let mut slice = match open.take() {
                Some(slice) => slice,
                None => {
                    let request = &requests[owner];
                    let audio = audio_for(source, request, settings, progress)?;
                    CopiedSlice::create(&request.path, parameters.clone(), time_base, audio)?
                }
            };
            let following = table.packets[number + 1..run.end]
                .iter()
                .filter_map(|packet| packet.pts)
                .min();
            slice.write(&mut packet, run, following)?;
            if number + 1 == run.end {
                slice.close(source.orientation)?;
                current = due.next();
            } else {
                open = Some(slice);
            }
        }
        Ok(())
    })();
    progress.end();
    copied
}

/// Returns the next packet of a stream; `None` at the end of the readable part.
fn next_of_stream(input: &mut ffmpeg::format::context::Input, index: usize) -> Option<Packet> {
    loop {
        let mut packet = Packet::empty();
        packet.read(input).ok()?;
        if packet.stream() == index {
            return Some(packet);
        }
    }
}

/// A slice that is being written.
struct CopiedSlice {
    path: std::path::PathBuf,
    /// Present until the file is ended.
    output: Option<Output>,
    time_base: Rational,
    audio: Option<AudioCopy>,
    /// Behind the output, which is closed before this is removed.
    temporary: Unfinished,
}

impl CopiedSlice {
    fn create(
        path: &Path,
        parameters: codec::Parameters,
        time_base: Rational,
        audio: Option<AudioTrack>,
    ) -> Result<Self, CurateError> {
        let internal = |error: ffmpeg::Error| CurateError::internal(path, error);
        let temporary = Unfinished::beside(path);
        let mut output = create_output(temporary.path())?;
        let mut stream = output
            .add_stream(encoder::find(codec::Id::None))
            .map_err(internal)?;
        stream.set_parameters(parameters);
        stream.set_time_base(time_base);
        clear_codec_tag(&mut stream);
        let audio = audio
            .map(|track| AudioCopy::attach(track, &mut output))
            .transpose()
            .map_err(internal)?;
        output
            .write_header()
            .map_err(|error| unwritable(path, error))?;
        Ok(Self {
            path: path.to_owned(),
            output: Some(output),
            time_base,
            audio,
            temporary,
        })
    }

    /// Writes a packet of the run; `following` is the earliest timestamp among those after it.
    fn write(
        &mut self,
        packet: &mut Packet,
        run: Run,
        following: Option<i64>,
    ) -> Result<(), CurateError> {
        let Some(output) = &mut self.output else {
            return Ok(());
        };
        let begin = run.begin_ticks;
        if let Some(pts) = packet.pts() {
            // The muxer takes the length of the last frame from its packet.
            if following.is_none() {
                packet.set_duration(run.end_ticks - pts);
            }
            packet.set_pts(Some(pts - begin));
            if let Some(audio) = &mut self.audio {
                let seconds = (pts - begin) as f64 * f64::from(self.time_base);
                audio.write_until(seconds, output)?;
            }
        }
        packet.set_dts(packet.dts().map(|dts| dts - begin));
        let base = output
            .stream(0)
            .map_or(self.time_base, |stream| stream.time_base());
        packet.rescale_ts(self.time_base, base);
        packet.set_position(-1);
        packet.set_stream(0);
        packet
            .write_interleaved(output)
            .map_err(|error| unwritable(&self.path, error))
    }

    fn close(mut self, orientation: Orientation) -> Result<(), CurateError> {
        let Some(mut output) = self.output.take() else {
            return Ok(());
        };
        if let Some(audio) = &mut self.audio {
            audio.write_until(f64::INFINITY, &mut output)?;
        }
        close_output(
            output,
            self.temporary.path(),
            &self.path,
            Projection::Equirectangular,
            orientation,
        )
    }
}
