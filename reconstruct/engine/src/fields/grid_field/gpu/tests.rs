//! Fields compared with those of the CPU, which other tests compare with their definition.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::*;
use crate::{
    device::test_device,
    fields::{grid_field::GridFieldShape, hash_grid::HashGridShape},
};

/// Words of the status of steps: three, then 16 counters of refused gradients.
const STATUS_WORDS: usize = 19;
const COUNTER: usize = 2;

fn random(len: usize, seed: u64) -> Vec<f32> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    (0..len).map(|_| random.random_range(-1.0..1.0)).collect()
}

/// Returns a field with outputs and features that matter.
fn field(grid: HashGridShape) -> GridField {
    let shape = GridFieldShape {
        grid,
        hidden_layers: 3,
        width: 32,
        outputs: 3,
    };
    let weights = shape.network().weight_count();
    let table = shape.parameter_count() - weights;
    let third = |values: Vec<f32>| values.iter().map(|value| 0.3 * value).collect();
    GridField::with_parameters(shape, random(table, 1), third(random(weights, 2)))
}

/// A field on the device with the buffers around it.
struct OnDevice {
    field: DeviceField,
    scratch: GridScratch,
    by_positions: DeviceBuffer<f32>,
    status: DeviceBuffer<u32>,
    program: Program,
}

impl OnDevice {
    fn new(gpu: &Gpu, host: &GridField, room: usize) -> Self {
        let dimensions = host.shape().grid.dimensions;
        let plain = PositionGradients {
            width: dimensions,
            places: [0, 1, 2, 3],
            scales: [1.0; 4],
        };
        let kernels = FieldKernels::new(gpu).expect("compiles");
        let zeros = |len| DeviceBuffer::zeros(gpu, "of a test", len).expect("fits");
        let network = NetworkBuffers::new(gpu, host.network(), room).expect("fits");
        let field = DeviceField::new(gpu, (host, network), (room, COUNTER), &plain).expect("fits");
        let scratch = GridScratch::new(gpu, &[host.grid()], room).expect("fits");
        let by_positions = zeros(room * dimensions);
        let status = DeviceBuffer::zeros(gpu, "status", STATUS_WORDS).expect("fits");
        let mut program = Program::default();
        let at = (gpu, &kernels);
        program.clear(&by_positions.raw);
        field.forward(at, &mut program).expect("records");
        field
            .backward(at, &mut program, &scratch, &by_positions.raw)
            .expect("records");
        field.step(at, &mut program, &status.raw);
        Self {
            field,
            scratch,
            by_positions,
            status,
            program,
        }
    }

    /// Runs both passes, and a step.
    fn run(&mut self, gpu: &Gpu, case: &Case, step: Option<&FieldStep>) {
        let rows = case.upstream.len() / 3;
        self.field.place(gpu, rows, case.used);
        self.field.positions.write(gpu, 0, &case.positions);
        self.field.network.upstream.write(gpu, 0, &case.upstream);
        self.field.set_step(gpu, step);
        self.program.submit(gpu);
    }
}

/// Positions with the gradients by the outputs there.
struct Case {
    positions: Vec<f32>,
    upstream: Vec<f32>,
    used: usize,
}

impl Case {
    fn new(host: &GridField, rows: usize, used: usize) -> Self {
        let dimensions = host.shape().grid.dimensions;
        // A tenth of the positions lie outside.
        let positions = random(rows * dimensions, 3);
        Self {
            positions: positions.iter().map(|at| 0.5 + 0.55 * at).collect(),
            upstream: random(3 * rows, 4),
            used,
        }
    }
}

/// Asserts that the largest difference is within `limit` of the largest value.
fn assert_close(found: &[f32], expected: &[f32], limit: f32, what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let largest = expected.iter().fold(0.0_f32, |most, v| most.max(v.abs()));
    assert!(largest > 0.0, "{what} is 0 everywhere");
    for (index, (found, expected)) in found.iter().zip(expected).enumerate() {
        let error = (found - expected).abs();
        assert!(
            error <= limit * largest,
            "{what} {index}: {found} {expected}"
        );
    }
}

#[test]
fn outputs_gradients_and_steps_are_those_of_the_cpu() {
    let Some(gpu) = test_device() else { return };
    for (grid, rows, used) in [
        (HashGridShape::new(2, 5, 10), 700, 17),
        (HashGridShape::new(3, 4, 9), 500, usize::MAX),
        (HashGridShape::new(4, 4, 8), 300, 9),
        // Large fields: the tables of two levels are 2^19 entries each.
        (HashGridShape::new(2, 13, 19), 200, usize::MAX),
    ] {
        let mut host = field(grid);
        let case = Case::new(&host, rows, used);
        let mut device = OnDevice::new(&gpu, &host, rows + 100);
        let step = FieldStep {
            numbers: [1; 2],
            rates: [1e-2, 1e-3],
        };
        let expected = host.forward(&case.positions, used);
        let by_positions = host.backward(&case.upstream);
        let gradients = host.arrays().map(|array| array.gradients.clone());
        host.step(step.rates);
        device.run(&gpu, &case, Some(&step));
        let outputs = &device.field.network.outputs;
        let found = outputs.read_range(&gpu, 0..expected.len()).expect("reads");
        assert_close(&found, &expected, 2e-4, "output");
        let all = device.by_positions.read_range(&gpu, 0..by_positions.len());
        assert_close(&all.expect("reads"), &by_positions, 1e-3, "by positions");
        let mut read = field(grid);
        let of_device = &device.field;
        of_device.read_gradients(&gpu, &mut read).expect("reads");
        for (found, expected) in read.arrays().iter().zip(&gradients) {
            assert_close(&found.gradients, expected, 1e-3, found.name);
        }
        of_device.read(&gpu, &mut read).expect("reads");
        for (found, expected) in read.arrays().iter().zip(host.arrays()) {
            // Adam's first step has the size of the rate, whatever the gradient: its sign may differ where the
            // gradient is rounding.
            let pairs = found.values.iter().zip(&expected.values);
            let apart = pairs.filter(|(a, b)| (*a - *b).abs() > 1e-5).count();
            assert!(apart * 200 <= found.values.len(), "{}: {apart}", found.name);
        }
    }
}

/// Sums of integers have the same bits in any order, and a program has them at any number of rows before.
#[test]
fn a_device_reproduces_the_same_bits() {
    let Some(gpu) = test_device() else { return };
    let host = field(HashGridShape::new(2, 4, 6));
    let case = Case::new(&host, 3000, usize::MAX);
    let mut device = OnDevice::new(&gpu, &host, 4000);
    let mut bits = || {
        device.run(&gpu, &case, None);
        let mut read = field(HashGridShape::new(2, 4, 6));
        let of_device = &device.field;
        of_device.read_gradients(&gpu, &mut read).expect("reads");
        let arrays = read.arrays();
        let gradients = arrays.iter().flat_map(|array| &array.gradients);
        let bits: Vec<u32> = gradients.map(|value| value.to_bits()).collect();
        device.run(&gpu, &Case::new(&host, 7, 3), None);
        bits
    };
    let first = bits();
    assert!(first == bits());
    // Without a step nothing has moved.
    let mut read = field(HashGridShape::new(2, 4, 6));
    device.field.read(&gpu, &mut read).expect("reads");
    assert_eq!(read.table.array, host.table.array);
}

/// A row without a finite gradient is refused by the entries that it reads; a position that is not a number takes
/// no part.
#[test]
fn gradients_that_are_not_finite_are_refused() {
    let Some(gpu) = test_device() else { return };
    let mut host = field(HashGridShape::new(2, 1, 10));
    let mut case = Case::new(&host, 40, usize::MAX);
    case.positions[0] = f32::NAN;
    case.upstream[3] = f32::INFINITY;
    let mut device = OnDevice::new(&gpu, &host, 40);
    let step = FieldStep {
        numbers: [1; 2],
        rates: [1e-2; 2],
    };
    device.run(&gpu, &case, Some(&step));
    host.forward(&case.positions, usize::MAX);
    host.backward(&case.upstream);
    let refused = host.step(step.rates);
    assert!(refused > 0);
    let status = device.status.read(&gpu).expect("reads");
    assert_eq!(status[3 + COUNTER] as usize, refused);
    // The sums are empty again.
    let sums = device.scratch.sums_of_test(&gpu);
    assert!(sums.iter().all(|&word| word == 0));
}

/// Fields beyond the largest buffer of an adapter are refused in one line.
#[test]
fn a_table_beyond_the_largest_buffer_is_refused() {
    let Some(gpu) = test_device() else { return };
    let host = field(HashGridShape::new(2, 2, 10));
    let plain = PositionGradients {
        width: 2,
        places: [0, 1, 2, 3],
        scales: [1.0; 4],
    };
    let network = NetworkBuffers::new(&gpu, host.network(), 10).expect("fits");
    gpu.exhaust_above(1 << 10);
    let refused = DeviceField::new(&gpu, (&host, network), (10, COUNTER), &plain);
    let message = refused.map(drop).expect_err("no room").to_string();
    assert!(
        message.contains("memory") && message.lines().count() == 1,
        "{message}"
    );
}
