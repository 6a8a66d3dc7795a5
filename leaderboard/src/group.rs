//! Groups of results in which only comparable scores stand side by side.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::PathBuf,
};

use omnilife_results::scenes_of_other_regions;
pub(crate) use omnilife_schemas::bootstrap::place;
use omnilife_schemas::{
    bootstrap::{self, Confidence},
    records::{Direction, ResultRecord},
};

use crate::{
    class::MethodClass,
    error::LeaderboardError,
    numbers::Numbers,
    quantity::{Quantity, ViewKind},
    validate, variants,
};

/// All results of one protocol. Protocols of different hashes never share a group.
pub(crate) struct Group<'a> {
    /// Id and version of the protocol.
    pub(crate) protocol: &'a str,
    pub(crate) protocol_hash: &'a str,
    /// All scores of any result, input views first, with their direction.
    pub(crate) quantities: Vec<(Quantity, Direction)>,
    /// Sorted by scene, then method; the pair is unique.
    pub(crate) scene_rows: Vec<SceneRow<'a>>,
    /// Sorted by method.
    pub(crate) methods: Vec<MethodRow<'a>>,
    /// Sorted.
    pub(crate) scenes: Vec<&'a str>,
    /// Indices in `scene_rows` by method.
    rows_by_method: BTreeMap<&'a str, Vec<usize>>,
    /// Reasons by kind of view and metric.
    reasons: Reasons<'a>,
    /// Scenes whose results have regions by other tracks: none of these scores are shown.
    other_regions: BTreeSet<&'a str>,
}

/// Reasons for missing values of a metric, by the name of the kind of view and by metric.
type Reasons<'a> = BTreeMap<&'a str, BTreeMap<&'a str, &'a str>>;

impl<'a> Group<'a> {
    pub(crate) fn quantity(&self, kind: ViewKind, metric: &str) -> Option<usize> {
        let mut quantities = self.quantities.iter();
        quantities.position(|(quantity, _)| quantity.kind == kind && quantity.metric == metric)
    }

    /// Returns the rows of a method, sorted by scene.
    pub(crate) fn rows_of(&self, method: &str) -> impl Iterator<Item = &SceneRow<'a>> {
        let rows = self.rows_by_method.get(method).into_iter().flatten();
        rows.map(|&at| &self.scene_rows[at])
    }

    /// Returns the rows of a scene, sorted by method.
    pub(crate) fn rows_in(&self, scene: &str) -> &[SceneRow<'a>] {
        let first = self.scene_rows.partition_point(|row| row.scene < scene);
        let rows = &self.scene_rows[first..];
        &rows[..rows.partition_point(|row| row.scene == scene)]
    }

    /// Returns true if any result scores views of a kind.
    pub(crate) fn has(&self, kind: ViewKind) -> bool {
        let mut quantities = self.quantities.iter();
        quantities.any(|(quantity, _)| quantity.kind == kind)
    }

    pub(crate) fn numbers_of(&self, result: &ResultRecord) -> Numbers {
        let without_regions = self.other_regions.contains(result.scene.as_str());
        Numbers::of(result, &self.quantities, without_regions)
    }

    /// Returns the metrics that results could not have, with reasons and the number of such results, in one line.
    pub(crate) fn unavailable(&self) -> Option<String> {
        let results: Vec<&ResultRecord> = self
            .scene_rows
            .iter()
            .flat_map(|row| row.results.iter().copied())
            .collect();
        let mut by_reason: BTreeMap<&str, (BTreeSet<&str>, BTreeSet<usize>)> = BTreeMap::new();
        for (index, result) in results.iter().enumerate() {
            for unavailable in &result.unavailable {
                let (metrics, of) = by_reason.entry(&unavailable.reason).or_default();
                metrics.insert(&unavailable.metric);
                of.insert(index);
            }
        }
        let parts = by_reason.into_iter().map(|(reason, (metrics, of))| {
            let metrics: Vec<&str> = metrics.into_iter().collect();
            format!(
                "{} in {} of {} results ({reason})",
                metrics.join(", "),
                of.len(),
                results.len()
            )
        });
        let parts: Vec<String> = parts.collect();
        (!parts.is_empty()).then(|| format!("Unavailable: {}.", parts.join("; ")))
    }

    /// Describes scenes whose scores by region are omitted.
    pub(crate) fn other_regions(&self) -> Option<String> {
        let scenes: Vec<&str> = self.other_regions.iter().copied().collect();
        (!scenes.is_empty()).then(|| {
            format!(
                "Static and dynamic scores are left out for {}: methods were scored with other tracks; score \
                 them again.",
                scenes.join(", ")
            )
        })
    }

    /// Returns the most frequent reason for missing values of a metric.
    pub(crate) fn why_unavailable(&self, kind: ViewKind, metric: &str) -> Option<&str> {
        let reasons = self.reasons.get(kind.name())?;
        reasons.get(metric).copied()
    }

    /// Returns the first digits of the protocol's hash, as printed.
    pub(crate) fn short_hash(&self) -> String {
        self.protocol_hash.chars().take(HASH_DIGITS).collect()
    }
}

/// Number of printed digits of a protocol's hash.
const HASH_DIGITS: usize = 12;

/// One method on one scene: the mean over its repetitions.
pub(crate) struct SceneRow<'a> {
    pub(crate) scene: &'a str,
    pub(crate) method: &'a str,
    /// Class of the method over all scenes.
    pub(crate) class: MethodClass,
    /// Sorted by seed, which is unique.
    pub(crate) results: Vec<&'a ResultRecord>,
    pub(crate) numbers: Numbers,
}

/// One method over scenes, every scene with the same weight.
pub(crate) struct MethodRow<'a> {
    pub(crate) method: &'a str,
    pub(crate) class: MethodClass,
    /// Scenes with a result of this method.
    pub(crate) scenes: usize,
    pub(crate) numbers: Numbers,
    /// True if every scene of the group is included, with complete results that leave no metric out for a quick look.
    pub(crate) complete: bool,
    /// The method of the group that this one is a variant of.
    pub(crate) whole: Option<&'a str>,
    /// In the order of [`Group::quantities`]; ranks are among complete methods of the same class, without variants.
    pub(crate) confidence: Vec<Confidence>,
    /// Number of ranked methods of the class, in the same order.
    pub(crate) ranked: Vec<usize>,
}

/// Groups results by protocol, ordered by protocol and hash.
///
/// # Errors
/// When a result holds impossible numbers, or two results have the same method, scene, seed and protocol, stand for
/// different scenes under one id, or contradict each other about a direction.
pub(crate) fn groups(
    results: &[(PathBuf, ResultRecord)],
) -> Result<Vec<Group<'_>>, LeaderboardError> {
    validate::validate(results)?;
    let mut by_protocol: BTreeMap<(&str, &str), Vec<&ResultRecord>> = BTreeMap::new();
    for (_, result) in results {
        by_protocol
            .entry((&result.protocol, &result.protocol_hash))
            .or_default()
            .push(result);
    }
    Ok(by_protocol
        .into_iter()
        .map(|((protocol, hash), results)| group(protocol, hash, results))
        .collect())
}

fn group<'a>(protocol: &'a str, hash: &'a str, mut results: Vec<&'a ResultRecord>) -> Group<'a> {
    results.sort_by(|a, b| (&a.scene, &a.method, a.seed).cmp(&(&b.scene, &b.method, b.seed)));
    let quantities = quantities(&results);
    let classes = classes(&results);
    let reasons = reasons(&results);
    let differ = scenes_of_other_regions(results.iter().copied());
    let other_regions: BTreeSet<&str> = differ.into_iter().map(|(_, scene)| scene).collect();
    let mut scene_rows: Vec<SceneRow<'a>> = Vec::new();
    for results in results.chunk_by(|a, b| (&a.scene, &a.method) == (&b.scene, &b.method)) {
        let numbers: Vec<Numbers> = results
            .iter()
            .map(|result| {
                let without_regions = other_regions.contains(result.scene.as_str());
                Numbers::of(result, &quantities, without_regions)
            })
            .collect();
        scene_rows.push(SceneRow {
            scene: &results[0].scene,
            method: &results[0].method,
            class: classes[results[0].method.as_str()],
            numbers: Numbers::mean(&numbers.iter().collect::<Vec<_>>()),
            results: results.to_vec(),
        });
    }
    let scenes: BTreeSet<&str> = scene_rows.iter().map(|row| row.scene).collect();
    let scenes: Vec<&str> = scenes.into_iter().collect();
    let mut rows_by_method: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for (at, row) in scene_rows.iter().enumerate() {
        rows_by_method.entry(row.method).or_default().push(at);
    }
    let methods = method_rows(&scene_rows, &scenes, &quantities);
    Group {
        protocol,
        protocol_hash: hash,
        quantities,
        scene_rows,
        methods,
        scenes,
        rows_by_method,
        reasons,
        other_regions,
    }
}

/// The reason that most results give, for every score that any of them lacks.
fn reasons<'a>(results: &[&'a ResultRecord]) -> Reasons<'a> {
    let mut counts: BTreeMap<(&str, &str), BTreeMap<&str, usize>> = BTreeMap::new();
    for unavailable in results.iter().flat_map(|result| &result.unavailable) {
        let score = (unavailable.view.as_str(), unavailable.metric.as_str());
        let of_score = counts.entry(score).or_default();
        *of_score.entry(&unavailable.reason).or_default() += 1;
    }
    let mut reasons = Reasons::new();
    for ((view, metric), counts) in counts {
        let most = counts.into_iter().max_by_key(|&(_, count)| count);
        if let Some((reason, _)) = most {
            reasons.entry(view).or_default().insert(metric, reason);
        }
    }
    reasons
}

fn classes<'a>(results: &[&'a ResultRecord]) -> BTreeMap<&'a str, MethodClass> {
    let mut by_method: BTreeMap<&str, Vec<&ResultRecord>> = BTreeMap::new();
    for &result in results {
        by_method.entry(&result.method).or_default().push(result);
    }
    let of = |(method, results)| (method, MethodClass::of::<'a>(results));
    by_method.into_iter().map(of).collect()
}

fn quantities(results: &[&ResultRecord]) -> Vec<(Quantity, Direction)> {
    let mut found: BTreeMap<(ViewKind, &str), Direction> = BTreeMap::new();
    for result in results {
        for kind in ViewKind::ALL {
            for (metric, summary) in kind.scores(result) {
                // Numbers that only complement others are in the results, not in tables.
                if let Some(direction) = summary.direction {
                    found.insert((kind, metric), direction);
                }
            }
        }
    }
    found
        .into_iter()
        .map(|((kind, metric), direction)| {
            let metric = metric.to_owned();
            (Quantity { kind, metric }, direction)
        })
        .collect()
}

fn method_rows<'a>(
    scene_rows: &[SceneRow<'a>],
    scenes: &[&'a str],
    quantities: &[(Quantity, Direction)],
) -> Vec<MethodRow<'a>> {
    let mut by_method: BTreeMap<&str, Vec<&SceneRow<'a>>> = BTreeMap::new();
    for row in scene_rows {
        by_method.entry(row.method).or_default().push(row);
    }
    let mut methods: Vec<MethodRow<'a>> = by_method
        .iter()
        .map(|(&method, rows)| {
            let numbers: Vec<&Numbers> = rows.iter().map(|row| &row.numbers).collect();
            let numbers = Numbers::mean(&numbers);
            // Only records of this program list aids.
            let mut results = rows.iter().flat_map(|row| &row.results);
            let is_ours = results.any(|result| result.aids.is_some());
            MethodRow {
                method,
                class: rows[0].class,
                scenes: rows.len(),
                complete: rows.len() == scenes.len() && numbers.are_whole(),
                numbers,
                whole: variants::whole_of(&by_method, method, is_ours),
                confidence: Vec::new(),
                ranked: Vec::new(),
            }
        })
        .collect();
    let clusters = bootstrap::clusters(scenes.iter().map(|scene| place(scene)));
    let resamples = bootstrap::resamples(&clusters);
    for (index, (_, direction)) in quantities.iter().enumerate() {
        let scores: Vec<bootstrap::Scores> = by_method
            .values()
            .zip(&methods)
            .map(|(rows, method)| bootstrap::Scores {
                by_scene: rows
                    .iter()
                    .filter(|row| row.numbers.complete)
                    .filter_map(|row| {
                        let scene = scenes.binary_search(&row.scene).ok()?;
                        Some((scene, row.numbers.scores[index]?))
                    })
                    .collect(),
                ranked: method.complete
                    && method.whole.is_none()
                    && method.numbers.scores[index].is_some(),
            })
            .collect();
        let classes: BTreeSet<MethodClass> = methods.iter().map(|method| method.class).collect();
        for class in classes {
            let of_class = |at: &usize| methods[*at].class == class;
            let rivals: Vec<usize> = (0..methods.len()).filter(of_class).collect();
            let of_rivals: Vec<bootstrap::Scores> =
                rivals.iter().map(|&at| scores[at].clone()).collect();
            let confidence = bootstrap::confidence(&of_rivals, &clusters, &resamples, *direction);
            let ranked = confidence.iter().filter(|found| found.rank.is_some());
            let ranked = ranked.count();
            for (at, confidence) in rivals.into_iter().zip(confidence) {
                methods[at].confidence.push(confidence);
                methods[at].ranked.push(ranked);
            }
        }
    }
    methods
}
