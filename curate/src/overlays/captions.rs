//! Captions that pass: strokes that begin and end together, close to each other, while others do not.
//!
//! Letters of a caption appear within half a second and go at once. What moves past the camera, and what the camera
//! carries, changes pixel by pixel. Where a camera rests, strokes all over the image begin and end together, so that a
//! caption must have most of them. It must begin or end within a shot, unless it stays for all of a longer one; over a
//! scene that rests it must do both, because whatever comes or goes in front of the scene ends or begins strokes too.

use std::{collections::BTreeMap, ops::RangeInclusive};

use omnilife_schemas::records::{
    Boundary, Overlay, OverlayClass, OverlaySpan, Sightings, TimeRange,
};

use super::{
    by_shot,
    regions::{Grid, Region},
    runs::{Run, Runs},
    stability::Sample,
};

/// Strokes begin together within so many samples before and after, and end together.
const BEGIN_SAMPLES: u32 = 2;
const END_SAMPLES: u32 = 1;
/// Largest number of begins that are tried for one end.
const MOST_BEGINS: usize = 8;
/// A stroke has at least so many others, itself among them, at most so many pixels away.
const LEAST_NEAR: usize = 7;
const NEAR_PIXELS: usize = 3;
/// Strokes of one caption are at most this many pixels apart.
const REACH_PIXELS: usize = 10;
/// Rows and columns at the border of a caption have at least this share of the strokes of its fullest one.
const LEAST_PROFILE: f64 = 0.2;
/// Least solid angle of a caption's strokes, steradians.
const LEAST_STROKES_STERADIANS: f64 = 0.012;
/// Least share of strokes in the rectangle around a caption, and its largest solid angle, steradians.
const LEAST_DENSITY: f64 = 0.2;
const MOST_STERADIANS: f64 = 0.8;
/// Least share of the strokes that stay in the rectangle, and of those that begin and end together in the image.
const LEAST_PURITY: f64 = 0.3;
const LEAST_CONCENTRATION: f64 = 0.5;
/// Least ratio of a line's width to its height.
const LEAST_ASPECT: f64 = 1.2;
/// Captions are not read at the poles: largest latitude of their middle, degrees.
const MOST_LATITUDE_DEGREES: f64 = 65.0;
/// Captions of fewer samples have at least this mean gradient, 8-bit levels per pixel: a skyline may stay as long.
const LONG_SAMPLES: u32 = 6;
const LEAST_SHORT_STRENGTH: f64 = 40.0;
/// Groups with begins and ends at most so many samples and middles at most so many degrees apart are one.
const SAME_SAMPLES: u32 = 3;
const SAME_DEGREES: f64 = 20.0;
/// Least number of samples of what stays for a whole shot.
const LEAST_LASTING_SAMPLES: u32 = 10;
/// A caption begins or ends with a shot within so many intervals of samples.
const BOUNDARY_INTERVALS: f64 = 1.5;

/// Accumulates over a video. Memory grows with its length by the times of samples and by the groups.
#[derive(Debug, Clone, Default)]
pub(super) struct CaptionPass {
    width: usize,
    times: Vec<f64>,
    runs: Runs,
    groups: Vec<Group>,
}

/// Strokes close to each other that began and ended together.
#[derive(Debug, Clone)]
struct Group {
    begin: u32,
    end: u32,
    rectangle: Rectangle,
    /// Solid angles of the strokes and of the rectangle.
    strokes_steradians: f64,
    steradians: f64,
    /// Share of the strokes that stay in the rectangle, and of those that begin and end together in the image.
    purity: f64,
    concentration: f64,
    /// Means over strokes, weighted by solid angle, in the order of [`measures`].
    measures: [f64; 4],
}

/// Pixels of an image that goes on over the seam.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Rectangle {
    rows: RangeInclusive<usize>,
    left: usize,
    columns: usize,
}

impl CaptionPass {
    /// Adds the pixels of a frame of this width.
    pub(super) fn add(&mut self, seconds: f64, samples: &[Sample], width: usize) {
        self.width = width;
        let number = self.times.len() as u32;
        self.times.push(seconds);
        self.runs.add(number, samples);
        let found = self.ended_before(number);
        self.groups.extend(found);
    }

    /// Returns the number of samples.
    fn samples(&self) -> u32 {
        self.times.len() as u32
    }

    /// Returns the captions, each place once, in order of time.
    pub(super) fn captions(&self, boundaries: &[Boundary], spans: &[OverlaySpan]) -> Vec<Overlay> {
        let mut whole = self.clone();
        whole.runs.end();
        // Ends are looked for in the middle of the samples around them.
        for number in self.samples()..=self.samples() + END_SAMPLES {
            let found = whole.ended_before(number);
            whole.groups.extend(found);
        }
        let mut groups = distinct(whole.groups, &self.grid());
        groups.sort_by_key(|group| group.begin);
        let mut found = Vec::new();
        for group in groups {
            if let Some(class) = self.class(&group, boundaries, spans) {
                by_shot::add(&mut found, self.overlay(&group, class), |_, _| true);
            }
        }
        found
    }

    fn grid(&self) -> Grid {
        Grid {
            width: self.width,
            height: self.runs.len() / self.width.max(1),
        }
    }

    /// Returns the groups whose ends are around the last sample but one before this number.
    fn ended_before(&self, number: u32) -> Vec<Group> {
        let Some(end) = number.checked_sub(1 + END_SAMPLES) else {
            return Vec::new();
        };
        let grid = self.grid();
        let ended = (self.runs.ended()).filter(|(_, run)| run.end().abs_diff(end) <= END_SAMPLES);
        let ended: Vec<(usize, &Run)> = ended.collect();
        let mut steradians = BTreeMap::<u32, f64>::new();
        for (at, run) in &ended {
            *steradians.entry(run.begin).or_default() += grid.steradians(at / grid.width);
        }
        let around = |begin: u32| {
            let range = begin.saturating_sub(BEGIN_SAMPLES)..=begin + BEGIN_SAMPLES;
            steradians.range(range).map(|(_, area)| area).sum::<f64>()
        };
        let begins = steradians.keys().map(|&begin| (begin, around(begin)));
        let mut begins: Vec<(u32, f64)> = begins
            .filter(|(_, area)| *area >= LEAST_STROKES_STERADIANS)
            .collect();
        begins.sort_by(|one, other| other.1.total_cmp(&one.1));
        let mut tried: Vec<u32> = Vec::new();
        for (begin, _) in begins {
            if tried.len() < MOST_BEGINS && tried.iter().all(|other| other.abs_diff(begin) > 1) {
                tried.push(begin);
            }
        }
        let groups = tried.iter().flat_map(|&begin| {
            let together = ended.iter().copied();
            let together =
                together.filter(move |(_, run)| run.begin.abs_diff(begin) <= BEGIN_SAMPLES);
            self.groups_of(&together.collect::<Vec<_>>(), begin)
        });
        groups.collect()
    }

    /// Returns the groups of strokes that began and ended together.
    fn groups_of(&self, together: &[(usize, &Run)], begin: u32) -> Vec<Group> {
        let grid = self.grid();
        let mut runs: BTreeMap<usize, &Run> = together.iter().copied().collect();
        let marks = dense(&grid, runs.keys().copied());
        runs.retain(|at, _| marks[*at]);
        let area_of = |at: &usize| grid.steradians(at / grid.width);
        let all: f64 = runs.keys().map(area_of).sum();
        if all < LEAST_STROKES_STERADIANS {
            return Vec::new();
        }
        let group = |region: &Region| {
            let strokes: Vec<usize> = (region.pixels.iter().copied())
                .filter(|at| marks[*at])
                .collect();
            let rectangle = Rectangle::around(&grid, &strokes)?;
            let strokes: Vec<usize> = (strokes.into_iter())
                .filter(|&at| rectangle.has(&grid, at))
                .collect();
            let area: f64 = strokes.iter().map(area_of).sum();
            if area < LEAST_STROKES_STERADIANS {
                return None;
            }
            let others = rectangle
                .pixels(&grid)
                .filter(|&at| !marks[at] && self.runs.has_stroke_since(at, begin));
            let others: f64 = others.map(|at| area_of(&at)).sum();
            let of_strokes = |of: fn(&Run) -> u32| {
                middle(
                    strokes
                        .iter()
                        .filter_map(|at| runs.get(at))
                        .map(|run| of(run)),
                )
            };
            let weighted = strokes
                .iter()
                .filter_map(|at| Some((area_of(at), *runs.get(at)?)));
            Some(Group {
                begin: of_strokes(|run| run.begin)?,
                end: of_strokes(Run::end)?,
                steradians: rectangle.steradians(&grid),
                rectangle,
                strokes_steradians: area,
                purity: area / (area + others),
                concentration: area / all,
                measures: measures(weighted),
            })
        };
        let regions = grid.regions(&marks, REACH_PIXELS);
        regions.iter().filter_map(group).collect()
    }

    /// Returns the class of a group; `None` if it begins and ends with its shot and does not last, or if it begins or
    /// ends with a shot in which nothing moves: then it may be the scene, in front of which something comes or goes.
    fn class(
        &self,
        group: &Group,
        boundaries: &[Boundary],
        spans: &[OverlaySpan],
    ) -> Option<OverlayClass> {
        let [first, last] = [self.times.first()?, self.times.last()?];
        let interval = (last - first) / f64::from(self.samples().max(2) - 1);
        let margin = BOUNDARY_INTERVALS * interval;
        let is_with_shot = |number: u32| {
            let seconds = self.seconds(number);
            let is_near = |boundary: &Boundary| {
                (boundary.begin_seconds - margin..=boundary.end_seconds + margin).contains(&seconds)
            };
            seconds - first < margin || last - seconds < margin || boundaries.iter().any(is_near)
        };
        let ends = [group.begin, group.end];
        let middle = 0.5 * ends.map(|number| self.seconds(number)).iter().sum::<f64>();
        match ends.map(is_with_shot) {
            [false, false] => Some(OverlayClass::Caption),
            [true, true] => {
                (group.samples() >= LEAST_LASTING_SAMPLES).then_some(OverlayClass::Watermark)
            }
            _ => (spans.iter())
                .any(|span| span.moving_steps > 0 && span.range.contains(middle))
                .then_some(OverlayClass::Caption),
        }
    }

    fn seconds(&self, number: u32) -> f64 {
        let last = self.times.last().copied().unwrap_or_default();
        self.times.get(number as usize).copied().unwrap_or(last)
    }

    fn overlay(&self, group: &Group, class: OverlayClass) -> Overlay {
        let grid = self.grid();
        let [longitude_degrees, latitude_degrees] = group.rectangle.middle_degrees(&grid);
        let [
            constancy,
            strength_levels,
            variation_levels,
            saturated_share,
        ] = group.measures;
        Overlay {
            class,
            longitude_degrees,
            latitude_degrees,
            solid_angle_steradians: group.steradians,
            extent_degrees: Some(group.rectangle.extent_degrees(&grid)),
            constancy,
            stayed: 1.0,
            strength_levels,
            variation_levels,
            saturated_share,
            sightings: Some(Sightings {
                seen_frames: group.samples(),
                looked_at_frames: self.samples(),
                reach_degrees: 0.0,
                block_pixels: 0.0,
            }),
            ranges: vec![TimeRange::new(
                self.seconds(group.begin),
                self.seconds(group.end),
            )],
        }
    }
}

impl Group {
    /// Returns the number of samples for which it stays.
    fn samples(&self) -> u32 {
        self.end + 1 - self.begin
    }

    fn is_caption(&self, grid: &Grid) -> bool {
        let [width, height] = self.rectangle.extent_degrees(grid);
        let [_, latitude] = self.rectangle.middle_degrees(grid);
        let [_, strength, ..] = self.measures;
        self.strokes_steradians >= LEAST_DENSITY * self.steradians
            && (self.samples() >= LONG_SAMPLES || strength >= LEAST_SHORT_STRENGTH)
            && self.steradians <= MOST_STERADIANS
            && self.purity >= LEAST_PURITY
            && self.concentration >= LEAST_CONCENTRATION
            && width * latitude.to_radians().cos() >= LEAST_ASPECT * height
            && latitude.abs() <= MOST_LATITUDE_DEGREES
    }

    /// Returns true if two groups are the same strokes, found around neighbouring begins and ends.
    fn is_same(&self, other: &Self, grid: &Grid) -> bool {
        if self.begin.abs_diff(other.begin) > SAME_SAMPLES
            || self.end.abs_diff(other.end) > SAME_SAMPLES
        {
            return false;
        }
        let [one, two] = [self, other].map(|group| group.rectangle.middle_degrees(grid));
        let across = (one[0] - two[0]).abs();
        across.min(360.0 - across) < SAME_DEGREES && (one[1] - two[1]).abs() < SAME_DEGREES
    }

    fn overlaps(&self, other: &Self, width: usize) -> bool {
        self.begin <= other.end
            && other.begin <= self.end
            && self.rectangle.overlaps(&other.rectangle, width)
    }
}

/// Returns the captions among groups: of the same strokes the largest group alone, of groups that overlap the larger.
fn distinct(mut groups: Vec<Group>, grid: &Grid) -> Vec<Group> {
    groups.sort_by(|one, other| other.strokes_steradians.total_cmp(&one.strokes_steradians));
    let mut known: Vec<Group> = Vec::new();
    for group in groups {
        if !known.iter().any(|other| other.is_same(&group, grid)) {
            known.push(group);
        }
    }
    let mut captions: Vec<Group> = Vec::new();
    for group in known.into_iter().filter(|group| group.is_caption(grid)) {
        if !captions
            .iter()
            .any(|other| other.overlaps(&group, grid.width))
        {
            captions.push(group);
        }
    }
    captions
}

impl Rectangle {
    /// Returns the rectangle around pixels, without sparse rows and columns at its border; `None` without pixels.
    fn around(grid: &Grid, pixels: &[usize]) -> Option<Self> {
        let rows = trimmed(pixels.iter().map(|at| at / grid.width))?;
        let is_inside = |at: &&usize| rows.contains(&(**at / grid.width));
        let inside = || pixels.iter().filter(is_inside);
        let seam = after_widest_gap(grid.width, inside().map(|at| at % grid.width));
        let shifted = |at: &usize| (at % grid.width + grid.width - seam) % grid.width;
        let columns = trimmed(inside().map(shifted))?;
        Some(Self {
            left: (seam + columns.start()) % grid.width,
            columns: columns.end() + 1 - columns.start(),
            rows,
        })
    }

    fn has(&self, grid: &Grid, at: usize) -> bool {
        let across = (at % grid.width + grid.width - self.left) % grid.width;
        self.rows.contains(&(at / grid.width)) && across < self.columns
    }

    fn pixels(&self, grid: &Grid) -> impl Iterator<Item = usize> {
        let (left, columns, width) = (self.left, self.columns, grid.width);
        let rows = self.rows.clone();
        rows.flat_map(move |y| (0..columns).map(move |x| y * width + (left + x) % width))
    }

    fn steradians(&self, grid: &Grid) -> f64 {
        let rows = self.rows.clone().map(|y| grid.steradians(y));
        rows.sum::<f64>() * self.columns as f64
    }

    fn middle_degrees(&self, grid: &Grid) -> [f64; 2] {
        let x = self.left as f64 + 0.5 * self.columns as f64;
        let y = 0.5 * (self.rows.start() + self.rows.end() + 1) as f64;
        let longitude = (x / grid.width as f64).rem_euclid(1.0) - 0.5;
        [longitude * 360.0, (0.5 - y / grid.height as f64) * 180.0]
    }

    /// Returns the width in longitude and the height in latitude.
    fn extent_degrees(&self, grid: &Grid) -> [f64; 2] {
        let rows = self.rows.end() + 1 - self.rows.start();
        [
            self.columns as f64 / grid.width as f64 * 360.0,
            rows as f64 / grid.height as f64 * 180.0,
        ]
    }

    fn overlaps(&self, other: &Self, width: usize) -> bool {
        let across = (other.left + width - self.left) % width;
        let is_across = across < self.columns || width - across < other.columns;
        let is_along =
            self.rows.start() <= other.rows.end() && other.rows.start() <= self.rows.end();
        is_across && is_along
    }
}

/// Returns the marks of pixels that have others near them.
fn dense(grid: &Grid, pixels: impl Iterator<Item = usize> + Clone) -> Vec<bool> {
    let mut marks = vec![false; grid.width * grid.height];
    for at in pixels.clone() {
        marks[at] = true;
    }
    let near = |at: usize| {
        let (x, y) = (at % grid.width, at / grid.width);
        let rows = y.saturating_sub(NEAR_PIXELS)..=(y + NEAR_PIXELS).min(grid.height - 1);
        let in_row = |row: usize| {
            let columns = (0..=2 * NEAR_PIXELS).map(|shift| x + grid.width + shift - NEAR_PIXELS);
            let marked = columns.filter(|column| marks[row * grid.width + column % grid.width]);
            marked.count()
        };
        rows.map(in_row).sum::<usize>()
    };
    let mut dense = vec![false; marks.len()];
    for at in pixels.filter(|&at| near(at) >= LEAST_NEAR) {
        dense[at] = true;
    }
    dense
}

/// Returns the range of values from the first to the last that is not rare; `None` without values.
fn trimmed(values: impl Iterator<Item = usize>) -> Option<RangeInclusive<usize>> {
    let mut counts = BTreeMap::<usize, usize>::new();
    for value in values {
        *counts.entry(value).or_default() += 1;
    }
    let most = *counts.values().max()? as f64;
    let mut kept = counts
        .iter()
        .filter(|(_, count)| **count as f64 >= LEAST_PROFILE * most)
        .map(|(value, _)| *value);
    let first = kept.next()?;
    Some(first..=kept.next_back().unwrap_or(first))
}

/// Returns the median; `None` without values.
fn middle(values: impl Iterator<Item = u32>) -> Option<u32> {
    let mut values: Vec<u32> = values.collect();
    values.sort_unstable();
    values.get(values.len() / 2).copied()
}

/// Returns the first column after the widest gap between columns around the sphere.
fn after_widest_gap(width: usize, columns: impl Iterator<Item = usize>) -> usize {
    let mut covered = vec![false; width];
    for column in columns {
        covered[column] = true;
    }
    let (mut widest, mut after, mut gap) = (0, 0, 0);
    // Twice around, so that a gap over the seam is one.
    for column in (0..2 * width).map(|column| column % width) {
        if covered[column] {
            if gap > widest {
                (widest, after) = (gap, column);
            }
            gap = 0;
        } else {
            gap += 1;
        }
    }
    after
}

/// Returns constancy, strength and variation in 8-bit levels, and the share that is nearly black or white.
fn measures<'a>(strokes: impl Iterator<Item = (f64, &'a Run)>) -> [f64; 4] {
    let mut sums = [0.0; 4];
    let mut total = 0.0;
    for (weight, run) in strokes {
        let [x, y] = run.gradient.map(f64::from);
        let is_extreme = !(25.0..=230.0).contains(&run.level);
        let values = [
            x.hypot(y) / f64::from(run.strength).max(1e-3),
            f64::from(run.strength),
            f64::from(run.variation()),
            f64::from(u8::from(is_extreme)),
        ];
        total += weight;
        for (sum, value) in sums.iter_mut().zip(values) {
            *sum += weight * value;
        }
    }
    sums.map(|sum| sum / f64::max(total, 1e-12))
}

#[cfg(test)]
mod tests;
