//! A figure with names: the pixels in one image, the words as text that a paper's editor can change.

use base64::{Engine, engine::general_purpose::STANDARD};
use maud::html;

use super::{
    gallery::Sheet,
    panels::{Canvas, GAP},
};

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
    document(markup)
}

/// Height of the two lines below a row of a gallery, in pixels of the figure.
const LABEL: usize = 44;

/// Returns a gallery: the rows of its pixels, and two lines of text below every sequence.
pub(super) fn gallery(sheet: &Sheet, png: &[u8], labels: &[[String; 2]]) -> String {
    let rows = sheet.rows.len();
    let (width, height) = (sheet.width, sheet.height + rows * LABEL - (rows - 1) * GAP);
    let row_top = |row: usize| sheet.rows[row][0] + row * (LABEL - GAP);
    let cells = labels.iter().enumerate();
    let markup = html! {
        svg xmlns="http://www.w3.org/2000/svg" viewBox={ "0 0 " (width) " " (height) }
            width=(width) height=(height) font-family="sans-serif" font-size="14" text-anchor="middle" {
            rect width=(width) height=(height) fill="#fff" {}
            defs {
                image #pixels width=(sheet.width) height=(sheet.height)
                    href={ "data:image/png;base64," (STANDARD.encode(png)) } {}
            }
            @for (row, [top, high]) in sheet.rows.iter().enumerate() {
                svg y=(row_top(row)) width=(width) height=(high) viewBox={ "0 " (top) " " (width) " " (high) } {
                    use href="#pixels" {}
                }
            }
            @for (at, [place, motion]) in cells {
                @let (row, column) = (at / sheet.columns, at % sheet.columns);
                @let x = column * (sheet.panel_width + GAP) + sheet.panel_width / 2;
                @let y = row_top(row) + sheet.rows[row][1];
                text x=(x) y=(y + 17) font-weight="bold" { (place) }
                text x=(x) y=(y + 34) font-size="12" fill="#555" { (motion) }
            }
        }
    };
    document(markup)
}

fn document(markup: maud::Markup) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n{}\n",
        markup.into_string()
    )
}
