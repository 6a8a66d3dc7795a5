//! From boundaries to slices: the kept segments of a video, and an mp4 of each of them.
//!
//! [`partition`] divides the whole of a video into kept shots and other segments. [`slice_video`] writes the kept ones
//! as mp4, frame-accurately by presentation timestamp and with spherical metadata
//! ([`omnilife_video::writing::spherical_boxes`]), so that players show them as 360-degree video.
//!
//! A slice is a stream copy if its frames are a run of independently decodable packets ([`packets`]). Everything else
//! is re-encoded whole, visually lossless ([`mp4`]). Joining re-encoded ends to a copied middle would keep more of the
//! original bits. But it puts two sets of codec parameters into one track, which many hardware decoders do not play.

mod copy;
mod encode;
pub mod partition;
mod stage;

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    ownership::refuse_existing,
    progress::Progress,
    records::{SliceFile, SliceMethod, TimeRange},
    statistics::frame_interval,
    store::{self, StoreError, Unfinished},
};
use omnilife_video::{
    Orientation, VideoReader,
    packets::{self, PacketTable},
    probe,
    writing::{audio, mp4},
};

pub use partition::{Shots, segments, shots};
pub(crate) use stage::remove_slices;
pub use stage::{SliceSettings, write_slices};

use crate::{error::CurateError, projection, sphere_layouts};

/// One slice to be written.
#[derive(Debug, Clone)]
pub struct SliceRequest {
    /// Its segment of the source.
    pub range: TimeRange,
    /// The mp4 to write.
    pub path: PathBuf,
    /// File name of the slice in the record.
    pub name: String,
}

/// Common data of all slices of a video.
#[derive(Debug, Clone, Copy)]
pub struct SliceSource<'a> {
    /// The video.
    pub video: &'a Path,
    /// Timestamps of all its frames in order, seconds.
    pub times: &'a [f64],
    /// Rotation that players apply to its frames.
    pub orientation: Orientation,
}

impl SliceSource<'_> {
    /// Timestamps of the frames inside a segment.
    fn times_in(&self, range: TimeRange) -> &[f64] {
        let first = self.times.partition_point(|&t| t < range.begin_seconds);
        let last = self.times.partition_point(|&t| t < range.end_seconds);
        &self.times[first..last]
    }
}

/// Writes slices as mp4 and verifies each by reading: it must hold exactly the frames of its segment, at the same
/// intervals.
///
/// # Errors
/// [`CurateError::Video`] when the source does not decode the same way again, FFmpeg has no encoder or a file cannot
/// be written, [`CurateError::Internal`] when a slice comes out wrong.
pub fn slice_video(
    source: &SliceSource<'_>,
    requests: &[SliceRequest],
    settings: SliceSettings,
    progress: &dyn Progress,
) -> Result<Vec<SliceFile>, CurateError> {
    if requests.is_empty() {
        return Ok(Vec::new());
    }
    let table = PacketTable::scan(source.video)?;
    let mut files: Vec<Option<SliceFile>> = vec![None; requests.len()];
    let runs: Vec<(usize, packets::Run)> = requests
        .iter()
        .enumerate()
        .filter_map(|(index, request)| Some((index, table.copyable(request.range)?)))
        .collect();
    if !runs.is_empty() {
        copy::copy_runs(source, &table, &runs, requests, settings, progress)?;
        for &(index, _) in &runs {
            let request = &requests[index];
            match check(source, request) {
                Ok(()) => files[index] = Some(describe(source, request, SliceMethod::Copied)?),
                Err(reason) => progress.note(&format!(
                    "{}: a copy of {:.3} s to {:.3} s {reason}; re-encoded instead",
                    source.video.display(),
                    request.range.begin_seconds,
                    request.range.end_seconds
                )),
            }
        }
    }
    let rest: Vec<usize> = (0..requests.len())
        .filter(|&index| files[index].is_none())
        .collect();
    if !rest.is_empty() {
        encode::encode_slices(source, requests, &rest, settings, progress)?;
    }
    for index in rest {
        let request = &requests[index];
        check(source, request).map_err(|reason| CurateError::internal(&request.path, reason))?;
        let encoder = mp4::ENCODER_SETTINGS.to_owned();
        files[index] = Some(describe(source, request, SliceMethod::Encoded { encoder })?);
    }
    Ok(files.into_iter().flatten().collect())
}

/// Writes one segment of a video to `out`. It starts at the first frame if no start is given, and ends at the end of
/// the last one if no end is.
///
/// # Errors
/// Those of [`slice_video`], and [`CurateError::Input`] for a segment without frames, for a video whose metadata say that
/// it is not monoscopic and equirectangular, and when a file of this name exists.
pub fn slice_segment(
    video: &Path,
    begin_seconds: Option<f64>,
    end_seconds: Option<f64>,
    out: &Path,
    settings: SliceSettings,
    progress: &dyn Progress,
) -> Result<SliceFile, CurateError> {
    refuse_existing(out)?;
    let probe = probe(video)?;
    if let Some(layout) = sphere_layouts::stated_other(&probe) {
        let reason = format!(
            "must be a monoscopic equirectangular video, as its slice says of itself, and its metadata says {layout}"
        );
        return Err(CurateError::input(video, reason));
    }
    if probe.spherical.is_none() && !projection::aspect::is_two_to_one(&probe) {
        let (width, height) = probe.upright_size();
        progress.note(&format!(
            "{}: states no projection and is {width}x{height}, not 2:1; the slice says that it is equirectangular",
            video.display()
        ));
    }
    let times = PacketTable::scan(video)?.times();
    let Some(&last) = times.last() else {
        return Err(CurateError::video(video, "its packets have no timestamps"));
    };
    let of_one_frame = 1.0 / probe.frames_per_second.max(1.0);
    let after_last = last + frame_interval(&times).unwrap_or(of_one_frame);
    let wanted = TimeRange {
        begin_seconds: begin_seconds.unwrap_or(times[0]),
        end_seconds: end_seconds.unwrap_or(after_last),
    };
    let inside: Vec<f64> = times
        .iter()
        .copied()
        .filter(|&t| wanted.contains(t))
        .collect();
    let Some(&first) = inside.first() else {
        return Err(CurateError::input(
            video,
            format!(
                "has no frame from {} s to {} s (its frames are from {:.3} s to {after_last:.3} s)",
                wanted.begin_seconds, wanted.end_seconds, times[0]
            ),
        ));
    };
    // A slice starts with a frame and lasts until the next one.
    let next = times.iter().copied().find(|&t| t >= wanted.end_seconds);
    // It gets its name when it has been read back.
    let unchecked = Unfinished::beside(out);
    let request = SliceRequest {
        range: TimeRange::new(first, next.unwrap_or(after_last)),
        path: unchecked.path().to_owned(),
        name: out.display().to_string(),
    };
    let source = SliceSource {
        video,
        times: &times,
        orientation: Orientation::of(&probe),
    };
    let requests = std::slice::from_ref(&request);
    let file = slice_video(&source, requests, settings, progress)?.pop();
    let file = file.ok_or_else(|| CurateError::internal(out, "no slice was written"))?;
    unchecked
        .rename(out)
        .map_err(|error| StoreError::write(out, error))?;
    Ok(file)
}

fn describe(
    source: &SliceSource<'_>,
    request: &SliceRequest,
    method: SliceMethod,
) -> Result<SliceFile, CurateError> {
    Ok(SliceFile {
        file: request.name.clone(),
        sha256: store::sha256_file(&request.path)?,
        frames: source.times_in(request.range).len() as u64,
        method,
        audio: audio::has_audio(&request.path)?,
    })
}

/// Verifies a slice by reading; the error gives its difference from its segment of the source.
fn check(source: &SliceSource<'_>, request: &SliceRequest) -> Result<(), String> {
    let expected = source.times_in(request.range);
    let mut reader = VideoReader::open(&request.path).map_err(|error| error.to_string())?;
    // Timestamps are rounded to the ticks of either file.
    let tolerance = 2.0 * reader.seconds_per_tick().max(1e-6);
    let mut found = 0;
    while let Some(frame) = reader.next_frame().map_err(|error| error.to_string())? {
        let Some(time) = expected.get(found) else {
            return Err(format!("has more than {} frames", expected.len()));
        };
        let wanted = time - request.range.begin_seconds;
        if (frame.time_seconds - wanted).abs() > tolerance {
            return Err(format!(
                "shows frame {found} at {:.6} s, expected {wanted:.6} s",
                frame.time_seconds
            ));
        }
        found += 1;
    }
    if found != expected.len() {
        return Err(format!("has {found} frames, expected {}", expected.len()));
    }
    let unsound = reader.damaged() + reader.out_of_time();
    if unsound > 0 {
        return Err(format!(
            "has {unsound} frames that are damaged or out of time"
        ));
    }
    Ok(())
}
