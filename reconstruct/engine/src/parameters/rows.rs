//! Copying of table rows on a GPU, into another table or another order.

use super::device_table::TableBuffers;
use crate::device::{
    DeviceBuffer, Gpu, GpuError, Kernel, Program, Rows, Shader, Threads, Uniform, wgsl_struct,
};

wgsl_struct! {
    /// Sizes and offsets of a move between two tables.
    pub(crate) struct RowMove {
        len: u32,
        rows: u32,
        arrays: u32,
        moments: u32,
        widths: [[u32; 4]; 4],
        old_begins: [[u32; 4]; 4],
        begins: [[u32; 4]; 4],
    }
}

/// Flag in the number of an old row: its moments are not copied.
#[cfg(test)]
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

/// Kernel that moves rows.
#[derive(Debug)]
pub(crate) struct RowMover {
    move_rows: Kernel,
}

/// Move of rows of one table into another, or within it; created once for two tables.
#[derive(Debug)]
pub(crate) struct RowMoves {
    program: Program,
    rows: Rows,
    /// Old row of every new row, with the flag [`COPY`] for a copy, which has no moments yet.
    pub(crate) sources: DeviceBuffer<u32>,
    /// Settings for values and for moments.
    settings: [Uniform<RowMove>; 2],
    template: RowMove,
}

/// Packs a number per array into the fixed length of the settings.
fn places(values: impl Iterator<Item = u32>) -> [[u32; 4]; 4] {
    let mut places = [[0; 4]; 4];
    for (place, value) in places.as_flattened_mut().iter_mut().zip(values) {
        *place = value;
    }
    places
}

impl RowMover {
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [move_rows] = Kernel::compile(gpu, &shader(), ["move_rows"])?;
        Ok(Self { move_rows })
    }

    /// Creates a move from a table to another with the same arrays. The latter's gradients are lost: their
    /// memory is the buffer for reordering, and every step overwrites them.
    pub(crate) fn between(
        &self,
        gpu: &Gpu,
        old: &TableBuffers,
        table: &TableBuffers,
    ) -> Result<RowMoves, GpuError> {
        assert_eq!(old.widths, table.widths, "other arrays");
        let begins = |table: &TableBuffers| {
            let begins: Vec<u32> = (0..table.widths.len())
                .map(|array| table.begin(array))
                .collect();
            places(begins.into_iter())
        };
        let template = RowMove {
            arrays: table.widths.len() as u32,
            widths: places(table.widths.iter().map(|&width| width as u32)),
            old_begins: begins(old),
            begins: begins(table),
            ..RowMove::default()
        };
        let uniform = || Uniform::of(gpu, "move of rows", &template);
        let settings = [uniform()?, uniform()?];
        let sources = DeviceBuffer::zeros(gpu, "sources of rows", table.capacity)?;
        let rows = Rows::new(0);
        let mut program = Program::default();
        for (settings, from, to) in [
            (&settings[0], &old.values, &table.values),
            (&settings[1], &old.first_moments, &table.first_moments),
            (&settings[1], &old.second_moments, &table.second_moments),
        ] {
            let ordered = &table.gradients.raw;
            program.run(
                gpu,
                &self.move_rows,
                Threads::ForRows(&rows, table.width()),
                &[&settings.raw, &sources.raw, &from.raw, ordered],
            );
            program.copy(ordered, &to.raw);
        }
        Ok(RowMoves {
            program,
            rows,
            sources,
            settings,
            template,
        })
    }
}

impl RowMoves {
    /// Writes the first `rows` rows of all arrays from the `sources` on the device.
    pub(crate) fn run(&self, gpu: &Gpu, rows: usize) {
        self.rows.set(rows);
        let width: u32 = self.template.widths.as_flattened().iter().sum();
        for (moments, settings) in (0..).zip(&self.settings) {
            let row_move = RowMove {
                len: width * rows as u32,
                rows: rows as u32,
                moments,
                ..self.template
            };
            settings.write(gpu, &row_move);
        }
        self.program.submit(gpu);
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
        let old = TableBuffers::new(&gpu, &table.arrays, [5, 6]).expect("fits");
        let mover = RowMover::new(&gpu).expect("compiles");
        table.append_copies(&[4, 1]);
        table.retain(&[true, false, true, true, false, true, true]);
        table.permute(&[4, 0, 2, 3, 1]);
        let sources = [1 | COPY, 0, 3, 4 | COPY, 2];
        let mut read = table.clone();
        // Into a larger table, and within it.
        let larger = TableBuffers::zeros(&gpu, old.widths.clone(), 9).expect("fits");
        for moved in [&larger, &old] {
            let moves = mover.between(&gpu, &old, moved).expect("fits");
            moves.sources.write(&gpu, 0, &sources);
            moves.run(&gpu, sources.len());
            for array in &mut read.arrays {
                array.values.fill(-1.0);
            }
            moved.read(&gpu, &mut read.arrays).expect("reads");
            assert_eq!(read, table);
        }
    }
}
