//! `sparse-panoramas`: from a few panoramas, all others.

use omnilife_schemas::records::{Protocol, ScoredViews, SplitRule};

use super::{ProtocolEntry, metric_list};

/// Setting of PanoGS: some panoramas of a place are given, ten in its tables. It does not state which; here they are
/// spread evenly over the posed frames, from the first on.
pub(super) const ENTRY: ProtocolEntry = ProtocolEntry {
    id: "sparse-panoramas",
    description: "Reconstruction from a few panoramas: ten posed frames, spread evenly from the first \
                  on, are given, all others are predicted and scored, whole ERP images at the scene's \
                  size (the setting of PanoGS, which publishes no image metric)",
    protocol,
};

fn protocol() -> Protocol {
    Protocol {
        metrics: metric_list::all(),
        ..Protocol::new(
            ENTRY.id,
            SplitRule::EvenlyGiven { count: 10 },
            ScoredViews::Novel,
        )
    }
}
