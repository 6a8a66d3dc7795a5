//! Rows of a table on a GPU from those of another.

use super::{adam::gpu::MAX_ARRAYS, device_table::TableBuffers};
use crate::device::{DeviceBuffer, Gpu, GpuError, Kernel, Program, Shader, Uniform, wgsl_struct};

wgsl_struct! {
    /// From which table to which.
    pub(crate) struct RowMove {
        len: u32,
        rows: u32,
        old_rows: u32,
        arrays: u32,
        ends: [[u32; 4]; 4],
        widths: [[u32; 4]; 4],
        forgets: [[u32; 4]; 4],
    }
}

/// Added to the number of an old row whose moments are not taken along.
const COPY: u32 = 1 << 31;

pub(crate) fn shader() -> Shader {
    Shader {
        file: "rows.wgsl",
        constants: String::new(),
        parts: &[
            include_str!("../device/common.wgsl"),
            include_str!("rows.wgsl"),
        ],
    }
}

/// Where a new row comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct RowSource {
    /// The old row.
    pub(crate) row: usize,
    /// Whether it has no moments yet.
    pub(crate) is_copy: bool,
}

/// What an array of a table has for each Gaussian, and what becomes of its moments.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct MovedArray {
    pub(crate) width: usize,
    /// Whether the moments of all rows are forgotten.
    pub(crate) forgets: bool,
}

/// Moves rows.
#[derive(Debug)]
pub(crate) struct RowMover {
    move_rows: Kernel,
}

impl RowMover {
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [move_rows] = Kernel::compile(gpu, &shader(), ["move_rows"])?;
        Ok(Self { move_rows })
    }

    /// A table with these rows of `old`, which has `old_rows` of them.
    pub(crate) fn moved(
        &self,
        gpu: &Gpu,
        (old, old_rows): (&TableBuffers, usize),
        arrays: &[MovedArray],
        sources: &[RowSource],
    ) -> Result<TableBuffers, GpuError> {
        assert!(arrays.len() <= MAX_ARRAYS, "too many arrays");
        let widths: Vec<usize> = arrays.iter().map(|array| array.width).collect();
        let table = TableBuffers::zeros(gpu, &widths, sources.len())?;
        let packed: Vec<u32> = sources
            .iter()
            .map(|source| source.row as u32 | if source.is_copy { COPY } else { 0 })
            .collect();
        let packed = DeviceBuffer::of(gpu, "rows", &packed)?;
        let mut settings = RowMove {
            len: table.values.len() as u32,
            rows: sources.len() as u32,
            old_rows: old_rows as u32,
            arrays: arrays.len() as u32,
            ..RowMove::default()
        };
        for (index, (array, &end)) in arrays.iter().zip(&table.ends).enumerate() {
            settings.ends[index / 4][index % 4] = end;
            settings.widths[index / 4][index % 4] = array.width as u32;
            settings.forgets[index / 4][index % 4] = u32::from(array.forgets);
        }
        let settings = Uniform::of(gpu, "move of rows", &settings)?;
        let mut program = Program::default();
        program.run(
            gpu,
            &self.move_rows,
            table.values.len(),
            &[
                &settings.raw,
                &packed.raw,
                &old.values.raw,
                &old.first_moments.raw,
                &old.second_moments.raw,
                &table.values.raw,
                &table.first_moments.raw,
                &table.second_moments.raw,
            ],
        );
        program.submit(gpu);
        Ok(table)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{device::test_device, parameters::ParameterTable};

    #[test]
    fn rows_move_as_in_a_table_of_the_host() {
        let Some(gpu) = test_device() else { return };
        let mut table = ParameterTable::new(5);
        for (name, width) in [("a", 3), ("b", 1), ("c", 4)] {
            let values = (0..5 * width).map(|index| index as f32).collect();
            table.add(name, width, values, 0.0);
        }
        for array in &mut table.arrays {
            let numbered = |offset: f32| array.values.iter().map(move |value| value + offset);
            let (first, second) = (numbered(100.0).collect(), numbered(200.0).collect());
            array.first_moments = first;
            array.second_moments = second;
        }
        let old = TableBuffers::new(&gpu, &table.arrays).expect("fits");
        table.append_copies(&[4, 1]);
        table.retain(&[true, false, true, true, false, true, true]);
        table.permute(&[4, 0, 2, 3, 1]);
        table.arrays[1].first_moments.fill(0.0);
        table.arrays[1].second_moments.fill(0.0);
        let source = |row, is_copy| RowSource { row, is_copy };
        let sources = [
            source(1, true),
            source(0, false),
            source(3, false),
            source(4, true),
            source(2, false),
        ];
        let arrays = [(3, false), (1, true), (4, false)];
        let arrays = arrays.map(|(width, forgets)| MovedArray { width, forgets });
        let mover = RowMover::new(&gpu).expect("compiles");
        let moved = mover
            .moved(&gpu, (&old, 5), &arrays, &sources)
            .expect("fits");
        let mut read = table.clone();
        for array in &mut read.arrays {
            array.values.fill(-1.0);
        }
        moved.read(&gpu, &mut read.arrays).expect("reads");
        assert_eq!(read, table);
    }
}
