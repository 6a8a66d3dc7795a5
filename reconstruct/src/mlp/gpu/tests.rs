//! Outputs and gradients against those of the processor, which are held against the definition.

use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

use super::*;
use crate::{gpu::test_device, mlp::passes::Activations};

const SMALL: NetworkShape = NetworkShape {
    row_inputs: 5,
    shared_inputs: 3,
    depth: 4,
    width: 8,
    skip_after: 1,
    outputs: 4,
};
const PUBLISHED: NetworkShape = NetworkShape {
    row_inputs: 63,
    shared_inputs: 21,
    depth: 8,
    width: 256,
    skip_after: 4,
    outputs: 10,
};

fn random(len: usize, seed: u64) -> Vec<f32> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    (0..len).map(|_| random.random_range(-1.0..1.0)).collect()
}

/// A network and what goes in from both sides.
struct Case {
    shape: NetworkShape,
    rows: usize,
    weights: Vec<f32>,
    shared: Vec<f32>,
    inputs: Vec<f32>,
    upstream: Vec<f32>,
}

impl Case {
    fn new(shape: NetworkShape, rows: usize) -> Self {
        let mut weights = shape.initial_weights(3);
        let heads = shape.layers()[shape.depth].hidden_weights().start;
        let count = weights.len() - heads;
        weights[heads..].copy_from_slice(&random(count, 4));
        Self {
            shape,
            rows,
            weights,
            shared: random(shape.shared_inputs, 5),
            inputs: random(rows * shape.row_inputs, 6),
            upstream: random(rows * shape.outputs, 7),
        }
    }

    /// Outputs and gradients by the weights.
    fn on_processor(&self) -> [Vec<f32>; 2] {
        let width = self.shape.row_inputs;
        let encode = |row: usize, out: &mut [f32]| {
            out.copy_from_slice(&self.inputs[row * width..(row + 1) * width]);
        };
        let mut activations = Activations::new(usize::MAX);
        let mut out = vec![0.0; self.rows * self.shape.outputs];
        let (weights, shared) = (&self.weights, &self.shared);
        self.shape
            .forward(weights, shared, &encode, &mut activations, &mut out);
        let mut gradients = vec![f32::NAN; weights.len()];
        self.shape.backward(
            weights,
            shared,
            &encode,
            &activations,
            &self.upstream,
            &mut gradients,
        );
        [out, gradients]
    }

    fn on_device(&self, gpu: &Gpu, block: usize) -> [Vec<f32>; 2] {
        let passes = Passes::new(gpu).expect("compiles");
        let buffers = NetworkBuffers::with_blocks(gpu, self.shape, self.rows, block).expect("fits");
        let buffer = |values: &[f32]| DeviceBuffer::of(gpu, "of a test", values).expect("fits");
        let weights = buffer(&self.weights);
        let gradients = buffer(&vec![7.0; self.weights.len()]);
        buffers.shared.write(gpu, 0, &self.shared);
        buffers.upstream.write(gpu, 0, &self.upstream);
        // Inputs come in as a product with the identity.
        let width = self.shape.row_inputs;
        let inputs = buffer(&self.inputs);
        let identity: Vec<f32> = (0..width * width)
            .map(|at| f32::from(at % width == at / width))
            .collect();
        let identity = buffer(&identity);
        let encode = |program: &mut Program, block: Block, out: &wgpu::Buffer| {
            let rows = Matrix::new(&inputs.raw, block.first * width, block.rows, width);
            let factors = (rows, Matrix::new(&identity.raw, 0, width, width));
            passes
                .products
                .record(gpu, program, factors, Destination::new(out, 0))
        };
        let mut program = Program::default();
        let mut recording = Recording {
            gpu,
            program: &mut program,
            weights: &weights.raw,
            encode: &encode,
        };
        passes.forward(&mut recording, &buffers).expect("records");
        passes
            .backward(&mut recording, &buffers, &gradients.raw)
            .expect("records");
        program.submit(gpu);
        [
            buffers.outputs.read(gpu).expect("reads"),
            gradients.read(gpu).expect("reads"),
        ]
    }
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
fn outputs_and_gradients_are_those_of_the_processor() {
    let Some(gpu) = test_device() else { return };
    for (shape, rows, block) in [
        (SMALL, 1, 64),
        (SMALL, 300, 4096),
        (SMALL, 300, 128),
        // More parts than one.
        (SMALL, 5000, 4096),
        (PUBLISHED, 150, 4096),
    ] {
        let case = Case::new(shape, rows);
        let [out, gradients] = case.on_device(&gpu, block);
        let [expected_out, expected] = case.on_processor();
        assert_close(&out, &expected_out, "output");
        assert_close(&gradients, &expected, "gradient");
    }
}

#[test]
fn nothing_goes_through() {
    let Some(gpu) = test_device() else { return };
    let [out, gradients] = Case::new(SMALL, 0).on_device(&gpu, 64);
    assert!(out.is_empty() && gradients.iter().all(|&gradient| gradient == 0.0));
}
