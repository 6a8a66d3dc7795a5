//! Matrix products of row-major matrices in f32.

/// A row-major matrix.
#[derive(Debug, Clone, PartialEq)]
pub struct Matrix {
    /// Number of rows.
    pub rows: usize,
    /// Number of columns.
    pub columns: usize,
    /// `rows * columns` values.
    pub data: Vec<f32>,
}

impl Matrix {
    /// Creates a matrix of zeros.
    pub fn zeros(rows: usize, columns: usize) -> Self {
        Self {
            rows,
            columns,
            data: vec![0.0; rows * columns],
        }
    }

    /// Returns the transpose.
    pub fn transposed(&self) -> Self {
        let mut data = Vec::with_capacity(self.data.len());
        for column in 0..self.columns {
            data.extend((0..self.rows).map(|row| self.data[row * self.columns + column]));
        }
        Self {
            rows: self.columns,
            columns: self.rows,
            data,
        }
    }

    /// Returns one row.
    pub fn row(&self, row: usize) -> &[f32] {
        &self.data[row * self.columns..(row + 1) * self.columns]
    }

    /// Returns `self * right`.
    pub fn times(&self, right: &Self) -> Self {
        assert_eq!(self.columns, right.rows, "inner sizes of a matrix product");
        let mut product = Self::zeros(self.rows, right.columns);
        multiply(
            &self.data,
            &right.data,
            &mut product.data,
            [self.rows, self.columns, right.columns],
        );
        product
    }
}

/// Computes `product = left * right` for `[m, k, n]`: `left` is m x k, `right` k x n, `product` m x n.
///
/// # Panics
/// When a slice's length does not fit the sizes.
pub fn multiply(left: &[f32], right: &[f32], product: &mut [f32], [m, k, n]: [usize; 3]) {
    // Checked: sizes whose product wraps around would pass as those of short slices.
    assert_eq!(Some(left.len()), m.checked_mul(k), "left factor");
    assert_eq!(Some(right.len()), k.checked_mul(n), "right factor");
    assert_eq!(Some(product.len()), m.checked_mul(n), "product");
    // SAFETY: the lengths were checked, strides are those of row-major matrices, and the product,
    // borrowed mutably, overlaps neither factor.
    unsafe {
        matrixmultiply::sgemm(
            m,
            k,
            n,
            1.0,
            left.as_ptr(),
            k as isize,
            1,
            right.as_ptr(),
            n as isize,
            1,
            0.0,
            product.as_mut_ptr(),
            n as isize,
            1,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[should_panic(expected = "left factor")]
    fn sizes_that_wrap_around_are_refused() {
        multiply(&[], &[], &mut [], [1 << 32, 1 << 32, 0]);
    }

    #[test]
    fn products_are_those_of_plain_loops() {
        for [m, k, n] in [[1, 1, 1], [7, 5, 3], [100, 64, 192], [33, 129, 17]] {
            let value = |i: usize, j: usize| ((i * 31 + j * 17) % 23) as f32 / 11.0 - 1.0;
            let fill = |rows: usize, columns: usize| Matrix {
                rows,
                columns,
                data: (0..rows * columns)
                    .map(|at| value(at / columns, at % columns))
                    .collect(),
            };
            let (left, right) = (fill(m, k), fill(k, n));
            let product = left.times(&right);
            for i in 0..m {
                for j in 0..n {
                    let expected: f64 = (0..k)
                        .map(|l| f64::from(value(i, l)) * f64::from(value(l, j)))
                        .sum();
                    assert!((f64::from(product.row(i)[j]) - expected).abs() < 1e-4);
                }
            }
            assert_eq!(left.transposed().transposed(), left);
        }
    }
}
