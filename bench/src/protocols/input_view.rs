//! `input-view`: a method reproduces its input views.

use omnilife_schemas::records::{Colour, Padding, Protocol, Resampling, ScoredViews, SplitRule};

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
        id: ENTRY.id.to_owned(),
        version: 3,
        split: SplitRule::AllGiven,
        scored: ScoredViews::Input,
        largest_width: None,
        resampling: Resampling::Area,
        padding: Padding::None,
        colour: Colour::Srgb8,
        metrics: metric_list::of_input_views(),
        mask_rule: "none".to_owned(),
    }
}
