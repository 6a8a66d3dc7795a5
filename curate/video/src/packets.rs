//! The packets of a video stream, and the segments of it that can be copied without re-encoding.

use std::path::Path;

use ffmpeg::{Packet, codec::packet::Ref, ffi, media};
use ffmpeg_next as ffmpeg;
use omnilife_schemas::records::TimeRange;

use crate::{decode::open_container, error::VideoError, raw_fields::CodecId};

/// One packet of the video stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PacketInfo {
    /// Presentation timestamp in ticks, if there is one.
    pub pts: Option<i64>,
    /// True if decoding can start here.
    pub key: bool,
    /// True if the container marks the frame as decoded but not shown.
    pub hidden: bool,
}

/// All packets of a video stream in order of decoding.
#[derive(Debug, Clone)]
pub struct PacketTable {
    /// Seconds per tick.
    pub seconds_per_tick: f64,
    /// The packets.
    pub packets: Vec<PacketInfo>,
    /// True if mp4 can hold the stream's codec.
    pub fits_mp4: bool,
}

/// Packets `first..end` in order of decoding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Run {
    /// First packet.
    pub first: usize,
    /// One after the last packet.
    pub end: usize,
    /// Presentation timestamp of the first frame, ticks.
    pub begin_ticks: i64,
    /// Presentation timestamp of the end, ticks.
    pub end_ticks: i64,
}

/// Codecs that mp4 holds and players expect in it.
const MP4_CODECS: &[ffmpeg::codec::Id] = &[
    ffmpeg::codec::Id::H264,
    ffmpeg::codec::Id::HEVC,
    ffmpeg::codec::Id::VP9,
    ffmpeg::codec::Id::AV1,
    ffmpeg::codec::Id::MPEG4,
];

impl PacketTable {
    /// Reads the headers of all packets; nothing is decoded.
    ///
    /// # Errors
    /// [`VideoError::Unusable`] when the file cannot be read as a video.
    pub fn scan(video: &Path) -> Result<Self, VideoError> {
        let mut input = open_container(video)?;
        let stream = input
            .streams()
            .best(media::Type::Video)
            .ok_or_else(|| VideoError::unusable(video, "has no video stream"))?;
        let index = stream.index();
        let seconds_per_tick = f64::from(stream.time_base());
        let fits_mp4 = CodecId::of(&stream).is_among(MP4_CODECS);
        let mut packets = Vec::new();
        loop {
            let mut packet = Packet::empty();
            match packet.read(&mut input) {
                Ok(()) if packet.stream() == index => packets.push(PacketInfo {
                    pts: packet.pts(),
                    key: packet.is_key(),
                    hidden: is_hidden(&packet),
                }),
                Ok(()) => {}
                // The analysis has found a file that breaks off damaged; its readable part can still be cut.
                Err(_) => break,
            }
        }
        Ok(Self {
            seconds_per_tick,
            packets,
            fits_mp4,
        })
    }

    /// Returns timestamps of the shown frames, in order, seconds.
    pub fn times(&self) -> Vec<f64> {
        let shown = self.packets.iter().filter(|packet| !packet.hidden);
        let mut ticks: Vec<i64> = shown.filter_map(|packet| packet.pts).collect();
        ticks.sort_unstable();
        ticks.dedup();
        ticks
            .iter()
            .map(|&t| t as f64 * self.seconds_per_tick)
            .collect()
    }

    /// Returns the packets that show exactly the frames of `range`, if they are independently decodable.
    ///
    /// They are if the first frame is a key frame and the packets of the segment follow each other in order of
    /// decoding. Then packets depend on earlier ones only, and none is missing or too many.
    pub fn copyable(&self, range: TimeRange) -> Option<Run> {
        if !self.fits_mp4 {
            return None;
        }
        let ticks = |seconds: f64| (seconds / self.seconds_per_tick).round() as i64;
        let (begin_ticks, end_ticks) = (ticks(range.begin_seconds), ticks(range.end_seconds));
        let is_inside = |packet: &PacketInfo| {
            packet
                .pts
                .is_some_and(|pts| begin_ticks <= pts && pts < end_ticks)
        };
        let first = self.packets.iter().position(is_inside)?;
        let length = self.packets[first..]
            .iter()
            .take_while(|packet| is_inside(packet))
            .count();
        let end = first + length;
        let run = &self.packets[first..end];
        let is_whole = !self.packets[end..].iter().any(is_inside);
        let is_clean = run.iter().all(|packet| !packet.hidden)
            && self.packets.iter().all(|packet| packet.pts.is_some());
        let begins = run[0].key && run[0].pts == Some(begin_ticks);
        (begins && is_whole && is_clean).then_some(Run {
            first,
            end,
            begin_ticks,
            end_ticks,
        })
    }
}

/// Returns true if a packet is decoded but not shown, as before the start of an edit list.
fn is_hidden(packet: &Packet) -> bool {
    // SAFETY: the pointer is that of a live packet, and the flags are plain bits.
    unsafe { (*packet.as_ptr()).flags & ffi::AV_PKT_FLAG_DISCARD != 0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Packets in order of decoding, `k` before a key frame's timestamp.
    fn table(packets: &str) -> PacketTable {
        PacketTable {
            seconds_per_tick: 1.0,
            fits_mp4: true,
            packets: packets
                .split(' ')
                .map(|word| PacketInfo {
                    pts: word.trim_start_matches('k').parse().ok(),
                    key: word.starts_with('k'),
                    hidden: false,
                })
                .collect(),
        }
    }

    fn range(begin_seconds: f64, end_seconds: f64) -> TimeRange {
        TimeRange::new(begin_seconds, end_seconds)
    }

    #[test]
    fn a_cut_on_key_frames_is_a_run_of_packets() {
        let closed = table("k0 2 1 3 k4 6 5 7 k8 9");
        let run = closed
            .copyable(range(4.0, 8.0))
            .map(|run| (run.first, run.end));
        assert_eq!(run, Some((4, 8)));
        assert!(closed.copyable(range(0.0, 10.0)).is_some());
        // Without reordering across it, the end needs no key frame.
        assert!(closed.copyable(range(4.0, 7.0)).is_some());
    }

    #[test]
    fn what_needs_other_packets_is_not_copied() {
        let closed = table("k0 2 1 3 k4 6 5 7 k8 9");
        assert_eq!(
            closed.copyable(range(1.0, 4.0)),
            None,
            "begins inside a group"
        );
        assert_eq!(
            closed.copyable(range(4.0, 6.0)),
            None,
            "frame 5 needs frame 6"
        );
        assert_eq!(closed.copyable(range(20.0, 30.0)), None, "no frames");
        let open = table("k0 1 k4 2 3 5");
        assert_eq!(open.copyable(range(0.0, 4.0)), None, "2 and 3 follow 4");
        let unknown = table("k0 x 2");
        assert_eq!(
            unknown.copyable(range(0.0, 3.0)),
            None,
            "a packet without a time"
        );
        let mut foreign = table("k0 1 2");
        foreign.fits_mp4 = false;
        assert_eq!(
            foreign.copyable(range(0.0, 3.0)),
            None,
            "mp4 has no such codec"
        );
    }
}
