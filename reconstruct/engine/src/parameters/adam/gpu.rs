//! Adam on a GPU.

use crate::parameters::adam::{BETA_1, EPSILON, SecondMomentDecay, corrections};
use crate::{
    device::{Buffer, Gpu, GpuError, Kernel, Program, Rows, Shader, Threads, Uniform, wgsl_struct},
    parameters::device_table::TableBuffers,
};

/// Maximum number of arrays of a table, the length of the kernel's settings.
pub(crate) const MAX_ARRAYS: usize = 16;

wgsl_struct! {
    /// Parameters of one step on all arrays.
    pub(crate) struct AdamStep {
        len: u32,
        arrays: u32,
        inverse_root: f32,
        beta_2: f32,
        ends: [[u32; 4]; 4],
        shifts: [[u32; 4]; 4],
        rates: [[f32; 4]; 4],
        numbers: [[u32; 4]; 4],
    }
}

/// Returns the constants of `value.wgsl`.
pub(crate) fn constants() -> String {
    format!(
        "const BETA_1: f32 = {BETA_1:e};\n\
         const EPSILON: f32 = {EPSILON:e};\n"
    )
}

pub(crate) fn shader() -> Shader {
    Shader {
        file: "adam.wgsl",
        constants: constants(),
        parts: &[
            include_str!("../../device/common.wgsl"),
            include_str!("../../device/status.wgsl"),
            include_str!("value.wgsl"),
            include_str!("adam.wgsl"),
        ],
    }
}

/// Kernel that updates all values of a table.
#[derive(Debug)]
pub(crate) struct Adam {
    update: Kernel,
}

/// Settings of the next step on one table.
#[derive(Debug)]
pub(crate) struct TableStep {
    settings: Uniform<AdamStep>,
    /// Per array of the table, its index among the trained arrays, which orders rates and counters of refused
    /// gradients; `None` for a frozen array.
    numbers: Vec<Option<usize>>,
}

impl TableStep {
    /// Creates the settings of a table whose arrays have these indices among the trained arrays.
    pub(crate) fn new(gpu: &Gpu, numbers: Vec<Option<usize>>) -> Result<Self, GpuError> {
        Ok(Self {
            settings: Uniform::of(gpu, "Adam step", &AdamStep::default())?,
            numbers,
        })
    }

    pub(crate) fn settings(&self) -> &Buffer {
        &self.settings.raw
    }

    /// Returns the trained values per row of a table.
    fn width(&self, table: &TableBuffers) -> usize {
        let arrays = table.widths.iter().zip(&self.numbers);
        let trained = arrays.filter(|(_, number)| number.is_some());
        trained.map(|(width, _)| width).sum()
    }

    /// Sets step number `step` (from 1) on `rows` rows, with the rates of all trained arrays, for everything
    /// that is submitted later. Without rows, nothing is updated.
    pub(crate) fn set(
        &self,
        gpu: &Gpu,
        (table, rows): (&TableBuffers, usize),
        (step, decay): (u64, SecondMomentDecay),
        rates: &[f32],
    ) {
        let corrections = corrections(step, decay);
        let mut settings = AdamStep {
            arrays: table.widths.len() as u32,
            inverse_root: corrections.inverse_root,
            beta_2: corrections.beta_2,
            ..AdamStep::default()
        };
        let mut end = 0;
        for (index, (&width, &number)) in table.widths.iter().zip(&self.numbers).enumerate() {
            settings.shifts[index / 4][index % 4] = table.begin(index) - end;
            // A frozen array has no values to update.
            if let Some(number) = number {
                end += (rows * width) as u32;
                settings.rates[index / 4][index % 4] = corrections.rate(rates[number]);
                settings.numbers[index / 4][index % 4] = number as u32;
            }
            settings.ends[index / 4][index % 4] = end;
        }
        settings.len = end;
        self.settings.write(gpu, &settings);
    }
}

impl Adam {
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [update] = Kernel::compile(gpu, &shader(), ["update"])?;
        Ok(Self { update })
    }

    pub(crate) fn record(
        &self,
        gpu: &Gpu,
        program: &mut Program,
        (step, table, rows): (&TableStep, &TableBuffers, &Rows),
        status: &Buffer,
    ) {
        program.run(
            gpu,
            &self.update,
            Threads::ForRows(rows, step.width(table)),
            &[
                &step.settings.raw,
                &table.values.raw,
                &table.gradients.raw,
                &table.first_moments.raw,
                &table.second_moments.raw,
                status,
            ],
        );
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64Mcg;

    use super::*;
    use crate::{
        device::{DeviceBuffer, test_device},
        parameters::{ParameterTable, adam::cpu},
        render::buffers::DeviceStatus,
    };

    /// Differs from the published one, so that the device must receive it.
    const DECAY: SecondMomentDecay = SecondMomentDecay(0.97);

    #[test]
    fn steps_are_those_of_the_cpu_and_nan_is_refused() {
        let Some(gpu) = test_device() else { return };
        let mut random = Pcg64Mcg::seed_from_u64(1);
        let mut table = ParameterTable::new(300);
        for (name, width) in [("a", 3), ("b", 1), ("c", 4)] {
            let values = (0..300 * width).map(|_| random.random_range(-1.0..1.0));
            table.add(name, width, values.collect(), 0.01 * width as f32);
        }
        let rates: Vec<f32> = table
            .arrays
            .iter()
            .map(|array| array.learning_rate)
            .collect();
        let status = DeviceBuffer::of(&gpu, "status", &[DeviceStatus::default()]).expect("fits");
        // More capacity than rows.
        let on_device = TableBuffers::new(&gpu, &table.arrays, [300, 410]).expect("fits");
        let rows = Rows::new(300);
        let adam = Adam::new(&gpu).expect("compiles");
        let numbers = [0, 1, 2].map(Some).to_vec();
        let next = TableStep::new(&gpu, numbers).expect("fits");
        let mut program = Program::default();
        adam.record(&gpu, &mut program, (&next, &on_device, &rows), &status.raw);
        let mut refused = [0; 3];
        for step in 1..=4 {
            for (index, array) in table.arrays.iter_mut().enumerate() {
                for gradient in &mut array.gradients {
                    *gradient = random.random_range(-1.0..1.0);
                }
                array.gradients[step as usize] = f32::NAN;
                array.gradients[17] = f32::INFINITY;
                let begin = on_device.begin(index) as usize;
                on_device.gradients.write(&gpu, begin, &array.gradients);
                refused[index] += cpu::step(array, step, DECAY) as u32;
            }
            next.set(&gpu, (&on_device, 300), (step, DECAY), &rates);
            program.submit(&gpu);
        }
        let mut read = table.clone();
        on_device.read(&gpu, &mut read.arrays).expect("reads");
        for (of_gpu, of_cpu) in read.arrays.iter().zip(&table.arrays) {
            for (gpu, cpu) in of_gpu.values.iter().zip(&of_cpu.values) {
                assert!((gpu - cpu).abs() < 1e-6, "{}: {gpu} and {cpu}", of_gpu.name);
            }
        }
        let status = status.read(&gpu).expect("reads")[0];
        assert_eq!((&status.refused[..3], status.refused[3]), (&refused[..], 0));

        // A halted device changes nothing.
        let halted = DeviceStatus {
            halted: 1,
            ..DeviceStatus::default()
        };
        let status = DeviceBuffer::of(&gpu, "status", &[halted]).expect("fits");
        let mut program = Program::default();
        adam.record(&gpu, &mut program, (&next, &on_device, &rows), &status.raw);
        program.submit(&gpu);
        let mut after = read.clone();
        on_device.read(&gpu, &mut after.arrays).expect("reads");
        for (after, before) in after.arrays.iter().zip(&read.arrays) {
            assert!(after.values == before.values && after.first_moments == before.first_moments);
        }
    }

    #[test]
    fn what_is_frozen_has_no_steps_and_neither_has_a_table_without_rows() {
        let Some(gpu) = test_device() else { return };
        let mut table = ParameterTable::new(30);
        for (name, width) in [("a", 2), ("b", 3), ("c", 1), ("d", 2)] {
            table.add(name, width, vec![0.5; 30 * width], 0.0);
        }
        for frozen in [0, 2] {
            table.freeze(frozen);
        }
        let status = DeviceBuffer::of(&gpu, "status", &[DeviceStatus::default()]).expect("fits");
        let on_device = TableBuffers::new(&gpu, &table.arrays, [30, 41]).expect("fits");
        let ones = vec![1.0; 41 * 8];
        on_device.gradients.write(&gpu, 0, &ones);
        let next = TableStep::new(&gpu, vec![None, Some(1), None, Some(0)]).expect("fits");
        let mut program = Program::default();
        let adam = Adam::new(&gpu).expect("compiles");
        let rows = Rows::new(30);
        adam.record(&gpu, &mut program, (&next, &on_device, &rows), &status.raw);
        let mut moved = [[0.5; 4]; 2];
        for (moved, rows) in moved.iter_mut().zip([0, 30]) {
            next.set(&gpu, (&on_device, rows), (1, DECAY), &[0.25, 0.125]);
            program.submit(&gpu);
            let mut read = table.clone();
            on_device.read(&gpu, &mut read.arrays).expect("reads");
            for (moved, array) in moved.iter_mut().zip(&read.arrays) {
                assert!(array.values.iter().all(|&value| value == array.values[0]));
                *moved = array.values[0];
            }
        }
        assert_eq!(moved[0], [0.5; 4]);
        let steps = [0.0, 0.125, 0.0, 0.25];
        for (value, step) in moved[1].iter().zip(steps) {
            assert!((0.5 - value - step).abs() < 1e-6, "{moved:?}");
        }
        let moments = on_device.first_moments.read(&gpu).expect("reads");
        assert!(moments[..2 * 41].iter().all(|&moment| moment == 0.0));
    }
}
