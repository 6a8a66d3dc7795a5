//! `published`: the published split of a data set.

use omnilife_schemas::records::{Colour, Padding, Protocol, Resampling, ScoredViews, SplitRule};

use super::{ProtocolEntry, metric_list};

/// Setting of the tables of data sets with lists of images for training and for testing, of which they score the
/// latter.
pub(super) const ENTRY: ProtocolEntry = ProtocolEntry {
    id: "published",
    description: "The split that a data set is published with: its images for training are given, its images \
                  for testing are predicted and scored, whole images at the scene's own size; scenes without \
                  one are refused",
    protocol,
};

fn protocol() -> Protocol {
    Protocol {
        id: ENTRY.id.to_owned(),
        version: 1,
        split: SplitRule::Published,
        scored: ScoredViews::Novel,
        largest_width: None,
        resampling: Resampling::Area,
        padding: Padding::None,
        colour: Colour::Srgb8,
        metrics: metric_list::all(),
        mask_rule: "none".to_owned(),
    }
}
