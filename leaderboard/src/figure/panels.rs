//! The pixels of a figure: rows of panels, each with its enlarged part and its error below.

use omnilife_schemas::rgb::RgbImage;

/// White between panels, pixels.
pub(super) const GAP: usize = 6;

/// Brightness of error maps, over the difference of the images.
pub(super) const ERROR_GAIN: f32 = 4.0;

/// Candidates for the enlarged part, along the width.
const TILES: usize = 8;

/// Default width of the enlarged part, as share of the image's.
const TILE_WIDTH: f64 = 0.16;

/// Colour of the frame around the enlarged part.
const FRAME: [u8; 3] = [255, 214, 0];

/// One scene's view: the ground truth and the methods' renderings, of one size.
pub(super) struct Views {
    truth: RgbImage,
    rendered: Vec<RgbImage>,
}

impl Views {
    /// Splits comparison images of scoring: rendering, a line `separator` pixels wide, truth.
    pub(super) fn of(pairs: &[(RgbImage, [u32; 2])], separator: usize) -> Self {
        let half = |pair: &RgbImage, left: usize, [width, height]: [u32; 2]| {
            crop(pair, [left, 0], [width as usize, height as usize])
        };
        let (first, size) = &pairs[0];
        Self {
            truth: half(first, size[0] as usize + separator, *size),
            rendered: (pairs.iter())
                .map(|(pair, size)| half(pair, 0, *size))
                .collect(),
        }
    }

    /// Returns the tile in which the methods' errors differ most; for one method, that of its largest error.
    fn most_telling(&self) -> Region {
        let mut best = (f64::NEG_INFINITY, Region::from([0.0, 0.0, TILE_WIDTH]));
        for row in 0..TILES / 2 {
            for column in 0..TILES {
                let left = column as f64 / TILES as f64 * (1.0 - TILE_WIDTH);
                let top = row as f64 / (TILES / 2) as f64 * (0.5 - TILE_WIDTH / 2.0);
                let region = Region::from([left, top, TILE_WIDTH]);
                let truth = region.cut(&self.truth);
                let errors = self
                    .rendered
                    .iter()
                    .map(|view| error(&truth, &region.cut(view)));
                let (low, high) = errors.fold((f64::INFINITY, 0.0_f64), |(low, high), error| {
                    (low.min(error), high.max(error))
                });
                let spread = if self.rendered.len() > 1 {
                    high - low
                } else {
                    high
                };
                if spread > best.0 {
                    best = (spread, region);
                }
            }
        }
        best.1
    }
}

/// Left and upper edge and width as shares of an image's width; half as high as wide.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Region([f64; 3]);

impl From<[f64; 3]> for Region {
    fn from(shares: [f64; 3]) -> Self {
        Self(shares)
    }
}

impl Region {
    /// Its pixels in an image of this size: corner and extent, inside.
    fn pixels(self, width: usize, height: usize) -> ([usize; 2], [usize; 2]) {
        let wide = width as f64;
        let [left, top, across] = self.0.map(|share| (share * wide).round() as usize);
        let extent = [across.clamp(2, width), (across / 2).clamp(1, height)];
        let corner = [left.min(width - extent[0]), top.min(height - extent[1])];
        (corner, extent)
    }

    fn cut(self, image: &RgbImage) -> RgbImage {
        let (corner, extent) = self.pixels(image.width, image.height);
        crop(image, corner, extent)
    }
}

/// The figure's pixels.
pub(super) struct Canvas {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Interleaved, 8 bits.
    pub(super) rgb: Vec<u8>,
    /// Left edges of the columns.
    pub(super) lefts: Vec<usize>,
    /// Upper edges of the rows, and the height of their panels.
    pub(super) tops: Vec<(usize, usize)>,
    pub(super) panel_width: usize,
}

impl Canvas {
    pub(super) fn of(
        rows: &[(String, u32, Views)],
        inset: Option<Region>,
        panel_width: usize,
    ) -> Self {
        let columns = 1 + rows[0].2.rendered.len();
        let lefts: Vec<usize> = (0..columns).map(|at| at * (panel_width + GAP)).collect();
        let half = panel_width / 2;
        let mut height = 0;
        let mut tops = Vec::new();
        for (_, _, views) in rows {
            let panel_height = panel_width * views.truth.height / views.truth.width;
            tops.push((height, panel_height));
            height += panel_height + half / 2 + 2 * GAP;
        }
        let width = columns * (panel_width + GAP) - GAP;
        let mut canvas = Self {
            width,
            height: height - GAP,
            rgb: vec![255; width * (height - GAP) * 3],
            lefts,
            tops,
            panel_width,
        };
        for (row, (_, _, views)) in rows.iter().enumerate() {
            canvas.row(row, views, inset.unwrap_or_else(|| views.most_telling()));
        }
        canvas
    }

    fn row(&mut self, row: usize, views: &Views, region: Region) {
        let (top, panel_height) = self.tops[row];
        let half = self.panel_width / 2;
        let below = top + panel_height + GAP;
        let all = [&views.truth].into_iter().chain(&views.rendered);
        for (column, view) in all.enumerate() {
            let left = self.lefts[column];
            let mut panel = view.resized_by_area(self.panel_width, panel_height);
            frame(&mut panel, region);
            paste(&mut self.rgb, self.width, &panel, [left, top]);
            let enlarged = enlarged(&region.cut(view), half - GAP / 2, half / 2);
            paste(&mut self.rgb, self.width, &enlarged, [left, below]);
            if column > 0 {
                let map = difference(&views.truth, view).resized_by_area(half - GAP / 2, half / 2);
                paste(
                    &mut self.rgb,
                    self.width,
                    &map,
                    [left + half + GAP / 2, below],
                );
            }
        }
    }
}

/// Copies an image into the pixels of a figure `width` wide.
pub(super) fn paste(rgb: &mut [u8], width: usize, image: &RgbImage, [left, top]: [usize; 2]) {
    let bytes = image.to_rgb8();
    for (row, line) in bytes.chunks_exact(image.width * 3).enumerate() {
        let begin = ((top + row) * width + left) * 3;
        rgb[begin..begin + line.len()].copy_from_slice(line);
    }
}

fn crop(image: &RgbImage, [left, top]: [usize; 2], [width, height]: [usize; 2]) -> RgbImage {
    let mut data = Vec::with_capacity(width * height * 3);
    for row in top..top + height {
        let begin = (row * image.width + left) * 3;
        data.extend_from_slice(&image.data[begin..begin + width * 3]);
    }
    RgbImage::new(width, height, data)
}

/// Enlarges an image by nearest pixels: an enlarged part shows its pixels and no more.
fn enlarged(image: &RgbImage, width: usize, height: usize) -> RgbImage {
    let mut data = Vec::with_capacity(width * height * 3);
    for row in 0..height {
        for column in 0..width {
            let at = row * image.height / height * image.width + column * image.width / width;
            data.extend_from_slice(&image.data[at * 3..at * 3 + 3]);
        }
    }
    RgbImage::new(width, height, data)
}

fn difference(truth: &RgbImage, view: &RgbImage) -> RgbImage {
    let values = truth.data.iter().zip(&view.data);
    RgbImage {
        width: truth.width,
        height: truth.height,
        data: values
            .map(|(truth, view)| ((truth - view).abs() * ERROR_GAIN).min(1.0))
            .collect(),
    }
}

/// Returns the mean absolute difference.
fn error(truth: &RgbImage, view: &RgbImage) -> f64 {
    let values = truth.data.iter().zip(&view.data);
    let sum: f64 = values
        .map(|(truth, view)| f64::from((truth - view).abs()))
        .sum();
    sum / truth.data.len() as f64
}

/// Draws a line of two pixels around a region.
fn frame(panel: &mut RgbImage, region: Region) {
    const LINE: usize = 2;
    let ([left, top], [width, height]) = region.pixels(panel.width, panel.height);
    for row in top..top + height {
        for column in left..left + width {
            let inner_row = row >= top + LINE && row + LINE < top + height;
            let inner_column = column >= left + LINE && column + LINE < left + width;
            if !(inner_row && inner_column) {
                let at = (row * panel.width + column) * 3;
                for (value, colour) in panel.data[at..at + 3].iter_mut().zip(FRAME) {
                    *value = f32::from(colour) / 255.0;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns two methods on a grey image: only the second has a bright spot.
    fn views() -> Views {
        let (width, height) = (64, 32);
        let pair = |spot: bool| {
            let mut pair = RgbImage::black(2 * width + 4, height);
            pair.data.fill(0.5);
            if spot {
                for row in 20..24 {
                    for column in 40..48 {
                        pair.data[(row * pair.width + column) * 3] = 1.0;
                    }
                }
            }
            (pair, [width as u32, height as u32])
        };
        Views::of(&[pair(false), pair(true)], 4)
    }

    #[test]
    fn what_is_enlarged_is_where_methods_differ() {
        let ([left, top], [width, height]) = views().most_telling().pixels(64, 32);
        let overlaps = left < 48 && left + width > 40 && top < 24 && top + height > 20;
        assert!(overlaps, "{left} {top} {width} {height}");
    }

    #[test]
    fn panels_enlarged_parts_and_errors_have_their_places() {
        let rows = [("scene".to_owned(), 4, views())];
        let canvas = Canvas::of(&rows, Some(Region::from([0.0, 0.0, 0.25])), 64);
        assert_eq!(canvas.lefts, [0, 70, 140]);
        assert_eq!(
            (canvas.width, canvas.height),
            (204, 32 + 16 + 2 * GAP - GAP)
        );
        let pixel = |column: usize, row: usize| {
            let at = (row * canvas.width + column) * 3;
            [canvas.rgb[at], canvas.rgb[at + 1], canvas.rgb[at + 2]]
        };
        assert_eq!(
            pixel(140 + 44, 22),
            [255, 128, 128],
            "the spot of the second method"
        );
        assert_eq!(pixel(44, 22), [128; 3], "the truth");
        assert_eq!(pixel(0, 0), FRAME);
        // The error of the spot: four times the difference, at half the panel's size.
        let (right, below) = (140 + 32 + GAP / 2, 32 + GAP);
        assert_eq!(pixel(right + 19, below + 11)[0], 255);
        assert_eq!(pixel(right + 2, below + 2), [0; 3]);
        assert_eq!(pixel(66, 5), [255; 3], "between panels");
    }
}
