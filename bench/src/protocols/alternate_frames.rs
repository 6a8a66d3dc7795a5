//! `alternate-frames`: every second frame is given, and those between are new in view and in time.

use omnilife_schemas::records::{Colour, Padding, Protocol, Resampling, ScoredViews, SplitRule};

use super::{ProtocolEntry, metric_list};

/// Setting for dynamic scenes of few frames per second: a method that only memorizes its input shows moving content in
/// the wrong place.
pub(super) const ENTRY: ProtocolEntry = ProtocolEntry {
    id: "alternate-frames",
    description: "Dynamic scenes in view and time: of every two posed frames the first is given and the \
                  second is predicted; both kinds are scored, whole images at the scene's own size, what \
                  moves and what stands still apart where masks are known",
    protocol,
};

fn protocol() -> Protocol {
    Protocol {
        id: ENTRY.id.to_owned(),
        version: 1,
        split: SplitRule::EveryNth {
            period: 2,
            offset: 1,
        },
        scored: ScoredViews::InputAndNovel,
        largest_width: None,
        resampling: Resampling::Area,
        padding: Padding::None,
        colour: Colour::Srgb8,
        metrics: metric_list::all(),
        mask_rule: "none".to_owned(),
    }
}
