//! `published`: the published split of a data set.

use omnilife_schemas::records::{Protocol, ScoredViews, SplitRule};

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
        metrics: metric_list::all(),
        ..Protocol::new(ENTRY.id, SplitRule::Published, ScoredViews::Novel)
    }
}
