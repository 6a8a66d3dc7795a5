// Kernels of a network's passes other than products: shared inputs, and sums over rows and parts.

struct SharedInputs {
    // Inputs of the layer.
    inputs: u32,
    outputs: u32,
    // Offset of its weights of shared inputs, and of its biases.
    weights: u32,
    biases: u32,
}

struct RowSums {
    columns: u32,
    // Offset of the block's rows.
    begin: u32,
}

struct PartSums {
    // Length of a partial sum.
    len: u32,
    // Offset of the sum.
    out_begin: u32,
    // 1 to add to the existing values.
    is_added: u32,
}

@group(0) @binding(0) var<uniform> layer: SharedInputs;
@group(0) @binding(1) var<storage, read> shared_inputs: array<f32>;
@group(0) @binding(2) var<storage, read> weights: array<f32>;
@group(0) @binding(3) var<storage, read_write> offsets: array<f32>;

@group(0) @binding(2) var<storage, read_write> gradients: array<f32>;

@group(0) @binding(0) var<uniform> row_sums: RowSums;
@group(0) @binding(1) var<storage, read> rows: array<f32>;
@group(0) @binding(2) var<storage, read_write> parts: array<f32>;

@group(0) @binding(0) var<uniform> part_sums: PartSums;
@group(0) @binding(1) var<storage, read> summands: array<f32>;

// Shared by both sums.
@group(0) @binding(3) var<uniform> block: BlockRows;

// Contribution of biases and shared inputs to every row of a layer; one thread per output.
@compute @workgroup_size(256)
fn add_shared(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let output = workgroup_number(group, groups) * WORKGROUP + thread;
    if output >= layer.outputs {
        return;
    }
    var sum = weights[layer.biases + output];
    for (var input = 0u; input < layer.inputs; input++) {
        sum += shared_inputs[input] * weights[layer.weights + input * layer.outputs + output];
    }
    offsets[output] = sum;
}

// A shared input is the same for all rows, so that the gradient of its weight is the bias's times the input.
// One thread per weight.
@compute @workgroup_size(256)
fn shared_gradients(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let weight = workgroup_number(group, groups) * WORKGROUP + thread;
    if weight >= layer.inputs * layer.outputs {
        return;
    }
    let by_bias = gradients[layer.biases + weight % layer.outputs];
    gradients[layer.weights + weight] = shared_inputs[weight / layer.outputs] * by_bias;
}

// Column sums over each part of the rows, one part after another; one thread per part and column.
@compute @workgroup_size(256)
fn sum_rows(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= block.parts * row_sums.columns {
        return;
    }
    let part = index / row_sums.columns;
    let per_part = (block.rows + block.parts - 1u) / block.parts;
    let end = min(block.rows, (part + 1u) * per_part);
    var sum = 0.0;
    for (var row = part * per_part; row < end; row++) {
        sum += rows[row_sums.begin + row * row_sums.columns + index % row_sums.columns];
    }
    parts[index] = sum;
}

// Sum of all parts; one thread per value.
@compute @workgroup_size(256)
fn sum_parts(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= part_sums.len {
        return;
    }
    var sum = 0.0;
    for (var part = 0u; part < block.parts; part++) {
        sum += summands[part * part_sums.len + index];
    }
    let at = part_sums.out_begin + index;
    if part_sums.is_added != 0u {
        sum += gradients[at];
    }
    gradients[at] = sum;
}
