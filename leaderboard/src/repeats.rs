//! Data that count several times: a scene under several names, and a run under several seeds.
//!
//! Means give every scene the same weight, and intervals come from draws of scenes. A scene that stands under two names
//! weighs double in both. A run that stands under two seeds has no spread.

use std::collections::{BTreeMap, BTreeSet};

use omnilife_schemas::{
    provenance,
    records::{ResultRecord, ScoredFile},
};

use crate::{class::MethodClass, format::counted, group::Group};

/// Returns a line on scenes that are one, a line on repetitions that are one, lines on repetitions of other runs, and a
/// line on runs that began with other files.
pub(crate) fn warnings(group: &Group<'_>) -> Vec<String> {
    let of_other_runs = OTHER_RUNS.iter().map(|other| other.line(group));
    [scenes(group), seeds(group), other_inputs(group)]
        .into_iter()
        .chain(of_other_runs)
        .flatten()
        .collect()
}

/// A fact in which repetitions must not differ.
struct OtherRuns {
    /// Says what the seeds are, after "seeds that".
    are: &'static str,
    /// Says what to do.
    remedy: &'static str,
    fact: fn(&ResultRecord) -> Option<String>,
}

const OTHER_RUNS: [OtherRuns; 3] = [
    OtherRuns {
        are: "were trained for other numbers of iterations",
        remedy: "Keep one number.",
        fact: |result| Some(result.iterations?.to_string()),
    },
    OtherRuns {
        are: "were trained with other options",
        remedy: "Keep one setting.",
        fact: |result| {
            // Results without a run record say nothing.
            result.seed?;
            match result.options.is_empty() {
                true => Some("defaults".to_owned()),
                false => Some(result.options.join(" ")),
            }
        },
    },
    OtherRuns {
        are: "other versions of the program trained",
        remedy: "Train them again by one version.",
        fact: |result| provenance::commit_in(&result.run_versions).map(str::to_owned),
    },
];

impl OtherRuns {
    /// Returns a line on the methods of which seeds of a scene differ.
    fn line(&self, group: &Group<'_>) -> Option<String> {
        let different: Vec<String> = (group.scene_rows.iter())
            .filter_map(|row| {
                let facts: BTreeSet<String> = row
                    .results
                    .iter()
                    .filter_map(|one| (self.fact)(one))
                    .collect();
                let words: Vec<String> = facts.into_iter().collect();
                (words.len() > 1)
                    .then(|| format!("{}, {} ({})", row.scene, row.method, words.join(" and ")))
            })
            .collect();
        (!different.is_empty()).then(|| {
            format!(
                "Means over seeds that {}, which are no repetitions: {}. {}",
                self.are,
                different.join("; "),
                self.remedy
            )
        })
    }
}

/// Returns the scenes whose runs began with other points, tracks or masks than each other.
fn other_inputs(group: &Group<'_>) -> Option<String> {
    /// Methods by the hash of a file, by its name in a scene.
    type Users<'a> = BTreeMap<(&'a str, &'a str), BTreeMap<&'a str, BTreeSet<&'a str>>>;
    let mut users = Users::new();
    for row in &group.scene_rows {
        for (name, sha256) in row.results.iter().flat_map(|result| &result.run_inputs) {
            let of_file = users.entry((row.scene, name)).or_default();
            of_file.entry(sha256).or_default().insert(row.method);
        }
    }
    let different: Vec<String> = users
        .into_iter()
        .filter(|(_, of_file)| of_file.len() > 1)
        .map(|((scene, name), of_file)| {
            let sides = of_file.into_values();
            let sides: Vec<String> = sides
                .map(|methods| methods.into_iter().collect::<Vec<_>>().join(" and "))
                .collect();
            format!("{scene}, {name} ({})", sides.join(" against "))
        })
        .collect();
    (!different.is_empty()).then(|| {
        format!(
            "Runs that began with other files of the same name: {}. Train those again that are older.",
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
