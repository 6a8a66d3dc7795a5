// Adam on all arrays of a table at once, one thread per value.

struct AdamStep {
    // Number of values of the trained arrays, without unused capacity.
    len: u32,
    arrays: u32,
    // 1 / sqrt(1 - beta2^t)
    inverse_root: f32,
    // Decay of second moments.
    beta_2: f32,
    // End of each array among these values, which a frozen array lacks, and its shift to its offset in the
    // table.
    ends: array<vec4<u32>, 4>,
    shifts: array<vec4<u32>, 4>,
    // Step size of each array, divided by 1 - beta1^t.
    rates: array<vec4<f32>, 4>,
    // Index of each array's counter of refused gradients.
    numbers: array<vec4<u32>, 4>,
}


@group(0) @binding(0) var<uniform> adam_step: AdamStep;
@group(0) @binding(1) var<storage, read_write> values: array<f32>;
@group(0) @binding(2) var<storage, read> gradients: array<f32>;
@group(0) @binding(3) var<storage, read_write> first_moments: array<f32>;
@group(0) @binding(4) var<storage, read_write> second_moments: array<f32>;
@group(0) @binding(5) var<storage, read_write> status: Status;

@compute @workgroup_size(256)
fn update(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let number_of_value = workgroup_number(group, groups) * WORKGROUP + thread;
    if number_of_value >= adam_step.len || status.halted != 0u {
        return;
    }
    var array_number = 0u;
    while array_number + 1u < adam_step.arrays
        && number_of_value >= adam_step.ends[array_number / 4u][array_number % 4u] {
        array_number++;
    }
    let index = number_of_value + adam_step.shifts[array_number / 4u][array_number % 4u];
    let rate = adam_step.rates[array_number / 4u][array_number % 4u];
    var g = gradients[index];
    // A gradient that is not finite counts as zero.
    if !is_finite(g) {
        let number = adam_step.numbers[array_number / 4u][array_number % 4u];
        atomicAdd(&status.refused[number], 1u);
        g = 0.0;
    }
    let m = BETA_1 * first_moments[index] + (1.0 - BETA_1) * g;
    let v = adam_step.beta_2 * second_moments[index] + (1.0 - adam_step.beta_2) * g * g;
    first_moments[index] = m;
    second_moments[index] = v;
    values[index] -= rate * m / (sqrt(v) * adam_step.inverse_root + EPSILON);
}
