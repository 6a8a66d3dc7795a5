//! Codebooks of numbers and palettes of rows: k-means that gives equal results on every machine.

use std::cmp::Ordering;

use rayon::prelude::*;

/// Number of values in a codebook: that of a byte.
const CODES: usize = 256;
/// Number of equal parts of the range of values in which they are counted.
const BINS: usize = 1024;
const CODEBOOK_ROUNDS: usize = 24;
/// Maximum number of rows that are compared with each other.
const GROUP: usize = 32;
const PALETTE_ROUNDS: usize = 2;

/// 256 values in rising order that stand for others.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Codebook {
    pub(super) values: Vec<f32>,
}

impl Codebook {
    /// Returns the codebook with a small mean squared error over finite values; up to 256 different ones are kept
    /// exactly.
    pub(super) fn of(values: &[f32]) -> Self {
        let mut sorted = values.to_vec();
        sorted.par_sort_unstable_by(f32::total_cmp);
        let mut codes = sorted.clone();
        codes.dedup();
        if codes.len() > CODES {
            codes = refined(&sorted, spread(&sorted));
        }
        let last = codes.last().copied().unwrap_or_default();
        codes.resize(CODES, last);
        Self { values: codes }
    }

    pub(super) fn nearest(&self, value: f32) -> u8 {
        let above = self.values.partition_point(|code| *code < value);
        let above = above.min(CODES - 1);
        let below = above.saturating_sub(1);
        let is_below = value - self.values[below] < self.values[above] - value;
        (if is_below { below } else { above }) as u8
    }
}

/// Returns first codes of sorted, different values, as dense as the cube root of their density: the best of many codes.
fn spread(sorted: &[f32]) -> Vec<f64> {
    let least = f64::from(sorted[0]);
    let step = (f64::from(sorted[sorted.len() - 1]) - least) / BINS as f64;
    let mut counts = [0_u32; BINS];
    for value in sorted {
        let bin = ((f64::from(*value) - least) / step) as usize;
        counts[bin.min(BINS - 1)] += 1;
    }
    let weights = counts.map(|count| f64::from(count).cbrt());
    let total: f64 = weights.iter().sum();
    let mut codes = Vec::with_capacity(CODES);
    let mut before = 0.0;
    for (bin, weight) in weights.iter().enumerate() {
        while codes.len() < CODES {
            let wanted = total * (codes.len() as f64 + 0.5) / CODES as f64;
            if wanted > before + weight {
                break;
            }
            codes.push(least + step * (bin as f64 + (wanted - before) / weight));
        }
        before += weight;
    }
    codes.resize(CODES, f64::from(sorted[sorted.len() - 1]));
    codes
}

/// Moves codes to the means of the sorted values that are nearest to them.
fn refined(sorted: &[f32], mut codes: Vec<f64>) -> Vec<f32> {
    let mut sums = Vec::with_capacity(sorted.len() + 1);
    sums.push(0.0);
    let mut sum = 0.0;
    for value in sorted {
        sum += f64::from(*value);
        sums.push(sum);
    }
    for _ in 0..CODEBOOK_ROUNDS {
        let mut from = 0;
        for code in 0..CODES {
            let middle = codes
                .get(code + 1)
                .map_or(f64::INFINITY, |next| 0.5 * (codes[code] + next));
            let nearest = sorted[from..].partition_point(|value| f64::from(*value) < middle);
            let to = from + nearest;
            if nearest > 0 {
                codes[code] = (sums[to] - sums[from]) / nearest as f64;
            }
            from = to;
        }
    }
    let mut codes: Vec<f32> = codes.iter().map(|code| *code as f32).collect();
    codes.sort_unstable_by(f32::total_cmp);
    codes
}

/// Rows that stand for others.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Palette {
    /// Values of its rows, one behind the other.
    pub(super) values: Vec<f32>,
    /// Number of the row that stands for each given one.
    pub(super) labels: Vec<u16>,
}

impl Palette {
    /// Returns a palette of at most `most` rows (65,536 at most) for finite rows of `width` values; so many or fewer
    /// rows are kept exactly.
    ///
    /// Halves at the median of the column that varies most give groups, whose rows are then clustered by k-means.
    pub(super) fn of(values: &[f32], width: usize, most: usize) -> Self {
        let rows = Rows { values, width };
        let mut members: Vec<u32> = (0..(values.len() / width) as u32).collect();
        let mut labels = vec![0; members.len()];
        let clusters = rows.clusters(&mut members, most.min(1 << 16));
        let mut values = Vec::with_capacity(width * clusters.len());
        for (number, cluster) in clusters.iter().enumerate() {
            values.extend(rows.mean(cluster));
            for &member in cluster {
                labels[member as usize] = number as u16;
            }
        }
        Self { values, labels }
    }
}

/// Rows of equal width.
#[derive(Clone, Copy)]
struct Rows<'a> {
    values: &'a [f32],
    width: usize,
}

impl<'a> Rows<'a> {
    fn row(self, member: u32) -> &'a [f32] {
        let at = member as usize * self.width;
        &self.values[at..at + self.width]
    }

    /// Divides members among at most `codes` clusters; all have members.
    fn clusters(self, members: &mut [u32], codes: usize) -> Vec<Vec<u32>> {
        let codes = codes.min(members.len());
        let column = match self.widest(members) {
            Some(column) if codes > 1 => column,
            _ => return vec![members.to_vec()],
        };
        let middle = members.len() / 2;
        let order = |a: &u32, b: &u32| -> Ordering {
            let [x, y] = [a, b].map(|member| self.row(*member)[column]);
            x.total_cmp(&y).then(a.cmp(b))
        };
        members.select_nth_unstable_by(middle, order);
        let all = members.len();
        let (left, right) = members.split_at_mut(middle);
        let of_left = (codes / 2).clamp(codes.saturating_sub(all - middle).max(1), middle);
        let (mut clusters, others) = rayon::join(
            || self.clusters(left, of_left),
            || self.clusters(right, codes - of_left),
        );
        clusters.extend(others);
        if codes > GROUP {
            return clusters;
        }
        for _ in 0..PALETTE_ROUNDS {
            clusters = self.reassigned(&clusters);
        }
        clusters
    }

    /// Moves every member to the cluster with the nearest mean.
    fn reassigned(self, clusters: &[Vec<u32>]) -> Vec<Vec<u32>> {
        let means: Vec<Vec<f32>> = clusters.iter().map(|cluster| self.mean(cluster)).collect();
        let distance = |member: u32, mean: &[f32]| -> f32 {
            let pairs = self.row(member).iter().zip(mean);
            pairs.map(|(a, b)| (a - b) * (a - b)).sum()
        };
        let mut moved = vec![Vec::new(); clusters.len()];
        for &member in clusters.iter().flatten() {
            let (mut nearest, mut least) = (0, f32::INFINITY);
            for (number, mean) in means.iter().enumerate() {
                let distance = distance(member, mean);
                if distance < least {
                    (nearest, least) = (number, distance);
                }
            }
            moved[nearest].push(member);
        }
        moved.retain(|cluster| !cluster.is_empty());
        moved
    }

    fn mean(self, members: &[u32]) -> Vec<f32> {
        let sums = self.sums(members, |value| value);
        let scale = (members.len().max(1) as f64).recip();
        sums.iter().map(|sum| (sum * scale) as f32).collect()
    }

    fn sums(self, members: &[u32], of: impl Fn(f64) -> f64) -> Vec<f64> {
        let mut sums = vec![0.0; self.width];
        for &member in members {
            for (sum, value) in sums.iter_mut().zip(self.row(member)) {
                *sum += of(f64::from(*value));
            }
        }
        sums
    }

    /// Returns the column that varies most; `None` where all rows are equal.
    fn widest(self, members: &[u32]) -> Option<usize> {
        let first = self.row(*members.first()?);
        if members.iter().all(|&member| self.row(member) == first) {
            return None;
        }
        let count = members.len() as f64;
        let sums = self.sums(members, |value| value);
        let squares = self.sums(members, |value| value * value);
        let variances = sums
            .iter()
            .zip(squares)
            .map(|(sum, squares)| squares - sum * sum / count);
        let widest = variances
            .enumerate()
            .max_by(|(_, a), (_, b)| a.total_cmp(b));
        widest.map(|(column, _)| column)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values with a dense middle and long tails.
    fn tailed(len: usize) -> Vec<f32> {
        let wave = |number: usize| (0.7 * number as f32).sin();
        (0..len)
            .map(|number| wave(number) + 20.0 * wave(7 * number).powi(99))
            .collect()
    }

    #[test]
    fn few_values_are_kept_and_many_come_near() {
        let few = [3.0, -1.0, 3.0, 0.5];
        let codebook = Codebook::of(&few);
        assert_eq!(codebook.values.len(), 256);
        for value in few {
            assert_eq!(codebook.values[usize::from(codebook.nearest(value))], value);
        }
        let many = tailed(20_000);
        let codebook = Codebook::of(&many);
        assert!(codebook.values.is_sorted());
        let mut squares = 0.0;
        for value in &many {
            let code = codebook.values[usize::from(codebook.nearest(*value))];
            assert!(
                codebook
                    .values
                    .iter()
                    .all(|other| (value - code).abs() <= (value - other).abs())
            );
            squares += f64::from(value - code).powi(2);
        }
        // Equal steps over the range of 42 have 0.047.
        let error = (squares / many.len() as f64).sqrt();
        assert!(error < 0.04, "{error}");
    }

    #[test]
    fn equal_values_have_a_codebook_too() {
        assert_eq!(Codebook::of(&[0.25; 9]).values, [0.25; 256]);
        assert_eq!(Codebook::of(&[]).values, [0.0; 256]);
    }

    #[test]
    fn few_rows_are_kept_and_many_come_near() {
        let values = tailed(3 * 400);
        let exact = Palette::of(&values, 3, 400);
        for (row, label) in values.chunks(3).zip(&exact.labels) {
            assert_eq!(row, &exact.values[3 * usize::from(*label)..][..3]);
        }
        let palette = Palette::of(&values, 3, 50);
        assert!(palette.values.len() <= 150 && palette.values.len() >= 90);
        let spread = |palette: &Palette| -> f32 {
            let rows = values.chunks(3).zip(&palette.labels);
            let differences = rows.flat_map(|(row, label)| {
                let near = &palette.values[3 * usize::from(*label)..][..3];
                row.iter().zip(near).map(|(a, b)| (a - b).powi(2))
            });
            differences.sum()
        };
        let one = Palette::of(&values, 3, 1);
        assert_eq!(one.values.len(), 3);
        assert!(
            spread(&palette) < 0.1 * spread(&one),
            "{} {}",
            spread(&palette),
            spread(&one)
        );
        assert_eq!(palette, Palette::of(&values, 3, 50));
    }

    #[test]
    fn equal_rows_have_one_in_the_palette() {
        let palette = Palette::of(&[0.5; 90], 9, 1024);
        assert_eq!(palette.values, [0.5; 9]);
        assert_eq!(palette.labels, [0; 10]);
    }
}
