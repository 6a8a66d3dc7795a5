//! Outputs and gradients compared with those of the CPU, which other tests compare with the definition.

use crate::fields::mlp::gpu::*;
use crate::{
    device::test_device,
    fields::mlp::cases::{Case, SMALL},
};

const PUBLISHED: NetworkShape = NetworkShape {
    row_inputs: 63,
    shared_inputs: 21,
    depth: 8,
    width: 256,
    skip_after: Some(4),
    has_biases: true,
    outputs: 10,
};

/// Shape of the networks of hash grids.
const WITHOUT_BIASES: NetworkShape = NetworkShape {
    shared_inputs: 0,
    skip_after: None,
    has_biases: false,
    ..SMALL
};

/// Outputs, gradients by the weights, and gradients by the inputs.
type Values = [Vec<f32>; 3];

/// Runs with a capacity equal to the number of rows.
fn on_device(case: &Case, gpu: &Gpu, block: usize) -> Values {
    in_room(case, gpu, [case.rows, block], |_| {})
}

/// Runs with a capacity of `room` rows, in blocks of `block`. `before` may run the program for other numbers
/// of rows.
fn in_room(
    case: &Case,
    gpu: &Gpu,
    [room, block]: [usize; 2],
    before: impl Fn(&dyn Fn(usize)),
) -> Values {
    let buffers = NetworkBuffers::with_blocks(gpu, case.shape, room, block).expect("fits");
    in_buffers(case, gpu, &buffers, before)
}

fn in_buffers(
    case: &Case,
    gpu: &Gpu,
    buffers: &NetworkBuffers,
    before: impl Fn(&dyn Fn(usize)),
) -> Values {
    let room = buffers.room[0];
    let passes = Passes::new(gpu).expect("compiles");
    let buffer = |values: &[f32]| DeviceBuffer::of(gpu, "of a test", values).expect("fits");
    let weights = buffer(&case.weights);
    let gradients = buffer(&vec![7.0; case.weights.len()]);
    let by_inputs = buffer(&vec![7.0; room * case.shape.row_inputs]);
    buffers.shared.write(gpu, 0, &case.shared);
    buffers.upstream.write(gpu, 0, &case.upstream);
    // Inputs are passed through a product with the identity.
    let width = case.shape.row_inputs;
    let inputs = buffer(&case.inputs);
    let identity: Vec<f32> = (0..width * width)
        .map(|at| f32::from(at % width == at / width))
        .collect();
    let identity = buffer(&identity);
    let encode =
        |program: &mut Program, (block, pass): (&Block, &BlockPass), out: &wgpu::Buffer| {
            let rows = Matrix::new(&inputs.raw, block.first * width, block.room, width);
            let factors = (rows, Matrix::new(&identity.raw, 0, width, width));
            let (over, to) = (Over::Rows(block, pass), Destination::new(out, 0));
            passes.products.record(gpu, program, over, factors, to)
        };
    let mut program = Program::default();
    let mut recording = Recording {
        gpu,
        program: &mut program,
        weights: &weights.raw,
        encode: &encode,
    };
    passes.forward(&mut recording, buffers).expect("records");
    if !buffers.keeps_activations {
        recording.program.clear(&buffers.hidden[0].raw);
    }
    passes
        .backward(
            &mut recording,
            buffers,
            &gradients.raw,
            Some(&by_inputs.raw),
        )
        .expect("records");
    before(&|rows| {
        buffers.place(gpu, rows);
        program.submit(gpu);
    });
    buffers.place(gpu, case.rows);
    program.submit(gpu);
    let outputs = 0..case.rows * case.shape.outputs;
    [
        buffers.outputs.read_range(gpu, outputs).expect("reads"),
        gradients.read(gpu).expect("reads"),
        by_inputs
            .read_range(gpu, 0..case.inputs.len())
            .expect("reads"),
    ]
}

fn assert_close(found: &[f32], expected: &[f32], what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    let largest = expected
        .iter()
        .fold(0.0_f32, |largest, v| largest.max(v.abs()));
    for (index, (found, expected)) in found.iter().zip(expected).enumerate() {
        let error = (found - expected).abs();
        assert!(
            error <= 1e-5 * largest,
            "{what} {index}: {found} {expected}"
        );
    }
}

#[test]
fn outputs_and_gradients_are_those_of_the_cpu() {
    let Some(gpu) = test_device() else { return };
    for (shape, rows, block) in [
        (SMALL, 1, 64),
        (SMALL, 300, 4096),
        (SMALL, 300, 128),
        // More than one partial sum.
        (SMALL, 5000, 4096),
        (PUBLISHED, 150, 4096),
        (WITHOUT_BIASES, 300, 4096),
        (WITHOUT_BIASES, 300, 128),
    ] {
        let case = Case::new(shape, rows);
        let [out, gradients, by_inputs] = on_device(&case, &gpu, block);
        let (expected_out, expected, expected_inputs) = case.with_input_gradients(usize::MAX);
        assert_close(&out, &expected_out, "output");
        assert_close(&gradients, &expected, "gradient");
        assert_close(&by_inputs, &expected_inputs, "gradient by inputs");
    }
}

/// One program for any number of rows within its capacity gives the same bits as one for that number alone,
/// independent of earlier runs.
#[test]
fn rows_come_and_go_within_the_room() {
    let Some(gpu) = test_device() else { return };
    let bits = |values: Values| -> Vec<u32> {
        values
            .iter()
            .flatten()
            .map(|value| value.to_bits())
            .collect()
    };
    for (rows, room, block) in [
        (300, 1000, 4096),
        // Several blocks, some without rows.
        (300, 1000, 128),
        (100, 1000, 128),
        (128, 1000, 128),
        (0, 1000, 128),
    ] {
        let case = Case::new(SMALL, rows);
        let alone = bits(on_device(&case, &gpu, block));
        let found = in_room(&case, &gpu, [room, block], |run| {
            [room, 7, 0, 200].into_iter().for_each(run);
        });
        assert!(bits(found) == alone, "{rows} of {room} in {block}");
    }
}

/// Networks in the memory of a larger one have the bits of their own buffers, although others overwrite their
/// activations.
#[test]
fn networks_share_memory() {
    let Some(gpu) = test_device() else { return };
    let larger = NetworkShape {
        row_inputs: 9,
        depth: 5,
        width: 16,
        outputs: 6,
        ..SMALL
    };
    for block in [4096, 128] {
        let memory = NetworkBuffers::with_blocks(&gpu, larger, 400, block).expect("fits");
        for shape in [SMALL, WITHOUT_BIASES, larger] {
            let case = Case::new(shape, 300);
            let shared = memory.sharing(&gpu, shape).expect("fits");
            let found = in_buffers(&case, &gpu, &shared, |run| run(400));
            assert!(found == in_room(&case, &gpu, [400, block], |_| {}));
        }
    }
}

#[test]
fn nothing_goes_through() {
    let Some(gpu) = test_device() else { return };
    let [out, gradients, _] = on_device(&Case::new(SMALL, 0), &gpu, 64);
    assert!(out.is_empty() && gradients.iter().all(|&gradient| gradient == 0.0));
}
