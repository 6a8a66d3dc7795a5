//! A rendered view over its ground truth, to look around in: the markup. `panorama.js` draws it in
//! perspective; without scripts both halves are there as they were scored.

use maud::{Markup, html};

use super::{comparisons::Picture, method_page, scene_file};

/// Switches of all panoramas of a page; scripts show them.
pub(super) fn tools() -> Markup {
    html! {
        p.look-tools hidden {
            label { input.look-around type="checkbox" checked; " Look around" }
            button.look-ahead type="button" { "Look ahead" }
            span.hint {
                "Drag, arrow keys and wheel or pinch turn and zoom all images together; the line wipes \
                 between rendering and truth."
            }
        }
    }
}

/// The view that the first page begins with.
pub(super) fn hero(picture: &Picture, scene: &str, rank: usize) -> Markup {
    let caption = html! {
        span {
            (picture.view) " of " a href=(scene_file(scene)) { (scene) } ", "
            a href=(method_page::file(&picture.method)) { (picture.method) }
            " (rank " (rank) ")"
        }
    };
    html! {
        div.hero { (figure(picture, "scenes/", &caption)) }
    }
}

/// Both halves on top of each other, cut at the slider's position. `folder` leads from the page to the
/// pictures.
pub(super) fn figure(picture: &Picture, folder: &str, caption: &Markup) -> Markup {
    let [width, height] = picture.half;
    let what = format!("{} by {}", picture.view, picture.method);
    let file = format!("{folder}{}", picture.file);
    let style = format!(
        "--half-width: {width}; --half-height: {height}; --width-ratio: {:.6}; --truth-offset: {:.6}",
        picture.width_ratio(),
        picture.truth_offset()
    );
    html! {
        figure.compare data-sphere[picture.is_sphere] style=(style) data-width=(width) data-height=(height)
            data-truth=(width + super::comparisons::SEPARATOR) {
            div.stage data-label={ "Look around in " (what) ": arrow keys turn, plus and minus zoom" } {
                div.truth {
                    img src=(file) alt={ "Ground truth of " (what) } loading="lazy" draggable="false";
                }
                div.prediction {
                    img src=(file) alt={ "Rendering of " (what) } loading="lazy" draggable="false";
                }
                span.half.rendered aria-hidden="true" { "rendered" }
                span.half.truth-label aria-hidden="true" { "truth" }
            }
            label {
                span.visually-hidden { "Share of the rendered view, " (what) }
                input.split type="range" min="0" max="100" value="50" step="1";
            }
            figcaption {
                (caption)
                label {
                    input.error-map type="checkbox";
                    " Error map" span.visually-hidden { ", " (what) }
                }
            }
        }
    }
}
