//! Sampling of frames from sequences: selection, size, and output as PNG.

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    RgbImage,
    layout::{FRAMES_FOLDER, MOTION_FOLDER},
    plain_text::counted,
    progress::Progress,
    records::{Probe, Sampling, SphereLayout, TimeRange, VideoProjection},
    rgb,
    statistics::frame_interval,
    store,
};
use omnilife_video::{Converter, Rgb8Image, Scaling, VideoReader};

use crate::{
    error::CurateError,
    settings,
    sphere_layouts::{self, ToErp},
};

/// Default width in pixels of sampled frames, if the video is wider.
pub const DEFAULT_WIDTH_PIXELS: u32 = 1024;
/// Fewer rows hold no faces, halves or circles of a sphere.
const LEAST_STORED_ROWS: u32 = 16;
/// Width in pixels of the frames in which motion is measured, if the sampled ones are wider.
const MOTION_WIDTH_PIXELS: u32 = 256;
/// Timestamps closer than this are one.
const SAME_INSTANT_SECONDS: f64 = 1e-9;

/// Returns the timestamps of the frames to sample from a shot, evenly in time.
///
/// `times` are the timestamps of all frames of the video in order. With [`Sampling::MaxFrames`] the distance is a whole
/// multiple of the shot's typical frame interval: the smallest that gives at most that many frames. So samples of a
/// steady video are exactly evenly spaced. With [`Sampling::FramesPerSecond`] the frame nearest to every instant is
/// taken. No frame is taken twice.
pub fn choose(times: &[f64], shot: TimeRange, sampling: Sampling) -> Vec<f64> {
    let first = times.partition_point(|&time| time < shot.begin_seconds);
    let last = times.partition_point(|&time| time < shot.end_seconds);
    let inside = &times[first..last];
    let (Some(&begin), Some(&end)) = (inside.first(), inside.last()) else {
        return Vec::new();
    };
    let smallest_gap = inside
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .fold(f64::INFINITY, f64::min);
    let interval = match sampling {
        // Every frame is the nearest one to some instant: no rate, however high, gives more.
        Sampling::FramesPerSecond(rate) if 1.0 / rate <= smallest_gap => return inside.to_vec(),
        Sampling::FramesPerSecond(rate) => 1.0 / rate,
        Sampling::MaxFrames(most) if inside.len() <= most as usize => return inside.to_vec(),
        Sampling::MaxFrames(most) => {
            let Some(typical) = frame_interval(inside) else {
                return inside.to_vec();
            };
            // Over `gaps` typical intervals, every stride-th frame makes floor(gaps / stride) + 1.
            let gaps = ((end - begin) / typical).round();
            let stride = (gaps / f64::from(most)).floor() + 1.0;
            stride * typical
        }
    };
    let last_instant = ((end - begin) / interval + 1e-6).floor() as u64;
    nearest_to_instants(inside, interval, last_instant)
}

/// Returns the values of sorted, non-empty `times` that are nearest to some of the instants 0 to `last_instant`, which
/// start at the first value and are `interval` apart.
///
/// Instants whose nearest value must be the one before are stepped over: a gap in `times` may hold any number of them.
fn nearest_to_instants(times: &[f64], interval: f64, last_instant: u64) -> Vec<f64> {
    let begin = times[0];
    let mut chosen = Vec::new();
    let mut instant = 0;
    while instant <= last_instant {
        let time = nearest(times, begin + instant as f64 * interval);
        if chosen.last() != Some(&time) {
            chosen.push(time);
        }
        let following = times.partition_point(|&other| other <= time);
        let Some(next) = times.get(following) else {
            break;
        };
        // One less than the last instant that is not nearer to the next value: with two large numbers the quotient may
        // be off by one.
        let middle = (time + (next - time) / 2.0 - begin) / interval;
        instant = (instant + 1).max((middle.floor() as u64).saturating_sub(1));
    }
    chosen
}

/// Returns the file of a sequence's frame by its number, relative to the sequence.
pub fn file_name(index: usize) -> String {
    format!("{FRAMES_FOLDER}/{index:06}.png")
}

/// Returns the file of a sequence's small frame for the measurement of motion, relative to the sequence.
pub fn motion_file_name(index: usize) -> String {
    format!("{MOTION_FOLDER}/{index:06}.png")
}

/// Returns the value of sorted, non-empty `times` nearest to an instant.
fn nearest(times: &[f64], instant: f64) -> f64 {
    let after = times.partition_point(|&time| time < instant);
    match (
        after.checked_sub(1).map(|before| times[before]),
        times.get(after),
    ) {
        (Some(before), Some(&after)) if instant - before <= after - instant => before,
        (_, Some(&after)) => after,
        (Some(before), None) => before,
        (None, None) => instant,
    }
}

/// Returns the size of sampled frames: `width` or the default, and half of that. A pinhole's height follows the video's
/// aspect ratio, to the nearest pixel. The video's own width is that of its sphere, however `layout` stores it.
///
/// # Errors
/// [`CurateError::Input`] for an odd width, one below 16 pixels, or more than the video has.
pub fn frame_size(
    video: &Path,
    probe: &Probe,
    width: Option<u32>,
    accept: Option<VideoProjection>,
    layout: Option<SphereLayout>,
) -> Result<(u32, u32), CurateError> {
    let stored = probe.upright_size();
    let native = layout.map_or(stored.0, |layout| layout.erp_width(stored)) & !1;
    if let Some(layout) = layout
        && stored.1 < LEAST_STORED_ROWS
    {
        let reason = format!("{} rows of pixels store no sphere as {layout}", stored.1);
        return Err(CurateError::input(video, reason));
    }
    if let Some(layout) = layout {
        sphere_layouts::expect_shape(layout, stored)
            .map_err(|reason| CurateError::input(video, reason))?;
    }
    let width = width.unwrap_or(native.min(DEFAULT_WIDTH_PIXELS));
    if !settings::is_frame_width(width) {
        return Err(CurateError::input(video, settings::width_fault(width)));
    }
    if width > native {
        return Err(CurateError::input(
            video,
            format!("a frame width of {width} pixels is more than the video's own {native}"),
        ));
    }
    let height = match accept {
        Some(VideoProjection::Rectilinear) => {
            let (columns, rows) = probe.upright_size();
            let height = f64::from(width) * f64::from(rows) / f64::from(columns);
            height.round().max(1.0) as u32
        }
        _ => width / 2,
    };
    Ok((width, height))
}

/// Frames that one sequence takes from its video.
#[derive(Debug, Clone)]
pub struct Selection {
    /// Timestamps of the frames, in order.
    pub times: Vec<f64>,
    /// Timestamps of the small frames in which motion is measured, in order.
    pub motion_times: Vec<f64>,
    /// Folder that receives `frames/000000.png` and `motion/000000.png` and on.
    pub folder: PathBuf,
}

/// A file that shows the frame of a time.
struct FrameRequest {
    time_seconds: f64,
    path: PathBuf,
    /// Width and height in pixels.
    size: (u32, u32),
    /// False for a small frame in which motion is measured.
    is_sampled: bool,
}

/// Returns the files of all selections in order of time, and creates their folders.
fn wanted_files(
    selections: &[Selection],
    size: (u32, u32),
) -> Result<Vec<FrameRequest>, CurateError> {
    let small = size.0.min(MOTION_WIDTH_PIXELS) & !1;
    let mut wanted = Vec::new();
    for Selection {
        times,
        motion_times,
        folder,
    } in selections
    {
        store::create_folder(&folder.join(FRAMES_FOLDER))?;
        if !motion_times.is_empty() {
            store::create_folder(&folder.join(MOTION_FOLDER))?;
        }
        let mut add = |times: &[f64], name: fn(usize) -> String, size, is_sampled| {
            wanted.extend(times.iter().enumerate().map(|(index, &time_seconds)| {
                let path = folder.join(name(index));
                FrameRequest {
                    time_seconds,
                    path,
                    size,
                    is_sampled,
                }
            }));
        };
        add(times, file_name, size, true);
        add(motion_times, motion_file_name, (small, small / 2), false);
    }
    wanted.sort_by(|a, b| a.time_seconds.total_cmp(&b.time_seconds));
    Ok(wanted)
}

/// Announces the extraction of files. Small frames in which motion is measured are told apart and not counted as steps.
fn begin(wanted: &[FrameRequest], progress: &dyn Progress) {
    let sampled = wanted.iter().filter(|wanted| wanted.is_sampled).count();
    progress.begin("extracting frames", Some(sampled as u64));
    let small = wanted.len() - sampled;
    if small > 0 {
        progress.status(&format!(
            "{} and {small} for motion",
            counted(sampled, "frame")
        ));
    }
}

/// Decodes a video once and writes the selected frames of all sequences at `size`, numbered from 0 in order of time.
/// They are equirectangular if the video stores a sphere by a `layout`.
///
/// # Errors
/// When the video breaks off, a selected frame does not recur, or a file cannot be written.
pub fn extract(
    video: &Path,
    probe: &Probe,
    selections: &[Selection],
    layout: Option<SphereLayout>,
    size: (u32, u32),
    progress: &dyn Progress,
) -> Result<(), CurateError> {
    let wanted = wanted_files(selections, size)?;
    let mut reader = VideoReader::open(video)?;
    let mut converter = Converter::new(Scaling::Native);
    let mut to_erp = layout.map(ToErp::new);
    let turns = probe.clockwise_quarter_turns();
    begin(&wanted, progress);
    let outcome: Result<(), CurateError> = (|| {
        let mut due = wanted.iter().peekable();
        while let Some(&&FrameRequest { time_seconds, .. }) = due.peek() {
            let lost = || {
                CurateError::video(
                    video,
                    format!("the frame at {time_seconds:.6} s did not decode a second time"),
                )
            };
            let frame = reader.next_frame()?.ok_or_else(lost)?;
            if frame.time_seconds < time_seconds - SAME_INSTANT_SECONDS {
                continue;
            }
            // A neighbour in its place would go unnoticed.
            if frame.time_seconds > time_seconds + SAME_INSTANT_SECONDS {
                return Err(lost());
            }
            let image = converter.convert(video, &frame.image)?.turned(turns);
            let image = match &mut to_erp {
                Some(to_erp) => to_erp.convert(&image, size.0 as usize),
                None => image,
            };
            let is_shown = |wanted: &&FrameRequest| {
                wanted.time_seconds <= frame.time_seconds + SAME_INSTANT_SECONDS
            };
            while let Some(wanted) = due.next_if(is_shown) {
                write_frame(&wanted.path, &image, wanted.size)?;
                progress.advance(u64::from(wanted.is_sampled));
            }
        }
        Ok(())
    })();
    progress.end();
    outcome
}

/// Describes the resampling of frames of the probed video to `size`, for the record.
pub fn resampling(probe: &Probe, layout: Option<SphereLayout>, size: (u32, u32)) -> String {
    let (columns, rows) = probe.upright_size();
    if let Some(layout) = layout {
        format!("area averaging on the sphere from {layout} of {columns}x{rows}")
    } else if (columns, rows) == size {
        "none".to_owned()
    } else {
        format!("area averaging from {columns}x{rows}")
    }
}

fn write_frame(path: &Path, image: &Rgb8Image, size: (u32, u32)) -> Result<(), CurateError> {
    let (width, height) = (size.0 as usize, size.1 as usize);
    if (image.width, image.height) == (width, height) {
        return Ok(rgb::write_rgb8_png(path, width, height, &image.data)?);
    }
    let bytes = RgbImage::from_rgb8(image.width, image.height, &image.data)
        .resized_by_area(width, height)
        .to_rgb8();
    Ok(rgb::write_rgb8_png(path, width, height, &bytes)?)
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

    use std::sync::Mutex;

    use proptest::prelude::*;

    use super::*;

    /// Keeps the number of steps and the status.
    #[derive(Default)]
    struct Announced(Mutex<(Option<u64>, String)>);

    impl Progress for Announced {
        fn begin(&self, _: &str, total: Option<u64>) {
            self.0.lock().unwrap().0 = total;
        }
        fn advance(&self, _: u64) {}
        fn status(&self, text: &str) {
            text.clone_into(&mut self.0.lock().unwrap().1);
        }
        fn end(&self) {}
        fn note(&self, _: &str) {}
    }

    #[test]
    fn frames_for_motion_are_no_steps_of_the_extraction() {
        let announced = |sampled: usize, small: usize| {
            let request = |is_sampled| FrameRequest {
                time_seconds: 0.0,
                path: PathBuf::new(),
                size: (2, 1),
                is_sampled,
            };
            let wanted = (0..sampled + small).map(|number| request(number < sampled));
            let progress = Announced::default();
            begin(&wanted.collect::<Vec<_>>(), &progress);
            progress.0.into_inner().unwrap()
        };
        let (total, status) = announced(12, 48);
        assert_eq!(total, Some(12));
        assert!(
            status.contains("12 frames") && status.contains("48"),
            "{status}"
        );
        assert_eq!(announced(3, 0), (Some(3), String::new()));
    }

    fn whole(times: &[f64]) -> TimeRange {
        TimeRange::new(times[0], times[times.len() - 1] + 1.0)
    }

    #[test]
    fn steady_video_is_sampled_at_exactly_even_distances() {
        let times: Vec<f64> = (0..188).map(|i| f64::from(i) * 0.04).collect();
        let chosen = choose(&times, whole(&times), Sampling::MaxFrames(120));
        assert_eq!(chosen.len(), 94);
        assert!(
            chosen
                .windows(2)
                .all(|pair| (pair[1] - pair[0] - 0.08).abs() < 1e-9)
        );
        let per_second = choose(&times, whole(&times), Sampling::FramesPerSecond(5.0));
        assert_eq!(per_second.len(), 38);
    }

    #[test]
    fn nothing_is_invented_where_there_are_fewer_frames() {
        let times = [0.0, 0.5, 1.5];
        assert_eq!(
            choose(&times, whole(&times), Sampling::MaxFrames(120)),
            times
        );
        assert_eq!(
            choose(&times, whole(&times), Sampling::FramesPerSecond(60.0)),
            times
        );
        assert_eq!(choose(&times, whole(&times), Sampling::MaxFrames(1)), [0.0]);
        for rate in [1e9, 1e300, f64::MAX] {
            let all = choose(&times, whole(&times), Sampling::FramesPerSecond(rate));
            assert_eq!(all, times, "{rate} per second");
        }
        let nowhere = TimeRange::new(9.0, 10.0);
        assert_eq!(choose(&times, nowhere, Sampling::MaxFrames(3)), [0.0; 0]);
    }

    #[test]
    fn a_gap_costs_no_more_than_its_frames() {
        let mut times: Vec<f64> = (0..20).map(|i| f64::from(i) / 10.0).collect();
        times.extend((0..20).map(|i| 3e9 + f64::from(i) / 10.0));
        let chosen = choose(&times, whole(&times), Sampling::FramesPerSecond(5.0));
        assert!((20..=24).contains(&chosen.len()), "{}", chosen.len());
        let distant = [0.0, 1e15];
        let rate = Sampling::FramesPerSecond(1e9);
        assert_eq!(choose(&distant, whole(&distant), rate), distant);
    }

    proptest! {
        /// Stepping over instants leaves out no frame that is nearest to one.
        #[test]
        fn the_frames_nearest_to_all_instants_are_found(
            gaps in proptest::collection::vec(1e-3_f64..3.0, 1..60),
            rate in 0.2_f64..40.0,
        ) {
            let mut times = vec![5.0];
            for gap in gaps {
                times.push(times[times.len() - 1] + gap);
            }
            let (interval, length) = (1.0 / rate, times[times.len() - 1] - 5.0);
            let last = (length / interval).floor() as u64;
            let mut all: Vec<f64> = (0..=last)
                .map(|instant| nearest(&times, 5.0 + instant as f64 * interval))
                .collect();
            all.dedup();
            prop_assert_eq!(nearest_to_instants(&times, interval, last), all);
        }

        /// Samples are frames of the shot, in order, never more than requested, and at a steady rate more than half of
        /// that.
        #[test]
        fn samples_keep_to_the_bound(count in 2_usize..400, most in 2_u32..150) {
            let times: Vec<f64> = (0..count).map(|i| i as f64 / 29.97).collect();
            let chosen = choose(&times, whole(&times), Sampling::MaxFrames(most));
            prop_assert!(chosen.len() <= most as usize);
            prop_assert!(2 * chosen.len() >= count.min(most as usize));
            prop_assert!(chosen.windows(2).all(|pair| pair[0] < pair[1]));
            prop_assert!(chosen.iter().all(|time| times.contains(time)));
        }

        /// Any rate gives frames in order, no two the same.
        #[test]
        fn any_rate_gives_frames(count in 1_usize..200, exponent in -6.0_f64..300.0) {
            let times: Vec<f64> = (0..count).map(|i| i as f64 / 29.97 + (i % 3) as f64 * 1e-3).collect();
            let rate = Sampling::FramesPerSecond(10_f64.powf(exponent));
            let chosen = choose(&times, whole(&times), rate);
            prop_assert!(!chosen.is_empty());
            prop_assert!(chosen.windows(2).all(|pair| pair[0] < pair[1]));
            prop_assert!(chosen.iter().all(|time| times.contains(time)));
        }
    }
}
