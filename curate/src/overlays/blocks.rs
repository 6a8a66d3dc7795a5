//! Blocks between the lines of a grid: detection and extent of a mosaic.

use omnilife_video::LumaImage;

use super::line_profiles::{LineProfiles, Lines, Window, lines};

/// Periods of the two directions differ by at most this share, or one pixel's rounding.
const MOST_PERIOD_DIFFERENCE: f32 = 0.06;

/// A block is flat when its pixels deviate from their mean by at most this many 8-bit levels, or this share of the mean
/// step between blocks.
const MOST_DEVIATION_LEVELS: f32 = 1.6;
const MOST_DEVIATION_SHARE: f32 = 0.2;
const LEAST_FLAT_SHARE: f32 = 0.8;
/// Least number of blocks: fewer can be flat by chance.
const LEAST_BLOCKS: f32 = 25.0;
/// Rows and columns of blocks in one patch; larger mosaics are found in parts.
const MOST_BLOCKS_PER_SIDE: usize = 64;
/// Nearly all neighbouring blocks differ by this many levels.
const LEAST_STEP_LEVELS: f32 = 3.0;
const LEAST_STEP_SHARE: f32 = 0.6;
/// Their mean difference is at least this, levels.
const LEAST_MEAN_STEP_LEVELS: f32 = 6.0;
/// Blocks two to four apart differ by at least this share of neighbours' differences: patterns repeat.
const LEAST_FAR_DIFFERENCES: [(usize, f32); 3] = [(2, 0.7), (3, 0.3), (4, 0.3)];
/// Pixels at a line lie between the levels at its sides, to at most this share of the mean step or so many levels.
/// Joints between tiles do not.
const MOST_RIDGE_SHARE: f32 = 0.25;
const MOST_RIDGE_LEVELS: f32 = 2.0;
/// Blocks are at least this large, pixels: codecs have smaller ones.
const LEAST_BLOCK_PIXELS: f32 = 4.6;
/// Two-coloured patterns leave less than this share of the blocks' variance unexplained.
const LEAST_TWO_LEVEL_RESIDUAL: f64 = 0.06;
/// Block sizes of codecs, pixels. The steps of a mosaic on their grid must exceed the image's own codec blocks by this
/// factor.
const CODEC_BLOCKS: [usize; 5] = [4, 8, 16, 32, 64];
const LEAST_OVER_BLOCKING: f32 = 5.0;

/// A rectangle of one frame, in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Area {
    /// First column; below the image's width.
    pub(super) left: usize,
    /// First row.
    pub(super) top: usize,
    /// Columns; may continue over the seam.
    pub(super) width: usize,
    /// Rows.
    pub(super) height: usize,
}

/// Pixelated area of one frame.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Patch {
    /// Its rectangle.
    pub(super) area: Area,
    /// Side of a block, pixels.
    pub(super) block_pixels: f32,
    /// Mean difference of neighbouring blocks, 8-bit levels.
    pub(super) step_levels: f32,
    /// Mean level.
    pub(super) level: f32,
    /// Share of the blocks that are nearly black or nearly white.
    pub(super) saturated_share: f32,
}

/// Blocks between lines.
#[derive(Debug, Clone)]
pub(super) struct Grid {
    period: f32,
    /// First column of each column of blocks, and the end of the last; may lie in the margin.
    xs: Vec<usize>,
    ys: Vec<usize>,
}

/// One block.
#[derive(Debug, Clone, Copy)]
struct Block {
    mean: f32,
    /// Mean absolute deviation.
    deviation: f32,
}

impl Block {
    fn is_flat(&self, step: f32) -> bool {
        self.deviation <= MOST_DEVIATION_LEVELS.max(MOST_DEVIATION_SHARE * step)
    }
}

/// Returns the block between two lines each way, without the pixels at the lines, which compression blurs.
fn block(image: &LumaImage, xs: [usize; 2], ys: [usize; 2]) -> Block {
    let inside = |[begin, end]: [usize; 2]| {
        let border = match end - begin {
            0..=3 => 0,
            4..=9 => 1,
            _ => 2,
        };
        begin + border..end - border
    };
    let columns = inside(xs);
    let rows = inside(ys);
    let count = (columns.len() * rows.len()).max(1) as f32;
    let pixels = || {
        rows.clone()
            .flat_map(|y| &image.row(y)[columns.clone()])
            .map(|&level| f32::from(level))
    };
    let mean = pixels().sum::<f32>() / count;
    let deviation = pixels().map(|level| (level - mean).abs()).sum::<f32>() / count;
    Block { mean, deviation }
}

impl Grid {
    /// Lines of one period in both directions.
    pub(super) fn of(
        profiles: &LineProfiles,
        window: Window,
        across: &mut Vec<u32>,
        down: &mut Vec<u32>,
    ) -> Option<Self> {
        let size = window.size as f32;
        let limits = ((size / 8.0 - 0.5).max(LEAST_BLOCK_PIXELS), size / 4.0 + 0.5);
        profiles.across(window, across);
        let columns = lines(across, limits.0, limits.1)?;
        profiles.down(window, down);
        let rows = lines(down, limits.0, limits.1)?;
        let difference = (columns.period - rows.period).abs();
        let from = |begin: usize, lines: &Lines| lines.cuts.iter().map(|cut| begin + cut).collect();
        (difference <= (MOST_PERIOD_DIFFERENCE * columns.period).max(0.34)).then(|| Self {
            period: 0.5 * (columns.period + rows.period),
            xs: from(window.left, &columns),
            ys: from(window.top, &rows),
        })
    }

    /// Returns true if the blocks are flat with steps between them, and not a codec's.
    pub(super) fn looks_pixelated(&self, image: &LumaImage, profiles: &LineProfiles) -> bool {
        let blocks = self.blocks(image);
        let step = mean_step(&blocks);
        is_flat_with_steps(&blocks, step) && !self.is_of_a_codec(step, profiles)
    }

    fn blocks(&self, image: &LumaImage) -> Vec<Vec<Block>> {
        self.ys
            .windows(2)
            .map(|ys| {
                self.xs
                    .windows(2)
                    .map(|xs| block(image, [xs[0], xs[1]], [ys[0], ys[1]]))
                    .collect()
            })
            .collect()
    }

    /// Extends the grid by the columns and rows of blocks around it that continue it.
    pub(super) fn grown(mut self, image: &LumaImage) -> Self {
        let step = mean_step(&self.blocks(image));
        loop {
            let before = (self.xs.len(), self.ys.len());
            for at_end in [false, true] {
                let next = next_cut(&self.xs, at_end, self.period, image.stride());
                if let Some(next) = next {
                    let cells: Vec<Block> = self
                        .ys
                        .windows(2)
                        .map(|ys| block(image, next.between, [ys[0], ys[1]]))
                        .collect();
                    if continues(&cells, step) {
                        insert(&mut self.xs, next.cut, at_end);
                    }
                }
                let next = next_cut(&self.ys, at_end, self.period, image.height);
                if let Some(next) = next {
                    let cells: Vec<Block> = self
                        .xs
                        .windows(2)
                        .map(|xs| block(image, [xs[0], xs[1]], next.between))
                        .collect();
                    if continues(&cells, step) {
                        insert(&mut self.ys, next.cut, at_end);
                    }
                }
            }
            if before == (self.xs.len(), self.ys.len())
                || before.0.max(before.1) > MOST_BLOCKS_PER_SIDE
            {
                return self;
            }
        }
    }

    /// Returns true if its lines are those of a codec whose blocks show all over the image.
    fn is_of_a_codec(&self, step_levels: f32, profiles: &LineProfiles) -> bool {
        CODEC_BLOCKS.iter().any(|&side| {
            let is_on_line = |cut: &usize| {
                let beyond = cut % side;
                beyond.min(side - beyond) <= 1
            };
            (self.period - side as f32).abs() < 1.0
                && self.xs.iter().all(is_on_line)
                && self.ys.iter().all(is_on_line)
                && step_levels < LEAST_OVER_BLOCKING * profiles.blocking_levels(side)
        })
    }

    pub(super) fn area(&self, image: &LumaImage) -> Option<Area> {
        let (left, right) = (*self.xs.first()?, *self.xs.last()?);
        let (top, bottom) = (*self.ys.first()?, *self.ys.last()?);
        Some(Area {
            left: left % image.width,
            top,
            width: (right - left).min(image.width),
            height: bottom - top,
        })
    }

    /// Returns by how many levels the pixels at lines lie beyond the blocks at both sides.
    fn ridge(&self, image: &LumaImage, blocks: &[Vec<Block>]) -> f32 {
        let mut beyond = 0.0;
        let mut count = 0.0_f32;
        let mut add = |[a, b]: [&Block; 2], x: usize, y: usize| {
            let level = f32::from(image.row(y)[x]);
            beyond += (level - a.mean.max(b.mean))
                .max(a.mean.min(b.mean) - level)
                .max(0.0);
            count += 1.0;
        };
        for (row, ys) in self.ys.windows(2).enumerate() {
            for (column, xs) in self.xs.windows(2).enumerate() {
                let here = &blocks[row][column];
                let middle = (usize::midpoint(xs[0], xs[1]), usize::midpoint(ys[0], ys[1]));
                if let Some(right) = blocks[row].get(column + 1) {
                    (xs[1] - 1..=xs[1]).for_each(|x| add([here, right], x, middle.1));
                }
                if let Some(below) = blocks.get(row + 1) {
                    (ys[1] - 1..=ys[1]).for_each(|y| add([here, &below[column]], middle.0, y));
                }
            }
        }
        beyond / count.max(1.0)
    }

    /// Returns the patch of the blocks if they are a mosaic.
    pub(super) fn patch(&self, image: &LumaImage) -> Option<Patch> {
        let blocks = self.blocks(image);
        let step_levels = mean_step(&blocks);
        let all = || blocks.iter().flatten();
        let count = all().count() as f32;
        let is_mosaic = count >= LEAST_BLOCKS
            && is_flat_with_steps(&blocks, step_levels)
            && self.ridge(image, &blocks) <= MOST_RIDGE_LEVELS.max(MOST_RIDGE_SHARE * step_levels)
            && !repeats(&blocks)
            && !has_two_levels(&blocks);
        let area = self.area(image)?;
        let saturated = all().filter(|block| !(25.0..=230.0).contains(&block.mean));
        is_mosaic.then(|| Patch {
            area,
            block_pixels: self.period,
            step_levels,
            level: all().map(|block| block.mean).sum::<f32>() / count,
            saturated_share: saturated.count() as f32 / count,
        })
    }
}

/// A line beside a grid's outermost one.
struct NextLine {
    cut: usize,
    /// The pixels from line to line, in order.
    between: [usize; 2],
}

fn next_cut(cuts: &[usize], at_end: bool, period: f32, limit: usize) -> Option<NextLine> {
    let (first, last) = (*cuts.first()?, *cuts.last()?);
    // Distances span the whole grid, so that roundings do not add up.
    let reach = cuts.len() as f32 * (last - first) as f32 / (cuts.len() - 1) as f32;
    debug_assert!((reach / cuts.len() as f32 - period).abs() < 1.5);
    if at_end {
        let cut = first + reach.round() as usize;
        (cut <= limit).then_some(NextLine {
            cut,
            between: [last, cut],
        })
    } else {
        let cut = last.checked_sub(reach.round() as usize)?;
        Some(NextLine {
            cut,
            between: [cut, first],
        })
    }
}

fn insert(cuts: &mut Vec<usize>, cut: usize, at_end: bool) {
    let at = if at_end { cuts.len() } else { 0 };
    cuts.insert(at, cut);
}

/// Returns true if blocks side by side are flat and differ.
fn continues(cells: &[Block], step: f32) -> bool {
    let flat = cells.iter().filter(|cell| cell.is_flat(step)).count() as f32;
    let steps = cells
        .windows(2)
        .filter(|pair| (pair[0].mean - pair[1].mean).abs() >= LEAST_STEP_LEVELS)
        .count() as f32;
    flat >= LEAST_FLAT_SHARE * cells.len() as f32
        && steps >= LEAST_STEP_SHARE * (cells.len() as f32 - 1.0)
}

/// Returns differences of blocks so many columns apart, and rows.
fn differences(blocks: &[Vec<Block>], distance: usize) -> [Vec<f32>; 2] {
    let apart = |a: &Block, b: &Block| (a.mean - b.mean).abs();
    let across = blocks
        .iter()
        .flat_map(|row| row.iter().zip(row.iter().skip(distance)))
        .map(|(a, b)| apart(a, b))
        .collect();
    let down = blocks
        .iter()
        .zip(blocks.iter().skip(distance))
        .flat_map(|(here, below)| here.iter().zip(below))
        .map(|(a, b)| apart(a, b))
        .collect();
    [across, down]
}

fn mean(values: &[f32]) -> f32 {
    values.iter().sum::<f32>() / values.len().max(1) as f32
}

fn mean_step(blocks: &[Vec<Block>]) -> f32 {
    let [across, down] = differences(blocks, 1);
    0.5 * (mean(&across) + mean(&down))
}

/// Returns true if nearly all blocks are flat and differ from their neighbours.
fn is_flat_with_steps(blocks: &[Vec<Block>], step: f32) -> bool {
    let (mut flat, mut count) = (0.0, 0.0);
    for block in blocks.iter().flatten() {
        flat += f32::from(u8::from(block.is_flat(step)));
        count += 1.0;
    }
    let steps = differences(blocks, 1).concat();
    let seen = steps
        .iter()
        .filter(|&&step| step >= LEAST_STEP_LEVELS)
        .count() as f32;
    step >= LEAST_MEAN_STEP_LEVELS
        && flat >= LEAST_FLAT_SHARE * count
        && seen >= LEAST_STEP_SHARE * steps.len() as f32
}

/// Returns true if blocks a few rows or columns apart are alike.
fn repeats(blocks: &[Vec<Block>]) -> bool {
    let near = differences(blocks, 1);
    LEAST_FAR_DIFFERENCES.into_iter().any(|(distance, share)| {
        let far = differences(blocks, distance);
        near.iter()
            .zip(&far)
            .any(|(near, far)| !far.is_empty() && mean(far) < share * mean(near))
    })
}

/// Returns true if the blocks have two levels: the best division in two leaves little variance.
fn has_two_levels(blocks: &[Vec<Block>]) -> bool {
    let mut levels: Vec<f32> = blocks.iter().flatten().map(|block| block.mean).collect();
    levels.sort_by(f32::total_cmp);
    // Sums of squares about the mean, from sums and sums of squares.
    let (mut all, mut all_squares) = (0.0, 0.0);
    for &level in &levels {
        all += f64::from(level);
        all_squares += f64::from(level * level);
    }
    let count = levels.len() as f64;
    let total = all_squares - all * all / count;
    let (mut dark, mut dark_count) = (0.0, 0.0);
    levels[..levels.len().saturating_sub(1)]
        .iter()
        .any(|&level| {
            dark += f64::from(level);
            dark_count += 1.0;
            let bright = all - dark;
            let within =
                all_squares - dark * dark / dark_count - bright * bright / (count - dark_count);
            within < LEAST_TWO_LEVEL_RESIDUAL * total
        })
}

impl Area {
    pub(super) fn middle(&self) -> (usize, usize) {
        (self.left + self.width / 2, self.top + self.height / 2)
    }

    /// Returns true if it contains a column, counted on over the seam, and row.
    pub(super) fn contains(&self, x: usize, y: usize, image_width: usize) -> bool {
        let from_left = (x + image_width - self.left) % image_width;
        from_left < self.width && (self.top..self.top + self.height).contains(&y)
    }
}
