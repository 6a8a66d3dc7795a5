// Last kernels of a step: accumulation of its loss and of the statistics for density control.

@group(0) @binding(0) var<storage, read> loss: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> status: Status;
// Losses of the steps since the host cleared the status.
@group(0) @binding(2) var<storage, read_write> losses: array<vec4<f32>>;
// One number: the step's losses other than the photometric one.
@group(0) @binding(3) var<storage, read_write> terms: array<f32>;

@group(0) @binding(0) var<storage, read> partials: array<f32>;
@group(0) @binding(1) var<storage, read_write> sum_of_terms: array<f32>;

@group(0) @binding(1) var<storage, read> alone_loss: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> member_count: array<u32>;

@group(0) @binding(0) var<uniform> view: StepView;
@group(0) @binding(2) var<storage, read> splat_gradients: array<f32>;
// Statistics since the last densification: sums of the lengths of the gradients by the splats' centres, in
// normalized device coordinates, and number of views that saw the Gaussian.
@group(0) @binding(3) var<storage, read_write> gradient_sums: array<f32>;
@group(0) @binding(4) var<storage, read_write> view_counts: array<u32>;
// Gradients by the table, and sums of the absolute values of those by peak times.
@group(0) @binding(5) var<storage, read> gradients: array<f32>;
@group(0) @binding(6) var<storage, read_write> time_gradients: array<f32>;

struct StepView {
    // Number of Gaussians of the table, and index of the first among all activated ones.
    gaussians: u32,
    first: u32,
    // Half the image's width and height.
    half_size: vec2<f32>,
    // Offset of peak times in the table, in values; NO_PEAKS without them.
    peaks: u32,
}

const NO_PEAKS: u32 = 0xffffffffu;

// Sum of all partial sums, always in the same order.
fn sum_of_partials(thread: u32) -> f32 {
    var sum = 0.0;
    for (var index = thread; index < arrayLength(&partials); index += WORKGROUP) {
        sum += partials[index];
    }
    return workgroup_sum(sum, thread);
}

// Adds a loss from its partial sums.
@compute @workgroup_size(256)
fn add_term(@builtin(local_invocation_index) thread: u32) {
    let sum = sum_of_partials(thread);
    if thread == 0u {
        sum_of_terms[0] += sum;
    }
}

// Adds the losses of the dynamic Gaussians drawn alone, if there are any.
@compute @workgroup_size(256)
fn add_alone(@builtin(local_invocation_index) thread: u32) {
    let sum = sum_of_partials(thread);
    if thread == 0u && member_count[0] > 0u {
        terms[0] += sum + alone_loss[0].w;
    }
}

// Counts the step, unless its loss is not finite.
@compute @workgroup_size(1)
fn judge_loss() {
    if status.halted != RUNNING {
        return;
    }
    let total = loss[0].w + terms[0];
    if !is_finite(total) {
        status.halted = HALTED_DIVERGED;
        return;
    }
    losses[status.steps] = vec4(loss[0].xyz, total);
    status.steps += 1u;
}

@compute @workgroup_size(256)
fn add_statistics(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= view.gaussians || status.halted != RUNNING {
        return;
    }
    let first = (view.first + index) * SUMS;
    if splat_gradients[first] != 0.0 {
        let gradient = vec2(splat_gradients[first + 12u], splat_gradients[first + 13u]);
        gradient_sums[index] += length(gradient * view.half_size);
        view_counts[index] += 1u;
        if view.peaks != NO_PEAKS {
            time_gradients[index] += abs(gradients[view.peaks + index]);
        }
    }
}
