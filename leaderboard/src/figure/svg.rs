//! A figure with names: the pixels in one image, the words as text that a paper's editor can change.

use base64::{Engine, engine::general_purpose::STANDARD};
use maud::html;

use super::panels::Canvas;

/// Height of the line of names above the panels, in pixels of the figure.
const HEAD: usize = 26;

/// Width left of the panels for the scenes' names.
const SIDE: usize = 26;

pub(super) fn drawing(
    canvas: &Canvas,
    png: &[u8],
    columns: &[String],
    rows: &[(String, u32)],
) -> String {
    let (width, height) = (canvas.width + SIDE, canvas.height + HEAD);
    let middle = canvas.panel_width / 2;
    let markup = html! {
        svg xmlns="http://www.w3.org/2000/svg" viewBox={ "0 0 " (width) " " (height) }
            width=(width) height=(height) font-family="sans-serif" font-size="16" text-anchor="middle" {
            rect width=(width) height=(height) fill="#fff" {}
            image x=(SIDE) y=(HEAD) width=(canvas.width) height=(canvas.height)
                href={ "data:image/png;base64," (STANDARD.encode(png)) } {}
            @for (name, left) in columns.iter().zip(&canvas.lefts) {
                text x=(SIDE + left + middle) y="18" { (name) }
            }
            @for ((scene, frame), (top, panel)) in rows.iter().zip(&canvas.tops) {
                @let y = HEAD + top + panel / 2;
                text x="17" y=(y) transform={ "rotate(-90 17 " (y) ")" } font-size="13" {
                    (scene) " (" (frame) ")"
                }
            }
        }
    };
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n{}\n",
        markup.into_string()
    )
}
