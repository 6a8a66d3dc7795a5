//! Strips of an image's rows, with the window's margins.

use std::ops::Range;

use super::{
    Columns,
    rows::{CHANNELS, LANES, MARGIN, RADIUS},
};

/// Pixels across a strip. It is a multiple of whole vectors, so that strips begin at a vector of the maps'
/// rows for every image width.
const STRIP: usize = 256;

const _: () = assert!(STRIP.is_multiple_of(LANES));

/// Shape of rows, padded to whole vectors.
#[derive(Debug, Clone, Copy)]
pub(super) struct RowShape {
    /// Pixels per row.
    pub(super) width: usize,
    /// Rows of the image.
    pub(super) height: usize,
    /// Neighbours of the first and the last of the columns.
    pub(super) columns: Columns,
}

impl RowShape {
    pub(super) fn values(&self) -> usize {
        self.width * CHANNELS
    }

    /// Returns the values per row with padding to whole vectors.
    pub(super) fn stride(&self) -> usize {
        self.values().next_multiple_of(LANES)
    }

    /// Returns the column `shifted - RADIUS`, wrapped where columns wrap; `None` for a column of zeros.
    fn column(self, shifted: usize) -> Option<usize> {
        match self.columns {
            Columns::Wrap => Some((self.width * RADIUS + shifted - RADIUS) % self.width),
            Columns::End => {
                let column = shifted.checked_sub(RADIUS);
                column.filter(|&column| column < self.width)
            }
        }
    }

    /// Returns the strips of a row, from left to right.
    pub(super) fn strips(self) -> impl Iterator<Item = Strip> {
        (0..self.width).step_by(STRIP).map(move |first| Strip {
            shape: self,
            first,
            width: STRIP.min(self.width - first),
        })
    }
}

/// Neighbouring columns of an image.
#[derive(Debug, Clone, Copy)]
pub(super) struct Strip {
    pub(super) shape: RowShape,
    /// First column.
    pub(super) first: usize,
    /// Columns.
    pub(super) width: usize,
}

impl Strip {
    /// Returns the range of the strip's values in a row.
    pub(super) fn values(&self) -> Range<usize> {
        self.first * CHANNELS..(self.first + self.width) * CHANNELS
    }

    /// Returns the values per row with padding to whole vectors.
    fn stride(&self) -> usize {
        self.vectors() * LANES
    }

    pub(super) fn vectors(&self) -> usize {
        self.values().len().div_ceil(LANES)
    }

    /// Returns the range of the strip's vectors in a row of [`RowShape::stride`].
    pub(super) fn padded(&self) -> Range<usize> {
        let begin = self.first * CHANNELS / LANES;
        begin..begin + self.vectors()
    }

    /// Returns the values of a row with its margins, padded to whole vectors.
    fn padded_len(&self) -> usize {
        (self.stride() + 2 * MARGIN).next_multiple_of(LANES)
    }

    /// Copies the strip of a row with [`RADIUS`] pixels on either side, continued past the image's edges as
    /// [`Columns`] defines, and padding.
    pub(super) fn pad(&self, row: &[f32], padded: &mut Vec<f32>) {
        padded.resize(self.padded_len(), 0.0);
        let values = self.values();
        let right_margin = MARGIN + values.len();
        padded[MARGIN..right_margin].copy_from_slice(&row[values]);
        for position in 0..RADIUS {
            let left = self.first + position;
            let right = left + self.width + RADIUS;
            let to = position * CHANNELS;
            for (to, shifted) in [(to, left), (right_margin + to, right)] {
                let values = &mut padded[to..to + CHANNELS];
                match self.shape.column(shifted) {
                    Some(column) => values.copy_from_slice(&row[column * CHANNELS..][..CHANNELS]),
                    None => values.fill(0.0),
                }
            }
        }
    }
}
