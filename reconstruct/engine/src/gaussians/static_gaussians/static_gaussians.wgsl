// The static parameterization: activation and its VJP, one thread per Gaussian.

@group(0) @binding(0) var<uniform> arrays: StaticArrays;
@group(0) @binding(1) var<storage, read> values: array<f32>;
@group(0) @binding(2) var<storage, read_write> gaussians: array<Gaussian>;
@group(0) @binding(3) var<storage, read_write> harmonics: array<f32>;

@group(0) @binding(3) var<storage, read> gaussian_gradients: array<Gaussian>;
@group(0) @binding(4) var<storage, read> harmonic_gradients: array<f32>;
@group(0) @binding(5) var<storage, read_write> gradients: array<f32>;

fn three(first: u32) -> vec3<f32> {
    return vec3(values[first], values[first + 1u], values[first + 2u]);
}

fn raw_rotation(index: u32) -> vec4<f32> {
    let first = arrays.quaternions + index * 4u;
    return vec4(values[first], values[first + 1u], values[first + 2u], values[first + 3u]);
}

fn quaternion_length(raw: vec4<f32>) -> f32 {
    return max(sqrt(dot(raw, raw)), LEAST_QUATERNION_LENGTH);
}

fn scale_of(raw: f32) -> f32 {
    // A clamp may turn NaN into a number, and the Gaussian would be drawn.
    return select(exp(clamp(raw, LOG_SCALE_MIN, LOG_SCALE_MAX)), raw, is_nan(raw));
}

@compute @workgroup_size(256)
fn activate(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= arrays.len {
        return;
    }
    let raw_scale = three(arrays.log_scales + index * 3u);
    let raw = raw_rotation(index);
    let entry = arrays.first + index;
    gaussians[entry] = Gaussian(
        three(arrays.positions + index * 3u),
        1.0 / (1.0 + exp(-values[arrays.opacity_logits + index])),
        vec3(scale_of(raw_scale.x), scale_of(raw_scale.y), scale_of(raw_scale.z)),
        raw / quaternion_length(raw),
    );
    let first = entry * (1u + arrays.rest) * 3u;
    for (var i = 0u; i < 3u; i++) {
        harmonics[first + i] = values[arrays.sh_constant + index * 3u + i];
    }
    for (var i = 0u; i < arrays.stored_rest * 3u; i++) {
        harmonics[first + 3u + i] = values[arrays.sh_rest + index * arrays.stored_rest * 3u + i];
    }
    for (var i = arrays.stored_rest * 3u; i < arrays.rest * 3u; i++) {
        harmonics[first + 3u + i] = 0.0;
    }
}

@compute @workgroup_size(256)
fn activate_vjp(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= arrays.len {
        return;
    }
    let entry = arrays.first + index;
    let gaussian = gaussians[entry];
    let by = gaussian_gradients[entry];
    for (var axis = 0u; axis < 3u; axis++) {
        gradients[arrays.positions + index * 3u + axis] = by.position[axis];
        gradients[arrays.log_scales + index * 3u + axis] = by.scale[axis] * gaussian.scale[axis];
    }
    // d(q/|q|): remove the part along q, divide by the length.
    let unit = gaussian.rotation;
    let along = dot(unit, by.rotation);
    let to_rotation = (by.rotation - unit * along) / quaternion_length(raw_rotation(index));
    for (var axis = 0u; axis < 4u; axis++) {
        gradients[arrays.quaternions + index * 4u + axis] = to_rotation[axis];
    }
    let opacity = gaussian.opacity;
    gradients[arrays.opacity_logits + index] = by.opacity * opacity * (1.0 - opacity);
    let first = entry * (1u + arrays.rest) * 3u;
    for (var i = 0u; i < 3u; i++) {
        gradients[arrays.sh_constant + index * 3u + i] = harmonic_gradients[first + i];
    }
    for (var i = 0u; i < arrays.stored_rest * 3u; i++) {
        gradients[arrays.sh_rest + index * arrays.stored_rest * 3u + i]
            = harmonic_gradients[first + 3u + i];
    }
}
