//! Table of measures for judging shots: one row per sampled frame, `samples.parquet`.
//!
//! Frames are measured while the video is decoded, before its boundaries are known, and a ledger may change those
//! later. So a row describes its frame, and shots gather the rows inside them.

use std::{ops::Range, path::Path};

use omnilife_schemas::{
    records::{Probe, TimeRange},
    statistics,
};
use omnilife_video::Rgb8Image;

use super::content::Content;
use crate::{
    boundaries::Signals,
    error::CurateError,
    projection::{FRAME_TESTS, Proof, measure_frame, proof},
};

/// Interval of the samples, seconds: a shot of a second has two at any rate from 10 frames per second on.
const INTERVAL_SECONDS: f64 = 0.4;
/// Settings of samples, for stages.
pub(crate) const SETTINGS: &str =
    "contrast, background, change and the readings of 6 tests every 0.4 s";

/// Names of the first columns; those of [`FRAME_TESTS`] follow.
const SPREAD: &str = "spread-levels";
const BACKGROUND: &str = "background-share";
const CHANGED: &str = "changed-share";

/// Collects the samples of a video while it is decoded.
#[derive(Debug)]
pub struct SamplePass {
    table: Signals,
    /// Cells of the last sample.
    cells: Vec<f32>,
}

impl Default for SamplePass {
    fn default() -> Self {
        let tests = FRAME_TESTS.iter().map(|test| test.id);
        let names = [SPREAD, BACKGROUND, CHANGED].into_iter().chain(tests);
        Self {
            table: Signals {
                times: Vec::new(),
                columns: names.map(|name| (name.to_owned(), Vec::new())).collect(),
            },
            cells: Vec::new(),
        }
    }
}

impl SamplePass {
    /// Returns true if the frame at this time is to be measured.
    pub(crate) fn wants(&self, time_seconds: f64) -> bool {
        let last = self.table.times.last();
        last.is_none_or(|last| time_seconds - last >= INTERVAL_SECONDS)
    }

    /// Measures a frame, equirectangular if the video's sphere layout is known.
    pub(crate) fn observe(&mut self, probe: &Probe, time_seconds: f64, image: &Rgb8Image) {
        let content = Content::of(image);
        let changed = (!self.table.times.is_empty()).then(|| content.changed_share(&self.cells));
        let numbers = [content.spread_levels, content.background_share]
            .map(Some)
            .into_iter()
            .chain([changed])
            .chain(measure_frame(probe, image).map(|value| value.map(|value| value as f32)));
        for ((_, column), number) in self.table.columns.iter_mut().zip(numbers) {
            column.push(number.unwrap_or(f32::NAN));
        }
        self.table.times.push(time_seconds);
        self.cells = content.cells;
    }

    /// Returns the samples so far.
    pub(crate) fn finish(self) -> Samples {
        Samples(self.table)
    }
}

/// The samples of a video; NaN for missing values.
#[derive(Debug)]
pub(crate) struct Samples(Signals);

/// The samples inside one shot.
pub(super) struct ShotSamples<'a> {
    samples: &'a Samples,
    range: Range<usize>,
}

impl Samples {
    /// Writes the table atomically.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub(crate) fn write(&self, path: &Path) -> Result<(), CurateError> {
        self.0.write_parquet(path)
    }

    /// Reads a table of [`Samples::write`].
    ///
    /// # Errors
    /// When the file is missing or another table.
    pub(crate) fn read(path: &Path) -> Result<Self, CurateError> {
        let table = Signals::read_parquet(path)?;
        for (name, _) in &SamplePass::default().table.columns {
            (table.column(name))
                .map_err(|missing| CurateError::input(path, missing.to_string()))?;
        }
        Ok(Self(table))
    }

    /// Returns true if some single sample is a whole sphere.
    pub(crate) fn show_spheres(&self) -> bool {
        let all = ShotSamples {
            samples: self,
            range: 0..self.0.times.len(),
        };
        let readings: Vec<Vec<Option<f64>>> = FRAME_TESTS
            .iter()
            .map(|test| all.numbers(test.id).collect())
            .collect();
        let of_frame = |at: usize| readings.iter().map(move |column| column[at]);
        (0..all.count()).any(|at| proof(of_frame(at)) == Proof::Sphere)
    }

    /// Returns the samples in a part of the video.
    pub(super) fn inside(&self, range: TimeRange) -> ShotSamples<'_> {
        let times = &self.0.times;
        let first = times.partition_point(|&time| time < range.begin_seconds);
        let end = times.partition_point(|&time| time < range.end_seconds);
        ShotSamples {
            samples: self,
            range: first..end.max(first),
        }
    }
}

impl ShotSamples<'_> {
    pub(super) fn count(&self) -> usize {
        self.range.len()
    }

    /// Returns the spans from the darkest to the brightest part of a frame, 8-bit levels.
    pub(super) fn spreads_levels(&self) -> Vec<f64> {
        self.numbers(SPREAD).flatten().collect()
    }

    /// Returns the share of the most frequent flat colour per frame.
    pub(super) fn background_shares(&self) -> Vec<f64> {
        self.numbers(BACKGROUND).flatten().collect()
    }

    /// Shares of the cells that changed, from every sample of the shot to the next.
    pub(super) fn changed_shares(&self) -> Vec<f64> {
        // A change up to the first sample is the cut before it.
        self.numbers(CHANGED).skip(1).flatten().collect()
    }

    /// Returns medians of the readings of [`FRAME_TESTS`], in their order; `None` if fewer than half of the samples
    /// have one.
    pub(super) fn readings(&self) -> impl Iterator<Item = Option<f64>> {
        FRAME_TESTS.iter().map(move |test| {
            let known: Vec<f64> = self.numbers(test.id).flatten().collect();
            let is_of_most = 2 * known.len() >= self.count();
            statistics::median(&known).filter(|_| is_of_most)
        })
    }

    fn numbers(&self, name: &str) -> impl Iterator<Item = Option<f64>> {
        let column = self.samples.0.column(name).unwrap_or(&[]);
        let inside = column.get(self.range.clone()).unwrap_or(&[]);
        let number = |value: &f32| value.is_finite().then_some(f64::from(*value));
        inside.iter().map(number)
    }
}
