//! `per-scene`: a method is trained on one scene and predicts that scene's held-out views.

use omnilife_schemas::records::{Protocol, ScoredViews, SplitRule};

use super::{ProtocolEntry, metric_list};

/// The 0.8/0.2 split of OmniLife360's per-scene tables. The paper does not state the held-out frames; every fifth, at
/// offset 4, is this project's reading.
pub(super) const ENTRY: ProtocolEntry = ProtocolEntry {
    id: "per-scene",
    description: "Per-scene optimization: of every five posed frames the first four are given and \
                  the fifth is predicted; both kinds are scored, whole ERP images at the scene's \
                  own size (OmniLife360, Table 2)",
    protocol,
};

fn protocol() -> Protocol {
    Protocol {
        version: 2,
        metrics: metric_list::all(),
        ..Protocol::new(
            ENTRY.id,
            SplitRule::EveryNth {
                period: 5,
                offset: 4,
            },
            ScoredViews::InputAndNovel,
        )
    }
}
