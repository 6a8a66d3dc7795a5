//! Boxes in images, and the borders that cut them.

use glam::{DVec2, dvec2};

use crate::posed_view::PosedView;

/// Largest distance to the border of a box that ends there, pixels.
const BORDER: f64 = 1.5;

/// Returns true if the border of the image cuts a box off.
pub(super) fn is_cut(view: &PosedView, [left, top, width, height]: [f64; 4]) -> bool {
    let [columns, rows] = view.camera.size().map(|side| side as f64);
    left < BORDER || top < BORDER || left + width > columns - BORDER || top + height > rows - BORDER
}

/// Returns the part of a box that is in the image; `None` if none is.
pub(super) fn within_image(
    view: &PosedView,
    [left, top, width, height]: [f64; 4],
) -> Option<[f64; 4]> {
    let [columns, rows] = view.camera.size().map(|side| side as f64);
    let (right, bottom) = ((left + width).min(columns), (top + height).min(rows));
    let (left, top) = (left.max(0.0), top.max(0.0));
    (right > left && bottom > top).then_some([left, top, right - left, bottom - top])
}

/// Returns the middle of a box, pixels.
pub(super) fn middle([left, top, width, height]: [f64; 4]) -> DVec2 {
    dvec2(left + 0.5 * width, top + 0.5 * height)
}
