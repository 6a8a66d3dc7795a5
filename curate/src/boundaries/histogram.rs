//! Boundaries from colour histograms of latitude bands.
//!
//! Every frame becomes HSV histograms of four latitude bands, rows weighted by the cosine of their
//! latitude. A camera that yaws moves colours along the bands and leaves the histograms as they
//! are. Distances are shares of the picture's weight that changed its colour bin, 0 to 1 (half the
//! L1 distance).
//!
//! Cuts are single frames whose distance stands out from its neighbourhood; gradual transitions are
//! runs of moderately raised distances whose two ends differ, the twin comparison of Zhang,
//! Kankanhalli and Smoliar ("Automatic partitioning of full-motion video", 1993). Both are refused
//! where the layout of the picture survives: then the light changed, not the shot.

use std::collections::VecDeque;

use omnilife_schemas::records::{Boundary, BoundaryKind};
use opencv::{
    core::{Mat, MatTraitConst, MatTraitConstManual},
    imgproc,
};

use super::{Detector, SignalPass, Signals};
use crate::{statistics, video::Rgb8Picture};

/// The detector.
pub const DETECTOR: Detector = Detector {
    id: "histogram",
    summary: "Colour histograms of latitude bands: sudden change for cuts, twin comparison for \
              gradual transitions, refused where the picture's layout stays.",
    settings: || format!("{SETTINGS:?}"),
    start: || Box::new(HistogramPass::default()),
    decide,
};

/// Limits of the detector. Distances are shares in [0, 1], windows are in seconds.
#[derive(Debug, Clone, Copy)]
struct Settings {
    /// Distances that make a step are taken over at least this long, so that one step means the
    /// same at 60 and at 25 frames per second.
    step_seconds: f64,
    /// Half the span over which `change` compares, and the width of the stretches it averages.
    change_reach_seconds: f64,
    change_average_seconds: f64,
    /// Half the span over which `layout` compares.
    layout_reach_seconds: f64,
    /// Correlation of layouts above which the shot is the same whatever its colours do.
    same_layout: f32,
    /// A cut changes at least this much from one frame to the next ...
    cut_distance: f32,
    /// ... and this many times the median step around it.
    cut_over_median: f32,
    cut_window_seconds: f64,
    /// Cuts closer than this are one transition.
    merge_seconds: f64,
    /// A gradual transition consists of steps of at least this much ...
    gradual_step: f32,
    /// ... and this many times the lower quartile of the steps around it,
    gradual_over_quiet: f32,
    gradual_window_seconds: f64,
    /// with pauses of at most this,
    gradual_gap_seconds: f64,
    /// lasts between these,
    gradual_shortest_seconds: f64,
    gradual_longest_seconds: f64,
    /// and its two sides differ by at least this.
    gradual_change: f32,
}

const SETTINGS: Settings = Settings {
    step_seconds: 0.035,
    change_reach_seconds: 0.75,
    change_average_seconds: 0.2,
    layout_reach_seconds: 0.1,
    same_layout: 0.92,
    cut_distance: 0.3,
    cut_over_median: 3.5,
    cut_window_seconds: 1.0,
    merge_seconds: 0.3,
    gradual_step: 0.06,
    gradual_over_quiet: 2.25,
    gradual_window_seconds: 1.5,
    gradual_gap_seconds: 0.1,
    gradual_shortest_seconds: 0.1,
    gradual_longest_seconds: 2.0,
    gradual_change: 0.55,
};

const BANDS: usize = 4;
const HUES: usize = 12;
const SATURATIONS: usize = 4;
const VALUES: usize = 8;
const BAND_BINS: usize = HUES * SATURATIONS * VALUES;
const LAYOUT_COLUMNS: usize = 32;
const LAYOUT_ROWS: usize = 16;

/// Signal: distance from the frame before.
const ADJACENT: &str = "adjacent";
/// Signal: distance from the frame `step_seconds` before, at least one frame.
const STEP: &str = "step";
/// Signal: distance between the stretches `change_reach_seconds` before and after.
const CHANGE: &str = "change";
/// Signal: correlation of the layouts `layout_reach_seconds` before and after.
const LAYOUT: &str = "layout";

/// What is kept of a frame while its neighbourhood passes by.
struct Descriptor {
    time_seconds: f64,
    /// Colour bins by band; the sum is 1.
    histogram: Vec<f32>,
    /// Luminance thumbnail with zero mean and unit norm; all zero for a flat picture.
    layout: Vec<f32>,
}

/// Keeps the descriptors of about two seconds and emits the row of the frame in their middle.
#[derive(Default)]
struct HistogramPass {
    window: VecDeque<Descriptor>,
    /// Index in `window` of the next frame whose row is due.
    due: usize,
    times: Vec<f64>,
    adjacent: Vec<f32>,
    step: Vec<f32>,
    change: Vec<f32>,
    layout: Vec<f32>,
}

impl SignalPass for HistogramPass {
    fn observe(&mut self, time_seconds: f64, picture: &Rgb8Picture) -> Result<(), String> {
        self.window.push_back(describe(time_seconds, picture)?);
        let reach = SETTINGS.change_reach_seconds + SETTINGS.change_average_seconds;
        while self.window[self.due].time_seconds + reach < time_seconds {
            self.emit();
            let oldest = self.window[self.due].time_seconds - reach;
            while self.due > 1 && self.window[0].time_seconds < oldest {
                self.window.pop_front();
                self.due -= 1;
            }
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Signals {
        while self.due < self.window.len() {
            self.emit();
        }
        Signals {
            times: self.times,
            columns: vec![
                (ADJACENT.to_owned(), self.adjacent),
                (STEP.to_owned(), self.step),
                (CHANGE.to_owned(), self.change),
                (LAYOUT.to_owned(), self.layout),
            ],
        }
    }
}

impl HistogramPass {
    fn emit(&mut self) {
        let here = &self.window[self.due];
        let now = here.time_seconds;
        let (adjacent, step) = match self.due.checked_sub(1) {
            None => (0.0, 0.0),
            Some(before) => {
                let earlier = self.last_until(now - SETTINGS.step_seconds).min(before);
                (
                    distance(&here.histogram, &self.window[before].histogram),
                    distance(&here.histogram, &self.window[earlier].histogram),
                )
            }
        };
        let near = SETTINGS.change_reach_seconds;
        let far = near + SETTINGS.change_average_seconds;
        let change = distance(
            &self.mean_between(now - far, now - near),
            &self.mean_between(now + near, now + far),
        );
        let before = self.last_until(now - SETTINGS.layout_reach_seconds);
        let after = self.first_from(now + SETTINGS.layout_reach_seconds);
        let layout = correlation(&self.window[before].layout, &self.window[after].layout);
        self.times.push(now);
        self.adjacent.push(adjacent);
        self.step.push(step);
        self.change.push(change);
        self.layout.push(layout);
        self.due += 1;
    }

    /// Index of the last frame at or before an instant, or of the first frame.
    fn last_until(&self, seconds: f64) -> usize {
        self.window
            .partition_point(|frame| frame.time_seconds <= seconds)
            .saturating_sub(1)
    }

    /// Index of the first frame at or after an instant, or of the last frame.
    fn first_from(&self, seconds: f64) -> usize {
        self.window
            .partition_point(|frame| frame.time_seconds < seconds)
            .min(self.window.len() - 1)
    }

    /// Mean histogram of the frames between two instants, or of the frame nearest to them.
    fn mean_between(&self, begin: f64, end: f64) -> Vec<f32> {
        let first = self.first_from(begin);
        let last = self.last_until(end).max(first);
        let mut mean = vec![0.0; BANDS * BAND_BINS];
        for index in first..=last {
            for (sum, value) in mean.iter_mut().zip(&self.window[index].histogram) {
                *sum += value;
            }
        }
        let share = 1.0 / (last - first + 1) as f32;
        mean.iter_mut().for_each(|value| *value *= share);
        mean
    }
}

fn distance(a: &[f32], b: &[f32]) -> f32 {
    0.5 * a.iter().zip(b).map(|(x, y)| (x - y).abs()).sum::<f32>()
}

/// Correlation of two layouts: 1 for two flat pictures, 0 for a flat and a structured one.
fn correlation(a: &[f32], b: &[f32]) -> f32 {
    let is_flat = |layout: &[f32]| layout.iter().all(|&value| value == 0.0);
    if is_flat(a) && is_flat(b) {
        return 1.0;
    }
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

fn describe(time_seconds: f64, picture: &Rgb8Picture) -> Result<Descriptor, String> {
    Ok(Descriptor {
        time_seconds,
        histogram: band_histograms(picture).map_err(|error| error.to_string())?,
        layout: luminance_layout(picture),
    })
}

fn band_histograms(picture: &Rgb8Picture) -> opencv::Result<Vec<f32>> {
    let rgb = Mat::from_slice(&picture.data)?;
    let rgb = rgb.reshape(3, picture.height as i32)?;
    let mut hsv = Mat::default();
    imgproc::cvt_color_def(&rgb, &mut hsv, imgproc::COLOR_RGB2HSV)?;
    let pixels = hsv.data_bytes()?;
    let mut histogram = vec![0.0_f32; BANDS * BAND_BINS];
    for (y, row) in pixels.chunks_exact(picture.width * 3).enumerate() {
        let latitude = (0.5 - (y as f64 + 0.5) / picture.height as f64) * std::f64::consts::PI;
        let weight = latitude.cos() as f32;
        let band = y * BANDS / picture.height;
        for pixel in row.as_chunks::<3>().0 {
            // OpenCV's 8-bit hue runs from 0 to 179.
            let hue = usize::from(pixel[0]) * HUES / 180;
            let saturation = usize::from(pixel[1]) * SATURATIONS / 256;
            let value = usize::from(pixel[2]) * VALUES / 256;
            let bin = (hue.min(HUES - 1) * SATURATIONS + saturation) * VALUES + value;
            histogram[band * BAND_BINS + bin] += weight;
        }
    }
    let total: f32 = histogram.iter().sum();
    if total > 0.0 {
        histogram.iter_mut().for_each(|value| *value /= total);
    }
    Ok(histogram)
}

fn luminance_layout(picture: &Rgb8Picture) -> Vec<f32> {
    let mut sums = vec![0.0_f32; LAYOUT_COLUMNS * LAYOUT_ROWS];
    let mut counts = vec![0.0_f32; LAYOUT_COLUMNS * LAYOUT_ROWS];
    for y in 0..picture.height {
        for x in 0..picture.width {
            let cell = y * LAYOUT_ROWS / picture.height * LAYOUT_COLUMNS
                + x * LAYOUT_COLUMNS / picture.width;
            let [red, green, blue] = picture.pixel(x, y).map(f32::from);
            sums[cell] += 0.299 * red + 0.587 * green + 0.114 * blue;
            counts[cell] += 1.0;
        }
    }
    let mut cells: Vec<f32> = sums
        .iter()
        .zip(&counts)
        .map(|(sum, count)| sum / count.max(1.0))
        .collect();
    let mean = cells.iter().sum::<f32>() / cells.len() as f32;
    cells.iter_mut().for_each(|cell| *cell -= mean);
    let norm = cells.iter().map(|cell| cell * cell).sum::<f32>().sqrt();
    // Below one grey level of deviation per cell there is no layout, only noise.
    let scale = if norm < (cells.len() as f32).sqrt() {
        0.0
    } else {
        1.0 / norm
    };
    cells.iter_mut().for_each(|cell| *cell *= scale);
    cells
}

/// Boundaries from the four signals.
fn decide(signals: &Signals) -> Vec<Boundary> {
    let table = Table {
        times: &signals.times,
        adjacent: signals.column(ADJACENT),
        step: signals.column(STEP),
        change: signals.column(CHANGE),
        layout: signals.column(LAYOUT),
    };
    let count = table.times.len();
    if [table.adjacent, table.step, table.change, table.layout]
        .iter()
        .any(|column| column.len() != count)
    {
        return Vec::new();
    }
    let sudden = table.sudden();
    let mut boundaries: Vec<Boundary> = sudden
        .iter()
        .map(|run| table.sudden_boundary(run))
        .collect();
    boundaries.extend(table.gradual(&sudden));
    boundaries.sort_by(|a, b| a.begin_seconds.total_cmp(&b.begin_seconds));
    boundaries
}

/// First and last index of a run of frames, both inside.
type Run = std::ops::RangeInclusive<usize>;

struct Table<'a> {
    times: &'a [f64],
    adjacent: &'a [f32],
    step: &'a [f32],
    change: &'a [f32],
    layout: &'a [f32],
}

impl Table<'_> {
    /// Runs of frames that differ from the frame before as only a new shot does; cuts closer than
    /// `merge_seconds` are one run.
    fn sudden(&self) -> Vec<Run> {
        let mut runs: Vec<Run> = Vec::new();
        for index in 1..self.times.len() {
            let median = statistics::local_quantile(
                self.times,
                self.step,
                index,
                SETTINGS.cut_window_seconds,
                0.5,
            );
            let stands_out = self.adjacent[index] >= SETTINGS.cut_distance
                && self.adjacent[index] >= SETTINGS.cut_over_median * median
                && self.layout[index] <= SETTINGS.same_layout;
            if !stands_out {
                continue;
            }
            match runs.last_mut() {
                Some(run)
                    if self.times[index] - self.times[*run.end()] < SETTINGS.merge_seconds =>
                {
                    *run = *run.start()..=index;
                }
                _ => runs.push(index..=index),
            }
        }
        runs
    }

    fn sudden_boundary(&self, run: &Run) -> Boundary {
        let strongest = self.adjacent[run.clone()]
            .iter()
            .copied()
            .fold(0.0, f32::max);
        let (mut first, mut last) = (*run.start(), *run.end());
        let kind = if first == last {
            BoundaryKind::Cut
        } else {
            // The tails of a fast transition are weaker than its core.
            while first > 1 && self.adjacent[first - 1] >= 0.25 * strongest {
                first -= 1;
            }
            while last + 1 < self.times.len() && self.adjacent[last + 1] >= 0.25 * strongest {
                last += 1;
            }
            BoundaryKind::Gradual
        };
        Boundary {
            begin_seconds: self.times[first - 1],
            end_seconds: self.times[last],
            kind,
            score: f64::from(strongest),
        }
    }

    /// Runs of raised steps whose sides differ, apart from those around a sudden boundary.
    fn gradual(&self, sudden: &[Run]) -> Vec<Boundary> {
        let mut found = Vec::new();
        for run in self.raised() {
            let (first, last) = (*run.start(), *run.end());
            let duration = self.times[last] - self.times[first - 1];
            let travelled: f32 = self.adjacent[run.clone()].iter().sum();
            let change = self.change[run.clone()].iter().copied().fold(0.0, f32::max);
            let layout = self.layout[run.clone()].iter().copied().fold(1.0, f32::min);
            let holds_sudden = sudden
                .iter()
                .any(|other| *other.start() <= last + 1 && first <= *other.end() + 1);
            if !holds_sudden
                && duration >= SETTINGS.gradual_shortest_seconds
                && duration <= SETTINGS.gradual_longest_seconds
                && travelled >= SETTINGS.gradual_change
                && change >= SETTINGS.gradual_change
                && layout <= SETTINGS.same_layout
            {
                found.push(Boundary {
                    begin_seconds: self.times[first - 1],
                    end_seconds: self.times[last],
                    kind: BoundaryKind::Gradual,
                    score: f64::from(change),
                });
            }
        }
        found
    }

    fn raised(&self) -> Vec<Run> {
        let mut runs: Vec<Run> = Vec::new();
        for index in 1..self.times.len() {
            let quiet = statistics::local_quantile(
                self.times,
                self.step,
                index,
                SETTINGS.gradual_window_seconds,
                0.25,
            );
            if self.step[index] < SETTINGS.gradual_step
                || self.step[index] < SETTINGS.gradual_over_quiet * quiet
            {
                continue;
            }
            match runs.last_mut() {
                Some(run)
                    if self.times[index] - self.times[*run.end()]
                        <= SETTINGS.gradual_gap_seconds =>
                {
                    *run = *run.start()..=index;
                }
                _ => runs.push(index..=index),
            }
        }
        runs
    }
}
