//! Classes of methods, by their input and their use of it. Ranks are within one class, and rows of a class are marked
//! if they were trained for longer or shorter than the others.

use omnilife_schemas::records::{ResultRecord, TrainingKind};

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
