//! Aids of the rows: components that help any method, such as larger steps in short schedules.
//!
//! Two methods are compared with equal aids if both have a row, as they are or as a variant, in which each aid that
//! both can have is used by both or by neither.

use std::collections::{BTreeMap, BTreeSet};

use omnilife_schemas::records::ResultRecord;

use crate::{
    group::{Group, SceneRow},
    variants::method_of,
};

/// Returns the aids that the rows used, in a line; `None` where no record says.
pub(crate) fn note(group: &Group<'_>) -> Option<String> {
    let mut used: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for row in &group.scene_rows {
        for aids in row.results.iter().filter_map(|result| result.aids.as_ref()) {
            let of_method = used.entry(row.method).or_default();
            let aids = aids.iter().filter(|(_, is_used)| **is_used);
            of_method.extend(aids.map(|(aid, _)| aid.as_str()));
        }
    }
    let mut methods: BTreeMap<BTreeSet<&str>, Vec<&str>> = BTreeMap::new();
    for (method, aids) in used {
        methods.entry(aids).or_default().push(method);
    }
    let parts = methods.into_iter().map(|(aids, methods)| {
        let aids: Vec<&str> = aids.into_iter().collect();
        let aids = if aids.is_empty() {
            "no aid".to_owned()
        } else {
            aids.join(", ")
        };
        format!("{aids} ({})", methods.join(", "))
    });
    let parts: Vec<String> = parts.collect();
    (!parts.is_empty()).then(|| format!("Aids that rows used on any scene: {}.", parts.join("; ")))
}

/// Returns a warning of the methods that no rows compare with equal aids.
pub(crate) fn warning(group: &Group<'_>) -> Option<String> {
    let mut unequal: BTreeMap<[&str; 2], BTreeSet<&str>> = BTreeMap::new();
    for scene in &group.scenes {
        let mut methods: BTreeMap<&str, Vec<&ResultRecord>> = BTreeMap::new();
        for row in group.rows_in(scene) {
            let rows = methods.entry(method_of(row.method)).or_default();
            rows.extend(first(row));
        }
        let methods: Vec<(&str, Vec<&ResultRecord>)> = methods.into_iter().collect();
        for (at, (method, rows)) in methods.iter().enumerate() {
            for (other, others) in &methods[at + 1..] {
                let aids = least_difference(rows, others);
                if !aids.is_empty() {
                    unequal.entry([*method, *other]).or_default().extend(aids);
                }
            }
        }
    }
    let pairs = unequal.iter().map(|([method, other], aids)| {
        let aids: Vec<&str> = aids.iter().copied().collect();
        format!("{method} and {other} ({})", aids.join(", "))
    });
    let pairs: Vec<String> = pairs.collect();
    (!pairs.is_empty()).then(|| {
        format!(
            "Not compared with equal aids: {}. bench run --aids both adds the rows without aids.",
            pairs.join("; ")
        )
    })
}

/// Returns the first result that says which aids were used.
fn first<'a>(row: &SceneRow<'a>) -> Option<&'a ResultRecord> {
    let mut results = row.results.iter().copied();
    results.find(|result| result.aids.is_some())
}

/// Returns the aids in which the most similar rows of two methods differ.
fn least_difference<'a>(rows: &[&'a ResultRecord], others: &[&'a ResultRecord]) -> Vec<&'a str> {
    let pairs = rows
        .iter()
        .flat_map(|row| others.iter().map(move |other| row.differing_aids(other)));
    pairs.min_by_key(Vec::len).unwrap_or_default()
}
