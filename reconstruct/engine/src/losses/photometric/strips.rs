//! Strips of an image's rows, with what the window reaches beside them.

use std::ops::Range;

use super::{
    Columns,
    rows::{CHANNELS, LANES, MARGIN, RADIUS},
};

/// Pixels across a strip. Whole vectors, whatever is left of the image: strips begin where the rows
/// of the maps have vectors.
const STRIP: usize = 256;

const _: () = assert!(STRIP.is_multiple_of(LANES));

/// Rows of one size, as long as whole vectors.
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
    /// Values per row.
    pub(super) fn values(&self) -> usize {
        self.width * CHANNELS
    }

    /// Values per row with padding to whole vectors.
    pub(super) fn stride(&self) -> usize {
        self.values().next_multiple_of(LANES)
    }

    /// The column that is `shifted` columns to the right of the one [`RADIUS`] columns before the first; `None`
    /// where there are zeros.
    fn column(self, shifted: usize) -> Option<usize> {
        match self.columns {
            Columns::Wrap => Some((self.width * RADIUS + shifted - RADIUS) % self.width),
            Columns::End => {
                let column = shifted.checked_sub(RADIUS);
                column.filter(|&column| column < self.width)
            }
        }
    }

    /// The strips of a row, from left to right.
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
    /// The strip's values in a row.
    pub(super) fn values(&self) -> Range<usize> {
        self.first * CHANNELS..(self.first + self.width) * CHANNELS
    }

    /// Values per row with padding to whole vectors.
    fn stride(&self) -> usize {
        self.vectors() * LANES
    }

    /// Vectors per row.
    pub(super) fn vectors(&self) -> usize {
        self.values().len().div_ceil(LANES)
    }

    /// The strip's vectors in a row of [`RowShape::stride`].
    pub(super) fn padded(&self) -> Range<usize> {
        let begin = self.first * CHANNELS / LANES;
        begin..begin + self.vectors()
    }

    /// Values of a row with its margins, as long as whole vectors.
    fn padded_len(&self) -> usize {
        (self.stride() + 2 * MARGIN).next_multiple_of(LANES)
    }

    /// Copies the strip of a row with [`RADIUS`] pixels on either side ([`Columns`] says what is beyond the
    /// image's edges), and something beyond.
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
