//! A protocol in words.

use maud::{Markup, html};

use omnilife_schemas::records::{Protocol, Resampling, SplitRule};

pub(super) fn explained(protocol: Option<&Protocol>) -> Markup {
    let Some(protocol) = protocol else {
        return html! {
            p { "The rules of this protocol were not among the results: no split.json has its hash." }
        };
    };
    let SplitRule::EveryNth { period, offset } = protocol.split;
    let Resampling::Area = protocol.resampling;
    html! {
        details open {
            summary { "What is scored" }
            dl {
                dt { "Split" }
                dd {
                    "Of every " (period) " posed frames in order of time, frame " (offset + 1)
                    " is a novel view that the method must predict; the others are input views, \
                     which it is given."
                }
                dt { "Size" }
                dd {
                    @match protocol.width {
                        Some(width) => {
                            (width) " pixels wide; ground truth is brought there by area averaging \
                             and never enlarged."
                        },
                        None => "The scene's own size.",
                    }
                }
                dt { "Metrics" }
                dd { (protocol.metrics.join(", ")) }
                dt { "Masks" }
                dd {
                    @if protocol.mask_rule == "none" {
                        "None: whole images are scored."
                    } @else {
                        (protocol.mask_rule)
                    }
                }
                dt { "Means" }
                dd {
                    "Over the views of a scene, then over its seeds, then over scenes, every scene \
                     with the same weight. A view that could not be scored is a failure; a method \
                     with failures or without a scene is not ranked."
                }
                dt { "Hash of the rules" }
                dd { code { (protocol.hash()) } }
            }
        }
    }
}
