//! Semi-global aggregation of matching costs (Hirschmueller 2008).
//!
//! Along a path over pixels `p`, with the hypothesis `k` of each:
//!
//! ```text
//! L(p, k) = C(p, k) + min(L(p', k), L(p', k +- 1) + P1, min_j L(p', j) + P2) - min_j L(p', j)
//! ```
//!
//! with `p'` before `p`. Sums are over four paths: along the row both ways, along the column both ways. If rows are
//! circles, a path starts a quarter turn before its first pixel, so that the seam is like any other place. A jump of
//! depth costs less at an edge of the image.

use rayon::prelude::*;

use crate::{CostVolume, LARGEST_COST, RowEnds};

/// Cost of a step to the next hypothesis.
const P1: u16 = 12;
/// Cost of a jump across a flat image; across an edge it is down to [`P2_LEAST`].
const P2_MOST: f32 = 110.0;
const P2_LEAST: u16 = 30;
/// Difference of grey values at which the cost of a jump has halved, in [0, 1].
const EDGE: f32 = 0.03;

/// Columns of one task in a vertical path.
const COLUMNS: usize = 32;

/// Sums of path costs, laid out as the costs.
#[derive(Debug)]
pub struct PathSums {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Hypotheses.
    pub count: usize,
    /// `width * height * count` sums of the costs of four paths.
    pub sums: Vec<u16>,
}

/// Aggregates the costs of an image's pixels along four directions.
pub fn aggregated<const C: usize>(
    volume: &CostVolume,
    pixels: &[[f32; C]],
    ends: RowEnds,
) -> PathSums {
    let (width, height, count) = (volume.width, volume.height, volume.count);
    let grey: Vec<f32> = pixels
        .iter()
        .map(|pixel| pixel.iter().sum::<f32>() / C as f32)
        .collect();
    let mut sums = vec![0_u16; width * height * count];
    sums.par_chunks_mut(width * count)
        .enumerate()
        .for_each(|(row, sums)| {
            let costs = &volume.costs[row * width * count..(row + 1) * width * count];
            let grey = &grey[row * width..(row + 1) * width];
            let lead = match ends {
                RowEnds::Joined => width / 4,
                RowEnds::Open => 0,
            };
            for is_backward in [false, true] {
                let mut path = Path::new(count);
                let mut before = None;
                for step in 0..width + lead {
                    // Forwards the path ends in the last column, backwards in the first.
                    let along = (step + width - lead) % width;
                    let column = if is_backward {
                        width - 1 - along
                    } else {
                        along
                    };
                    let jump = before.map_or(P2_LEAST, |b: usize| jump(grey[b], grey[column]));
                    path.advance(&costs[column * count..(column + 1) * count], jump);
                    if step >= lead {
                        path.add_to(&mut sums[column * count..(column + 1) * count]);
                    }
                    before = Some(column);
                }
            }
        });
    for is_upward in [false, true] {
        let mut paths: Vec<Path> = (0..width).map(|_| Path::new(count)).collect();
        let mut before: Option<usize> = None;
        for step in 0..height {
            let row = if is_upward { height - 1 - step } else { step };
            let costs = &volume.costs[row * width * count..(row + 1) * width * count];
            sums[row * width * count..(row + 1) * width * count]
                .par_chunks_mut(COLUMNS * count)
                .zip(paths.par_chunks_mut(COLUMNS))
                .enumerate()
                .for_each(|(block, (sums, paths))| {
                    for (index, (sums, path)) in sums.chunks_exact_mut(count).zip(paths).enumerate()
                    {
                        let column = block * COLUMNS + index;
                        let jump = before.map_or(P2_LEAST, |before| {
                            jump(grey[before * width + column], grey[row * width + column])
                        });
                        path.advance(&costs[column * count..(column + 1) * count], jump);
                        path.add_to(sums);
                    }
                });
            before = Some(row);
        }
    }
    PathSums {
        width,
        height,
        count,
        sums,
    }
}

/// Returns the cost of a jump between two pixels.
fn jump(before: f32, here: f32) -> u16 {
    let edge = (before - here).abs() / EDGE;
    ((P2_MOST / (1.0 + edge)) as u16).max(P2_LEAST)
}

/// The costs of a path that has reached a pixel, between two sentinels.
#[derive(Debug)]
struct Path {
    costs: Vec<u16>,
    next: Vec<u16>,
    least: u16,
}

/// More than any cost, and far enough from overflow.
const NEVER: u16 = u16::MAX / 2;
const _: () = assert!(NEVER as u32 + LARGEST_COST as u32 + P2_MOST as u32 <= u16::MAX as u32);

impl Path {
    fn new(count: usize) -> Self {
        let mut costs = vec![0; count + 2];
        costs[0] = NEVER;
        costs[count + 1] = NEVER;
        Self {
            next: costs.clone(),
            costs,
            least: 0,
        }
    }

    fn advance(&mut self, costs: &[u8], jump: u16) {
        let count = costs.len();
        let (below, same, above) = (
            &self.costs[..count],
            &self.costs[1..=count],
            &self.costs[2..count + 2],
        );
        let after_jump = self.least + jump;
        let mut least = u16::MAX;
        for (k, next) in self.next[1..=count].iter_mut().enumerate() {
            let smooth = same[k].min(below[k].min(above[k]) + P1).min(after_jump);
            *next = u16::from(costs[k]) + smooth - self.least;
            least = least.min(*next);
        }
        self.least = least;
        std::mem::swap(&mut self.costs, &mut self.next);
    }

    fn add_to(&self, sums: &mut [u16]) {
        for (sum, cost) in sums.iter_mut().zip(&self.costs[1..]) {
            *sum += cost;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 7;
    const HEIGHT: usize = 5;
    const COUNT: usize = 6;

    /// Adds the costs of a path over these pixels to the sums, by the definition.
    fn add_path(volume: &CostVolume, grey: &[f32], pixels: &[usize], sums: &mut [u16]) {
        let mut before: Option<(usize, Vec<i64>)> = None;
        for &pixel in pixels {
            let own = |k: usize| i64::from(volume.costs[pixel * COUNT + k]);
            let costs: Vec<i64> = match &before {
                None => (0..COUNT).map(own).collect(),
                Some((other, last)) => {
                    let least = last.iter().copied().min().unwrap_or(0);
                    let edge = (grey[*other] - grey[pixel]).abs() / EDGE;
                    let jump = ((P2_MOST / (1.0 + edge)) as i64).max(i64::from(P2_LEAST));
                    let smooth = |k: usize| {
                        let beside = (0..COUNT).filter(|other| other.abs_diff(k) == 1);
                        let beside = beside.map(|other| last[other] + i64::from(P1));
                        beside.chain([last[k], least + jump]).min().unwrap_or(0)
                    };
                    (0..COUNT).map(|k| own(k) + smooth(k) - least).collect()
                }
            };
            for (sum, cost) in sums[pixel * COUNT..].iter_mut().zip(&costs) {
                *sum += *cost as u16;
            }
            before = Some((pixel, costs));
        }
    }

    #[test]
    fn sums_are_those_of_the_definition() {
        let volume = CostVolume {
            width: WIDTH,
            height: HEIGHT,
            count: COUNT,
            costs: (0..WIDTH * HEIGHT * COUNT)
                .map(|at| (at * 7919 % 251) as u8)
                .collect(),
        };
        let pixels: Vec<[f32; 1]> = (0..WIDTH * HEIGHT)
            .map(|at| [(at * 31 % 17) as f32 / 170.0])
            .collect();
        let grey = pixels.as_flattened();
        let mut expected = vec![0; WIDTH * HEIGHT * COUNT];
        let row = |row: usize| (0..WIDTH).map(move |column| row * WIDTH + column);
        let column = |column: usize| (0..HEIGHT).map(move |row| row * WIDTH + column);
        let rows = (0..HEIGHT).map(|number| row(number).collect::<Vec<usize>>());
        let columns = (0..WIDTH).map(|number| column(number).collect::<Vec<usize>>());
        for mut path in rows.chain(columns) {
            add_path(&volume, grey, &path, &mut expected);
            path.reverse();
            add_path(&volume, grey, &path, &mut expected);
        }
        assert_eq!(aggregated(&volume, &pixels, RowEnds::Open).sums, expected);
    }
}
