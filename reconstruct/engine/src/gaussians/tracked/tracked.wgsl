// Gaussians of rigid objects: placement at the objects' poses, its VJP, and bounds. Quaternions are (w, x, y, z).

struct TrackedRows {
    // Number of Gaussians, and index of the first among all activated ones.
    len: u32,
    first: u32,
    // Number of objects.
    objects: u32,
    // Offsets in the table, in values: centres in the objects' coordinates, and object numbers.
    positions: u32,
    numbers: u32,
}

// An object at a moment.
struct ObjectPlace {
    // The given pose: the object's axes to the world's, and the centre in normalized units.
    rotation: vec4<f32>,
    centre: vec3<f32>,
    // Unit of the object's coordinates.
    unit: f32,
    up: vec3<f32>,
    // Lever arm of the heading's corrections.
    lever: f32,
    // Largest offsets of its Gaussians from the centre, in the object's coordinates.
    limit: vec3<f32>,
    // Weight of the knot after the moment.
    share: f32,
    // Offset of the object's corrections, and number of their knots.
    first_correction: u32,
    knots: u32,
    // Knots before and after the moment.
    before: u32,
    after: u32,
    // 1 during the path.
    is_there: u32,
}

@group(0) @binding(0) var<uniform> tracked: TrackedRows;
@group(0) @binding(1) var<storage, read> objects: array<ObjectPlace>;
@group(0) @binding(2) var<storage, read> corrections: array<f32>;
@group(0) @binding(3) var<storage, read> values: array<f32>;
@group(0) @binding(4) var<storage, read_write> gaussians: array<Gaussian>;
@group(0) @binding(5) var<storage, read_write> gaussian_gradients: array<Gaussian>;
@group(0) @binding(6) var<storage, read_write> harmonic_gradients: array<f32>;
// Per Gaussian, its part of the gradient by the centre and, in w, by the heading of its object.
@group(0) @binding(7) var<storage, read_write> by_poses: array<vec4<f32>>;

@group(0) @binding(2) var<storage, read> summed_by_poses: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> correction_gradients: array<f32>;

// Values of the table, or corrections.
@group(0) @binding(2) var<storage, read_write> bounded: array<f32>;
@group(0) @binding(3) var<storage, read_write> status: Status;

fn object_number(value: f32) -> u32 {
    return min(u32(value), tracked.objects - 1u);
}

fn product(a: vec4<f32>, b: vec4<f32>) -> vec4<f32> {
    return vec4(
        a.x * b.x - dot(a.yzw, b.yzw),
        a.x * b.yzw + b.x * a.yzw + cross(a.yzw, b.yzw),
    );
}

fn rotated(rotation: vec4<f32>, vector: vec3<f32>) -> vec3<f32> {
    let twice = 2.0 * cross(rotation.yzw, vector);
    return vector + rotation.x * twice + cross(rotation.yzw, twice);
}

struct ObjectPose {
    rotation: vec4<f32>,
    centre: vec3<f32>,
}

fn correction_of_knot(object: ObjectPlace, knot: u32) -> vec4<f32> {
    let first = object.first_correction + knot * CORRECTION_VALUES;
    return vec4(
        corrections[first],
        corrections[first + 1u],
        corrections[first + 2u],
        corrections[first + 3u],
    );
}

// The given pose with its correction.
fn pose_of(object: ObjectPlace) -> ObjectPose {
    let before = correction_of_knot(object, object.before);
    let after = correction_of_knot(object, object.after);
    let correction = before + object.share * (after - before);
    let sine_cosine = sin_cos(0.5 * (correction.w / object.lever));
    let turn = vec4(sine_cosine.y, sine_cosine.x * object.up);
    return ObjectPose(product(turn, object.rotation), object.centre + correction.xyz);
}

// Places the activated Gaussians in the world.
@compute @workgroup_size(256)
fn place_objects(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= tracked.len {
        return;
    }
    let object = objects[object_number(values[tracked.numbers + index])];
    let entry = tracked.first + index;
    if object.is_there == 0u {
        gaussians[entry].opacity = 0.0;
        return;
    }
    let pose = pose_of(object);
    let gaussian = gaussians[entry];
    gaussians[entry] = Gaussian(
        rotated(pose.rotation, gaussian.position * object.unit) + pose.centre,
        gaussian.opacity,
        gaussian.scale * object.unit,
        product(pose.rotation, gaussian.rotation),
    );
}

// Leaves the gradients by the Gaussians in their objects' coordinates, and those Gaussians' rotations.
@compute @workgroup_size(256)
fn place_objects_vjp(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= tracked.len {
        return;
    }
    let object = objects[object_number(values[tracked.numbers + index])];
    let entry = tracked.first + index;
    if object.is_there == 0u {
        gaussian_gradients[entry] = Gaussian(vec3<f32>(), 0.0, vec3<f32>(), vec4<f32>());
        let stored = arrayLength(&harmonic_gradients) / arrayLength(&gaussian_gradients);
        for (var channel = 0u; channel < 3u; channel++) {
            harmonic_gradients[entry * stored + channel] = 0.0;
        }
        by_poses[index] = vec4<f32>();
        return;
    }
    let pose = pose_of(object);
    let gaussian = gaussians[entry];
    var by = gaussian_gradients[entry];
    let turned = product(vec4(0.0, 0.5 * object.up), gaussian.rotation);
    let by_heading = dot(by.position, cross(object.up, gaussian.position - pose.centre))
        + dot(by.rotation, turned);
    by_poses[index] = vec4(by.position, by_heading);
    let back = vec4(pose.rotation.x, -pose.rotation.yzw);
    by.position = rotated(back, by.position) * object.unit;
    by.rotation = product(back, by.rotation);
    gaussian_gradients[entry] = by;
    gaussians[entry].rotation = product(back, gaussian.rotation);
}

var<workgroup> pose_sums: array<vec4<f32>, WORKGROUP>;

// Gradient by the corrections of one object, always summed in the same order; one workgroup per object.
@compute @workgroup_size(256)
fn sum_by_object(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = workgroup_number(group, groups);
    var sum = vec4<f32>();
    for (var index = thread; index < tracked.len; index += WORKGROUP) {
        if object_number(values[tracked.numbers + index]) == number {
            sum += summed_by_poses[index];
        }
    }
    pose_sums[thread] = sum;
    workgroupBarrier();
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        if thread < half {
            pose_sums[thread] += pose_sums[thread + half];
        }
        workgroupBarrier();
    }
    if number >= tracked.objects {
        return;
    }
    let object = objects[number];
    let by_centre = pose_sums[0].xyz;
    let by = vec4(by_centre, pose_sums[0].w / object.lever);
    for (var value = thread; value < object.knots * CORRECTION_VALUES; value += WORKGROUP) {
        let knot = value / CORRECTION_VALUES;
        var gradient = 0.0;
        if knot == object.before {
            gradient += (1.0 - object.share) * by[value % CORRECTION_VALUES];
        }
        if knot == object.after {
            gradient += object.share * by[value % CORRECTION_VALUES];
        }
        correction_gradients[object.first_correction + value] = gradient;
    }
}

// Puts Gaussians back to the side of their object's box.
@compute @workgroup_size(256)
fn keep_in_boxes(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= tracked.len || status.halted != RUNNING {
        return;
    }
    let limit = objects[object_number(bounded[tracked.numbers + index])].limit;
    for (var axis = 0u; axis < 3u; axis++) {
        let place = tracked.positions + index * 3u + axis;
        let value = bounded[place];
        // A clamp may turn NaN into a number.
        bounded[place] = select(clamp(value, -limit[axis], limit[axis]), value, is_nan(value));
    }
}

// Subtracts the mean of each object's corrections; one thread per object and value of a correction.
@compute @workgroup_size(256)
fn fix_gauge(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = workgroup_number(group, groups) * WORKGROUP + thread;
    if number >= tracked.objects * CORRECTION_VALUES || status.halted != RUNNING {
        return;
    }
    let knots = objects[number / CORRECTION_VALUES].knots;
    let first = objects[number / CORRECTION_VALUES].first_correction + number % CORRECTION_VALUES;
    var sum = 0.0;
    for (var knot = 0u; knot < knots; knot++) {
        sum += bounded[first + knot * CORRECTION_VALUES];
    }
    let mean = sum / f32(knots);
    for (var knot = 0u; knot < knots; knot++) {
        bounded[first + knot * CORRECTION_VALUES] -= mean;
    }
}
