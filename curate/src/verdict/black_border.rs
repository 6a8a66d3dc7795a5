//! Black borders: pillarboxes, half spheres and fisheye circles.

use super::{VerdictTest, median_over};
use crate::video::Rgb8Picture;

/// 8-bit level up to which a pixel counts as black: limited-range black with compression noise.
const BLACK_LEVEL: u8 = 24;

/// Black columns at the sides.
pub(super) const SIDES: VerdictTest = VerdictTest {
    id: "black-sides",
    summary: "Share of the width that is black columns at the left and right edge. A whole sphere \
              has none, unless the scene is dark.",
    limit: 0.01,
    at_most: "no black columns at the sides",
    above: "black columns at the sides: a pillarbox or half a sphere",
    measure: |_, samples| median_over(samples, black_sides),
};

/// Black corners.
pub(super) const CORNERS: VerdictTest = VerdictTest {
    id: "black-corners",
    summary: "Share of black pixels in the four corner boxes of a tenth of the width and height; \
              fisheye circles leave them black.",
    limit: 0.5,
    at_most: "the corners show a picture",
    above: "the corners are black, as around fisheye circles",
    measure: |_, samples| median_over(samples, black_corners),
};

fn is_black(pixel: [u8; 3]) -> bool {
    pixel.iter().all(|&level| level <= BLACK_LEVEL)
}

/// `None` for a frame that is black as a whole.
fn black_sides(picture: &Rgb8Picture) -> Option<f64> {
    let is_black_column = |x: usize| {
        let black = (0..picture.height)
            .filter(|&y| is_black(picture.pixel(x, y)))
            .count();
        // Not all of it: subtitles and noise reach into borders.
        black as f64 >= 0.98 * picture.height as f64
    };
    let left = (0..picture.width)
        .take_while(|&x| is_black_column(x))
        .count();
    if left == picture.width {
        return None;
    }
    let right = (0..picture.width)
        .rev()
        .take_while(|&x| is_black_column(x))
        .count();
    Some((left + right) as f64 / picture.width as f64)
}

fn black_corners(picture: &Rgb8Picture) -> Option<f64> {
    let (box_width, box_height) = (picture.width / 10, picture.height / 10);
    let mut black = 0_usize;
    let mut all = 0_usize;
    for y in (0..box_height).chain(picture.height - box_height..picture.height) {
        for x in (0..box_width).chain(picture.width - box_width..picture.width) {
            black += usize::from(is_black(picture.pixel(x, y)));
            all += 1;
        }
    }
    (all > 0).then(|| black as f64 / all as f64)
}
