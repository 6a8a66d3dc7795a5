//! Boxes in images, and the borders that cut them.

use glam::{DVec2, dvec2};
use omnilife_schemas::posed_view::PosedView;

/// Largest distance to the border of a box that ends there, as a share of the image's width.
const BORDER: f64 = 0.01;

/// Returns true if the border of the image cuts a box off.
pub(super) fn is_cut(view: &PosedView, of_object: [f64; 4]) -> bool {
    cut_ends(view, of_object).as_flattened().contains(&true)
}

/// Returns, for columns and for rows, the ends at which the border of the image cuts a box off: the lower and the higher.
fn cut_ends(view: &PosedView, [left, top, width, height]: [f64; 4]) -> [[bool; 2]; 2] {
    let [columns, rows] = view.camera.size().map(|side| side as f64);
    let border = BORDER * columns;
    [(left, width, columns), (top, height, rows)]
        .map(|(begin, side, all)| [begin < border, begin + side > all - border])
}

/// Returns the shift, pixels, from a predicted box to a found one whose sides the border of the image cuts off: that of
/// its ends inside of the image. `shown` is the part of the predicted one in the image. `None` if both ends of a side are
/// cut off.
pub(super) fn shift_of_ends(view: &PosedView, found: [f64; 4], shown: [f64; 4]) -> Option<DVec2> {
    let ends = cut_ends(view, found);
    let along = |axis: usize| {
        let low = found[axis] - shown[axis];
        let high = low + found[axis + 2] - shown[axis + 2];
        match ends[axis] {
            [false, false] => Some(0.5 * (low + high)),
            [true, false] => Some(high),
            [false, true] => Some(low),
            [true, true] => None,
        }
    };
    Some(dvec2(along(0)?, along(1)?))
}

/// Returns the part of a segment in an image; `None` if none is (Liang and Barsky).
fn within_sides([from, to]: [DVec2; 2], size: DVec2) -> Option<[DVec2; 2]> {
    let step = to - from;
    let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
    for axis in 0..2 {
        if step[axis] == 0.0 {
            if !(0.0..=size[axis]).contains(&from[axis]) {
                return None;
            }
            continue;
        }
        let at = [0.0, size[axis]].map(|side| (side - from[axis]) / step[axis]);
        enter = enter.max(at[0].min(at[1]));
        leave = leave.min(at[0].max(at[1]));
    }
    (enter <= leave).then(|| [from + enter * step, from + leave * step])
}

/// Returns the box around the parts of edges that are in an image: left, top, width and height, pixels. `None` if none
/// is.
pub(super) fn shown_box(
    view: &PosedView,
    edges: impl Iterator<Item = [DVec2; 2]>,
) -> Option<[f64; 4]> {
    let [columns, rows] = view.camera.size().map(|side| side as f64);
    let shown = edges.filter_map(|edge| within_sides(edge, dvec2(columns, rows)));
    let (low, high) = shown.flatten().fold(
        (DVec2::INFINITY, DVec2::NEG_INFINITY),
        |(low, high), end| (low.min(end), high.max(end)),
    );
    let size = high - low;
    size.is_finite().then_some([low.x, low.y, size.x, size.y])
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
