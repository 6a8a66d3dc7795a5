//! `sparse-interpolation`: from two views, those between them.

use omnilife_schemas::records::{Protocol, ScoredViews, SplitRule};

use super::{ProtocolEntry, metric_list};

/// The sparse-view protocol of OmniLife360's feed-forward tables. The paper says "groups of 10". This project's reading
/// is that groups share no frame, and that a group with a frame without pose is omitted. The published feed-forward
/// methods run at no more than 1024x512.
pub(super) const ENTRY: ProtocolEntry = ProtocolEntry {
    id: "sparse-interpolation",
    description: "Feed-forward reconstruction: of every group of ten consecutive frames the first \
                  and the last are given and the eight between them are predicted; the novel views \
                  alone are scored, whole ERP images at most 1024 pixels wide (OmniLife360, Table 3)",
    protocol,
};

fn protocol() -> Protocol {
    Protocol {
        largest_width: Some(1024),
        metrics: metric_list::all(),
        ..Protocol::new(
            ENTRY.id,
            SplitRule::Groups { length: 10 },
            ScoredViews::Novel,
        )
    }
}
