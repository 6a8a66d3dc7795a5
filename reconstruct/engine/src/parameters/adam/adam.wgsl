// Adam on all arrays of a table at once, one thread per value.

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
    update_value(array_number, index, gradients[index]);
}
