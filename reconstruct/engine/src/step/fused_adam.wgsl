// One kernel from the gradients by splats to Adam, one thread per static Gaussian (Faster-GS): the gradients by
// Gaussians and by parameters never reach memory. It stands for `project_gaussians_vjp`, the VJP of the static
// activation and `update` of Adam, whose functions it shares.

@group(0) @binding(5) var<storage, read_write> values: array<f32>;
@group(0) @binding(6) var<storage, read_write> first_moments: array<f32>;
@group(0) @binding(7) var<storage, read_write> second_moments: array<f32>;
@group(0) @binding(8) var<storage, read_write> status: Status;
@group(0) @binding(9) var<uniform> arrays: StaticArrays;
@group(0) @binding(10) var<uniform> adam_step: AdamStep;

// True unless an array is frozen, or the whole table takes no step.
fn is_trained(array_number: u32) -> bool {
    var start = 0u;
    if array_number > 0u {
        start = adam_step.ends[(array_number - 1u) / 4u][(array_number - 1u) % 4u];
    }
    return adam_step.ends[array_number / 4u][array_number % 4u] > start;
}

fn train_value(array_number: u32, index: u32, gradient: f32) {
    if is_trained(array_number) {
        update_value(array_number, index, gradient);
    }
}

@compute @workgroup_size(256)
fn update_gaussians(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= view.gaussians || status.halted != RUNNING {
        return;
    }
    let gaussian = gaussians[index];
    let placed = place(gaussian);
    var by: DrawnGradient;
    if placed.is_seen && splat_gradients[index * SUMS] != 0.0 {
        by = drawn_gradient(index, gaussian, placed);
    }
    for (var axis = 0u; axis < 3u; axis++) {
        train_value(POSITIONS, arrays.positions + index * 3u + axis, by.gaussian.position[axis]);
        let by_log = by.gaussian.scale[axis] * gaussian.scale[axis];
        train_value(LOG_SCALES, arrays.log_scales + index * 3u + axis, by_log);
    }
    // d(q/|q|): remove the part along q, divide by the length.
    let first = arrays.quaternions + index * 4u;
    let raw = vec4(values[first], values[first + 1u], values[first + 2u], values[first + 3u]);
    let unit = gaussian.rotation;
    let across = by.gaussian.rotation - unit * dot(unit, by.gaussian.rotation);
    let by_raw = across / max(sqrt(dot(raw, raw)), LEAST_QUATERNION_LENGTH);
    for (var axis = 0u; axis < 4u; axis++) {
        train_value(QUATERNIONS, first + axis, by_raw[axis]);
    }
    let opacity = gaussian.opacity;
    let by_logit = by.gaussian.opacity * opacity * (1.0 - opacity);
    train_value(OPACITY_LOGITS, arrays.opacity_logits + index, by_logit);
    train_harmonics(index, &by);
}

fn train_harmonics(index: u32, by: ptr<function, DrawnGradient>) {
    for (var channel = 0u; channel < 3u; channel++) {
        let place_of_value = arrays.sh_constant + index * 3u + channel;
        train_value(SH_CONSTANT, place_of_value, SH_C0 * (*by).colour[channel]);
    }
    let drawn_rest = sh_count(view.sh_degree) - 1u;
    for (var i = 0u; i < arrays.stored_rest; i++) {
        let first = arrays.sh_rest + (index * arrays.stored_rest + i) * 3u;
        for (var channel = 0u; channel < 3u; channel++) {
            // Coefficients above the drawn degree have no gradient.
            var gradient = 0.0;
            if i < drawn_rest {
                gradient = (*by).basis[i] * (*by).colour[channel];
            }
            train_value(SH_REST, first + channel, gradient);
        }
    }
}
