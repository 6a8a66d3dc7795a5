//! Choice of a protocol's metrics.

use omnilife_schemas::{names::UnknownName, records::QUICK_LOOK};

use crate::metrics::{METRICS, Metric, Need};

/// Metrics to compute. The others are unavailable in the result, for that reason: a partial score does not stand for
/// the whole protocol, but its numbers are the protocol's.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum MetricChoice {
    /// Every metric of the protocol.
    #[default]
    All,
    /// Those without a network: LPIPS takes most of the time of scoring.
    WithoutNetworks,
    /// Those of these ids.
    Only(Vec<String>),
}

impl MetricChoice {
    /// Chooses the metrics of these ids.
    ///
    /// # Errors
    /// [`UnknownName`] for an unknown id.
    pub fn only(ids: &[String]) -> Result<Self, UnknownName> {
        for id in ids {
            omnilife_schemas::names::find("metric", id, METRICS, |metric| metric.id)?;
        }
        Ok(Self::Only(ids.to_vec()))
    }

    /// Returns why a metric is omitted; `None` for a computed one.
    pub(super) fn why_not(&self, metric: &Metric) -> Option<String> {
        let is_network = |need: &Need| matches!(need, Need::Network(_));
        let is_left_out = match self {
            Self::All => false,
            Self::WithoutNetworks => metric.needs.iter().any(is_network),
            Self::Only(ids) => !ids.iter().any(|id| id == metric.id),
        };
        is_left_out.then(|| QUICK_LOOK.to_owned())
    }
}
