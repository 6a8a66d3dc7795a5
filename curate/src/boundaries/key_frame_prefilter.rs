//! Boundaries without decoding everything: only candidates that the compressed stream marks.
//!
//! Key frames stand in a stream every half to ten seconds and decode by themselves. A segment
//! between two of them is a candidate
//!
//! * when the colours or the layout of its two key frames differ: perhaps another shot, perhaps only a moving camera;
//!   or
//! * when one of its packets is much larger than those around it and nearly as large as a key frame: an image that its
//!   predecessor did not predict, though the shot may have come back before the next key frame.
//!
//! Candidate segments, and the frames after them that a detector needs, are decoded whole and given to the detector;
//! the rest counts as one shot. A shot that starts and ends between two key frames without a large packet is missed.

use std::{ops::Range, path::Path};

use omnilife_schemas::{progress::Progress, records::Boundary, statistics};

use super::{
    Detector,
    descriptor::{Descriptor, correlation, distance},
};
use crate::{
    error::CurateError,
    slicing::packets::PacketTable,
    video::{Converter, PacketChoice, Scaling, VideoReader, probe::probe},
};

/// Key frames whose colours differ by more than this share enclose a candidate. It is half of the histogram detector's
/// limit for a gradual transition, because a key frame may stand in the middle of one.
const CANDIDATE_DISTANCE: f32 = 0.2;
/// Key frames whose layouts correlate less than this enclose a candidate as well.
const CANDIDATE_CORRELATION: f32 = 0.7;
/// A packet is a candidate above this many times the median of the packets within a second that are
/// no key frames ...
const PACKET_OVER_MEDIAN: f32 = 5.0;
/// ... if it is at least this share of the key frame before it.
const PACKET_OVER_KEY: f32 = 0.3;
const PACKET_WINDOW_SECONDS: f64 = 1.0;
/// Time decoded after a candidate segment, so that a change at its end is seen from both sides.
const AFTER_SECONDS: f64 = 1.5;

/// Result of a search of the candidate segments.
#[derive(Debug, Clone, PartialEq)]
pub struct KeyFramePrefilter {
    /// Boundaries in order of time.
    pub boundaries: Vec<Boundary>,
    /// Segments between key frames.
    pub segments: usize,
    /// Number of candidates among them.
    pub candidate: usize,
    /// Frames that were decoded, key frames twice where their segment was a candidate.
    pub decoded_frames: u64,
    /// Frames of the video.
    pub frames: u64,
}

/// Searches a video's candidate segments with a detector.
///
/// # Errors
/// [`CurateError::Video`] when the file is no video or its packets have no timestamps.
pub fn search(
    video: &Path,
    detector: &Detector,
    progress: &dyn Progress,
) -> Result<KeyFramePrefilter, CurateError> {
    let table = PacketTable::scan(video)?;
    let segments = segments(&table).ok_or_else(|| {
        CurateError::video(
            video,
            "has no key frames with timestamps; it can only be searched whole",
        )
    })?;
    let probe = probe(video)?;
    let turns = probe.clockwise_quarter_turns();
    let keys = key_frames(video, turns, segments.len(), progress)?;
    let candidate: Vec<bool> = segments
        .iter()
        .map(|segment| may_hold_boundary(segment, &keys, &table))
        .collect();
    let runs = runs_to_decode(&segments, &candidate, &table);
    let mut search = KeyFramePrefilter {
        boundaries: Vec::new(),
        segments: segments.len(),
        candidate: candidate.iter().filter(|&&flag| flag).count(),
        decoded_frames: keys.len() as u64,
        frames: table.times().len() as u64,
    };
    let packets: usize = runs.iter().map(Range::len).sum();
    progress.begin("decoding candidate segments", Some(packets as u64));
    let outcome = runs.iter().try_for_each(|run| {
        let boundaries = search_run(video, run.clone(), &table, detector, turns, progress)?;
        search.decoded_frames += boundaries.frames;
        search.boundaries.extend(boundaries.found);
        Ok(())
    });
    progress.end();
    outcome.map(|()| search)
}

/// Packets from one key frame up to the next, and its time.
#[derive(Debug, Clone, PartialEq)]
struct Segment {
    packets: Range<usize>,
    begin_seconds: f64,
}

/// Returns `None` if a packet has no timestamp or the first is no key frame.
fn segments(table: &PacketTable) -> Option<Vec<Segment>> {
    let mut segments: Vec<Segment> = Vec::new();
    for (index, packet) in table.packets.iter().enumerate() {
        let seconds = packet.pts? as f64 * table.seconds_per_tick;
        if packet.key {
            segments.push(Segment {
                packets: index..index + 1,
                begin_seconds: seconds,
            });
        } else {
            segments.last_mut()?.packets.end = index + 1;
        }
    }
    (!segments.is_empty()).then_some(segments)
}

/// Descriptors of the key frames that decode.
fn key_frames(
    video: &Path,
    turns: u32,
    expected: usize,
    progress: &dyn Progress,
) -> Result<Vec<Descriptor>, CurateError> {
    let mut reader = VideoReader::open(video)?;
    reader.choose(PacketChoice::KeyFrames);
    let mut converter = Converter::new(Scaling::MaxWidth(128));
    let mut keys = Vec::with_capacity(expected);
    progress.begin("decoding key frames", Some(expected as u64));
    let outcome: Result<(), CurateError> = (|| {
        while let Some(frame) = reader.next_frame()? {
            let image = converter.convert(video, &frame.image)?.turned(turns);
            let descriptor = Descriptor::of(frame.time_seconds, &image)
                .map_err(|reason| CurateError::internal(video, reason))?;
            keys.push(descriptor);
            progress.advance(1);
        }
        Ok(())
    })();
    progress.end();
    outcome.map(|()| keys)
}

/// Returns true if a boundary may lie between this segment's key frame and the next.
fn may_hold_boundary(segment: &Segment, keys: &[Descriptor], table: &PacketTable) -> bool {
    let at = keys.partition_point(|key| key.time_seconds < segment.begin_seconds - 1e-6);
    let begins = keys
        .get(at)
        .is_some_and(|key| (key.time_seconds - segment.begin_seconds).abs() < 1e-6);
    if !begins {
        // Its key frame did not decode: nothing is known of it.
        return true;
    }
    let differs = keys.get(at + 1).is_some_and(|next| {
        distance(&keys[at].histogram, &next.histogram) > CANDIDATE_DISTANCE
            || correlation(&keys[at].layout, &next.layout) < CANDIDATE_CORRELATION
    });
    // After the last key frame there is no other to compare with.
    let is_last = at + 1 == keys.len();
    differs || is_last || has_large_packet(segment, table)
}

fn has_large_packet(segment: &Segment, table: &PacketTable) -> bool {
    let packets = &table.packets[segment.packets.clone()];
    let key_bytes = packets[0].bytes as f32;
    // In order of presentation, without the key frame, which is large by nature.
    let mut rest: Vec<(f64, f32)> = packets[1..]
        .iter()
        .filter_map(|packet| {
            let seconds = packet.pts? as f64 * table.seconds_per_tick;
            Some((seconds, packet.bytes as f32))
        })
        .collect();
    rest.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (times, bytes): (Vec<f64>, Vec<f32>) = rest.into_iter().unzip();
    (0..times.len()).any(|index| {
        bytes[index] >= PACKET_OVER_KEY * key_bytes
            && bytes[index]
                >= PACKET_OVER_MEDIAN
                    * statistics::local_quantile(&times, &bytes, index, PACKET_WINDOW_SECONDS, 0.5)
    })
}

/// Packets to decode: candidate segments with what follows them, joined where they meet.
fn runs_to_decode(
    segments: &[Segment],
    candidate: &[bool],
    table: &PacketTable,
) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for (index, segment) in segments.iter().enumerate() {
        if !candidate[index] {
            continue;
        }
        let mut end = segment.packets.end;
        if let Some(next) = segments.get(index + 1) {
            let until = next.begin_seconds + AFTER_SECONDS;
            end += table.packets[end..]
                .iter()
                .take_while(|packet| {
                    packet
                        .pts
                        .is_some_and(|pts| pts as f64 * table.seconds_per_tick < until)
                })
                .count();
        }
        match runs.last_mut() {
            Some(run) if run.end >= segment.packets.start => run.end = run.end.max(end),
            _ => runs.push(segment.packets.start..end),
        }
    }
    runs
}

/// Boundaries that a detector finds in a run of packets.
struct RunBoundaries {
    found: Vec<Boundary>,
    frames: u64,
}

fn search_run(
    video: &Path,
    run: Range<usize>,
    table: &PacketTable,
    detector: &Detector,
    turns: u32,
    progress: &dyn Progress,
) -> Result<RunBoundaries, CurateError> {
    let begin = table.packets[run.start].pts.unwrap_or(0) as f64 * table.seconds_per_tick;
    let mut reader = VideoReader::open(video)?;
    reader.choose(PacketChoice::Run(run));
    let mut converter = Converter::new(detector.images);
    let mut pass = (detector.start)()?;
    let mut frames = 0;
    while let Some(frame) = reader.next_frame()? {
        frames += 1;
        progress.advance(1);
        // Images of an open group that depend on packets which were not decoded.
        if frame.time_seconds < begin - 1e-6 {
            continue;
        }
        let image = converter.convert(video, &frame.image)?.turned(turns);
        pass.observe(frame.time_seconds, &image)
            .map_err(|reason| CurateError::internal(video, reason))?;
    }
    let signals = pass.finish();
    let found = if signals.times.len() > 1 {
        (detector.decide)(&signals).map_err(|error| CurateError::internal(video, error))?
    } else {
        Vec::new()
    };
    Ok(RunBoundaries { found, frames })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::slicing::packets::PacketInfo;

    /// Returns a frame every tenth of a second; a key frame of 1,000 bytes every ten, others of `bytes`.
    fn table(count: usize, bytes: impl Fn(usize) -> usize) -> PacketTable {
        PacketTable {
            seconds_per_tick: 0.1,
            fits_mp4: true,
            packets: (0..count)
                .map(|index| PacketInfo {
                    pts: Some(index as i64),
                    key: index % 10 == 0,
                    hidden: false,
                    bytes: if index % 10 == 0 { 1_000 } else { bytes(index) },
                })
                .collect(),
        }
    }

    fn flat(time_seconds: f64, bin: usize) -> Descriptor {
        let mut histogram = vec![0.0; super::super::descriptor::HISTOGRAM_BINS];
        histogram[bin] = 1.0;
        Descriptor {
            time_seconds,
            histogram,
            layout: vec![0.0; 512],
        }
    }

    #[test]
    fn a_stretch_between_different_key_frames_is_suspicious_and_decoded_with_what_follows() {
        let table = table(60, |_| 50);
        let segments = segments(&table).unwrap_or_default();
        assert_eq!(segments.len(), 6);
        // The shot changes between the third and the fourth key frame.
        let keys: Vec<Descriptor> = (0..6)
            .map(|index| flat(f64::from(index), usize::from(index > 2)))
            .collect();
        let candidate: Vec<bool> = segments
            .iter()
            .map(|segment| may_hold_boundary(segment, &keys, &table))
            .collect();
        assert_eq!(candidate, [false, false, true, false, false, true]);
        // 1.5 s after the next key frame at 3 s; the last segment has nothing after it.
        assert_eq!(
            runs_to_decode(&segments, &candidate, &table),
            [20..45, 50..60]
        );
    }

    #[test]
    fn a_large_packet_between_equal_key_frames_is_suspicious() {
        let keys: Vec<Descriptor> = (0..3).map(|index| flat(f64::from(index), 0)).collect();
        let of = |bytes: &dyn Fn(usize) -> usize| {
            let table = table(30, bytes);
            let segments = segments(&table).unwrap_or_default();
            may_hold_boundary(&segments[1], &keys, &table)
        };
        assert!(!of(&|_| 50));
        assert!(of(&|index| if index == 14 { 600 } else { 50 }));
        // Not small beside a key frame, but all of them are so: a stream of large packets.
        assert!(!of(&|_| 600));
        // Much larger than its neighbours, and still small.
        assert!(!of(&|index| if index == 14 { 290 } else { 20 }));
    }

    #[test]
    fn a_key_frame_that_does_not_decode_makes_its_stretch_suspicious() {
        let table = table(30, |_| 50);
        let segments = segments(&table).unwrap_or_default();
        let keys = [flat(0.0, 0), flat(2.0, 0)];
        assert!(may_hold_boundary(&segments[1], &keys, &table));
    }
}
