// Density control of Gaussians with their own times, and placement of the children of splits.

@group(0) @binding(1) var<storage, read> seen_by: array<u32>;
@group(0) @binding(2) var<storage, read> time_gradients: array<f32>;
@group(0) @binding(3) var<storage, read_write> time_keys: array<u32>;
@group(0) @binding(4) var<storage, read_write> time_items: array<u32>;

@group(0) @binding(3) var<storage, read> sorted_time_keys: array<u32>;
@group(0) @binding(4) var<storage, read> sorted_time_items: array<u32>;
@group(0) @binding(5) var<storage, read_write> grown_in_space: array<atomic<u32>>;

// Selects Gaussians with a large gradient of their peak time.
@compute @workgroup_size(256)
fn find_restless(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= decided.rows {
        return;
    }
    let seen = seen_by[index];
    let mean = time_gradients[index] / f32(max(seen, 1u));
    time_keys[index] = key_of_excess(seen, mean / decided.time_threshold);
    time_items[index] = index;
}

// Grows as many of them as there is room for, after those that grow already.
@compute @workgroup_size(256)
fn grow_in_time(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let rank = workgroup_number(group, groups) * WORKGROUP + thread;
    let room = density.room - atomicLoad(&grown_in_space[0]);
    if rank >= min(density.rows, room) || sorted_time_keys[rank] == NO_CANDIDATE {
        return;
    }
    let index = sorted_time_items[rank];
    if growth[index] != SPLIT {
        let is_short = is_at_least(density.clone_lifespan, lifespan_of(index));
        growth[index] = select(SPLIT, CLONE, is_short);
    }
}

// Places a child in space and time.
fn placed_child(index: u32, drawn: Child, parameters: TemporalParameters) -> Child {
    let log_scales = log_scales_of(index);
    var child = Child(
        scattered(index, drawn.position),
        parameters.peak,
        log_scales - SPLIT_SHRINK,
        0.0,
    );
    if density.has_times == 0u {
        return child;
    }
    let position = table_vector(temporal.positions, index);
    if is_at_most(largest_scale(log_scales), position, density.clone_size) {
        child.log_scales = log_scales;
    }
    if temporal.log_lifespans == NONE {
        return child;
    }
    var log_lifespan = values[temporal.log_lifespans + index];
    if temporal.peaks != NONE {
        child.peak = clamp(
            parameters.peak + drawn.peak * parameters.lifespan,
            -density.farthest_peak,
            density.farthest_peak,
        );
        let mean = parameters.velocity * steadiness_of(parameters.lifespan);
        child.position += mean * (child.peak - parameters.peak);
        if density.shortens == 1u && parameters.lifespan >= density.clone_lifespan {
            log_lifespan -= LIFESPAN_SHRINK;
        }
    }
    // A clamp may hide a NaN.
    let bounded = clamp(log_lifespan, temporal.log_least, temporal.log_largest);
    child.log_lifespan = select(bounded, log_lifespan, is_nan(log_lifespan));
    return child;
}

// True if a Gaussian is opaque enough at some time of the clip.
fn is_seen(opacity_logit: f32, parameters: TemporalParameters) -> bool {
    let distance = max(abs(parameters.peak) - density.half_clip, 0.0);
    let ratio = distance / parameters.lifespan;
    let opacity = 1.0 / (1.0 + exp(-opacity_logit));
    return is_at_least(opacity * exp(-0.5 * ratio * ratio), density.prune_opacity);
}
