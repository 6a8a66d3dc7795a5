// Motion regularization of static Gaussians (Omni4DGS Eqs. 10 and 11), one thread per Gaussian.

// One number: static Gaussians.
@group(0) @binding(2) var<storage, read_write> static_count: array<atomic<u32>>;

@group(0) @binding(2) var<storage, read> all_static: array<u32>;
// Gradients by the table, which are added to.
@group(0) @binding(3) var<storage, read_write> gradients: array<f32>;
// Partial sums of the loss, one per workgroup.
@group(0) @binding(4) var<storage, read_write> partials: array<f32>;

// Settings of the loss.
@group(0) @binding(5) var<uniform> motion: MotionWeight;

struct MotionWeight {
    // Weight of one Gaussian, or the sum of those of all static ones.
    weight: f32,
    // Not 0 if the loss is on the Gaussians alone that the view shows, each with the weight.
    seen_alone: u32,
}

@compute @workgroup_size(256)
fn count_static(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index < temporal.len && !is_dynamic(index) {
        atomicAdd(&static_count[0], 1u);
    }
}

// Adds one Gaussian's gradients; returns its weighted |d(t + Dt) - d(t)|^2, with Dt = 1 frame.
fn motion_of(index: u32, scale: f32) -> f32 {
    let parameters = parameters_of(index);
    let centre = table_vector(temporal.positions, index) - temporal.observer;
    let vibrations = array(
        vibration(IMAGE, parameters.peak),
        vibration(NEXT, parameters.peak),
    );
    let before = centre + parameters.velocity * vibrations[0].x;
    let after = centre + parameters.velocity * vibrations[1].x;
    let near = length(before);
    let far = length(after);
    if !(near > LEAST_DISTANCE && far > LEAST_DISTANCE) {
        return 0.0;
    }
    let d_before = before / near;
    let d_after = after / far;
    let step = parameters.velocity * (vibrations[1].x - vibrations[0].x);
    let farther = dot(step, before + after) / (near + far);
    let change = (step - d_before * farther) / far;
    let value = scale * dot(change, change);
    let turn = 2.0 * scale * cross(centre, step) / (near * far);
    let by_after = -cross(d_after, turn) / far;
    let by_before = cross(d_before, turn) / near;
    let by_centre = cross(d_before * (farther / (near * far)) - change / far, turn);
    let by_peak = -dot(
        parameters.velocity,
        vibrations[0].y * by_before + vibrations[1].y * by_after,
    );
    let by_velocity = by_before * vibrations[0].x + by_after * vibrations[1].x;
    let raw = raw_vjp(index, TemporalGradient(by_peak, 0.0, by_velocity));
    if temporal.peaks != NONE {
        gradients[temporal.peaks + index] += raw.peak;
    }
    for (var axis = 0u; axis < 3u; axis++) {
        gradients[temporal.positions + index * 3u + axis] += by_centre[axis];
        if temporal.velocities != NONE {
            gradients[temporal.velocities + index * 3u + axis] += raw.velocity[axis];
        }
        if temporal.tangential_velocities != NONE {
            gradients[temporal.tangential_velocities + index * 3u + axis]
                += raw.tangential_velocity[axis];
        }
    }
    return value;
}

@compute @workgroup_size(256)
fn regularize_motion(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = workgroup_number(group, groups);
    let index = number * WORKGROUP + thread;
    var value = 0.0;
    if index < temporal.len && !is_dynamic(index) {
        if motion.seen_alone == 0u {
            value = motion_of(index, motion.weight / f32(max(all_static[0], 1u)));
        } else if gradients[temporal.opacity_logits + index] != 0.0 {
            value = motion_of(index, motion.weight);
        }
    }
    let sum = workgroup_sum(value, thread);
    if thread == 0u && number < arrayLength(&partials) {
        partials[number] = sum;
    }
}
