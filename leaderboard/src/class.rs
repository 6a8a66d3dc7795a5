//! Classes of methods, by their input and their use of it. Ranks are within one class, and rows of a class are marked
//! if they were trained for longer or shorter than the others.

use std::collections::BTreeMap;

use omnilife_schemas::records::{ResultRecord, TrainingKind};

use crate::group::MethodRow;

/// Kind of training of a method, in the order of the tables.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) enum MethodClass {
    /// Trained a model of each scene from all of its given views.
    PerSceneTraining,
    /// No training on the scene.
    WithoutTraining,
    /// Not stated in any record of the run.
    NotStated,
}

impl MethodClass {
    /// Returns the class of a method's results. An explicit statement decides over inference; among equals a training
    /// decides: records of the same method differ in their statements.
    pub(crate) fn of<'a>(results: impl IntoIterator<Item = &'a ResultRecord>) -> Self {
        let classes = results.into_iter().map(|result| match result.training {
            Some(TrainingKind::PerScene) => (0, Self::PerSceneTraining),
            Some(TrainingKind::WithoutTraining) => (0, Self::WithoutTraining),
            None => (1, Self::inferred(result)),
        });
        classes.min().map_or(Self::NotStated, |(_, class)| class)
    }

    fn inferred(result: &ResultRecord) -> Self {
        // A sweep for depth takes time but trains nothing on the scene.
        let is_trained = match result.iterations {
            Some(iterations) => iterations > 0,
            None => result.training_seconds.unwrap_or(0.0) > 0.0,
        };
        if is_trained {
            Self::PerSceneTraining
        } else if result.backend.is_some() {
            Self::WithoutTraining
        } else {
            Self::NotStated
        }
    }

    /// Returns the heading over its rows.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::PerSceneTraining => "Trained per scene",
            Self::WithoutTraining => "Without training",
            Self::NotStated => "Training not stated",
        }
    }
}

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
