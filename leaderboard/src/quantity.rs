//! Scored quantities: metrics over kinds of views.

use std::collections::BTreeMap;

use omnilife_schemas::records::{ResultRecord, Summary};

/// The scores of a failed run.
static NO_SCORES: BTreeMap<String, Summary> = BTreeMap::new();

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

    /// Returns the scores of views of this kind. A failed run has none, whatever views it left.
    pub(crate) fn scores(self, result: &ResultRecord) -> &BTreeMap<String, Summary> {
        if result.run_failure.is_some() {
            return &NO_SCORES;
        }
        match self {
            Self::Input => &result.input_views,
            Self::Novel => &result.novel_views,
        }
    }
}

/// A scored quantity: a metric over one kind of view.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Quantity {
    pub(crate) kind: ViewKind,
    pub(crate) metric: String,
}
