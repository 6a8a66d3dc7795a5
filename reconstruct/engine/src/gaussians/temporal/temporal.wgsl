// Motion and fading of activated Gaussians at a moment, after the static activation, and its VJP.

@group(0) @binding(2) var<storage, read_write> gaussians: array<Gaussian>;
@group(0) @binding(3) var<storage, read_write> features: array<f32>;

@group(0) @binding(2) var<storage, read> gaussian_gradients: array<Gaussian>;
@group(0) @binding(3) var<storage, read> feature_gradients: array<f32>;
// Gradients by the table; those of the static activation are already there, those by opacities are replaced.
@group(0) @binding(4) var<storage, read_write> gradients: array<f32>;

@group(0) @binding(1) var<storage, read_write> bounded: array<f32>;
@group(0) @binding(2) var<storage, read_write> status: Status;

@compute @workgroup_size(256)
fn activate_temporal(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= temporal.len {
        return;
    }
    let parameters = parameters_of(index);
    let mean_velocity = parameters.velocity * steadiness_of(parameters.lifespan);
    let entry = temporal.first + index;
    gaussians[entry].position += parameters.velocity * vibration(DRAWN, parameters.peak).x
        + mean_velocity * temporal.shift;
    gaussians[entry].opacity *= drawn_marginal(marginal_of(parameters));
    var channel = entry * temporal.channels;
    if temporal.velocity_unit > 0.0 {
        for (var axis = 0u; axis < 3u; axis++) {
            features[channel + axis] = mean_velocity[axis] / temporal.velocity_unit;
        }
        channel += 3u;
    }
    if temporal.lifespan_unit > 0.0 {
        let shown = min(parameters.lifespan, temporal.lifespan_largest);
        features[channel] = shown / temporal.lifespan_unit;
    }
}

@compute @workgroup_size(256)
fn activate_temporal_vjp(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= temporal.len {
        return;
    }
    let entry = temporal.first + index;
    let by = gaussian_gradients[entry];
    let parameters = parameters_of(index);
    let marginal = marginal_of(parameters);
    let drawn = drawn_marginal(marginal);
    let opacity = 1.0 / (1.0 + exp(-values[temporal.opacity_logits + index]));
    gradients[temporal.opacity_logits + index] = by.opacity * drawn * opacity * (1.0 - opacity);
    let by_marginal = select(0.0, by.opacity * opacity, drawn > 0.0);

    var by_mean = by.position * temporal.shift;
    var by_log_lifespan = 0.0;
    var channel = entry * temporal.channels;
    if temporal.velocity_unit > 0.0 {
        for (var axis = 0u; axis < 3u; axis++) {
            by_mean[axis] += feature_gradients[channel + axis] / temporal.velocity_unit;
        }
        channel += 3u;
    }
    if temporal.lifespan_unit > 0.0 && parameters.lifespan < temporal.lifespan_largest {
        by_log_lifespan += feature_gradients[channel] * parameters.lifespan / temporal.lifespan_unit;
    }

    let amplitude_slope = vibration(DRAWN, parameters.peak);
    let steadiness = steadiness_of(parameters.lifespan);
    // d exp(-rho/2) / d ln beta
    if steadiness > 0.0 {
        by_log_lifespan -= 0.5 * staticness_of(parameters.lifespan) * steadiness
            * dot(parameters.velocity, by_mean);
    }
    var by_peak = -amplitude_slope.y * dot(parameters.velocity, by.position);
    // If the exponential underflows to 0, so do its derivatives, even if the ratio is infinite.
    if marginal > 0.0 {
        let ratio = distance_from_peak(DRAWN, parameters.peak) / parameters.lifespan;
        by_peak += by_marginal * marginal * ratio / parameters.lifespan;
        by_log_lifespan += by_marginal * marginal * ratio * ratio;
    }
    let by_velocity = by.position * amplitude_slope.x + by_mean * steadiness;
    set_raw(index, raw_vjp(index, TemporalGradient(by_peak, by_log_lifespan, by_velocity)));
}

fn set_raw(index: u32, raw: RawTemporalGradient) {
    if temporal.peaks != NONE {
        gradients[temporal.peaks + index] = raw.peak;
    }
    if temporal.log_lifespans != NONE {
        gradients[temporal.log_lifespans + index] = raw.log_lifespan;
    }
    for (var axis = 0u; axis < 3u; axis++) {
        if temporal.velocities != NONE {
            gradients[temporal.velocities + index * 3u + axis] = raw.velocity[axis];
        }
        if temporal.tangential_velocities != NONE {
            gradients[temporal.tangential_velocities + index * 3u + axis]
                = raw.tangential_velocity[axis];
        }
    }
}

// Clamps lifespans to their bounds.
@compute @workgroup_size(256)
fn keep_within_bounds(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= temporal.len || temporal.log_lifespans == NONE || status.halted != RUNNING {
        return;
    }
    let place = temporal.log_lifespans + index;
    bounded[place] = clamp(bounded[place], temporal.log_least, temporal.log_largest);
}
