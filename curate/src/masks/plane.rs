//! Perspective frames, compared after the shift of the whole image between them.

use std::path::Path;

use omnilife_schemas::{RgbImage, records::Sequence};

use super::{changes::ComparableFrame, field::Field, residual::IMAGE_WIDTH};
use crate::error::CurateError;

/// Largest shift at the smallest size, pixels.
const LARGEST_SHIFT: isize = 4;
/// Smallest width of the copies that shifts are found in, pixels.
const SMALLEST_WIDTH: usize = 48;
/// Detail within so many pixels of its place has not moved.
const SLACK_PIXELS: isize = 1;
/// Differences are averaged over squares that reach so many pixels.
const REACH_PIXELS: usize = 2;
/// A camera stands while its image shifts by no more than so many pixels.
const STANDS_PIXELS: isize = 1;

/// A grey frame and its smaller copies, each half the size of the one before.
#[derive(Debug, Clone)]
pub(super) struct Plane(Vec<Field>);

impl Plane {
    fn new(image: &RgbImage) -> Self {
        let width = IMAGE_WIDTH.min(image.width);
        let height = (image.height * width / image.width).max(1);
        let mut levels = vec![grey(image, width, height)];
        while let Some(last) = levels
            .last()
            .filter(|last| last.width >= 2 * SMALLEST_WIDTH)
        {
            let (width, height) = (last.width / 2, (last.height / 2).max(1));
            let halved = grey(image, width, height);
            levels.push(halved);
        }
        Self(levels)
    }

    /// Returns the columns and rows by which the image has moved until another frame.
    fn shift(&self, that: &Self) -> [isize; 2] {
        let mut shift = [0, 0];
        for (level, (this, that)) in self.0.iter().zip(&that.0).enumerate().rev() {
            let reach = if level + 1 == self.0.len() {
                LARGEST_SHIFT
            } else {
                1
            };
            shift = shift.map(|at| 2 * at);
            let around = |at: isize| at - reach..=at + reach;
            let all = around(shift[0]).flat_map(|x| around(shift[1]).map(move |y| [x, y]));
            let costs = all.map(|shift| (mean_difference(this, that, shift), shift));
            let best = costs.min_by(|a, b| a.0.total_cmp(&b.0));
            shift = best.map_or(shift, |(_, shift)| shift);
        }
        shift
    }
}

impl ComparableFrame for Plane {
    const IS_SPHERE: bool = false;

    fn read(folder: &Path, sequence: &Sequence, index: usize) -> Result<Self, CurateError> {
        let path = folder.join(&sequence.frames.entries[index].file);
        Ok(Self::new(&RgbImage::read(&path)?))
    }

    fn compare(&self, that: &Self) -> opencv::Result<(Field, bool)> {
        let shift = self.shift(that);
        let (this, that) = (&self.0[0], &that.0[0]);
        let slack = || -SLACK_PIXELS..=SLACK_PIXELS;
        let shifts = slack().flat_map(|x| slack().map(move |y| [shift[0] + x, shift[1] + y]));
        let misfits =
            shifts.map(|shift| differences(this, that, shift).box_mean(REACH_PIXELS, false));
        let misfit = misfits.reduce(|a, b| Ok(a?.smaller(&b?)));
        let stands = shift.iter().all(|at| at.abs() <= STANDS_PIXELS);
        Ok((misfit.unwrap_or_else(|| Ok(this.clone()))?, stands))
    }

    fn grey(&self) -> Field {
        self.0[0].clone()
    }
}

fn grey(image: &RgbImage, width: usize, height: usize) -> Field {
    let small = image.resized_by_area(width, height);
    let (pixels, _) = small.data.as_chunks::<3>();
    let luma = pixels
        .iter()
        .map(|[r, g, b]| 0.2126 * r + 0.7152 * g + 0.0722 * b);
    Field {
        width,
        height,
        values: luma.collect(),
    }
}

/// Returns the absolute differences to another image that has moved by a shift; 0 where the other one ends.
fn differences(this: &Field, that: &Field, [x, y]: [isize; 2]) -> Field {
    let value = |pixel: usize| {
        let (column, row) = (pixel % this.width, pixel / this.width);
        let column = column.checked_add_signed(x).filter(|&at| at < that.width);
        let row = row.checked_add_signed(y).filter(|&at| at < that.height);
        match (column, row) {
            (Some(column), Some(row)) => {
                (that.values[row * that.width + column] - this.values[pixel]).abs()
            }
            _ => 0.0,
        }
    };
    Field {
        width: this.width,
        height: this.height,
        values: (0..this.values.len()).map(value).collect(),
    }
}

/// Returns the mean of the differences over the pixels that both images show.
fn mean_difference(this: &Field, that: &Field, shift: [isize; 2]) -> f32 {
    let sum: f32 = differences(this, that, shift).values.iter().sum();
    let shown = |side: usize, shift: isize| side.saturating_sub(shift.unsigned_abs());
    let pixels = shown(this.width, shift[0]) * shown(this.height, shift[1]);
    if pixels == 0 {
        f32::INFINITY
    } else {
        sum / pixels as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A texture that has moved by some columns and rows, with a patch that has moved by some more.
    fn frame([x, y]: [usize; 2], patch: usize) -> RgbImage {
        let (width, height) = (160, 96);
        let mut image = RgbImage::black(width, height);
        for (at, pixel) in image.data.chunks_exact_mut(3).enumerate() {
            let (column, row) = (at % width, at / width);
            let inside = (40 + patch..60 + patch).contains(&column) && (30..50).contains(&row);
            let (column, row) = (column + 40 - x, row + 40 - y);
            let level = (column as f32 / 5.0).sin() + (row as f32 / 7.0).cos();
            pixel.fill(if inside { 1.0 } else { 0.5 + 0.2 * level });
        }
        image
    }

    #[test]
    fn what_moves_with_the_whole_image_is_no_change() {
        let here = Plane::new(&frame([0, 0], 0));
        let there = Plane::new(&frame([6, 4], 0));
        assert_eq!(here.shift(&there), [6, 4]);
        let (misfit, stands) = here.compare(&here).expect("filtered");
        assert!(stands && misfit.values.iter().all(|&value| value < 1e-6));
        let moved = Plane::new(&frame([0, 0], 12));
        let (misfit, stands) = here.compare(&moved).expect("filtered");
        assert!(stands);
        let at = |x: usize, y: usize| misfit.values[y * misfit.width + x];
        assert!(
            at(45, 40) > 0.1 && at(65, 40) > 0.1,
            "{} {}",
            at(45, 40),
            at(65, 40)
        );
        assert!(at(120, 80) < 1e-6);
    }
}
