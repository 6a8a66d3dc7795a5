//! Lines of a common period in the luminance of one frame: the steps of a grid in a window, along rows and along
//! columns.

use omnilife_schemas::statistics;

use crate::video::LumaImage;

/// Windows begin and end at multiples of this many pixels.
pub(super) const STRIP_PIXELS: usize = 16;

/// Columns are lines if their gradients reach this factor of those of the other columns, and this share of the mean
/// line's.
const LINE_CONTRAST: f32 = 2.5;
const LEAST_LINE_SHARE: f32 = 0.25;
/// Pixels that a line spreads over at most, after compression or scaling.
const MOST_LINE_PIXELS: usize = 3;
/// Mean gradient over the whole window, in 8-bit levels, below which a window is plain.
const LEAST_MEAN_LEVELS: f32 = 0.35;
/// Largest share of columns above the mean: fewer than half.
const MOST_LINE_COLUMNS: f32 = 0.45;
/// Largest distance of a line from its place by the period, pixels.
const MOST_DEVIATION_PIXELS: f32 = 0.6;
/// Least number of lines, and least share of those expected by the period.
const LEAST_LINES: usize = 4;
const LEAST_PRESENT_SHARE: f32 = 0.75;

/// Sums of gradients of an image, from which those of any window take one subtraction a column.
#[derive(Debug, Default)]
pub(super) struct LineProfiles {
    columns: usize,
    rows: usize,
    /// Per strip of rows and one more, and per column: absolute differences to the next column,
    /// summed over all rows above the strip.
    across: Vec<u32>,
    /// Per strip of columns and one more, and per row: absolute differences to the next row, summed
    /// over all columns left of the strip.
    down: Vec<u32>,
}

/// A square of pixels; `left` may be so large that it reaches into the image's margin.
#[derive(Debug, Clone, Copy)]
pub(super) struct Window {
    pub(super) left: usize,
    pub(super) top: usize,
    pub(super) size: usize,
}

impl Window {
    pub(super) fn middle(self) -> (usize, usize) {
        (self.left + self.size / 2, self.top + self.size / 2)
    }
}

impl LineProfiles {
    /// Measures an image, margin included. Reuses allocated memory.
    pub(super) fn measure(&mut self, image: &LumaImage) {
        self.columns = image.stride() / STRIP_PIXELS * STRIP_PIXELS;
        self.rows = image.height / STRIP_PIXELS * STRIP_PIXELS;
        self.measure_across(image);
        self.measure_down(image);
    }

    fn measure_across(&mut self, image: &LumaImage) {
        let columns = self.columns;
        self.across.clear();
        self.across
            .resize((self.rows / STRIP_PIXELS + 1) * columns, 0);
        let mut sums = vec![0_u16; columns];
        for strip in 0..self.rows / STRIP_PIXELS {
            sums.fill(0);
            for y in strip * STRIP_PIXELS..(strip + 1) * STRIP_PIXELS {
                let row = image.row(y);
                for ((sum, here), next) in sums.iter_mut().zip(row).zip(&row[1..]) {
                    // 16 differences of 8 bits fit; without checks eight are added at once.
                    *sum = sum.wrapping_add(u16::from(here.abs_diff(*next)));
                }
            }
            let (before, after) = self.across.split_at_mut((strip + 1) * columns);
            let before = &before[strip * columns..];
            for ((after, before), sum) in after.iter_mut().zip(before).zip(&sums) {
                *after = before.wrapping_add(u32::from(*sum));
            }
        }
    }

    fn measure_down(&mut self, image: &LumaImage) {
        let (rows, strips) = (self.rows, self.columns / STRIP_PIXELS);
        self.down.clear();
        self.down.resize((strips + 1) * rows, 0);
        for y in 0..rows.min(image.height - 1) {
            let (here, next) = (image.row(y), image.row(y + 1));
            let mut total = 0_u32;
            let blocks = here
                .as_chunks::<STRIP_PIXELS>()
                .0
                .iter()
                .zip(next.as_chunks::<STRIP_PIXELS>().0);
            for (strip, (here, next)) in blocks.take(strips).enumerate() {
                total = total.wrapping_add(difference(here, next));
                self.down[(strip + 1) * rows + y] = total;
            }
        }
    }

    /// Returns all windows of this size, so many pixels apart.
    pub(super) fn windows(&self, size: usize, step: usize) -> impl Iterator<Item = Window> {
        let tops = (0..(self.rows + 1).saturating_sub(size)).step_by(step);
        let columns = self.columns;
        tops.flat_map(move |top| {
            (0..(columns + 1).saturating_sub(size))
                .step_by(step)
                .map(move |left| Window { left, top, size })
        })
    }

    /// Sums the absolute difference of each column of a window to the next over its rows.
    pub(super) fn across(&self, window: Window, into: &mut Vec<u32>) {
        let row = |y: usize| y / STRIP_PIXELS * self.columns + window.left;
        let (above, below) = (row(window.top), row(window.top + window.size));
        subtracted(&self.across, above, below, window.size, into);
    }

    /// Sums the absolute difference of each row of a window to the next over its columns.
    pub(super) fn down(&self, window: Window, into: &mut Vec<u32>) {
        let column = |x: usize| x / STRIP_PIXELS * self.rows + window.top;
        let (left, right) = (column(window.left), column(window.left + window.size));
        subtracted(&self.down, left, right, window.size, into);
    }

    /// Returns how visible a codec's blocks are, 8-bit levels: by how much the mean difference is larger on every
    /// `period`-th column, counted from the image's left border, than elsewhere. It is taken over the most visible
    /// strips of rows, without the top tenth. Blocks over a fifth of the image's width or more, on that grid, count as
    /// the codec's own.
    pub(super) fn blocking_levels(&self, period: usize) -> f32 {
        let strips = self.rows / STRIP_PIXELS;
        let samples = |columns: usize| (columns * STRIP_PIXELS) as f32;
        let lines = self.columns / period;
        let mut excesses: Vec<f32> = (0..strips)
            .map(|strip| {
                let above = &self.across[strip * self.columns..][..self.columns];
                let below = &self.across[(strip + 1) * self.columns..][..self.columns];
                let sums = || above.iter().zip(below).map(|(above, below)| below - above);
                let total: u32 = sums().sum();
                let on_lines: u32 = sums().skip(period - 1).step_by(period).sum();
                on_lines as f32 / samples(lines)
                    - (total - on_lines) as f32 / samples(self.columns - lines)
            })
            .collect();
        excesses.sort_by(f32::total_cmp);
        excesses.get(strips * 9 / 10).copied().unwrap_or(0.0)
    }
}

fn difference(here: &[u8; STRIP_PIXELS], next: &[u8; STRIP_PIXELS]) -> u32 {
    here.iter()
        .zip(next)
        .fold(0, |sum, (here, next)| sum + u32::from(here.abs_diff(*next)))
}

fn subtracted(sums: &[u32], from: usize, to: usize, size: usize, into: &mut Vec<u32>) {
    let pairs = sums[from..from + size].iter().zip(&sums[to..to + size]);
    into.clear();
    into.extend(pairs.map(|(from, to)| to.wrapping_sub(*from)));
}

/// Lines of a common distance.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Lines {
    /// Distance, pixels; need not be whole.
    pub(super) period: f32,
    /// First pixel after each line, counted from where the profile begins.
    pub(super) cuts: Vec<usize>,
}

/// Returns the lines of a square window's profile (entry `i` is the sum of gradients between `i` and `i + 1`). It must
/// have nearly all lines of one period between the limits, and nothing else.
pub(super) fn lines(profile: &[u32], least_period: f32, most_period: f32) -> Option<Lines> {
    let threshold = line_threshold(profile)?;
    let places = peaks(profile, threshold)?;
    if places.len() < LEAST_LINES {
        return None;
    }
    let distances: Vec<f32> = places.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let typical = statistics::median(&distances)?;
    let (first, last) = (places[0], places[places.len() - 1]);
    let intervals = ((last - first) / typical).round();
    let period = (last - first) / intervals;
    if !(least_period..=most_period).contains(&period)
        || places.len() as f32 - 1.0 < LEAST_PRESENT_SHARE * intervals
        || first > period + 1.0
        || profile.len() as f32 - last > period + 2.0
    {
        return None;
    }
    let fits = |place: &f32| {
        let from_first = place - first;
        (from_first - (from_first / period).round() * period).abs() <= MOST_DEVIATION_PIXELS
    };
    if !places.iter().all(fits) {
        return None;
    }
    let cuts = (0..=intervals as usize)
        .map(|index| (first + index as f32 * period).round() as usize + 1)
        .collect();
    Some(Lines { period, cuts })
}

/// Returns the threshold of lines; `None` unless few columns of the profile stand out.
///
/// Nearly all windows end here, so it uses whole numbers: processors add several at once.
fn line_threshold(profile: &[u32]) -> Option<u32> {
    let count = profile.len() as u32;
    let total: u32 = profile.iter().sum();
    let mean = total / count;
    // Each sum has as many samples as there are columns.
    if mean as f32 <= LEAST_MEAN_LEVELS * count as f32 {
        return None;
    }
    let (mut above, mut above_sum) = (0_u32, 0_u32);
    for &value in profile {
        above += u32::from(value > mean);
        above_sum += if value > mean { value } else { 0 };
    }
    let peak = above_sum as f32 / above as f32;
    let base = (total - above_sum) as f32 / (count - above).max(1) as f32;
    let threshold = (LINE_CONTRAST * base).max(LEAST_LINE_SHARE * peak);
    (peak > threshold && (above as f32) < MOST_LINE_COLUMNS * count as f32)
        .then_some(threshold as u32)
}

/// Returns centres of the runs of columns above the threshold; `None` if one is not a sharp line.
fn peaks(profile: &[u32], threshold: u32) -> Option<Vec<f32>> {
    let mut places = Vec::new();
    let mut at = 0;
    while at < profile.len() {
        if profile[at] <= threshold {
            at += 1;
            continue;
        }
        let run = profile[at..]
            .iter()
            .take_while(|&&value| value > threshold)
            .count();
        if run > MOST_LINE_PIXELS {
            return None;
        }
        let values = || (at..).zip(&profile[at..at + run]);
        let weight: u32 = values().map(|(_, value)| value).sum();
        let moment: f32 = values().map(|(x, &value)| x as f32 * value as f32).sum();
        places.push(moment / weight as f32);
        at += run;
    }
    Some(places)
}
