//! Products with a repeatedly used right factor, such as the weights of a layer. It is laid out for the product once,
//! and the left factor is read in place, so that nothing is copied before a product. For layers of 64 to 192 channels
//! copying takes longer than multiplying.
//!
//! A value of the product is the sum over blocks of 256 rows of the right factor, in order, of sums whose terms are
//! added in order. Each term is multiplied and added with one rounding if the CPU has such an instruction. So a value
//! does not depend on the other values computed with it.

use fearless_simd::{Level, Simd, dispatch, f32x16, prelude::*};

/// Columns of a panel.
const LANES: usize = 16;
/// Rows of the right factor whose products are summed before they are added to earlier ones.
const BLOCK: usize = 256;

/// A right factor.
#[derive(Debug, Clone)]
pub struct PackedMatrix {
    rows: usize,
    columns: usize,
    /// By 16 columns, then by row; zeros beyond the last column.
    panels: Vec<[f32; LANES]>,
}

/// A left factor in place: every row consists of `segments` pieces of `segment_len` values.
#[derive(Debug, Clone, Copy)]
pub struct LeftFactor<'a> {
    /// The values, from the first of the first row on.
    pub values: &'a [f32],
    /// Values from the start of a row to that of the next.
    pub row_spacing: usize,
    /// Pieces of a row.
    pub segments: usize,
    /// Values of a piece.
    pub segment_len: usize,
    /// Values from the start of a piece to that of the next.
    pub segment_spacing: usize,
}

impl<'a> LeftFactor<'a> {
    /// Describes a row-major matrix.
    pub fn row_major(values: &'a [f32], columns: usize) -> Self {
        Self {
            values,
            row_spacing: columns,
            segments: 1,
            segment_len: columns,
            segment_spacing: columns,
        }
    }
}

impl PackedMatrix {
    /// Packs a row-major matrix of so many columns.
    ///
    /// # Panics
    /// When the values do not fill whole rows.
    pub fn new(values: &[f32], columns: usize) -> Self {
        assert!(values.len().is_multiple_of(columns), "whole rows");
        let rows = values.len() / columns;
        let panels = (0..columns.div_ceil(LANES))
            .flat_map(|panel| (0..rows).map(move |row| (panel * LANES, row)))
            .map(|(first, row)| {
                std::array::from_fn(|lane| {
                    let column = first + lane;
                    if column < columns {
                        values[row * columns + column]
                    } else {
                        0.0
                    }
                })
            })
            .collect();
        Self {
            rows,
            columns,
            panels,
        }
    }

    /// Computes `product = left * self`, row-major, with as many rows as `product` has.
    ///
    /// # Panics
    /// When the rows of the left factor are not as long as this one has rows or exceed its values, or `product` has no
    /// whole rows.
    pub fn multiply_into(&self, left: &LeftFactor<'_>, product: &mut [f32]) {
        assert_eq!(
            left.segments * left.segment_len,
            self.rows,
            "inner sizes of a product"
        );
        assert!(product.len().is_multiple_of(self.columns), "whole rows");
        dispatch!(Level::new(), simd => self.multiply_with(simd, left, product));
    }

    #[inline(always)]
    fn multiply_with<S: Simd>(&self, simd: S, left: &LeftFactor<'_>, product: &mut [f32]) {
        let has_wide_registers = simd.level().as_avx512().is_some();
        for first in (0..self.rows).step_by(BLOCK) {
            let block = first..self.rows.min(first + BLOCK);
            let mut column = 0;
            while column < self.columns {
                let panel = |index: usize| {
                    let panel = &self.panels[(column / LANES + index) * self.rows..][..self.rows];
                    &panel[block.clone()]
                };
                let sums = Sums {
                    left,
                    first,
                    column,
                    columns: self.columns,
                };
                // Sums stay in registers: 24 of 32, or 12 of 16, of which two hold a panel's row.
                if has_wide_registers && column + LANES < self.columns {
                    sums.of_rows::<S, 12, 2>(simd, [panel(0), panel(1)], product);
                    column += 2 * LANES;
                } else {
                    sums.of_rows::<S, 6, 1>(simd, [panel(0)], product);
                    column += LANES;
                }
            }
        }
    }
}

/// A block of the right factor's rows in some panels, with its part of the product.
#[derive(Clone, Copy)]
struct Sums<'a> {
    left: &'a LeftFactor<'a>,
    /// First row of the block.
    first: usize,
    /// First column of the panels.
    column: usize,
    columns: usize,
}

impl Sums<'_> {
    /// Computes all rows, `ROWS` at a time, then one at a time.
    #[inline(always)]
    fn of_rows<S: Simd, const ROWS: usize, const PANELS: usize>(
        self,
        simd: S,
        panels: [&[[f32; LANES]]; PANELS],
        product: &mut [f32],
    ) {
        let rows = product.len() / self.columns;
        let mut row = 0;
        while row + ROWS <= rows {
            let sums = self.tile::<S, ROWS, PANELS>(simd, panels, row);
            self.store(row, &sums, product);
            row += ROWS;
        }
        while row + 4 <= rows {
            let sums = self.tile::<S, 4, PANELS>(simd, panels, row);
            self.store(row, &sums, product);
            row += 4;
        }
        while row < rows {
            let sums = self.tile::<S, 1, PANELS>(simd, panels, row);
            self.store(row, &sums, product);
            row += 1;
        }
    }

    /// Sums over the block.
    #[expect(
        clippy::needless_range_loop,
        reason = "loops over constant ranges are unrolled, so that the sums stay in registers"
    )]
    #[inline(always)]
    fn tile<S: Simd, const ROWS: usize, const PANELS: usize>(
        self,
        simd: S,
        panels: [&[[f32; LANES]]; PANELS],
        row: usize,
    ) -> [[f32x16<S>; PANELS]; ROWS] {
        let mut sums = [[f32x16::splat(simd, 0.0); PANELS]; ROWS];
        let left = self.left;
        let rows = panels[0].len();
        let mut done = 0;
        while done < rows {
            let (segment, within) = (
                (self.first + done) / left.segment_len,
                (self.first + done) % left.segment_len,
            );
            let run = (left.segment_len - within).min(rows - done);
            let begin = row * left.row_spacing + segment * left.segment_spacing + within;
            let mut factors: [&[f32]; ROWS] = [&[]; ROWS];
            for at in 0..ROWS {
                factors[at] = &left.values[begin + at * left.row_spacing..][..run];
            }
            let mut rights: [&[[f32; LANES]]; PANELS] = [&[]; PANELS];
            for panel in 0..PANELS {
                rights[panel] = &panels[panel][done..][..run];
            }
            for step in 0..run {
                let mut right = [f32x16::splat(simd, 0.0); PANELS];
                for panel in 0..PANELS {
                    right[panel] = f32x16::from_slice(simd, &rights[panel][step]);
                }
                for at in 0..ROWS {
                    let factor = f32x16::splat(simd, factors[at][step]);
                    for panel in 0..PANELS {
                        sums[at][panel] = factor.mul_add(right[panel], sums[at][panel]);
                    }
                }
            }
            done += run;
        }
        sums
    }

    /// Adds sums over the block to those over the blocks before it.
    #[inline(always)]
    fn store<S: Simd, const ROWS: usize, const PANELS: usize>(
        self,
        row: usize,
        sums: &[[f32x16<S>; PANELS]; ROWS],
        product: &mut [f32],
    ) {
        for (at, sums) in sums.iter().enumerate() {
            let values = &mut product[(row + at) * self.columns..][..self.columns];
            for (values, sums) in values[self.column..].chunks_mut(LANES).zip(sums) {
                let sums = <[f32; LANES]>::from(*sums);
                if self.first == 0 {
                    values.copy_from_slice(&sums[..values.len()]);
                } else {
                    for (value, sum) in values.iter_mut().zip(sums) {
                        *value += sum;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::matrix;

    fn values(count: usize, factor: usize) -> Vec<f32> {
        (0..count)
            .map(|at| ((at * factor + 11) % 101) as f32 / 50.0 - 1.0)
            .collect()
    }

    /// Sums of one order of terms: not one bit may differ, for any remaining rows and columns.
    #[test]
    fn products_are_those_of_the_library_to_the_bit() {
        for [m, k, n] in [
            [1, 1, 1],
            [7, 5, 3],
            [64, 64, 64],
            [29, 300, 72],
            [33, 513, 40],
            [12, 256, 192],
        ] {
            let (left, right) = (values(m * k, 37), values(k * n, 53));
            let mut expected = vec![0.0; m * n];
            matrix::multiply(&left, &right, &mut expected, [m, k, n]);
            let mut found = vec![f32::NAN; m * n];
            let left = LeftFactor::row_major(&left, k);
            PackedMatrix::new(&right, n).multiply_into(&left, &mut found);
            assert_eq!(found, expected, "{m} {k} {n}");
        }
    }

    #[test]
    fn rows_may_overlap_and_be_in_pieces() {
        // Windows of 3 rows and 2 columns of an image of 7 columns and 2 channels.
        let image = values(7 * 5 * 2, 29);
        let right = values(12 * 24, 53);
        let (mut patches, mut expected) = (Vec::new(), vec![0.0; 6 * 24]);
        for x in 0..6 {
            for y in 1..4 {
                patches.extend_from_slice(&image[(y * 7 + x) * 2..][..4]);
            }
        }
        matrix::multiply(&patches, &right, &mut expected, [6, 12, 24]);
        let left = LeftFactor {
            values: &image[14..],
            row_spacing: 2,
            segments: 3,
            segment_len: 4,
            segment_spacing: 14,
        };
        let mut found = vec![f32::NAN; 6 * 24];
        PackedMatrix::new(&right, 24).multiply_into(&left, &mut found);
        assert_eq!(found, expected);
    }
}
