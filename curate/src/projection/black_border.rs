//! Black borders: letterboxes, pillarboxes and half spheres.

use omnilife_schemas::{records::Probe, statistics};
use omnilife_video::Rgb8Image;

use super::{ProjectionTest, median_over};

/// 8-bit level up to which a pixel counts as black: limited-range black with compression noise.
const BLACK_LEVEL: u8 = 24;
/// Least black share of a line. Not all of it: subtitles and noise reach into borders.
const BLACK_SHARE: f64 = 0.98;
const LIMIT: f64 = 0.01;
/// Least drop of the black share of lines at the end of a border.
const LEAST_STEP: f64 = 0.5;

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
              black cap at one pole alone is a patch over a tripod and no border, unless frames are \
              2:1 without it alone.",
    limit: LIMIT,
    at_most: "no black rows above and below",
    above: "black rows above and below: a letterbox",
    measure: |probe, samples| {
        median_over(samples, |image| {
            let border = border(image)?;
            let share = |rows: usize| rows as f64 / image.height as f64;
            let both = share(border.top.min(border.bottom));
            let one = share(border.top.max(border.bottom));
            // Bars on one side alone, if the rest is 2:1 and the whole is not.
            Some(if is_two_to_one_without(probe, one) {
                one
            } else {
                both
            })
        })
    },
};

/// Returns true if frames are not 2:1 with black rows of this share of the height, and are without, to a row in a hundred.
fn is_two_to_one_without(probe: &Probe, share: f64) -> bool {
    let (width, height) = probe.upright_size();
    let ratio = |height: f64| f64::from(width) / (2.0 * height) - 1.0;
    let [whole, rest] = [1.0, 1.0 - share].map(|part| ratio(f64::from(height) * part).abs());
    whole > LIMIT && rest <= LIMIT
}

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

impl Border {
    const NONE: Self = Self {
        left: 0,
        right: 0,
        top: 0,
        bottom: 0,
    };

    /// Keeps the sides and rows that are wide enough to count; `None` without any.
    ///
    /// Black above or below alone stays: it may be a patch over a pole.
    fn of_some_width(mut self, image: &Rgb8Image) -> Option<Self> {
        if self.top.min(self.bottom) as f64 <= LIMIT * image.height as f64 {
            (self.top, self.bottom) = (0, 0);
        }
        if (self.left + self.right) as f64 <= LIMIT * image.width as f64 {
            (self.left, self.right) = (0, 0);
        }
        (self != Self::NONE).then_some(self)
    }

    /// Keeps the sides and rows that end at a sharp edge.
    fn with_sharp_edges(mut self, image: &Rgb8Image) -> Self {
        let column = |x| black_share_of_column(image, x);
        let row = |y| black_share_of_row(image, y);
        // From the last line of the border to the first one inside it.
        let is_sharp =
            |width: usize, outside: f64, inside: f64| width == 0 || outside - inside >= LEAST_STEP;
        let (right, bottom) = (image.width - self.right, image.height - self.bottom);
        let beside = is_sharp(
            self.left,
            column(self.left.saturating_sub(1)),
            column(self.left),
        ) && is_sharp(
            self.right,
            column(right.min(image.width - 1)),
            column(right - 1),
        );
        if !beside {
            (self.left, self.right) = (0, 0);
        }
        let above = is_sharp(self.top, row(self.top.saturating_sub(1)), row(self.top))
            && is_sharp(
                self.bottom,
                row(bottom.min(image.height - 1)),
                row(bottom - 1),
            );
        if !above {
            (self.top, self.bottom) = (0, 0);
        }
        self
    }

    /// Returns the image inside of it; `None` if hardly anything is left.
    fn inside(&self, image: &Rgb8Image) -> Option<Rgb8Image> {
        let columns = self.left..image.width.checked_sub(self.right)?;
        let rows = self.top..image.height.checked_sub(self.bottom)?;
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
    }
}

fn black_share_of_column(image: &Rgb8Image, x: usize) -> f64 {
    let black = (0..image.height).filter(|&y| is_black(image.pixel(x, y)));
    black.count() as f64 / image.height as f64
}

fn black_share_of_row(image: &Rgb8Image, y: usize) -> f64 {
    let black = (0..image.width).filter(|&x| is_black(image.pixel(x, y)));
    black.count() as f64 / image.width as f64
}

/// Returns `None` for an entirely black frame.
fn border(image: &Rgb8Image) -> Option<Border> {
    let (width, height) = (image.width, image.height);
    let is_black_column = |x: &usize| black_share_of_column(image, *x) >= BLACK_SHARE;
    let is_black_row = |y: &usize| black_share_of_row(image, *y) >= BLACK_SHARE;
    let left = (0..width).take_while(is_black_column).count();
    let top = (0..height).take_while(is_black_row).count();
    (left < width && top < height).then(|| Border {
        left,
        right: (0..width).rev().take_while(is_black_column).count(),
        top,
        bottom: (0..height).rev().take_while(is_black_row).count(),
    })
}

/// Returns the images without the border that most of them have; `None` without such a border.
pub(super) fn without_border(samples: &[Rgb8Image]) -> Option<Vec<Rgb8Image>> {
    let first = samples.first()?;
    let borders: Vec<Border> = samples.iter().filter_map(border).collect();
    let typical = |side: fn(&Border) -> usize| {
        let widths: Vec<f64> = borders.iter().map(|border| side(border) as f64).collect();
        statistics::median(&widths).map_or(0, |width| width as usize)
    };
    let cut = Border {
        left: typical(|border| border.left),
        right: typical(|border| border.right),
        top: typical(|border| border.top),
        bottom: typical(|border| border.bottom),
    }
    .of_some_width(first)?;
    Some(
        samples
            .iter()
            .filter_map(|image| cut.inside(image))
            .collect(),
    )
}

/// Returns one image without its border; `None` unless that ends at sharp edges. Dark edges of a scene fade into the
/// rest of it.
pub(super) fn without_sharp_border(image: &Rgb8Image) -> Option<Rgb8Image> {
    border(image)?
        .of_some_width(image)?
        .with_sharp_edges(image)
        .of_some_width(image)?
        .inside(image)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Columns of these levels.
    fn of_columns(levels: &[u8]) -> Rgb8Image {
        let (width, height) = (levels.len(), 32);
        let row = levels.iter().flat_map(|&level| [level; 3]);
        Rgb8Image::new(
            width,
            height,
            (0..height).flat_map(|_| row.clone()).collect(),
        )
    }

    #[test]
    fn a_bar_is_cut_off_and_the_dark_side_of_a_scene_is_not() {
        let bars: Vec<u8> = (0..64)
            .map(|x| if (8..56).contains(&x) { 90 } else { 3 })
            .collect();
        let inside = without_sharp_border(&of_columns(&bars)).expect("bars");
        assert_eq!((inside.width, inside.height), (48, 32));

        // Lines become bright over some columns.
        let mut night = of_columns(&[10; 64]);
        for y in 0..32 {
            for x in 12..52_usize {
                let from_edge = x.min(63 - x) - 11;
                if y < from_edge {
                    night.data[3 * (y * 64 + x)..][..3].fill(90);
                }
            }
        }
        assert!(border(&night).is_some_and(|border| border.left > 10));
        assert_eq!(without_sharp_border(&night), None);
    }

    /// Frames of 512x288 with 32 black rows below are a sphere of 512x256 and padding; those of 512x256 have a patch.
    #[test]
    fn rows_on_one_side_are_padding_where_the_rest_is_two_to_one() {
        let image = |height: usize, black: usize| {
            let rows = (0..height).map(|y| if y < height - black { 90 } else { 0 });
            let data = rows.flat_map(|level| [level; 3 * 64]).collect();
            Rgb8Image::new(64, height, data)
        };
        let share =
            |size: [u32; 2], image: Rgb8Image| (ROWS.measure)(&Probe::of_size(size), &[image]);
        let padded = share([512, 288], image(36, 4));
        assert!(
            padded.is_some_and(|share| (share - 1.0 / 9.0).abs() < 1e-9),
            "{padded:?}"
        );
        assert_eq!(share([512, 256], image(32, 4)), Some(0.0));
        // Another shape altogether.
        assert_eq!(share([512, 400], image(50, 4)), Some(0.0));
    }
}
