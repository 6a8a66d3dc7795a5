// Limit of sizes in training, one thread per Gaussian of a part, between its activation and the render: the twin of
// `size_limit.rs`.

@group(0) @binding(1) var<storage, read_write> gaussians: array<Gaussian>;
@group(0) @binding(2) var<storage, read_write> values: array<f32>;
@group(0) @binding(3) var<storage, read_write> first_moments: array<f32>;
@group(0) @binding(4) var<storage, read_write> status: Status;
@group(0) @binding(5) var<uniform> arrays: StaticArrays;

@compute @workgroup_size(256)
fn cut_sizes(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= arrays.len || status.halted != RUNNING {
        return;
    }
    let entry = arrays.first + index;
    let opacity = gaussians[entry].opacity;
    var scale = gaussians[entry].scale;
    let point = to_camera(gaussians[entry].position - view.centre);
    let distance = length(point);
    let is_too_large = max(max(scale.x, scale.y), scale.z) >= distance;
    if !is_too_large || !(opacity >= ALPHA_MIN) || !is_finite(distance) || !sees(point, distance) {
        return;
    }
    let limit = CUT_SHARE * distance;
    for (var axis = 0u; axis < 3u; axis++) {
        if scale[axis] > limit {
            let place = arrays.log_scales + index * 3u + axis;
            values[place] += log(limit / scale[axis]);
            first_moments[place] = 0.0;
            scale[axis] = limit;
        }
    }
    gaussians[entry].scale = scale;
}
