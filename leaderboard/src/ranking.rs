//! Results grouped so that only comparable scores stand side by side.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::PathBuf,
};

use omnilife_schemas::records::{Direction, ResultRecord, Summary};

use crate::error::LeaderboardError;

/// The two kinds of view, in the order of the columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum ViewKind {
    Input,
    Novel,
}

impl ViewKind {
    pub(crate) const ALL: [Self; 2] = [Self::Input, Self::Novel];

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Input => "input",
            Self::Novel => "novel",
        }
    }

    pub(crate) fn scores(self, result: &ResultRecord) -> &BTreeMap<String, Summary> {
        match self {
            Self::Input => &result.input_views,
            Self::Novel => &result.novel_views,
        }
    }
}

/// A scored quantity: a metric over one kind of view.
pub(crate) type Quantity = (ViewKind, String);

/// All results of one protocol. Protocols of different hashes never share a group.
pub(crate) struct Group<'a> {
    /// Id and version of the protocol.
    pub(crate) protocol: String,
    pub(crate) protocol_hash: String,
    /// Sorted by scene, then method; the pair is unique.
    pub(crate) results: Vec<&'a ResultRecord>,
    /// Metric ids of all results with their directions.
    pub(crate) directions: BTreeMap<String, Direction>,
    /// Mean rows, sorted by method; empty with a single scene.
    pub(crate) means: Vec<MethodMean<'a>>,
    /// Scenes in the group.
    pub(crate) scenes: usize,
}

/// A method's scores averaged over scenes, every scene with the same weight.
pub(crate) struct MethodMean<'a> {
    pub(crate) method: &'a str,
    /// Scenes with a result of this method.
    pub(crate) scenes: usize,
    /// Whether any of them has failures.
    pub(crate) failures: usize,
    /// Arithmetic means of the per-scene means. A quantity that a scene of this method lacks has
    /// no mean: an average over the rest would look better than it is.
    pub(crate) scores: BTreeMap<Quantity, f64>,
    /// Mean over the scenes, where all of them state it.
    pub(crate) training_seconds: Option<f64>,
    pub(crate) gaussians: Option<f64>,
    pub(crate) iterations: Option<f64>,
}

impl MethodMean<'_> {
    /// Whether every scene of the group went in, without failures.
    pub(crate) fn is_complete(&self, scenes: usize) -> bool {
        self.scenes == scenes && self.failures == 0
    }
}

/// Groups results by protocol, ordered by protocol and hash.
///
/// # Errors
/// When two results have the same method, scene and protocol, stand for different scenes under one
/// id, or contradict each other about a metric's direction.
pub(crate) fn groups(
    results: &[(PathBuf, ResultRecord)],
) -> Result<Vec<Group<'_>>, LeaderboardError> {
    refuse_different_scenes(results)?;
    let mut rows = BTreeMap::new();
    for (path, result) in results {
        let protocol = (&result.protocol, &result.protocol_hash);
        let group: &mut BTreeMap<_, _> = rows.entry(protocol).or_default();
        let key = (&result.scene, &result.method);
        if let Some((first, _)) = group.insert(key, (path, result)) {
            return Err(LeaderboardError::Duplicate {
                method: result.method.clone(),
                scene: result.scene.clone(),
                protocol: result.protocol.clone(),
                first: first.clone(),
                second: path.clone(),
            });
        }
    }
    rows.into_iter()
        .map(|((protocol, hash), rows)| {
            let rows: Vec<_> = rows.into_values().collect();
            let directions = directions(&rows)?;
            let results: Vec<_> = rows.into_iter().map(|(_, result)| result).collect();
            let scenes: BTreeSet<_> = results.iter().map(|result| &result.scene).collect();
            Ok(Group {
                protocol: protocol.clone(),
                protocol_hash: hash.clone(),
                means: if scenes.len() > 1 {
                    method_means(&results)
                } else {
                    Vec::new()
                },
                scenes: scenes.len(),
                results,
                directions,
            })
        })
        .collect()
}

fn refuse_different_scenes(results: &[(PathBuf, ResultRecord)]) -> Result<(), LeaderboardError> {
    // Another protocol scores other frames, so only results of one protocol can contradict.
    let mut known: BTreeMap<(&str, &str), (&PathBuf, &str)> = BTreeMap::new();
    for (path, result) in results {
        let (first, sha256) = *known
            .entry((&result.protocol_hash, &result.scene))
            .or_insert((path, &result.scene_sha256));
        if sha256 != result.scene_sha256 {
            return Err(LeaderboardError::SceneDiffers {
                scene: result.scene.clone(),
                first: first.clone(),
                second: path.clone(),
            });
        }
    }
    Ok(())
}

fn directions(
    rows: &[(&PathBuf, &ResultRecord)],
) -> Result<BTreeMap<String, Direction>, LeaderboardError> {
    let mut directions = BTreeMap::new();
    for (path, result) in rows {
        let summaries = result.input_views.iter().chain(&result.novel_views);
        for (metric, summary) in summaries {
            let known = *directions
                .entry(metric.clone())
                .or_insert(summary.direction);
            if known != summary.direction {
                return Err(LeaderboardError::Direction {
                    path: (*path).clone(),
                    metric: metric.clone(),
                    found: match summary.direction {
                        Direction::HigherIsBetter => "better when higher",
                        Direction::LowerIsBetter => "better when lower",
                    },
                });
            }
        }
    }
    Ok(directions)
}

fn method_means<'a>(results: &[&'a ResultRecord]) -> Vec<MethodMean<'a>> {
    let mut by_method: BTreeMap<&str, Vec<&ResultRecord>> = BTreeMap::new();
    for result in results {
        by_method.entry(&result.method).or_default().push(result);
    }
    by_method
        .into_iter()
        .map(|(method, results)| MethodMean {
            method,
            scenes: results.len(),
            failures: results.iter().map(|result| result.failures.len()).sum(),
            scores: mean_scores(&results),
            training_seconds: mean(results.iter().map(|result| result.training_seconds)),
            gaussians: mean(
                results
                    .iter()
                    .map(|result| result.gaussians.map(|n| n as f64)),
            ),
            iterations: mean(
                results
                    .iter()
                    .map(|result| result.iterations.map(|n| n as f64)),
            ),
        })
        .collect()
}

fn mean_scores(results: &[&ResultRecord]) -> BTreeMap<Quantity, f64> {
    let quantities: BTreeSet<Quantity> = results
        .iter()
        .flat_map(|result| {
            ViewKind::ALL.into_iter().flat_map(|kind| {
                kind.scores(result)
                    .keys()
                    .map(move |metric| (kind, metric.clone()))
            })
        })
        .collect();
    quantities
        .into_iter()
        .filter_map(|(kind, metric)| {
            let value = mean(
                results
                    .iter()
                    .map(|result| kind.scores(result).get(&metric).map(|summary| summary.mean)),
            )?;
            Some(((kind, metric), value))
        })
        .collect()
}

/// Arithmetic mean, or `None` when a value is missing.
fn mean(values: impl ExactSizeIterator<Item = Option<f64>>) -> Option<f64> {
    let count = values.len() as f64;
    values.sum::<Option<f64>>().map(|sum| sum / count)
}

/// The best of some scores, as it will be printed, when at least two compete.
///
/// Scores are compared after rounding by `print`: equal prints are equally good.
pub(crate) fn best(
    scores: &[f64],
    direction: Direction,
    print: impl Fn(f64) -> String,
) -> Option<String> {
    if scores.len() < 2 {
        return None;
    }
    scores
        .iter()
        .copied()
        .reduce(|best, score| {
            if direction.prefers(score, best) {
                score
            } else {
                best
            }
        })
        .map(print)
}
