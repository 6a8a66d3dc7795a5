//! Markup of a panorama viewer with a rendered view over its ground truth. `panorama.js` draws it in perspective;
//! without scripts both halves are shown as scored.

use maud::{Markup, html};

use super::{comparisons::ComparisonImage, method_page, scene_file};

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

/// Returns the first view of the first page, whole and never enlarged; `standing` is the method's rank in words.
pub(super) fn hero(image: &ComparisonImage, scene: &str, standing: &str) -> Markup {
    let caption = html! {
        span {
            (image.view) " of " a href=(scene_file(scene)) { (scene) } ", "
            a href=(method_page::file(&image.method)) { (image.method) }
            " (" (standing) ")"
        }
    };
    whole(image, "scenes/", &caption)
}

/// Returns a view with all that it shows, at most as wide as it is in pixels.
pub(super) fn whole(image: &ComparisonImage, folder: &str, caption: &Markup) -> Markup {
    let [width, height] = image.half;
    let size = format!("--half-width: {width}; --half-height: {height}");
    html! {
        div.hero style=(size) {
            (drawn(image, folder, caption, false))
        }
    }
}

/// Returns both halves on top of each other, cut at the slider's position, to look around in where they are whole
/// spheres. `folder` leads from the page to the images.
pub(super) fn figure(image: &ComparisonImage, folder: &str, caption: &Markup) -> Markup {
    drawn(image, folder, caption, image.is_sphere)
}

fn drawn(image: &ComparisonImage, folder: &str, caption: &Markup, turns: bool) -> Markup {
    let [width, height] = image.half;
    let what = format!("{} by {}", image.view, image.method);
    let file = format!("{folder}{}", image.file);
    let style = format!(
        "--half-width: {width}; --half-height: {height}; --width-ratio: {:.6}; --truth-offset: {:.6}",
        image.width_ratio(),
        image.truth_offset()
    );
    html! {
        figure.compare data-sphere[turns] style=(style) data-width=(width) data-height=(height)
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
