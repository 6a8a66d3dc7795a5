// Deformation of canonical Gaussians by a network's outputs, and its VJP.

struct Canonical {
    // Number of Gaussians, and index of the first among all activated ones.
    len: u32,
    first: u32,
    // Offset of their positions in the table, in values.
    positions: u32,
    // Octaves of the encoding.
    octaves: u32,
    // Unit of length, normalized units.
    length_unit: f32,
}

@group(0) @binding(0) var<uniform> canonical: Canonical;
@group(0) @binding(1) var<storage, read> values: array<f32>;
@group(0) @binding(2) var<storage, read_write> inputs: array<f32>;
// Gaussians whose positions are encoded.
@group(0) @binding(3) var<uniform> block: BlockRows;

@group(0) @binding(1) var<storage, read> outputs: array<f32>;
@group(0) @binding(2) var<storage, read_write> gaussians: array<Gaussian>;
@group(0) @binding(3) var<storage, read_write> gaussian_gradients: array<Gaussian>;
@group(0) @binding(4) var<storage, read_write> upstream: array<f32>;

// Encoded positions, the network's inputs; one thread per Gaussian and octave, and one for the position
// itself.
@compute @workgroup_size(256)
fn encode_positions(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    let per_row = canonical.octaves + 1u;
    let row = index / per_row;
    if row >= block.rows {
        return;
    }
    let octave = index % per_row;
    let begin = canonical.positions + (block.first + row) * 3u;
    let to = row * 3u * (1u + 2u * canonical.octaves);
    for (var axis = 0u; axis < 3u; axis++) {
        let position = values[begin + axis] / canonical.length_unit;
        // 0 times NaN is NaN: one such Gaussian would reach the gradient by the weights of all.
        let value = select(0.0, position, is_finite(position));
        if octave == 0u {
            inputs[to + axis] = value;
        } else {
            let encoded = sin_cos(value * f32(1u << (octave - 1u)));
            let place = to + 3u + (octave - 1u) * 6u + axis;
            inputs[place] = encoded.x;
            inputs[place + 3u] = encoded.y;
        }
    }
}

fn three(first: u32) -> vec3<f32> {
    return vec3(outputs[first], outputs[first + 1u], outputs[first + 2u]);
}

// q/|q| + dq
fn deformed_quaternion(rotation: vec4<f32>, first: u32) -> vec4<f32> {
    return rotation + vec4(three(first + 3u), outputs[first + 6u]);
}

fn quaternion_length(q: vec4<f32>) -> f32 {
    return max(sqrt(dot(q, q)), LEAST_QUATERNION_LENGTH);
}

// Deforms the activated canonical Gaussians in place; one thread per Gaussian.
@compute @workgroup_size(256)
fn deform(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= canonical.len {
        return;
    }
    let unit = canonical.length_unit;
    let first = index * OUTPUTS;
    let entry = canonical.first + index;
    let gaussian = gaussians[entry];
    let scale = gaussian.scale + unit * three(first + 7u);
    let least = vec3(unit * LEAST_SCALE);
    let rotation = deformed_quaternion(gaussian.rotation, first);
    gaussians[entry] = Gaussian(
        gaussian.position + unit * three(first),
        gaussian.opacity,
        // `max` may replace a NaN scale by the least one, and draw it.
        select(scale, least, scale < least),
        rotation / quaternion_length(rotation),
    );
}

// Turns gradients by the deformed Gaussians into those by the outputs and by the canonical Gaussians, which
// `gaussians` holds; one thread per Gaussian.
@compute @workgroup_size(256)
fn deform_vjp(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= canonical.len {
        return;
    }
    let unit = canonical.length_unit;
    let first = index * OUTPUTS;
    let entry = canonical.first + index;
    let gaussian = gaussians[entry];
    var by = gaussian_gradients[entry];
    let scale = gaussian.scale + unit * three(first + 7u);
    by.scale = select(by.scale, vec3<f32>(), scale < vec3(unit * LEAST_SCALE));
    // d(p/|p|): remove the part along p, divide by the length.
    let sum = deformed_quaternion(gaussian.rotation, first);
    let length = quaternion_length(sum);
    let along = dot(sum / length, by.rotation);
    by.rotation = (by.rotation - sum / length * along) / length;
    gaussian_gradients[entry] = by;
    var is_usable = true;
    for (var i = 0u; i < 3u; i++) {
        is_usable = is_usable && is_finite(by.position[i]) && is_finite(by.scale[i]);
    }
    for (var i = 0u; i < 4u; i++) {
        is_usable = is_usable && is_finite(by.rotation[i]);
    }
    // A Gaussian without a finite gradient does not contribute to that of the weights.
    for (var i = 0u; i < 3u; i++) {
        upstream[first + i] = select(0.0, unit * by.position[i], is_usable);
        upstream[first + 7u + i] = select(0.0, unit * by.scale[i], is_usable);
    }
    for (var i = 0u; i < 4u; i++) {
        upstream[first + 3u + i] = select(0.0, by.rotation[i], is_usable);
    }
}
