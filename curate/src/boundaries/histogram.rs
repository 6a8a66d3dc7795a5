//! Boundaries from colour histograms of latitude bands.
//!
//! Distances between frames are shares of the image's weight that changed its colour bin, 0 to 1;
//! see `descriptor.rs`.
//!
//! Cuts are single frames whose distance stands out from its neighbourhood. Gradual transitions are runs of moderately
//! raised distances whose two ends differ, the twin comparison of Zhang, Kankanhalli and Smoliar ("Automatic
//! partitioning of full-motion video", 1993). Both are refused if the layout of the image survives, whichever way the
//! camera faces afterwards: then the light changed, not the shot.

use std::collections::VecDeque;

use omnilife_schemas::{
    records::{Boundary, BoundaryKind},
    statistics,
};
use omnilife_video::{Rgb8Image, Scaling};

use super::{
    Detector, MissingSignal, SignalPass, Signals,
    descriptor::{Descriptor, HISTOGRAM_BINS, correlation, distance},
};

/// The detector.
pub const DETECTOR: Detector = Detector {
    id: "histogram",
    summary: "Colour histograms of latitude bands: sudden change for cuts, twin comparison for \
              gradual transitions, refused where the image's layout stays.",
    settings: || format!("{SETTINGS:?}"),
    images: Scaling::MaxWidth(128),
    start: || Ok(Box::new(HistogramPass::default())),
    decide,
};

/// Limits of the detector. Distances are shares in [0, 1], windows are in seconds.
#[derive(Debug, Clone, Copy)]
struct Settings {
    /// Distances that make a step are taken over at least this long, so that one step means the
    /// same at 60 and at 25 frames per second.
    step_seconds: f64,
    /// Half the span over which `change` compares, and the width of the segments it averages.
    change_reach_seconds: f64,
    change_average_seconds: f64,
    /// Half the spans over which layouts are compared. A change is judged by the first that covers
    /// it, a cut by the first of all.
    layout_reach_seconds: [f64; LAYOUTS.len()],
    /// Correlation of layouts above which the shot is the same, whatever its colours.
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
    /// lasts at least and at most this,
    gradual_shortest_seconds: f64,
    gradual_longest_seconds: f64,
    /// and its two sides differ by at least this.
    gradual_change: f32,
}

const SETTINGS: Settings = Settings {
    step_seconds: 0.035,
    change_reach_seconds: 0.75,
    change_average_seconds: 0.2,
    layout_reach_seconds: [0.1, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0, 1.3],
    same_layout: 0.6,
    cut_distance: 0.2,
    cut_over_median: 4.5,
    cut_window_seconds: 1.0,
    merge_seconds: 0.3,
    gradual_step: 0.02,
    gradual_over_quiet: 2.5,
    gradual_window_seconds: 1.5,
    gradual_gap_seconds: 0.1,
    gradual_shortest_seconds: 0.1,
    gradual_longest_seconds: 2.5,
    gradual_change: 0.4,
};

/// Signal: distance from the frame before.
const ADJACENT: &str = "adjacent";
/// Signal: distance from the frame `step_seconds` before, at least one frame.
const STEP: &str = "step";
/// Signal: distance between the segments `change_reach_seconds` before and after.
const CHANGE: &str = "change";
/// Signals: correlation of the layouts each of `layout_reach_seconds` before and after.
const LAYOUTS: [&str; 8] = [
    "layout_100ms",
    "layout_200ms",
    "layout_300ms",
    "layout_400ms",
    "layout_600ms",
    "layout_800ms",
    "layout_1000ms",
    "layout_1300ms",
];

/// Keeps the descriptors of about three seconds and emits the row of the frame in their middle.
#[derive(Default)]
struct HistogramPass {
    window: VecDeque<Descriptor>,
    /// Index in `window` of the next frame whose row is due.
    due: usize,
    times: Vec<f64>,
    adjacent: Vec<f32>,
    step: Vec<f32>,
    change: Vec<f32>,
    layouts: [Vec<f32>; LAYOUTS.len()],
}

impl SignalPass for HistogramPass {
    fn observe(&mut self, time_seconds: f64, image: &Rgb8Image) -> Result<(), String> {
        self.window.push_back(Descriptor::of(time_seconds, image)?);
        let reach = SETTINGS.layout_reach_seconds.into_iter().fold(
            SETTINGS.change_reach_seconds + SETTINGS.change_average_seconds,
            f64::max,
        );
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
        let mut columns = vec![
            (ADJACENT.to_owned(), self.adjacent),
            (STEP.to_owned(), self.step),
            (CHANGE.to_owned(), self.change),
        ];
        columns.extend(LAYOUTS.map(str::to_owned).into_iter().zip(self.layouts));
        Signals {
            times: self.times,
            columns,
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
        let layouts = SETTINGS
            .layout_reach_seconds
            .map(|reach| self.layouts_around(now, reach));
        self.times.push(now);
        self.adjacent.push(adjacent);
        self.step.push(step);
        self.change.push(change);
        for (column, layout) in self.layouts.iter_mut().zip(layouts) {
            column.push(layout);
        }
        self.due += 1;
    }

    /// Returns the correlation of the layouts `reach_seconds` before and after an instant.
    fn layouts_around(&self, now: f64, reach_seconds: f64) -> f32 {
        let before = self.last_until(now - reach_seconds);
        let after = self.first_from(now + reach_seconds);
        correlation(&self.window[before].layout, &self.window[after].layout)
    }

    /// Returns the index of the last frame at or before an instant, or of the first frame.
    fn last_until(&self, seconds: f64) -> usize {
        self.window
            .partition_point(|frame| frame.time_seconds <= seconds)
            .saturating_sub(1)
    }

    /// Returns the index of the first frame at or after an instant, or of the last frame.
    fn first_from(&self, seconds: f64) -> usize {
        self.window
            .partition_point(|frame| frame.time_seconds < seconds)
            .min(self.window.len() - 1)
    }

    /// Returns the mean histogram of the frames between two instants, or of the nearest frame.
    fn mean_between(&self, begin: f64, end: f64) -> Vec<f32> {
        let first = self.first_from(begin);
        let last = self.last_until(end).max(first);
        let mut mean = vec![0.0; HISTOGRAM_BINS];
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

fn decide(signals: &Signals) -> Result<Vec<Boundary>, MissingSignal> {
    let mut layouts = [[].as_slice(); LAYOUTS.len()];
    for (column, name) in layouts.iter_mut().zip(LAYOUTS) {
        *column = signals.column(name)?;
    }
    let table = Table {
        times: &signals.times,
        adjacent: signals.column(ADJACENT)?,
        step: signals.column(STEP)?,
        change: signals.column(CHANGE)?,
        layouts,
    };
    let sudden = table.sudden();
    let mut boundaries: Vec<Boundary> = sudden
        .iter()
        .map(|run| table.sudden_boundary(run))
        .collect();
    boundaries.extend(table.gradual(&sudden));
    boundaries.sort_by(|a, b| a.begin_seconds.total_cmp(&b.begin_seconds));
    Ok(boundaries)
}

/// First and last index of a run of frames, both inside.
type Run = std::ops::RangeInclusive<usize>;

struct Table<'a> {
    times: &'a [f64],
    adjacent: &'a [f32],
    step: &'a [f32],
    change: &'a [f32],
    layouts: [&'a [f32]; LAYOUTS.len()],
}

impl Table<'_> {
    /// Returns runs of frames that differ from the frame before as only a new shot does. Cuts closer than
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
                && self.layouts[0][index] <= SETTINGS.same_layout;
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
        // A flash is two sudden changes that leave the shot as it was.
        runs.retain(|run| self.layout_around(run) <= SETTINGS.same_layout);
        runs
    }

    /// Returns the correlation of the layouts before and after a run, over the first span that covers it or one of the
    /// next two: a flash leaves traces a little further off.
    fn layout_around(&self, run: &Run) -> f32 {
        let half = 0.5 * (self.times[*run.end()] - self.times[run.start().saturating_sub(1)]);
        let reaches = &SETTINGS.layout_reach_seconds;
        let first = reaches.partition_point(|&reach| reach < half);
        let first = first.min(reaches.len() - 1);
        let middle = usize::midpoint(*run.start(), *run.end());
        self.layouts[first..]
            .iter()
            .take(3)
            .map(|column| column[middle])
            .fold(f32::NEG_INFINITY, f32::max)
    }

    fn sudden_boundary(&self, run: &Run) -> Boundary {
        let strongest = self.adjacent[run.clone()]
            .iter()
            .copied()
            .fold(0.0, f32::max);
        let (mut first, mut last) = (*run.start(), *run.end());
        // The tails of a fast transition are weaker than its core.
        while first > 1 && self.adjacent[first - 1] >= 0.25 * strongest {
            first -= 1;
        }
        while last + 1 < self.times.len() && self.adjacent[last + 1] >= 0.25 * strongest {
            last += 1;
        }
        let kind = if first == last {
            BoundaryKind::Cut
        } else {
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
            let holds_sudden = sudden
                .iter()
                .any(|other| *other.start() <= last + 1 && first <= *other.end() + 1);
            let lasts_right = (SETTINGS.gradual_shortest_seconds
                ..=SETTINGS.gradual_longest_seconds)
                .contains(&duration);
            if !holds_sudden
                && lasts_right
                && travelled >= SETTINGS.gradual_change
                && change >= SETTINGS.gradual_change
                && self.layout_around(&run) <= SETTINGS.same_layout
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
