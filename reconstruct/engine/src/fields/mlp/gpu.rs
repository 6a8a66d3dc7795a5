//! A network's passes on a GPU; the twin of `passes.rs`.
//!
//! Rows go through the layers in blocks that bound the memory of activations. A single block keeps them for
//! the backward pass; several blocks are evaluated once more. Sums over rows are divided into parts that are
//! added in order: a device reproduces the same bits. Buffers and programs are sized for the capacity.

use crate::device::{
    DeviceBuffer, Gpu, GpuError, Kernel, Program, Shader, Threads, Uniform, wgsl_struct,
};
use crate::fields::mlp::{
    blocks_gpu::{Block, BlockPass, Blocks, PARTS},
    network::{Layer, NetworkShape},
    product_gpu::{Destination, Finish, Matrix, Over, Products},
};

/// Rows of a block: 64 MiB of activations per layer of 256.
const BLOCK: usize = 1 << 16;

wgsl_struct! {
    /// Location of a layer's weights of shared inputs.
    pub(crate) struct SharedInputs {
        inputs: u32,
        outputs: u32,
        weights: u32,
        biases: u32,
    }

    /// Rows of a block whose columns are summed.
    pub(crate) struct RowSums {
        columns: u32,
        begin: u32,
    }

    /// Partial sums to add up.
    pub(crate) struct PartSums {
        len: u32,
        out_begin: u32,
        is_added: u32,
    }
}

pub(crate) fn shader() -> Shader {
    Shader {
        file: "passes.wgsl",
        constants: String::new(),
        parts: &[
            include_str!("../../device/common.wgsl"),
            include_str!("block.wgsl"),
            include_str!("passes.wgsl"),
        ],
    }
}

/// The kernels of both passes.
#[derive(Debug)]
pub(crate) struct Passes {
    products: Products,
    add_shared: Kernel,
    shared_gradients: Kernel,
    sum_rows: Kernel,
    sum_parts: Kernel,
}

/// Buffers of a network's passes.
#[derive(Debug)]
pub(crate) struct NetworkBuffers {
    shape: NetworkShape,
    layers: Vec<Layer>,
    blocks: Blocks,
    /// Capacity in rows, and rows of its largest block.
    room: [usize; 2],
    /// False if other networks overwrite the activations between both passes.
    keeps_activations: bool,
    /// Inputs that all rows share; the host sets them.
    pub(crate) shared: DeviceBuffer<f32>,
    pub(crate) outputs: DeviceBuffer<f32>,
    /// Gradients by the outputs.
    pub(crate) upstream: DeviceBuffer<f32>,
    /// Inputs of a block's rows.
    inputs: DeviceBuffer<f32>,
    /// Outputs of the hidden layers, for a block.
    hidden: Vec<DeviceBuffer<f32>>,
    /// Contribution of biases and shared inputs, layer by layer.
    offsets: Vec<DeviceBuffer<f32>>,
    /// Gradients by a layer's outputs and by those of the previous layer, for a block.
    by_output: [DeviceBuffer<f32>; 2],
    parts: DeviceBuffer<f32>,
}

impl NetworkBuffers {
    /// Allocates buffers for a capacity of `room` rows, without rows.
    pub(crate) fn new(gpu: &Gpu, shape: NetworkShape, room: usize) -> Result<Self, GpuError> {
        Self::with_blocks(gpu, shape, room, BLOCK)
    }

    fn with_blocks(
        gpu: &Gpu,
        shape: NetworkShape,
        room: usize,
        largest_block: usize,
    ) -> Result<Self, GpuError> {
        assert!(
            shape.has_biases || shape.shared_inputs == 0,
            "gradients by shared inputs are those by biases"
        );
        let layers = shape.layers();
        let blocks = Blocks::new(gpu, room, largest_block)?;
        let block_rows = blocks.largest();
        let zeros = |label, len| DeviceBuffer::zeros(gpu, label, len);
        let layer = |label| zeros(label, block_rows * shape.width);
        let matrix = |layer: &Layer| {
            layer
                .hidden_weights()
                .len()
                .max(layer.row_weights().len())
                .max(layer.outputs)
        };
        let largest = layers.iter().map(matrix).max().unwrap_or(0);
        Ok(Self {
            shared: zeros("shared inputs", shape.shared_inputs)?,
            outputs: zeros("outputs of the network", room * shape.outputs)?,
            upstream: zeros("gradients by the network's outputs", room * shape.outputs)?,
            inputs: zeros("inputs of rows", block_rows * shape.row_inputs)?,
            hidden: (0..shape.depth)
                .map(|_| layer("outputs of a layer"))
                .collect::<Result<_, GpuError>>()?,
            offsets: offsets(gpu, &layers)?,
            by_output: [
                layer("gradients by a layer's outputs")?,
                layer("gradients by a layer's inputs")?,
            ],
            parts: zeros("parts of gradients", PARTS * largest)?,
            room: [room, largest_block],
            keeps_activations: true,
            shape,
            layers,
            blocks,
        })
    }

    /// Creates buffers of another network, which is not larger in any size, for other rows in the memory of these.
    /// Outputs and gradients by them hold until the next network's pass, and activations are evaluated once more
    /// for the backward pass.
    pub(crate) fn sharing(&self, gpu: &Gpu, shape: NetworkShape) -> Result<Self, GpuError> {
        let sizes = |shape: &NetworkShape| {
            let NetworkShape {
                row_inputs,
                shared_inputs,
                depth,
                width,
                outputs,
                ..
            } = *shape;
            [row_inputs, shared_inputs, depth, width, outputs]
        };
        let mut pairs = sizes(&shape).into_iter().zip(sizes(&self.shape));
        assert!(
            pairs.all(|(size, room)| size <= room),
            "{shape:?} in {:?}",
            self.shape
        );
        let layers = shape.layers();
        Ok(Self {
            shared: self.shared.clone(),
            outputs: self.outputs.clone(),
            upstream: self.upstream.clone(),
            inputs: self.inputs.clone(),
            hidden: self.hidden[..shape.depth].to_vec(),
            offsets: offsets(gpu, &layers)?,
            by_output: self.by_output.clone(),
            parts: self.parts.clone(),
            room: self.room,
            keeps_activations: false,
            blocks: Blocks::new(gpu, self.room[0], self.room[1])?,
            shape,
            layers,
        })
    }

    /// Sets the number of rows for everything that is submitted later.
    pub(crate) fn place(&self, gpu: &Gpu, rows: usize) {
        self.blocks.place(gpu, rows, self.keeps_activations);
    }

    fn hidden(&self, index: usize, block: &Block) -> Matrix<'_> {
        Matrix::new(&self.hidden[index].raw, 0, block.room, self.shape.width)
    }

    fn inputs(&self, block: &Block) -> Matrix<'_> {
        Matrix::new(&self.inputs.raw, 0, block.room, self.shape.row_inputs)
    }
}

/// Callback that records the writing of a block's inputs to the start of a buffer.
pub(crate) type Encode<'a> =
    dyn Fn(&mut Program, (&Block, &BlockPass), &wgpu::Buffer) -> Result<(), GpuError> + 'a;

/// Context in which the commands of a pass are recorded.
pub(crate) struct Recording<'a> {
    pub(crate) gpu: &'a Gpu,
    pub(crate) program: &'a mut Program,
    pub(crate) weights: &'a wgpu::Buffer,
    pub(crate) encode: &'a Encode<'a>,
}

impl Passes {
    pub(crate) fn new(gpu: &Gpu) -> Result<Self, GpuError> {
        let [add_shared, shared_gradients, sum_rows, sum_parts] = Kernel::compile(
            gpu,
            &shader(),
            ["add_shared", "shared_gradients", "sum_rows", "sum_parts"],
        )?;
        Ok(Self {
            products: Products::new(gpu)?,
            add_shared,
            shared_gradients,
            sum_rows,
            sum_parts,
        })
    }

    /// Records the evaluation of all rows.
    pub(crate) fn forward(
        &self,
        to: &mut Recording<'_>,
        buffers: &NetworkBuffers,
    ) -> Result<(), GpuError> {
        for (layer, offsets) in buffers.layers.iter().zip(&buffers.offsets) {
            // Without biases, offsets stay 0.
            if !buffers.shape.has_biases {
                break;
            }
            let uniform = shared_inputs(to.gpu, layer)?;
            to.program.run(
                to.gpu,
                &self.add_shared,
                layer.outputs,
                &[&uniform.raw, &buffers.shared.raw, to.weights, &offsets.raw],
            );
        }
        for block in buffers.blocks.iter() {
            self.forward_block(to, buffers, (block, &block.once))?;
        }
        Ok(())
    }

    fn forward_block(
        &self,
        to: &mut Recording<'_>,
        buffers: &NetworkBuffers,
        (block, pass): (&Block, &BlockPass),
    ) -> Result<(), GpuError> {
        (to.encode)(to.program, (block, pass), &buffers.inputs.raw)?;
        let over = Over::Rows(block, pass);
        for (index, layer) in buffers.layers.iter().enumerate() {
            let offsets = &buffers.offsets[index].raw;
            let out = match buffers.hidden.get(index) {
                Some(hidden) => Destination {
                    finish: Finish::OffsetAndClip(offsets),
                    ..Destination::new(&hidden.raw, 0)
                },
                None => Destination {
                    finish: Finish::Offset(offsets),
                    ..Destination::new(&buffers.outputs.raw, block.first * layer.outputs)
                },
            };
            let weights = |begin, rows| Matrix::new(to.weights, begin, rows, layer.outputs);
            let of_hidden = weights(layer.hidden_weights().start, layer.hidden_inputs);
            let of_rows = weights(layer.row_weights().start, layer.row_inputs);
            let inputs = (buffers.inputs(block), of_rows);
            let Some(before) = index.checked_sub(1) else {
                self.products
                    .record(to.gpu, to.program, over, inputs, out)?;
                continue;
            };
            let hidden = (buffers.hidden(before, block), of_hidden);
            if layer.row_inputs == 0 {
                self.products
                    .record(to.gpu, to.program, over, hidden, out)?;
                continue;
            }
            let unfinished = Destination {
                finish: Finish::Plain,
                ..out
            };
            self.products
                .record(to.gpu, to.program, over, hidden, unfinished)?;
            let rest = Destination {
                is_added: true,
                ..out
            };
            self.products
                .record(to.gpu, to.program, over, inputs, rest)?;
        }
        Ok(())
    }

    /// Records the gradients by the weights, after [`Passes::forward`]: overwrites `gradients`, and
    /// `by_inputs`, if given, with those by the inputs of all rows.
    pub(crate) fn backward(
        &self,
        to: &mut Recording<'_>,
        buffers: &NetworkBuffers,
        gradients: &wgpu::Buffer,
        by_inputs: Option<&wgpu::Buffer>,
    ) -> Result<(), GpuError> {
        let are_there = buffers.keeps_activations && buffers.blocks.iter().count() == 1;
        for block in buffers.blocks.iter() {
            if !are_there {
                self.forward_block(to, buffers, (block, &block.again))?;
            }
            self.backward_block(to, buffers, block, (gradients, by_inputs))?;
        }
        for layer in buffers
            .layers
            .iter()
            .filter(|layer| layer.shared_inputs > 0)
        {
            let uniform = shared_inputs(to.gpu, layer)?;
            to.program.run(
                to.gpu,
                &self.shared_gradients,
                layer.shared_inputs * layer.outputs,
                &[&uniform.raw, &buffers.shared.raw, gradients],
            );
        }
        Ok(())
    }

    fn backward_block(
        &self,
        to: &mut Recording<'_>,
        buffers: &NetworkBuffers,
        block: &Block,
        (gradients, by_inputs): (&wgpu::Buffer, Option<&wgpu::Buffer>),
    ) -> Result<(), GpuError> {
        let mut is_added = false;
        let depth = buffers.shape.depth;
        let [mut by_output, mut by_input] = [&buffers.by_output[0].raw, &buffers.by_output[1].raw];
        for (index, layer) in buffers.layers.iter().enumerate().rev() {
            let (buffer, begin) = if index == depth {
                (&buffers.upstream.raw, block.first * layer.outputs)
            } else {
                (by_output, 0)
            };
            let gradient = Matrix::new(buffer, begin, block.room, layer.outputs);
            if buffers.shape.has_biases {
                self.sum_rows(to, buffers, block, (buffer, begin), (gradients, layer))?;
            }
            if layer.row_inputs > 0 {
                let factors = (buffers.inputs(block).transposed(), gradient);
                let begin = layer.row_weights().start;
                self.sum_products(to, buffers, block, factors, (gradients, begin))?;
                if let Some(by_inputs) = by_inputs {
                    let weights = Matrix::new(to.weights, begin, layer.row_inputs, layer.outputs);
                    let out = Destination {
                        is_added,
                        ..Destination::new(by_inputs, block.first * layer.row_inputs)
                    };
                    let factors = (gradient, weights.transposed());
                    let over = Over::Rows(block, &block.once);
                    self.products
                        .record(to.gpu, to.program, over, factors, out)?;
                    is_added = true;
                }
            }
            let Some(before) = index.checked_sub(1) else {
                break;
            };
            let hidden = buffers.hidden(before, block);
            let begin = layer.hidden_weights().start;
            let factors = (hidden.transposed(), gradient);
            self.sum_products(to, buffers, block, factors, (gradients, begin))?;
            let weights = Matrix::new(to.weights, begin, layer.hidden_inputs, layer.outputs);
            let out = if index == depth { by_output } else { by_input };
            let masked = Destination {
                finish: Finish::Mask(&buffers.hidden[before].raw),
                ..Destination::new(out, 0)
            };
            let factors = (gradient, weights.transposed());
            let over = Over::Rows(block, &block.once);
            self.products
                .record(to.gpu, to.program, over, factors, masked)?;
            if index < depth {
                std::mem::swap(&mut by_output, &mut by_input);
            }
        }
        Ok(())
    }

    /// Records the gradients by a layer's biases.
    fn sum_rows(
        &self,
        to: &mut Recording<'_>,
        buffers: &NetworkBuffers,
        block: &Block,
        (rows, begin): (&wgpu::Buffer, usize),
        (gradients, layer): (&wgpu::Buffer, &Layer),
    ) -> Result<(), GpuError> {
        let sums = RowSums {
            columns: layer.outputs as u32,
            begin: begin as u32,
        };
        let sums = Uniform::of(to.gpu, "sums over rows", &sums)?;
        to.program.run(
            to.gpu,
            &self.sum_rows,
            Threads::ForRows(&block.parts, layer.outputs),
            &[&sums.raw, rows, &buffers.parts.raw, &block.uniform.raw],
        );
        let gradients = (gradients, layer.biases().start);
        self.sum_parts(to, buffers, block, layer.outputs, gradients)
    }

    /// Records a product over a block's rows, as a sum of parts.
    fn sum_products(
        &self,
        to: &mut Recording<'_>,
        buffers: &NetworkBuffers,
        block: &Block,
        factors: (Matrix<'_>, Matrix<'_>),
        gradients: (&wgpu::Buffer, usize),
    ) -> Result<(), GpuError> {
        let len = factors.0.product_len(factors.1);
        let (over, parts) = (Over::Sum(block), Destination::new(&buffers.parts.raw, 0));
        self.products
            .record(to.gpu, to.program, over, factors, parts)?;
        self.sum_parts(to, buffers, block, len, gradients)
    }

    fn sum_parts(
        &self,
        to: &mut Recording<'_>,
        buffers: &NetworkBuffers,
        block: &Block,
        len: usize,
        (gradients, begin): (&wgpu::Buffer, usize),
    ) -> Result<(), GpuError> {
        let sums = PartSums {
            len: len as u32,
            out_begin: begin as u32,
            is_added: (block.first > 0).into(),
        };
        let sums = Uniform::of(to.gpu, "sums of parts", &sums)?;
        to.program.run(
            to.gpu,
            &self.sum_parts,
            Threads::ForRows(&block.is_used, len),
            &[&sums.raw, &buffers.parts.raw, gradients, &block.uniform.raw],
        );
        Ok(())
    }
}

/// Allocates a value for each output of each layer.
fn offsets(gpu: &Gpu, layers: &[Layer]) -> Result<Vec<DeviceBuffer<f32>>, GpuError> {
    let offsets = |layer: &Layer| DeviceBuffer::zeros(gpu, "offsets of a layer", layer.outputs);
    layers.iter().map(offsets).collect()
}

fn shared_inputs(gpu: &Gpu, layer: &Layer) -> Result<Uniform<SharedInputs>, GpuError> {
    let shared = SharedInputs {
        inputs: layer.shared_inputs as u32,
        outputs: layer.outputs as u32,
        weights: layer.shared_weights().start as u32,
        biases: layer.biases().start as u32,
    };
    Uniform::of(gpu, "shared inputs of a layer", &shared)
}

#[cfg(test)]
mod tests;
