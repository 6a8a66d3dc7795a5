// Opacity reset, one thread per Gaussian; clears the moments.

struct OpacityReset {
    // Offset of the opacity logits in the table, in values, and their number.
    begin: u32,
    len: u32,
    // Upper bound of the logits afterwards.
    largest: f32,
}

@group(0) @binding(0) var<uniform> reset: OpacityReset;
@group(0) @binding(1) var<storage, read_write> values: array<f32>;
@group(0) @binding(2) var<storage, read_write> first_moments: array<f32>;
@group(0) @binding(3) var<storage, read_write> second_moments: array<f32>;

@compute @workgroup_size(256)
fn reset_opacities(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = workgroup_number(group, groups) * WORKGROUP + thread;
    if number >= reset.len {
        return;
    }
    let index = reset.begin + number;
    // NaN is replaced by the bound, as on the CPU.
    let is_less = !is_nan(values[index]) && values[index] < reset.largest;
    values[index] = select(reset.largest, values[index], is_less);
    first_moments[index] = 0.0;
    second_moments[index] = 0.0;
}
