//! Data that count several times: a scene under several names, and a run under several seeds.
//!
//! Means give every scene the same weight, and intervals come from draws of scenes. A scene that stands under two names
//! weighs double in both. A run that stands under two seeds has no spread.

use std::collections::{BTreeMap, BTreeSet};

use omnilife_schemas::records::{ResultRecord, ScoredFile};

use crate::{class::MethodClass, format::counted, group::Group};

/// Returns a line on scenes that are one, a line on repetitions that are one, and a line on repetitions of other runs.
pub(crate) fn warnings(group: &Group<'_>) -> Vec<String> {
    let lines = [scenes(group), seeds(group), other_lengths(group)];
    lines.into_iter().flatten().collect()
}

/// Returns the methods of which seeds of a scene were trained for other numbers of iterations.
fn other_lengths(group: &Group<'_>) -> Option<String> {
    let different: Vec<String> = (group.scene_rows.iter())
        .filter_map(|row| {
            let lengths: BTreeSet<u64> = row
                .results
                .iter()
                .filter_map(|one| one.iterations)
                .collect();
            let words: Vec<String> = lengths.iter().map(u64::to_string).collect();
            (lengths.len() > 1)
                .then(|| format!("{}, {} ({})", row.scene, row.method, words.join(" and ")))
        })
        .collect();
    (!different.is_empty()).then(|| {
        format!(
            "Means over seeds that were trained for other numbers of iterations, which are no repetitions: {}. Keep one \
             number.",
            different.join("; ")
        )
    })
}

/// Returns the names of scenes with the same frames, poses and images.
fn scenes(group: &Group<'_>) -> Option<String> {
    let mut names: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    let rows = group.scene_rows.iter();
    for (scene, result) in
        rows.flat_map(|row| row.results.iter().map(move |result| (row.scene, result)))
    {
        if !result.scene_sha256.is_empty() {
            names.entry(&result.scene_sha256).or_default().insert(scene);
        }
    }
    let one: Vec<String> = names
        .into_values()
        .filter(|names| names.len() > 1)
        .map(|names| names.into_iter().collect::<Vec<_>>().join(" and "))
        .collect();
    (!one.is_empty()).then(|| {
        format!(
            "One scene under several names, which counts several times in means and intervals: {}. Keep the results of \
             one name.",
            one.join("; ")
        )
    })
}

/// Returns the methods with the same views, byte for byte, under several seeds of a scene. Methods without training may
/// well have no random numbers.
fn seeds(group: &Group<'_>) -> Option<String> {
    let of_training = group
        .scene_rows
        .iter()
        .filter(|row| row.class != MethodClass::WithoutTraining);
    let repeated: Vec<String> = of_training
        .filter_map(|row| {
            let mut distinct: BTreeSet<Vec<&str>> = BTreeSet::new();
            let views: Vec<Vec<&str>> = row.results.iter().filter_map(|one| views(one)).collect();
            let count = views.len();
            distinct.extend(views);
            let again = count - distinct.len();
            (again > 0).then(|| {
                let (scene, method) = (row.scene, row.method);
                format!("{scene}, {method} ({} again)", counted(again, "seed"))
            })
        })
        .collect();
    (!repeated.is_empty()).then(|| {
        format!(
            "The same views, byte for byte, under several seeds, which are no repetitions: {}.",
            repeated.join("; ")
        )
    })
}

/// Returns the hashes of the scored files of a result; `None` without known files.
fn views(result: &ResultRecord) -> Option<Vec<&str>> {
    let files: &[ScoredFile] = &result.predictions.as_ref()?.files;
    let hashes = files.iter().map(|file| file.sha256.as_str());
    (!files.is_empty()).then(|| hashes.collect())
}
