//! `input-view`: a method reproduces its input views.

use omnilife_schemas::records::{Protocol, ScoredViews, SplitRule};

use super::{ProtocolEntry, metric_list};

/// Setting of the papers on UAV video and on neural atlases: fidelity of training views. It says nothing about unseen
/// views.
pub(super) const ENTRY: ProtocolEntry = ProtocolEntry {
    id: "input-view",
    description: "Fidelity to what was given: every posed frame is given and every one is scored, \
                  whole images at the scene's own size; nothing is held out (the training-view \
                  scores of dynamic urban UAV scenes and of neural atlas graphs)",
    protocol,
};

fn protocol() -> Protocol {
    Protocol {
        version: 3,
        metrics: metric_list::of_input_views(),
        ..Protocol::new(ENTRY.id, SplitRule::AllGiven, ScoredViews::Input)
    }
}
