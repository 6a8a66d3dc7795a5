//! Products of matrices on a GPU.

use crate::device::{Gpu, GpuError, Kernel, Program, Shader, Uniform, Workgroups, wgsl_struct};
use crate::fields::mlp::blocks_gpu::{Block, BlockPass};

/// Rows and columns of the square that a workgroup computes: 256 threads with 4 by 4 values each.
pub(super) const SIDE: u32 = 64;

wgsl_struct! {
    /// Sizes and offsets of a product; see `product.wgsl`.
    pub(crate) struct Product {
        sums_rows: u32,
        fixed_len: u32,
        columns: u32,
        left_begin: u32,
        left_row_stride: u32,
        left_inner_stride: u32,
        right_begin: u32,
        right_inner_stride: u32,
        right_column_stride: u32,
        out_begin: u32,
        is_added: u32,
        finish: u32,
    }
}

pub(crate) fn shader() -> Shader {
    Shader {
        file: "product.wgsl",
        constants: format!("const SIDE: u32 = {SIDE}u;\n"),
        parts: &[
            include_str!("../../device/common.wgsl"),
            include_str!("block.wgsl"),
            include_str!("product.wgsl"),
        ],
    }
}

/// A matrix in a buffer, row-major or transposed. A matrix with a row per block row has the block's capacity.
#[derive(Debug, Clone, Copy)]
pub(super) struct Matrix<'a> {
    buffer: &'a wgpu::Buffer,
    begin: usize,
    rows: usize,
    columns: usize,
    row_stride: usize,
    column_stride: usize,
}

impl<'a> Matrix<'a> {
    /// Creates a row-major matrix that starts at value `begin`.
    pub(super) fn new(buffer: &'a wgpu::Buffer, begin: usize, rows: usize, columns: usize) -> Self {
        Self {
            buffer,
            begin,
            rows,
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

    /// Returns the number of values of the product with `right`.
    pub(super) fn product_len(self, right: Self) -> usize {
        self.rows * right.columns
    }
}

/// Dimension of a product that runs over the rows of a block.
#[derive(Debug, Clone, Copy)]
pub(super) enum Over<'a> {
    /// The product's rows, in the given pass.
    Rows(&'a Block, &'a BlockPass),
    /// The inner dimension: the block's parts give one product each.
    Sum(&'a Block),
}

/// Final operation on the values of a product.
#[derive(Debug, Clone, Copy)]
pub(super) enum Finish<'a> {
    /// None.
    Plain,
    /// Adds a value per column.
    Offset(&'a wgpu::Buffer),
    /// Adds a value per column and clips at 0 (`ReLU`).
    OffsetAndClip(&'a wgpu::Buffer),
    /// Sets values to 0 where a matrix of the product's size, at the start of its buffer, is not above 0.
    Mask(&'a wgpu::Buffer),
}

/// Destination of a product: a row-major matrix, or one per part, consecutive.
#[derive(Debug, Clone, Copy)]
pub(super) struct Destination<'a> {
    pub(super) buffer: &'a wgpu::Buffer,
    pub(super) begin: usize,
    /// True to add to the existing values.
    pub(super) is_added: bool,
    pub(super) finish: Finish<'a>,
}

impl<'a> Destination<'a> {
    /// Creates a destination for one matrix, which is overwritten.
    pub(super) fn new(buffer: &'a wgpu::Buffer, begin: usize) -> Self {
        Self {
            buffer,
            begin,
            is_added: false,
            finish: Finish::Plain,
        }
    }
}

/// Kernel of matrix products.
#[derive(Debug)]
pub(super) struct Products {
    multiply: Kernel,
}

impl Products {
    pub(super) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [multiply] = Kernel::compile(gpu, &shader(), ["multiply"])?;
        Ok(Self { multiply })
    }

    /// Adds `out = left * right` to a program.
    pub(super) fn record(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        over: Over<'_>,
        (left, right): (Matrix<'_>, Matrix<'_>),
        out: Destination<'_>,
    ) -> Result<(), GpuError> {
        assert_eq!(left.columns, right.rows, "inner sizes");
        // All bindings must be set: without an operand beside it, a factor is bound once more.
        let (finish, beside) = match out.finish {
            Finish::Plain => (0, left.buffer),
            Finish::Offset(beside) => (1, beside),
            Finish::OffsetAndClip(beside) => (2, beside),
            Finish::Mask(beside) => (3, beside),
        };
        let sides = |len: usize| len.div_ceil(SIDE as usize);
        let across = sides(right.columns);
        let (block, sums_rows, workgroups) = match over {
            Over::Rows(block, pass) => (block, false, Workgroups::ForEach(&pass.squares, across)),
            Over::Sum(block) => {
                let each = sides(left.rows) * across;
                (block, true, Workgroups::ForEach(&block.parts, each))
            }
        };
        let fixed_len = if sums_rows { left.rows } else { left.columns };
        let product = Product {
            sums_rows: sums_rows.into(),
            fixed_len: fixed_len as u32,
            columns: right.columns as u32,
            left_begin: left.begin as u32,
            left_row_stride: left.row_stride as u32,
            left_inner_stride: left.column_stride as u32,
            right_begin: right.begin as u32,
            right_inner_stride: right.row_stride as u32,
            right_column_stride: right.column_stride as u32,
            out_begin: out.begin as u32,
            is_added: out.is_added.into(),
            finish,
        };
        let product_uniform = Uniform::of(gpu, "product", &product)?;
        program.run_workgroups(
            gpu,
            &self.multiply,
            workgroups,
            &[
                &product_uniform.raw,
                left.buffer,
                right.buffer,
                beside,
                out.buffer,
                &block.uniform.raw,
            ],
        );
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::{DeviceBuffer, test_device};

    fn values(len: usize, step: usize) -> Vec<f32> {
        (0..len)
            .map(|at| ((at * step) % 29) as f32 / 14.0 - 1.0)
            .collect()
    }

    /// Returns the product by its definition; both factors are row-major.
    fn expected(left: &[f32], right: &[f32], [rows, inner, columns]: [usize; 3]) -> Vec<f64> {
        let term = |i: usize, k: usize, j: usize| {
            f64::from(left[i * inner + k]) * f64::from(right[k * columns + j])
        };
        (0..rows * columns)
            .map(|at| {
                (0..inner)
                    .map(|k| term(at / columns, k, at % columns))
                    .sum()
            })
            .collect()
    }

    fn transposed(values: &[f32], columns: usize) -> Vec<f32> {
        let rows = values.len() / columns;
        (0..values.len())
            .map(|at| values[at % rows * columns + at / rows])
            .collect()
    }

    #[test]
    fn products_are_those_of_the_definition() {
        let Some(gpu) = test_device() else { return };
        let products = Products::new(&gpu).expect("compiles");
        for size @ [rows, inner, columns] in [[130, 37, 70], [3, 200, 65], [64, 64, 64], [1, 1, 1]]
        {
            let (left, right) = (values(rows * inner, 7), values(inner * columns, 11));
            let expected = expected(&left, &right, size);
            let beside: Vec<f32> = values(rows * columns, 5);
            let buffer = |values: &[f32]| DeviceBuffer::of(&gpu, "matrix", values).expect("fits");
            for (parts, is_transposed) in
                [(1, [false, false]), (3, [true, false]), (2, [false, true])]
            {
                let [a, b] = [
                    (&left, inner, is_transposed[0]),
                    (&right, columns, is_transposed[1]),
                ]
                .map(|(values, columns, flip)| {
                    let values = if flip {
                        transposed(values, columns)
                    } else {
                        values.clone()
                    };
                    // Matrices may start anywhere in their buffer.
                    buffer(&[vec![9.0; 5], values].concat())
                });
                let matrix = |buffer, rows, columns, flip: bool| {
                    if flip {
                        Matrix::new(buffer, 5, columns, rows).transposed()
                    } else {
                        Matrix::new(buffer, 5, rows, columns)
                    }
                };
                let a = matrix(&a.raw, rows, inner, is_transposed[0]);
                let b = matrix(&b.raw, inner, columns, is_transposed[1]);
                let out = buffer(&vec![0.5; parts * rows * columns + 2]);
                let beside_buffer = buffer(&beside);
                let mut program = Program::default();
                let sums = parts > 1;
                let len = if sums { inner } else { rows };
                let block = Block::new(&gpu, 0, len).expect("fits");
                block.set_parts(&gpu, len, parts);
                let mut run = |is_added, finish| {
                    let over = match sums {
                        true => Over::Sum(&block),
                        false => Over::Rows(&block, &block.once),
                    };
                    let to = Destination {
                        is_added,
                        finish,
                        ..Destination::new(&out.raw, 2)
                    };
                    products
                        .record(&gpu, &mut program, over, (a, b), to)
                        .expect("records");
                };
                run(false, Finish::Plain);
                if parts == 1 {
                    run(true, Finish::OffsetAndClip(&beside_buffer.raw));
                    run(true, Finish::Mask(&beside_buffer.raw));
                    run(true, Finish::Offset(&beside_buffer.raw));
                }
                program.submit(&gpu);
                let found = out.read(&gpu).expect("reads");
                assert_eq!(found[..2], [0.5, 0.5], "what is before the product");
                for (at, &product) in expected.iter().enumerate() {
                    let sum: f64 = (0..parts)
                        .map(|part| f64::from(found[2 + part * rows * columns + at]))
                        .sum();
                    let expected = if parts == 1 {
                        let offset = f64::from(beside[at % columns]);
                        let clipped = (2.0 * product + offset).max(0.0);
                        let masked = if beside[at] > 0.0 {
                            clipped + product
                        } else {
                            0.0
                        };
                        masked + product + offset
                    } else {
                        product
                    };
                    assert!((sum - expected).abs() < 1e-4, "{at}: {sum} {expected}");
                }
            }
        }
    }
}
