//! Black borders: letterboxes, pillarboxes and half spheres.

use super::{ProjectionTest, median_over};
use crate::video::Rgb8Image;
use omnilife_schemas::statistics;

/// 8-bit level up to which a pixel counts as black: limited-range black with compression noise.
const BLACK_LEVEL: u8 = 24;
/// Share of a line that has to be black. Not all of it: subtitles and noise reach into borders.
const BLACK_SHARE: f64 = 0.98;
const LIMIT: f64 = 0.01;

/// Black columns at the sides.
pub(super) const SIDES: ProjectionTest = ProjectionTest {
    id: "black-sides",
    summary: "Share of the width that is black columns at the left and right edge. A whole sphere \
              has none, unless the scene is dark.",
    limit: LIMIT,
    at_most: "no black columns at the sides",
    above: "black columns at the sides: a pillarbox or half a sphere",
    measure: |_, samples| {
        median_over(samples, |image| {
            let border = border(image)?;
            Some((border.left + border.right) as f64 / image.width as f64)
        })
    },
};

/// Black rows above and below.
pub(super) const ROWS: ProjectionTest = ProjectionTest {
    id: "black-rows",
    summary: "Share of the height that is black rows at the top, and as much at the bottom. A \
              black cap at one pole alone is a patch over a tripod and no border.",
    limit: LIMIT,
    at_most: "no black rows above and below",
    above: "black rows above and below: a letterbox",
    measure: |_, samples| {
        median_over(samples, |image| {
            let border = border(image)?;
            Some(border.top.min(border.bottom) as f64 / image.height as f64)
        })
    },
};

pub(crate) fn is_black(pixel: [u8; 3]) -> bool {
    pixel.iter().all(|&level| level <= BLACK_LEVEL)
}

/// Black lines at the four edges.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Border {
    left: usize,
    right: usize,
    top: usize,
    bottom: usize,
}

/// `None` for a frame that is black as a whole.
fn border(image: &Rgb8Image) -> Option<Border> {
    let (width, height) = (image.width, image.height);
    let is_black_column = |x: &usize| {
        let black = (0..height)
            .filter(|&y| is_black(image.pixel(*x, y)))
            .count();
        black as f64 >= BLACK_SHARE * height as f64
    };
    let is_black_row = |y: &usize| {
        let black = (0..width).filter(|&x| is_black(image.pixel(x, *y))).count();
        black as f64 >= BLACK_SHARE * width as f64
    };
    let left = (0..width).take_while(is_black_column).count();
    let top = (0..height).take_while(is_black_row).count();
    (left < width && top < height).then(|| Border {
        left,
        right: (0..width).rev().take_while(is_black_column).count(),
        top,
        bottom: (0..height).rev().take_while(is_black_row).count(),
    })
}

/// The images without the border that most of them have; `None` where there is none.
///
/// Black above or below alone stays: it may be a patch over a pole.
pub(super) fn without_border(samples: &[Rgb8Image]) -> Option<Vec<Rgb8Image>> {
    let first = samples.first()?;
    let borders: Vec<Border> = samples.iter().filter_map(border).collect();
    let typical = |side: fn(&Border) -> usize| {
        let widths: Vec<f64> = borders.iter().map(|border| side(border) as f64).collect();
        statistics::median(&widths).map_or(0, |width| width as usize)
    };
    let mut cut = Border {
        left: typical(|border| border.left),
        right: typical(|border| border.right),
        top: typical(|border| border.top),
        bottom: typical(|border| border.bottom),
    };
    if cut.top.min(cut.bottom) as f64 <= LIMIT * first.height as f64 {
        (cut.top, cut.bottom) = (0, 0);
    }
    if (cut.left + cut.right) as f64 <= LIMIT * first.width as f64 {
        (cut.left, cut.right) = (0, 0);
    }
    if cut
        == (Border {
            left: 0,
            right: 0,
            top: 0,
            bottom: 0,
        })
    {
        return None;
    }
    let inside = |image: &Rgb8Image| {
        let columns = cut.left..image.width.checked_sub(cut.right)?;
        let rows = cut.top..image.height.checked_sub(cut.bottom)?;
        (columns.len() >= 16 && rows.len() >= 16).then(|| Rgb8Image {
            width: columns.len(),
            height: rows.len(),
            data: rows
                .flat_map(|y| {
                    let row = &image.data[y * image.width * 3..];
                    row[columns.start * 3..columns.end * 3].iter().copied()
                })
                .collect(),
        })
    };
    Some(samples.iter().filter_map(inside).collect())
}
