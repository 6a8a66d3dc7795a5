//! Detection of borders of a single colour around views: images that were cropped, shrunk or fitted into a frame.

use std::fmt;

use super::look::ViewFacts;
use crate::metrics::ViewPair;

/// Least width of a border on opposite sides, and the largest difference of both, pixels.
const LEAST_WIDTH: usize = 2;
const LARGEST_DIFFERENCE: usize = 1;
/// Largest difference of levels within a border of the ground truth, whose files may be JPEG or frames of a video.
const TRUE_LEVELS: u8 = 12;

/// Widths of a border of one colour that the ground truth does not have, pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Border {
    /// Columns on the left and on the right.
    pub across: [usize; 2],
    /// Rows at the top and at the bottom.
    pub down: [usize; 2],
}

impl Border {
    /// Measures the border of a prediction. Pixels that do not count are those of the ground truth.
    pub(super) fn of(pair: &ViewPair) -> Self {
        let of =
            |bytes: &[u8], levels: u8| [0, 1].map(|axis| sides(bytes, pair.size(), axis, levels));
        let [predicted, truth] = [of(pair.prediction(), 0), of(pair.truth(), TRUE_LEVELS)];
        let beyond =
            |axis: usize| [0, 1].map(|end| predicted[axis][end].saturating_sub(truth[axis][end]));
        Self {
            across: beyond(0),
            down: beyond(1),
        }
    }

    /// Returns true for a border on opposite sides: a frame. The poles of a panorama may be of one colour, each of its
    /// own width.
    fn is_frame(self) -> bool {
        [self.across, self.down].into_iter().any(|[near, far]| {
            near.min(far) >= LEAST_WIDTH && near.abs_diff(far) <= LARGEST_DIFFERENCE
        })
    }
}

impl fmt::Display for Border {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [[left, right], [top, bottom]] = [self.across, self.down];
        write!(
            f,
            "{left} pixels on the left, {right} on the right, {top} at the top, {bottom} at the bottom"
        )
    }
}

/// Returns the common border of all views; `None` unless it is on opposite sides.
pub(super) fn common(views: &[ViewFacts]) -> Option<Border> {
    let (first, others) = views.split_first()?;
    let is_common = others.iter().all(|view| view.border == first.border);
    (first.border.is_frame() && is_common).then_some(first.border)
}

/// Returns the numbers of lines of the colour of the first pixel, up to a difference of levels, at both ends of an axis
/// (0: columns, 1: rows). An image whose half is of one colour shows no border.
fn sides(bytes: &[u8], [width, height]: [usize; 2], axis: usize, levels: u8) -> [usize; 2] {
    let pixels = bytes.as_chunks::<3>().0;
    let (lines, length, step, stride) = match axis {
        0 => (width, height, width, 1),
        _ => (height, width, 1, width),
    };
    let is_plain = |line: usize| {
        let mut places = (0..length).map(|place| line * stride + place * step);
        places.all(|place| {
            let mut channels = pixels[place].iter().zip(&pixels[0]);
            channels.all(|(one, first)| one.abs_diff(*first) <= levels)
        })
    };
    let half = lines / 2;
    let near = (0..half).take_while(|&line| is_plain(line)).count();
    let far = (0..half).take_while(|&line| is_plain(lines - 1 - line));
    let found = [near, far.count()];
    if found.contains(&half) { [0; 2] } else { found }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::{View, ViewKind};

    const SIZE: [usize; 2] = [64, 32];

    /// Returns an image of many colours, black in columns and rows beyond these.
    fn framed(columns: [usize; 2], rows: [usize; 2]) -> Vec<u8> {
        let is_inside =
            |at: usize, length: usize, [near, far]: [usize; 2]| (near..length - far).contains(&at);
        let pixel = |place: usize| {
            let (column, row) = (place % SIZE[0], place / SIZE[0]);
            match is_inside(column, SIZE[0], columns) && is_inside(row, SIZE[1], rows) {
                true => [1 + column as u8, 1 + row as u8, 1 + (7 * place % 200) as u8],
                false => [0; 3],
            }
        };
        (0..SIZE[0] * SIZE[1]).flat_map(pixel).collect()
    }

    /// Returns the common border of views as predicted, whose ground truth has none.
    fn found(predicted: &[Vec<u8>]) -> Option<Border> {
        let truth = framed([0; 2], [0; 2]);
        let facts = |(frame, bytes): (usize, &Vec<u8>)| {
            let view = View {
                kind: ViewKind::Novel,
                frame: frame as u32,
            };
            let pair = ViewPair::new(SIZE[0], SIZE[1], bytes.clone(), truth.clone())?;
            Some(ViewFacts::of(view, &pair, true))
        };
        let views: Vec<ViewFacts> = predicted.iter().enumerate().filter_map(facts).collect();
        assert_eq!(views.len(), predicted.len());
        common(&views)
    }

    #[test]
    fn borders_on_opposite_sides_are_found() {
        for (across, down) in [([8, 8], [4, 4]), ([5, 6], [0, 0]), ([0, 0], [9, 9])] {
            let views = [framed(across, down), framed(across, down)];
            assert_eq!(found(&views), Some(Border { across, down }));
        }
        // Black poles, a seam of a pixel, and nothing.
        for (across, down) in [([0, 0], [3, 12]), ([1, 1], [0, 0]), ([0, 0], [0, 0])] {
            let views = [framed(across, down), framed(across, down)];
            assert_eq!(found(&views), None);
        }
        // Of one view alone, and views of one colour.
        let of_one = [framed([8, 8], [4, 4]), framed([0, 0], [0, 0])];
        assert_eq!(found(&of_one), None);
        let black = vec![0; 3 * SIZE[0] * SIZE[1]];
        assert_eq!(found(&[black.clone(), black]), None);
    }

    #[test]
    fn a_border_of_the_ground_truth_does_not_count() {
        let bytes = || framed([8, 8], [4, 4]);
        let pair = ViewPair::new(SIZE[0], SIZE[1], bytes(), bytes());
        let none = Border {
            across: [0; 2],
            down: [0; 2],
        };
        assert_eq!(pair.map(|pair| Border::of(&pair)), Some(none));
    }
}
