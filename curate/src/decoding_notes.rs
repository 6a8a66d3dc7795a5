//! Notes on the frames of a video and their colours, as decoding finds them.

use omnilife_schemas::records::Probe;

use crate::repetitions::{self, Repetitions};

/// Time without a frame that is reported, seconds. Cameras that drop frames in the dark leave less.
const REPORTED_GAP_SECONDS: f64 = 1.0;

/// Numbers of unusual frames.
pub(crate) struct Faults {
    pub(crate) damaged_frames: u64,
    pub(crate) frames_out_of_time: u64,
    pub(crate) interlaced_frames: u64,
    pub(crate) repetitions: Repetitions,
}

/// Returns a line for every kind that occurs.
pub(crate) fn lines(probe: &Probe, faults: &Faults) -> Vec<String> {
    let frames = probe.decoded_frames.unwrap_or_default();
    let lines = [
        damage(faults.damaged_frames),
        out_of_time(faults.frames_out_of_time),
        interlaced(faults.interlaced_frames),
        repetitions::note(faults.repetitions, frames, probe.frames_per_second),
        gap(probe),
        high_range(probe),
        wide_gamut(probe),
        assumed_matrix(probe),
    ];
    lines.into_iter().flatten().collect()
}

fn damage(frames: u64) -> Option<String> {
    (frames > 0).then(|| {
        format!(
            "places that the decoder found damaged, and patched up or left out: {frames}; frames after each of them, \
             until the next key frame, may be wrong too and are not marked"
        )
    })
}

fn out_of_time(frames: u64) -> Option<String> {
    (frames > 0).then(|| {
        format!(
            "frames that have no time after that of the frame before, and are left out: {frames}; if files were joined \
             end to end, join them anew with times that go on: ffmpeg -f concat -i LIST -c copy OUT"
        )
    })
}

fn interlaced(frames: u64) -> Option<String> {
    (frames > 0).then(|| {
        format!(
            "{frames} frames are marked as interlaced and used as stored; if each has rows of two moments, take the \
             rows apart first: ffmpeg -i IN -vf bwdif OUT"
        )
    })
}

fn gap(probe: &Probe) -> Option<String> {
    let longest = probe.longest_interval_seconds?;
    (longest >= REPORTED_GAP_SECONDS && longest * probe.frames_per_second > 2.0).then(|| {
        format!("the longest time without a frame is {longest:.1} s, which counts as footage")
    })
}

fn high_range(probe: &Probe) -> Option<String> {
    probe.is_hdr().then(|| {
        format!(
            "is coded for high dynamic range ({}); its levels are used as coded, not tone-mapped",
            probe.transfer
        )
    })
}

fn wide_gamut(probe: &Probe) -> Option<String> {
    probe.is_wide_gamut().then(|| {
        format!(
            "its colours have the primaries of {}, wider than those of sRGB, and are used as coded: they look paler \
             than they are",
            probe.primaries
        )
    })
}

fn assumed_matrix(probe: &Probe) -> Option<String> {
    let matrix = probe.assumed_matrix.as_ref()?;
    Some(format!(
        "states no matrix of its colours, and {matrix} is taken, as players do at {}x{}",
        probe.width, probe.height
    ))
}
