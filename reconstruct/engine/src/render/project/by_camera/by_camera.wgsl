// Gradient by a camera's pose (see by_camera.rs), one thread per Gaussian; sums per workgroup.

const SH_C0: f32 = 0.2820948;

@group(0) @binding(1) var<storage, read> gaussians: array<Gaussian>;
@group(0) @binding(2) var<storage, read> harmonics: array<f32>;
@group(0) @binding(3) var<storage, read> gaussian_gradients: array<Gaussian>;
@group(0) @binding(4) var<storage, read> harmonic_gradients: array<f32>;
// Partial sums per workgroup: by the rotation, by the centre.
@group(0) @binding(5) var<storage, read_write> partials: array<PoseGradient>;

struct PoseGradient {
    rotation: vec3<f32>,
    centre: vec3<f32>,
}

var<workgroup> sums: array<PoseGradient, WORKGROUP>;

fn by_harmonic(index: u32, coefficient: u32) -> vec3<f32> {
    let at = (index * sh_count(view.stored_sh_degree) + coefficient) * 3u;
    return vec3(harmonic_gradients[at], harmonic_gradients[at + 1u], harmonic_gradients[at + 2u]);
}

fn harmonic(index: u32, coefficient: u32) -> vec3<f32> {
    let at = (index * sh_count(view.stored_sh_degree) + coefficient) * 3u;
    return vec3(harmonics[at], harmonics[at + 1u], harmonics[at + 2u]);
}

// Part of the gradient by the centre that comes from the direction in which harmonics are evaluated.
fn through_direction(index: u32, offset: vec3<f32>) -> vec3<f32> {
    let by_colour = by_harmonic(index, 0u) / SH_C0;
    if view.sh_degree == 0u || all(by_colour == vec3<f32>()) {
        return vec3<f32>();
    }
    let distance = length(offset);
    let direction = offset / distance;
    var by_values: array<f32, 15>;
    for (var k = 1u; k < sh_count(view.sh_degree); k++) {
        by_values[k - 1u] = dot(by_colour, harmonic(index, k));
    }
    let by_direction = basis_vjp(view.sh_degree, direction, by_values);
    return (by_direction - direction * dot(by_direction, direction)) / distance;
}

fn of_one(index: u32) -> PoseGradient {
    let by = gaussian_gradients[index];
    let offset = gaussians[index].position - view.centre;
    let torque = cross(offset, by.position - through_direction(index, offset));
    // Products e_i (x) q, component by component; quaternions are (w, x, y, z).
    let q = gaussians[index].rotation;
    let h = by.rotation;
    let twist = 0.5 * vec3(
        -q.y * h.x + q.x * h.y - q.w * h.z + q.z * h.w,
        -q.z * h.x + q.w * h.y + q.x * h.z - q.y * h.w,
        -q.w * h.x - q.z * h.y + q.y * h.z + q.x * h.w,
    );
    return PoseGradient(-(torque + twist), -by.position);
}

fn is_finite_sum(one: PoseGradient) -> bool {
    // A sum is finite only if all of its terms are.
    let sum = abs(one.rotation) + abs(one.centre);
    return is_finite(sum.x + sum.y + sum.z);
}

@compute @workgroup_size(256)
fn pose_gradient(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = workgroup_number(group, groups);
    let index = number * WORKGROUP + thread;
    var mine = PoseGradient();
    if index < view.gaussians {
        let one = of_one(index);
        // Values that are not finite are counted where the gradient is applied to the Gaussian.
        if is_finite_sum(one) {
            mine = one;
        }
    }
    sums[thread] = mine;
    workgroupBarrier();
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        if thread < half {
            sums[thread].rotation += sums[thread + half].rotation;
            sums[thread].centre += sums[thread + half].centre;
        }
        workgroupBarrier();
    }
    if thread == 0u && number < arrayLength(&partials) {
        partials[number] = sums[0];
    }
}
