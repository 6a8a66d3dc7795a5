//! Which metrics of a protocol are computed.

use omnilife_schemas::names::UnknownName;

use crate::metrics::{METRICS, Metric, Need};

/// Metrics that are computed. Those that are left out are unavailable in the result, with that
/// reason: a quick look is no score of the whole protocol, and its other numbers are the protocol's.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum MetricChoice {
    /// Every metric of the protocol.
    #[default]
    All,
    /// Those that need no network: LPIPS takes most of the time of scoring.
    WithoutNetworks,
    /// Those of these ids.
    Only(Vec<String>),
}

impl MetricChoice {
    /// The metrics of these ids.
    ///
    /// # Errors
    /// [`UnknownName`] for an id that no metric has.
    pub fn only(ids: &[String]) -> Result<Self, UnknownName> {
        for id in ids {
            omnilife_schemas::names::find("metric", id, METRICS, |metric| metric.id)?;
        }
        Ok(Self::Only(ids.to_vec()))
    }

    /// Why a metric is left out; `None` for one that is computed.
    pub(super) fn why_not(&self, metric: &Metric) -> Option<String> {
        let is_network = |need: &Need| matches!(need, Need::Network(_));
        let is_left_out = match self {
            Self::All => false,
            Self::WithoutNetworks => metric.needs.iter().any(is_network),
            Self::Only(ids) => !ids.iter().any(|id| id == metric.id),
        };
        is_left_out.then(|| "left out for a quick look".to_owned())
    }
}
