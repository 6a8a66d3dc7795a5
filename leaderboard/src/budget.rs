//! Iterations of methods, and methods with other iterations than is usual in their class.

use std::collections::BTreeMap;

use crate::{class::MethodClass, group::MethodRow};

/// Returns the usual iterations of every class of a group: the most frequent ones, the largest of equally frequent.
/// Methods that stopped at a time limit, or differ between scenes, have means.
pub(crate) fn usual_iterations(methods: &[&MethodRow<'_>]) -> BTreeMap<MethodClass, u64> {
    let mut counts: BTreeMap<MethodClass, BTreeMap<u64, usize>> = BTreeMap::new();
    for method in methods {
        if let Some(iterations) = iterations(method) {
            let of_class = counts.entry(method.class).or_default();
            *of_class.entry(iterations).or_default() += 1;
        }
    }
    let most = |counts: &BTreeMap<u64, usize>| {
        let found = counts
            .iter()
            .max_by_key(|&(&iterations, &count)| (count, iterations));
        found.map(|(&iterations, _)| iterations)
    };
    (counts.iter())
        .filter_map(|(&class, counts)| Some((class, most(counts)?)))
        .collect()
}

/// Returns a method's iterations, rounded if scenes differ.
pub(crate) fn iterations(method: &MethodRow<'_>) -> Option<u64> {
    let iterations = method.numbers.iterations?;
    Some(iterations.round() as u64)
}

/// Returns true if a method had another budget than is usual in its class.
pub(crate) fn has_unusual_budget(
    method: &MethodRow<'_>,
    usual: &BTreeMap<MethodClass, u64>,
) -> bool {
    let own = iterations(method);
    own.is_some() && own != usual.get(&method.class).copied()
}
