// Centres near their anchors: no gradient before they move, and bounds; one thread per Gaussian.

struct CentreBounds {
    // Number of Gaussians.
    len: u32,
    // Offset of the centres in the table, in values.
    positions: u32,
    // 1 once centres move.
    moves: u32,
    pad: u32,
}

@group(0) @binding(0) var<uniform> bounds: CentreBounds;
@group(0) @binding(1) var<storage, read_write> gradients: array<f32>;

// First position of each centre, and its maximum distance from there in w.
@group(0) @binding(1) var<storage, read> anchors: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> values: array<f32>;
@group(0) @binding(3) var<storage, read_write> first_moments: array<f32>;
@group(0) @binding(4) var<storage, read_write> status: Status;

// Clears the gradients by the centres until they move.
@compute @workgroup_size(256)
fn hold_centres(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= bounds.len || bounds.moves == 1u {
        return;
    }
    for (var axis = 0u; axis < 3u; axis++) {
        gradients[bounds.positions + index * 3u + axis] = 0.0;
    }
}

// Returns centres to their balls, and removes the outward part of their moments.
@compute @workgroup_size(256)
fn keep_near_anchors(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= bounds.len || status.halted != RUNNING {
        return;
    }
    let first = bounds.positions + index * 3u;
    let anchor = anchors[index];
    let away = vec3(values[first], values[first + 1u], values[first + 2u]) - anchor.xyz;
    let distance = length(away);
    if is_nan(distance) || distance <= anchor.w {
        return;
    }
    let outward = away / distance;
    let centre = anchor.xyz + outward * anchor.w;
    let along = vec3(first_moments[first], first_moments[first + 1u], first_moments[first + 2u]);
    // A negative moment is a step outward.
    let moment = along - outward * min(dot(along, outward), 0.0);
    for (var axis = 0u; axis < 3u; axis++) {
        values[first + axis] = centre[axis];
        first_moments[first + axis] = moment[axis];
    }
}
