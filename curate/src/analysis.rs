//! The analysis pass: one decode of a whole video that feeds every analysis of its frames.

use std::path::Path;

use omnilife_schemas::{
    progress::Progress,
    records::{Probe, SphereLayout, TimeRange},
    statistics::frame_interval,
};
use omnilife_video::{Converter, Rgb8Image, Scaling, VideoReader, packets::PacketTable, probe};

use crate::{
    boundaries::{Detector, Signals},
    error::CurateError,
    near_duplicates::{SignaturePass, signature},
    overlays::{MosaicPass, OverlayPass},
    projection::FrameSamples,
    repetitions::{RepetitionPass, Repetitions},
    sharpness::{self, View, sharpness},
    shots::SamplePass,
    sphere_layouts::{self, ToErp},
};

/// Width in pixels of the images from which ERP projection and overlays are judged.
const SAMPLE_WIDTH_PIXELS: u32 = 512;
/// A video counts as truncated when it ends this much before the duration its container states: in seconds, and as a
/// share of the duration; the larger counts. Containers round, edit lists hide frames, and a sound track may end a
/// little after the images, so a few frames mean nothing.
const TRUNCATION_SECONDS: f64 = 0.5;
const TRUNCATION_SHARE: f64 = 0.002;

/// Results of one pass over a video.
#[derive(Debug)]
pub struct Analysis {
    /// The probe, with its measured entries filled in.
    pub probe: Probe,
    /// From the start of the first frame to the end of the last.
    pub range: TimeRange,
    /// The boundary detector's signals, one row per frame.
    pub signals: Signals,
    /// Frames spread over the video, for the ERP projection.
    pub samples: FrameSamples,
    /// Samples for the projection of single shots, once boundaries are known.
    pub shot_samples: SamplePass,
    /// Detector of overlays: content that stays while the scene moves, in equirectangular images.
    pub overlays: OverlayPass,
    /// Detector of mosaics in single frames.
    pub mosaics: MosaicPass,
    /// Visual signature of the video over time.
    pub signature: SignaturePass,
    /// Frames and packets that were damaged.
    pub damaged_frames: u64,
    /// Frames that are marked as interlaced.
    pub interlaced_frames: u64,
    /// Frames without a time after that of the frame before, left out.
    pub frames_out_of_time: u64,
    /// Frames that repeat the picture of the one before.
    pub repetitions: Repetitions,
}

/// Converts frames of other sphere layouts to equirectangular images.
struct SphereImages {
    stored: Converter,
    to_erp: ToErp,
    width: usize,
}

impl SphereImages {
    /// Creates a converter to images of at most this width.
    fn new(layout: SphereLayout, probe: &Probe, most_pixels: u32) -> Self {
        let size = probe.upright_size();
        let width = most_pixels.min(layout.erp_width(size) & !1);
        let stored = sphere_layouts::stored_width(layout, width, size);
        Self {
            stored: Converter::new(Scaling::MaxWidth(stored)),
            to_erp: ToErp::new(layout),
            width: width as usize,
        }
    }

    fn convert(
        &mut self,
        video: &Path,
        frame: &ffmpeg_next::frame::Video,
        turns: u32,
    ) -> Result<Rgb8Image, CurateError> {
        let stored = self.stored.convert(video, frame)?.turned(turns);
        Ok(self.to_erp.convert(&stored, self.width))
    }
}

/// Decodes a video from end to end once. Memory does not grow with its length, except for a few numbers per frame. With
/// a layout, overlays are searched for on its sphere, and shots are judged by it where it is complete. The projection
/// of the video and its boundaries are judged from the frames as stored.
///
/// # Errors
/// [`CurateError::Video`] when the file is not a video, has no frames, or breaks off early.
pub fn analyse(
    video: &Path,
    detector: &Detector,
    layout: Option<SphereLayout>,
    progress: &dyn Progress,
) -> Result<Analysis, CurateError> {
    analyse_with(video, detector, layout, None, progress)
}

/// Analyses as [`analyse`]; for images of a kind, the signals have the sharpness of every frame as well.
pub(crate) fn analyse_with(
    video: &Path,
    detector: &Detector,
    layout: Option<SphereLayout>,
    measured: Option<View>,
    progress: &dyn Progress,
) -> Result<Analysis, CurateError> {
    let mut reader = VideoReader::open(video)?;
    let mut probe = probe::describe(&reader)?;
    let expected = probe.duration_seconds * probe.frames_per_second;
    progress.begin(
        "analysing",
        (expected >= 1.0).then_some(expected.round() as u64),
    );
    let turns = probe.clockwise_quarter_turns();
    let mut small = Converter::new(detector.images);
    let mut pass = (detector.start)()?;
    let mut medium = Converter::new(Scaling::MaxWidth(SAMPLE_WIDTH_PIXELS));
    let sphere_images = |width: u32| layout.map(|layout| SphereImages::new(layout, &probe, width));
    let mut sphere = sphere_images(SAMPLE_WIDTH_PIXELS);
    let mut small_sphere = sphere_images(signature::WIDTH_PIXELS);
    let mut tiny = Converter::new(Scaling::MaxWidth(signature::WIDTH_PIXELS));
    let mut large = Converter::new(Scaling::MaxWidth(sharpness::WIDTH_PIXELS));
    let mut large_sphere = measured.and_then(|_| sphere_images(sharpness::WIDTH_PIXELS));
    let mut sharpnesses = Vec::new();
    let mut signature = SignaturePass::default();
    let mut samples = FrameSamples::default();
    let mut shot_samples = SamplePass::default();
    let mut overlays = OverlayPass::default();
    let mut mosaics = MosaicPass::default();
    let mut repetitions = RepetitionPass::default();
    let mut times = Vec::new();
    let mut size = None;
    let outcome: Result<(), CurateError> = (|| {
        while let Some(frame) = reader.next_frame()? {
            let this = (frame.image.width(), frame.image.height());
            let first = *size.get_or_insert(this);
            if this != first {
                return Err(CurateError::video(
                    video,
                    format!(
                        "its frames change from {}x{} to {}x{} pixels at {:.3} s",
                        first.0, first.1, this.0, this.1, frame.time_seconds
                    ),
                ));
            }
            times.push(frame.time_seconds);
            let image = small.convert(video, &frame.image)?.turned(turns);
            pass.observe(frame.time_seconds, &image)
                .map_err(|reason| CurateError::internal(video, reason))?;
            repetitions.observe(image);
            let is_of_sphere =
                overlays.wants(frame.time_seconds) || shot_samples.wants(frame.time_seconds);
            if is_of_sphere || samples.wants(frame.time_seconds) {
                let image = medium.convert(video, &frame.image)?.turned(turns);
                let of_sphere = match &mut sphere {
                    Some(sphere) if is_of_sphere => {
                        Some(sphere.convert(video, &frame.image, turns)?)
                    }
                    _ => None,
                };
                let shown = of_sphere.as_ref().unwrap_or(&image);
                if overlays.wants(frame.time_seconds) {
                    overlays.observe(frame.time_seconds, shown);
                }
                if shot_samples.wants(frame.time_seconds) {
                    // The black behind half a sphere is not the background of a title.
                    let is_half = layout.is_some_and(sphere_layouts::is_half);
                    let shown = if is_half { &image } else { shown };
                    shot_samples.observe(&probe, frame.time_seconds, shown);
                }
                samples.offer(frame.time_seconds, image);
            }
            if let Some(view) = measured {
                let image = match &mut large_sphere {
                    None => large.convert(video, &frame.image)?.turned(turns),
                    Some(sphere) => sphere.convert(video, &frame.image, turns)?,
                };
                sharpnesses.push(sharpness(&image, view));
            }
            if signature.wants(frame.time_seconds) {
                let image = match &mut small_sphere {
                    None => tiny.convert(video, &frame.image)?.turned(turns),
                    Some(sphere) => sphere.convert(video, &frame.image, turns)?,
                };
                signature.observe(frame.time_seconds, &image);
            }
            if mosaics.wants(frame.time_seconds) {
                mosaics.observe(video, frame.time_seconds, &frame.image, turns)?;
            }
            progress.advance(1);
        }
        Ok(())
    })();
    progress.end();
    outcome?;

    let (Some(&first), Some(&last)) = (times.first(), times.last()) else {
        return Err(CurateError::video(
            video,
            "none of its frames can be decoded",
        ));
    };
    let interval = frame_interval(&times).unwrap_or(if probe.frames_per_second > 0.0 {
        1.0 / probe.frames_per_second
    } else {
        0.0
    });
    let range = TimeRange::new(first, last + interval);
    refuse_truncated(video, &reader, &probe, &range)?;
    measure_rate(&mut probe, &times, reader.seconds_per_tick());
    // A duration of the whole file may be that of longer sound, or include a late start.
    let surplus = probe.duration_seconds - range.duration_seconds();
    if probe.duration_seconds <= 0.0 || surplus > tolerated_seconds(&probe) {
        probe.duration_seconds = range.duration_seconds();
    }
    probe.decoded_frames = Some(times.len() as u64);
    let mut signals = pass.finish();
    if measured.is_some() {
        let column = sharpness::COLUMN.to_owned();
        signals.columns.push((column, sharpnesses));
    }
    Ok(Analysis {
        probe,
        range,
        signals,
        samples,
        shot_samples,
        overlays,
        mosaics,
        signature,
        damaged_frames: reader.damaged(),
        interlaced_frames: reader.interlaced(),
        frames_out_of_time: reader.out_of_time(),
        repetitions: repetitions.finish(),
    })
}

/// Probes a video without decoding, with the frame rate from the time stamps of its frames: headers are wrong by a
/// frame, or by more at a variable rate. If a frame has no time stamp, the header's rate stays and
/// `variable_frame_rate` is `None`.
///
/// # Errors
/// Those of [`probe()`].
pub fn timed_probe(video: &Path) -> Result<Probe, CurateError> {
    let mut probe = probe(video)?;
    let table = PacketTable::scan(video)?;
    if table.packets.iter().all(|packet| packet.pts.is_some()) {
        measure_rate(&mut probe, &table.times(), table.seconds_per_tick);
    }
    Ok(probe)
}

/// Measures the frame rate from the time stamps of all frames, in seconds.
fn measure_rate(probe: &mut Probe, times: &[f64], seconds_per_tick: f64) {
    let (Some(&first), Some(&last)) = (times.first(), times.last()) else {
        return;
    };
    if times.len() > 1 {
        probe.frames_per_second = (times.len() - 1) as f64 / (last - first);
    }
    let intervals = times.windows(2).map(|pair| pair[1] - pair[0]);
    probe.longest_interval_seconds = intervals.max_by(f64::total_cmp);
    let interval = frame_interval(times).unwrap_or_default();
    probe.variable_frame_rate = Some(is_variable(times, interval, seconds_per_tick));
}

fn refuse_truncated(
    video: &Path,
    reader: &VideoReader,
    probe: &Probe,
    range: &TimeRange,
) -> Result<(), CurateError> {
    let filled = filled_seconds(reader, probe, range);
    if probe.duration_seconds - filled > tolerated_seconds(probe) {
        return Err(CurateError::video(
            video,
            format!(
                "is truncated: ends after {filled:.2} s, its container states {:.2} s",
                probe.duration_seconds
            ),
        ));
    }
    if reader.ends_in_partial_packet() {
        let covered = range.duration_seconds();
        return Err(CurateError::video(
            video,
            format!("is truncated: its last packet is cut off, at {covered:.2} s"),
        ));
    }
    Ok(())
}

/// Returns the time by which frames may end before the stated duration.
fn tolerated_seconds(probe: &Probe) -> f64 {
    TRUNCATION_SECONDS.max(TRUNCATION_SHARE * probe.duration_seconds)
}

/// Returns the time that the content of a file fills, counted as its stated duration is. A duration of the video stream
/// is that of its frames. One of the whole file includes longer sound, and in Matroska the time before the first packet.
fn filled_seconds(reader: &VideoReader, probe: &Probe, range: &TimeRange) -> f64 {
    let covered = range.duration_seconds();
    let is_of_stream = reader.stream().is_some_and(|stream| stream.duration() > 0);
    match reader.packet_times() {
        Some([first, last]) if !is_of_stream => {
            let counts_from_zero = probe.container.split(',').any(|name| name == "matroska");
            covered.max(if counts_from_zero { last } else { last - first })
        }
        _ => covered,
    }
}

/// Returns true if some interval deviates from the typical one by more than half a percent and by more than the
/// rounding of the source's clock.
fn is_variable(times: &[f64], typical: f64, seconds_per_tick: f64) -> bool {
    let tolerated = (0.005 * typical).max(1.01 * seconds_per_tick);
    times
        .windows(2)
        .any(|pair| (pair[1] - pair[0] - typical).abs() > tolerated)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dropped_frame_makes_the_rate_variable_and_clock_rounding_does_not() {
        let steady: Vec<f64> = (0..90).map(|i| f64::from(i) / 30.0).collect();
        let rounded: Vec<f64> = steady
            .iter()
            .map(|t| (t * 1000.0).round() / 1000.0)
            .collect();
        let mut dropped = steady.clone();
        dropped.remove(40);
        assert!(!is_variable(&steady, 1.0 / 30.0, 1.0 / 90_000.0));
        assert!(!is_variable(&rounded, 0.033, 0.001));
        assert!(is_variable(&dropped, 1.0 / 30.0, 1.0 / 90_000.0));
    }
}
