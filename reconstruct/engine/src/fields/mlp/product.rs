//! Products of f32 matrices, transposed or not, on one thread.

#[derive(Debug, Clone, Copy)]
pub(super) struct Factor<'a> {
    values: &'a [f32],
    rows: usize,
    columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a> Factor<'a> {
    /// Creates a row-major matrix with `columns` columns.
    pub(super) fn new(values: &'a [f32], columns: usize) -> Self {
        assert_eq!(values.len() % columns, 0, "whole rows");
        Self {
            values,
            rows: values.len() / columns,
            columns,
            row_stride: columns,
            column_stride: 1,
        }
    }

    /// Returns the transpose without copying.
    pub(super) fn transposed(self) -> Self {
        Self {
            rows: self.columns,
            columns: self.rows,
            row_stride: self.column_stride,
            column_stride: self.row_stride,
            ..self
        }
    }
}

/// Computes `product = left * right`, row-major.
pub(super) fn multiply(left: Factor<'_>, right: Factor<'_>, product: &mut [f32]) {
    multiply_onto(left, right, 0.0, product);
}

/// Computes `product += left * right`, row-major.
pub(super) fn multiply_add(left: Factor<'_>, right: Factor<'_>, product: &mut [f32]) {
    multiply_onto(left, right, 1.0, product);
}

/// Computes `product = left * right + kept * product`.
fn multiply_onto(left: Factor<'_>, right: Factor<'_>, kept: f32, product: &mut [f32]) {
    assert_eq!(left.columns, right.rows, "inner sizes");
    assert_eq!(product.len(), left.rows * right.columns, "product");
    let stride = |stride: usize| stride as isize;
    // SAFETY: `Factor::new` and `Factor::transposed` keep every factor's strides within its values; sizes
    // were checked; the product is borrowed mutably and overlaps neither.
    unsafe {
        matrixmultiply::sgemm(
            left.rows,
            left.columns,
            right.columns,
            1.0,
            left.values.as_ptr(),
            stride(left.row_stride),
            stride(left.column_stride),
            right.values.as_ptr(),
            stride(right.row_stride),
            stride(right.column_stride),
            kept,
            product.as_mut_ptr(),
            stride(right.columns),
            1,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn matrix(rows: usize, columns: usize) -> Vec<f32> {
        (0..rows * columns)
            .map(|at| ((at * 31) % 23) as f32 / 11.0 - 1.0)
            .collect()
    }

    #[test]
    fn products_of_transposes_are_those_of_plain_loops() {
        let [m, k, n] = [33, 20, 17];
        let (left, right) = (matrix(m, k), matrix(k, n));
        let (left_t, right_t) = (matrix(k, m), matrix(n, k));
        let straight = |values: &[f32], columns: usize, i: usize, j: usize| values[i * columns + j];
        for (transposed_left, transposed_right) in [(false, false), (true, false), (false, true)] {
            let a = if transposed_left {
                Factor::new(&left_t, m).transposed()
            } else {
                Factor::new(&left, k)
            };
            let b = if transposed_right {
                Factor::new(&right_t, k).transposed()
            } else {
                Factor::new(&right, n)
            };
            let mut product = vec![7.0; m * n];
            multiply(a, b, &mut product);
            multiply_add(a, b, &mut product);
            for i in 0..m {
                for j in 0..n {
                    let expected: f64 = (0..k)
                        .map(|l| {
                            let a = if transposed_left {
                                straight(&left_t, m, l, i)
                            } else {
                                straight(&left, k, i, l)
                            };
                            let b = if transposed_right {
                                straight(&right_t, k, j, l)
                            } else {
                                straight(&right, n, l, j)
                            };
                            2.0 * f64::from(a) * f64::from(b)
                        })
                        .sum();
                    assert!((f64::from(product[i * n + j]) - expected).abs() < 1e-4);
                }
            }
        }
    }
}
