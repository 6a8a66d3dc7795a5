//! `alternate-frames`: every second frame is given, and those between are new in view and in time.

use omnilife_schemas::records::{Protocol, ScoredViews, SplitRule};

use super::{ProtocolEntry, metric_list};

/// Setting for dynamic scenes of few frames per second: a method that only memorizes its input shows moving content in
/// the wrong place.
pub(super) const ENTRY: ProtocolEntry = ProtocolEntry {
    id: "alternate-frames",
    description: "Dynamic scenes in view and time: of every two posed frames the first is an input view and \
                  the second a novel one; both kinds are scored, whole images at the scene's own size, \
                  and by dynamic and static regions where the scene has masks",
    protocol,
};

fn protocol() -> Protocol {
    Protocol {
        metrics: metric_list::all(),
        ..Protocol::new(
            ENTRY.id,
            SplitRule::EveryNth {
                period: 2,
                offset: 1,
            },
            ScoredViews::InputAndNovel,
        )
    }
}
