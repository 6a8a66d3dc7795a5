// What closes a training step: its loss is noted, and what density control goes by.

@group(0) @binding(0) var<storage, read> loss: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> status: Status;
// Losses of the steps since the host cleared the status.
@group(0) @binding(2) var<storage, read_write> losses: array<vec4<f32>>;

@group(0) @binding(0) var<uniform> view: StepView;
@group(0) @binding(2) var<storage, read> splat_gradients: array<f32>;
// Since the last densification: sums of the lengths of the gradients by the splats' centres, in
// normalized device coordinates, and how many views saw the Gaussian.
@group(0) @binding(3) var<storage, read_write> gradient_sums: array<f32>;
@group(0) @binding(4) var<storage, read_write> view_counts: array<u32>;

struct StepView {
    gaussians: u32,
    // Half the image's width and height.
    half_size: vec2<f32>,
}

// Counts the step, unless its loss is not finite.
@compute @workgroup_size(1)
fn judge_loss() {
    if status.halted != RUNNING {
        return;
    }
    if !is_finite(loss[0].w) {
        status.halted = HALTED_DIVERGED;
        return;
    }
    losses[status.steps] = loss[0];
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
    let first = index * SUMS;
    if splat_gradients[first] != 0.0 {
        let gradient = vec2(splat_gradients[first + 12u], splat_gradients[first + 13u]);
        gradient_sums[index] += length(gradient * view.half_size);
        view_counts[index] += 1u;
    }
}
