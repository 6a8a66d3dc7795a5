//! Two methods, or two runs of one, paired scene by scene and view by view.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    bootstrap::{self, Scores},
    layout::SPLIT_FILE,
    records::{Direction, ResultRecord, Split, Summary},
    store,
};

use crate::{error::BenchError, frames_table, job::ScoreKey};

/// A result and the file that it was read from.
pub type StoredResult = (PathBuf, ResultRecord);

/// Comparison of A to B.
#[derive(Debug, Clone, PartialEq)]
pub struct PairedComparison {
    /// Id and version of the protocol.
    pub protocol: String,
    /// The two methods.
    pub methods: [String; 2],
    /// Scenes that both have scored completely; differences are over these.
    pub scenes: Vec<String>,
    /// Omitted scenes, with the reason.
    pub left_out: Vec<String>,
    /// Aids that both methods can have and one side used, by scene.
    pub differing_aids: Vec<String>,
    /// One for every metric of every kind of view that both have.
    pub differences: Vec<Difference>,
}

/// The difference of two methods in one metric.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// `input` or `novel`.
    pub view: String,
    /// Id of the metric.
    pub metric: String,
    /// Direction of better scores; `None` for a number that only complements another.
    pub direction: Option<Direction>,
    /// Means of A and of B over the scenes.
    pub means: [f64; 2],
    /// Mean over the scenes of A's score minus B's.
    pub mean: f64,
    /// Its 95 % interval from draws of videos with replacement; `None` for scenes of fewer than two videos.
    pub interval: Option<[f64; 2]>,
    /// Number of these videos.
    pub videos: usize,
    /// Scenes in which A is better, B is better, and neither is.
    pub scenes: WinsAndLosses,
    /// The same of views.
    pub views: WinsAndLosses,
}

/// Number of times that the first of two is better than the second.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct WinsAndLosses {
    /// The first is better.
    pub wins: usize,
    /// The second is better.
    pub losses: usize,
    /// They are equal.
    pub ties: usize,
}

impl WinsAndLosses {
    fn add(&mut self, direction: Option<Direction>, left: f64, right: f64) {
        let Some(direction) = direction else {
            return;
        };
        if direction.prefers(left, right) {
            self.wins += 1;
        } else if direction.prefers(right, left) {
            self.losses += 1;
        } else {
            self.ties += 1;
        }
    }
}

/// Compares the results of two methods.
///
/// Seeds of one scene are averaged first. Scenes that one side lacks or could not score completely are omitted from all
/// means and named.
///
/// # Errors
/// When a side holds several methods, when protocols or scenes differ (the message gives the difference), or when
/// nothing is left to compare.
pub fn compare(a: &[StoredResult], b: &[StoredResult]) -> Result<PairedComparison, BenchError> {
    let methods = [method(a)?, method(b)?];
    let sides = [by_scene(a), by_scene(b)];
    let names: BTreeSet<&str> = sides.iter().flat_map(|side| side.keys().copied()).collect();
    let mut left_out = Vec::new();
    let mut scenes = Vec::new();
    for scene in names {
        let of_scene = sides.each_ref().map(|side| side.get(scene));
        let [Some(left), Some(right)] = of_scene else {
            let lacking = &methods[usize::from(of_scene[0].is_some())];
            left_out.push(format!("{scene}: {lacking} has no result"));
            continue;
        };
        refuse_other_rules(left, right)?;
        let reason = [left, right].into_iter().zip(methods).find_map(|side| {
            let (results, method) = side;
            let mut results = results.iter();
            let reason = results.find_map(|(_, result)| result.why_incomplete())?;
            Some(format!("{scene}: {method}: {reason}"))
        });
        match reason {
            Some(reason) => left_out.push(reason),
            None => scenes.push((scene, [left.as_slice(), right.as_slice()])),
        }
    }
    let Some((_, [first, _])) = scenes.first() else {
        return Err(BenchError::NothingToCompare {
            methods: methods.join(" and "),
            reasons: left_out.join("; "),
        });
    };
    let differing_aids = scenes.iter().filter_map(|(scene, [left, right])| {
        let aids = left[0].1.differing_aids(&right[0].1);
        (!aids.is_empty()).then(|| format!("{scene}: {}", aids.join(", ")))
    });
    Ok(PairedComparison {
        differing_aids: differing_aids.collect(),
        protocol: first[0].1.protocol.clone(),
        methods: methods.map(str::to_owned),
        differences: differences(&scenes)?,
        scenes: scenes
            .iter()
            .map(|(scene, _)| (*scene).to_owned())
            .collect(),
        left_out,
    })
}

/// Results of one scene by one method: repetitions with other seeds.
type Repetitions<'a> = [&'a StoredResult];
/// A scene with the results of both sides.
type PairedScene<'a> = (&'a str, [&'a Repetitions<'a>; 2]);

fn method(results: &[StoredResult]) -> Result<&str, BenchError> {
    let mut methods = results.iter().map(|(file, result)| (file, &result.method));
    let Some((_, first)) = methods.next() else {
        return Err(BenchError::NothingToCompare {
            methods: "one side".to_owned(),
            reasons: "it has no result".to_owned(),
        });
    };
    match methods.find(|(_, method)| *method != first) {
        Some((file, other)) => Err(BenchError::mismatch(
            file,
            format!("is of method {other}, others of {first}; compare folders of one method each"),
        )),
        None => Ok(first),
    }
}

fn by_scene(results: &[StoredResult]) -> BTreeMap<&str, Vec<&StoredResult>> {
    let mut scenes: BTreeMap<&str, Vec<&StoredResult>> = BTreeMap::new();
    for result in results {
        scenes.entry(&result.1.scene).or_default().push(result);
    }
    scenes
}

/// Refuses results of different rules or scenes, whose scores are not comparable; names the difference.
fn refuse_other_rules(left: &Repetitions<'_>, right: &Repetitions<'_>) -> Result<(), BenchError> {
    let (first, reference) = left[0];
    for (file, result) in left.iter().chain(right).copied() {
        if result.protocol_hash != reference.protocol_hash {
            return Err(BenchError::mismatch(
                file,
                format!(
                    "is of protocol {} ({:.12}), {} of {} ({:.12}): {}",
                    result.protocol,
                    result.protocol_hash,
                    first.display(),
                    reference.protocol,
                    reference.protocol_hash,
                    differing_rules((file, result), (first, reference))
                ),
            ));
        }
        if result.scene_sha256 != reference.scene_sha256 {
            return Err(BenchError::mismatch(
                file,
                format!(
                    "is of another scene {} ({:.12}) than {} ({:.12}): camera, times, poses, ground \
                     truth or masks of the split's frames differ",
                    result.scene,
                    result.scene_sha256,
                    first.display(),
                    reference.scene_sha256
                ),
            ));
        }
        if result.has_other_regions(reference) {
            let reason = format!(
                "has static and dynamic regions by other tracks than {}: score one of them again",
                first.display()
            );
            return Err(BenchError::mismatch(file, reason));
        }
    }
    Ok(())
}

/// Returns the differing rules, if both splits are found.
fn differing_rules(left: (&Path, &ResultRecord), right: (&Path, &ResultRecord)) -> String {
    let rules = [left, right].map(|(file, result)| {
        let split = split_of(file, &result.protocol_hash)?;
        serde_json::to_value(split.protocol).ok()
    });
    let [Some(left), Some(right)] = rules else {
        return "their split.json, which hold the rules, are not in a folder above".to_owned();
    };
    let (Some(left), Some(right)) = (left.as_object(), right.as_object()) else {
        return String::new();
    };
    let differing: Vec<String> = left
        .iter()
        .filter(|(rule, value)| right.get(*rule) != Some(*value))
        .map(|(rule, value)| {
            let other = right
                .get(rule)
                .map_or("nothing".to_owned(), ToString::to_string);
            format!("{rule} is {value}, not {other}")
        })
        .collect();
    differing.join("; ")
}

/// Returns the split with this protocol in a folder above a result.
fn split_of(file: &Path, protocol_hash: &str) -> Option<Split> {
    file.ancestors().skip(1).find_map(|folder| {
        let split: Split = store::read_record(&folder.join(SPLIT_FILE)).ok()?;
        (split.protocol_hash == protocol_hash).then_some(split)
    })
}

/// Scores of a kind of view.
type Kind = (
    &'static str,
    fn(&ResultRecord) -> &BTreeMap<String, Summary>,
);

const KINDS: [Kind; 2] = [
    ("input", |result| &result.input_views),
    ("novel", |result| &result.novel_views),
];

fn differences(scenes: &[PairedScene<'_>]) -> Result<Vec<Difference>, BenchError> {
    let clusters = bootstrap::clusters(scenes.iter().map(|(scene, _)| bootstrap::place(scene)));
    let resamples = bootstrap::resamples(&clusters);
    let views = scenes
        .iter()
        .map(|(_, sides)| Ok([view_scores(sides[0])?, view_scores(sides[1])?]))
        .collect::<Result<Vec<_>, BenchError>>()?;
    let mut differences = Vec::new();
    for (view, summaries) in KINDS {
        for (metric, summary) in summaries(&scenes[0].1[0][0].1) {
            // A metric counts if every scene has it on both sides.
            let means: Option<Vec<[f64; 2]>> = scenes
                .iter()
                .map(|(_, sides)| {
                    let mean = |side: &Repetitions<'_>| mean(side, |r| summaries(r).get(metric));
                    Some([mean(sides[0])?, mean(sides[1])?])
                })
                .collect();
            let Some(means) = means else { continue };
            let direction = summary.direction;
            let scores = Scores {
                by_scene: means.iter().map(|[a, b]| a - b).enumerate().collect(),
                ranked: false,
            };
            // Only ranks depend on the direction.
            let order = direction.unwrap_or(Direction::HigherIsBetter);
            let interval = bootstrap::confidence(&[scores], &clusters, &resamples, order)[0].mean;
            let over_scenes =
                |side: usize| means.iter().map(|pair| pair[side]).sum::<f64>() / means.len() as f64;
            let means_over_scenes = [over_scenes(0), over_scenes(1)];
            let mut won_scenes = WinsAndLosses::default();
            for [left, right] in &means {
                won_scenes.add(direction, *left, *right);
            }
            let mut won_views = WinsAndLosses::default();
            for [left, right] in &views {
                for (key, score) in left.iter().filter(|(key, _)| key.is_of(view, metric)) {
                    if let Some(other) = right.get(key) {
                        won_views.add(direction, *score, *other);
                    }
                }
            }
            differences.push(Difference {
                view: view.to_owned(),
                metric: metric.clone(),
                direction,
                means: means_over_scenes,
                mean: means_over_scenes[0] - means_over_scenes[1],
                interval,
                videos: clusters.len(),
                scenes: won_scenes,
                views: won_views,
            });
        }
    }
    Ok(differences)
}

/// Returns the mean over repetitions; `None` if one lacks the metric.
fn mean<'a>(
    results: &'a Repetitions<'a>,
    summary: impl Fn(&'a ResultRecord) -> Option<&'a Summary>,
) -> Option<f64> {
    let sum: Option<f64> = results
        .iter()
        .map(|(_, result)| summary(result).map(|summary| summary.mean))
        .sum();
    sum.map(|sum| sum / results.len() as f64)
}

/// Refuses a table whose scores do not give a result's means, such as a truncated one.
fn refuse_another_table(
    table: &Path,
    scores: &[(ScoreKey, f64)],
    result: &ResultRecord,
) -> Result<(), BenchError> {
    for (view, summaries) in [
        ("input", &result.input_views),
        ("novel", &result.novel_views),
    ] {
        for (metric, summary) in summaries {
            let scores = scores.iter().filter(|(key, _)| key.is_of(view, metric));
            let (found, expected) = (scores.count(), summary.views as usize);
            if found != expected {
                return Err(BenchError::mismatch(
                    table,
                    format!(
                        "has {found} scores of the {view} views by {metric}, the result is of \
                         {expected}"
                    ),
                ));
            }
        }
    }
    Ok(())
}

/// Returns scores of the views of a scene, means over repetitions; views that one of them lacks are omitted.
fn view_scores(results: &Repetitions<'_>) -> Result<BTreeMap<ScoreKey, f64>, BenchError> {
    let mut sums: BTreeMap<ScoreKey, (f64, usize)> = BTreeMap::new();
    for (file, result) in results.iter().copied() {
        let table = file.with_file_name(&result.frames_table);
        let scores = frames_table::read(&table)?;
        refuse_another_table(&table, &scores, result)?;
        for (key, score) in scores {
            let (sum, count) = sums.entry(key).or_default();
            *sum += score;
            *count += 1;
        }
    }
    let complete = sums
        .into_iter()
        .filter(|(_, (_, count))| *count == results.len());
    Ok(complete
        .map(|(key, (sum, count))| (key, sum / count as f64))
        .collect())
}
