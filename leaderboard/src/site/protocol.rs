//! A protocol in words.

use maud::{Markup, html};

use omnilife_schemas::records::{Colour, Padding, Protocol, Resampling, ScoredViews, SplitRule};

pub(super) fn explained(protocol: Option<&Protocol>) -> Markup {
    let Some(protocol) = protocol else {
        return html! {
            p { "The rules of this protocol were not among the results: no split.json has its hash." }
        };
    };
    let Resampling::Area = protocol.resampling;
    let Colour::Srgb8 = protocol.colour;
    html! {
        details.protocol {
            summary { "What is scored" }
            dl {
                dt { "Split" }
                dd { (split_in_words(&protocol.split)) }
                dt { "Scored" }
                dd {
                    @match protocol.scored {
                        ScoredViews::InputAndNovel => "Input views and novel views, apart.",
                        ScoredViews::Novel => "Novel views alone.",
                        ScoredViews::Input => "Input views alone.",
                    }
                }
                dt { "Size" }
                dd {
                    @match (protocol.padding, protocol.largest_width) {
                        (Padding::Frame { width, height }, _) => {
                            "As large as fits into frames of " (width) "x" (height) " pixels in proportion; \
                             larger ground truth is brought there by area averaging, nothing is enlarged. \
                             Predictions may fill the frame, with the image in its middle: its padding is cut \
                             off and not scored."
                        },
                        (Padding::None, Some(width)) => {
                            "At most " (width) " pixels wide; larger ground truth is brought there \
                             by area averaging, nothing is enlarged or padded."
                        },
                        (Padding::None, None) => "The scene's own size, without padding.",
                    }
                }
                dt { "Colour" }
                dd {
                    "Red, green and blue as decoded (sRGB), of 8 bits."
                }
                dt { "Metrics" }
                dd { (protocol.metrics.join(", ")) }
                dt { "Masks" }
                dd {
                    @if protocol.mask_rule == "none" {
                        "Whole images are scored, but for the metrics that name a part of them."
                    } @else {
                        (protocol.mask_rule)
                    }
                }
                dt { "Means" }
                dd {
                    "Over the views of a scene, then over its seeds, then over scenes, every scene \
                     with the same weight. A view that could not be scored is a failure; a method \
                     with failures, with a run that failed or without a scene is not ranked."
                }
                dt { "Hash of the rules" }
                dd { code { (protocol.hash()) } }
            }
        }
    }
}

fn split_in_words(rule: &SplitRule) -> String {
    match rule {
        SplitRule::EveryNth { period, offset } => format!(
            "Of every {period} posed frames in order of time, frame {} is a novel view that the \
             method must predict; the others are input views, which it is given.",
            offset + 1
        ),
        SplitRule::Groups { length } => format!(
            "Groups of {length} consecutive frames that share none: the first and the last of a \
             group are given, the {} between them are novel views that the method must predict. \
             Incomplete groups are left out.",
            length.saturating_sub(2)
        ),
        SplitRule::EvenlyGiven { count } => format!(
            "{count} of the posed frames, spread evenly from the first on, are input views, which the \
             method is given; it predicts all others, the novel views."
        ),
        SplitRule::Given { frames } => {
            let frames: Vec<String> = frames.iter().map(u32::to_string).collect();
            format!(
                "Frames {} are input views, which the method is given; it predicts all others with a pose, the \
                 novel views.",
                frames.join(", ")
            )
        }
        SplitRule::AllGiven => "Every posed frame is an input view, which the method is given; \
                                nothing is held out."
            .to_owned(),
        SplitRule::Published => {
            "Input views, which the method is given, and novel views, which it must \
                                 predict, are those that the publisher of the scene lists."
                .to_owned()
        }
    }
}
