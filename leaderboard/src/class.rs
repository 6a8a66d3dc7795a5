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
        let classes = results.into_iter().map(|result| {
            let class = match result.training_kind() {
                Some(TrainingKind::PerScene) => Self::PerSceneTraining,
                Some(TrainingKind::WithoutTraining) => Self::WithoutTraining,
                None => Self::NotStated,
            };
            (result.training.is_none(), class)
        });
        classes.min().map_or(Self::NotStated, |(_, class)| class)
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
