//! Scene-clustered bootstrap: intervals of means and ranks over other draws of scenes.
//!
//! Scenes cut from one video share place, camera and light, so videos are drawn with replacement,
//! each with all its scenes. All methods see the same draws, which makes ranks paired comparisons.
//! Intervals are percentile intervals (Efron and Tibshirani 1993, chapter 13).

use std::collections::BTreeMap;

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::records::Direction;

/// Number of resamples.
pub const RESAMPLES: usize = 1000;
/// Number of videos below which percentile intervals are known to be too short.
pub const FEW_VIDEOS: usize = 10;

/// Seed of the draws: the same results give the same intervals.
const SEED: u64 = 360;

/// Tails of a two-sided 95 % interval.
const TAILS: [f64; 2] = [0.025, 0.975];

/// Interval of a mean score, and the rank with its interval.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Confidence {
    /// 95 % interval of the mean; `None` with fewer than two clusters.
    pub mean: Option<[f64; 2]>,
    /// Rank among the ranked methods, from 1; equal means share the better rank.
    pub rank: Option<usize>,
    /// 95 % interval of the rank.
    pub rank_interval: Option<[usize; 2]>,
}

/// Scores of one method.
#[derive(Debug, Clone, PartialEq)]
pub struct Scores {
    /// Scene (index into the clusters) and score.
    pub by_scene: Vec<(usize, f64)>,
    /// True where the method is ranked.
    pub ranked: bool,
}

/// Returns the part of a scene's id that names its place. Scenes cut from one video share it, so they are neither
/// independent nor, in tables by scene, separate columns.
pub fn place(scene: &str) -> &str {
    scene.rsplit_once('/').map_or(scene, |(place, _)| place)
}

/// Returns the number of every scene's cluster, from 0, given the scenes' places in order.
pub fn clusters<'a>(places: impl Iterator<Item = &'a str>) -> Vec<usize> {
    let mut numbers: BTreeMap<&str, usize> = BTreeMap::new();
    places
        .map(|place| {
            let next = numbers.len();
            *numbers.entry(place).or_insert(next)
        })
        .collect()
}

/// Returns how often each resample draws each cluster; empty with fewer than two clusters.
pub fn resamples(clusters: &[usize]) -> Vec<Vec<u32>> {
    let count = clusters.iter().max().map_or(0, |last| last + 1);
    if count < 2 {
        return Vec::new();
    }
    let mut random = Pcg64Mcg::seed_from_u64(SEED);
    (0..RESAMPLES)
        .map(|_| {
            let mut draws = vec![0; count];
            for _ in 0..count {
                draws[random.random_range(0..count)] += 1;
            }
            draws
        })
        .collect()
}

/// Returns intervals and ranks of one quantity, in the order of the methods.
pub fn confidence(
    methods: &[Scores],
    clusters: &[usize],
    resamples: &[Vec<u32>],
    direction: Direction,
) -> Vec<Confidence> {
    let all_once = vec![1; clusters.iter().max().map_or(0, |last| last + 1)];
    let observed = means(methods, clusters, &all_once);
    let ranks = ranks(methods, &observed, direction);
    let mut drawn_means: Vec<Vec<f64>> = vec![Vec::new(); methods.len()];
    let mut drawn_ranks: Vec<Vec<usize>> = vec![Vec::new(); methods.len()];
    for draws in resamples {
        let drawn = means(methods, clusters, draws);
        for (method, rank) in self::ranks(methods, &drawn, direction)
            .into_iter()
            .enumerate()
        {
            drawn_ranks[method].extend(rank);
        }
        for (method, mean) in drawn.into_iter().enumerate() {
            drawn_means[method].extend(mean);
        }
    }
    ranks
        .into_iter()
        .zip(drawn_means.into_iter().zip(drawn_ranks))
        .map(|(rank, (mut means, mut ranks))| {
            means.sort_by(f64::total_cmp);
            ranks.sort_unstable();
            Confidence {
                mean: interval(&means),
                rank,
                rank_interval: interval(&ranks),
            }
        })
        .collect()
}

/// Returns every method's mean over the scenes of the drawn clusters; `None` without any.
fn means(methods: &[Scores], clusters: &[usize], draws: &[u32]) -> Vec<Option<f64>> {
    methods
        .iter()
        .map(|method| {
            let (mut sum, mut weight) = (0.0, 0);
            for &(scene, score) in &method.by_scene {
                let draws = draws[clusters[scene]];
                sum += f64::from(draws) * score;
                weight += draws;
            }
            (weight > 0).then(|| sum / f64::from(weight))
        })
        .collect()
}

/// Returns the ranks of the ranked methods, from 1; equal means share the better rank.
fn ranks(methods: &[Scores], means: &[Option<f64>], direction: Direction) -> Vec<Option<usize>> {
    let mut order: Vec<(usize, f64)> = methods
        .iter()
        .zip(means)
        .enumerate()
        .filter_map(|(index, (method, mean))| method.ranked.then_some((index, (*mean)?)))
        .collect();
    order.sort_by(|a, b| match direction {
        Direction::HigherIsBetter => b.1.total_cmp(&a.1),
        Direction::LowerIsBetter => a.1.total_cmp(&b.1),
    });
    let mut ranks = vec![None; methods.len()];
    let mut rank = 0;
    for (position, &(method, mean)) in order.iter().enumerate() {
        if position == 0 || mean != order[position - 1].1 {
            rank = position + 1;
        }
        ranks[method] = Some(rank);
    }
    ranks
}

/// Returns the 95 % interval of sorted values: the nearest ranks outward.
fn interval<T: Copy>(sorted: &[T]) -> Option<[T; 2]> {
    let last = sorted.len().checked_sub(1)?;
    let [low, high] = TAILS.map(|tail| tail * last as f64);
    Some([sorted[low.floor() as usize], sorted[high.ceil() as usize]])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all_ranked(scores: &[&[f64]]) -> Vec<Scores> {
        let method = |scores: &&[f64]| Scores {
            by_scene: scores.iter().copied().enumerate().collect(),
            ranked: true,
        };
        scores.iter().map(method).collect()
    }

    #[test]
    fn intervals_of_independent_scenes_are_as_wide_as_the_normal_approximation() {
        // 0, 1, ..., 99: the mean's standard error is 2.887 by the formula of the population.
        let scores: Vec<f64> = (0..100).map(f64::from).collect();
        let clusters: Vec<usize> = (0..100).collect();
        let methods = all_ranked(&[&scores]);
        let found = confidence(
            &methods,
            &clusters,
            &resamples(&clusters),
            Direction::HigherIsBetter,
        );
        let [low, high] = found[0].mean.unwrap_or_default();
        let error = (100.0 * 100.0 - 1.0_f64).sqrt() / 12.0_f64.sqrt() / 10.0;
        assert!((low - (49.5 - 1.96 * error)).abs() < 0.6, "{low}");
        assert!((high - (49.5 + 1.96 * error)).abs() < 0.6, "{high}");
    }

    /// Ten scenes of one video are one observation, not ten.
    #[test]
    fn scenes_of_one_video_move_together() {
        let scores: Vec<f64> = (0..40).map(|scene| f64::from(scene / 10)).collect();
        let apart: Vec<usize> = (0..40).collect();
        let together: Vec<usize> = (0..40).map(|scene| scene / 10).collect();
        let width = |clusters: &[usize]| {
            let methods = all_ranked(&[&scores]);
            let found = confidence(
                &methods,
                clusters,
                &resamples(clusters),
                Direction::HigherIsBetter,
            );
            let [low, high] = found[0].mean.unwrap_or_default();
            high - low
        };
        let ratio = width(&together) / width(&apart);
        assert!((2.2..4.5).contains(&ratio), "{ratio}");
    }

    #[test]
    fn a_method_that_is_better_everywhere_has_rank_one_in_every_draw() {
        let methods = all_ranked(&[&[1.0, 9.0, 3.0], &[2.0, 10.0, 4.0], &[2.0, 10.0, 4.0]]);
        let clusters = [0, 1, 2];
        let resamples = resamples(&clusters);
        let found = confidence(&methods, &clusters, &resamples, Direction::HigherIsBetter);
        assert_eq!(found[0].rank_interval, Some([3, 3]));
        assert_eq!((found[1].rank, found[2].rank), (Some(1), Some(1)));
        let found = confidence(&methods, &clusters, &resamples, Direction::LowerIsBetter);
        assert_eq!(
            (found[0].rank, found[0].rank_interval),
            (Some(1), Some([1, 1]))
        );
    }

    #[test]
    fn one_video_has_no_interval() {
        let methods = all_ranked(&[&[1.0, 2.0]]);
        let clusters = [0, 0];
        let found = confidence(
            &methods,
            &clusters,
            &resamples(&clusters),
            Direction::HigherIsBetter,
        );
        assert_eq!(found[0].mean, None);
        assert_eq!((found[0].rank, found[0].rank_interval), (Some(1), None));
    }
}
