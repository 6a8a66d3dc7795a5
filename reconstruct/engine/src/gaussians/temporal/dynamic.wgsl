// Dynamic Gaussians of a moment, drawn alone: copies in which all others have opacity 0.

@group(0) @binding(2) var<storage, read> gaussians: array<Gaussian>;
@group(0) @binding(3) var<storage, read> harmonics: array<f32>;
@group(0) @binding(4) var<storage, read_write> alone: array<Gaussian>;
@group(0) @binding(5) var<storage, read_write> alone_harmonics: array<f32>;
// One number: dynamic Gaussians that are drawn at all.
@group(0) @binding(6) var<storage, read_write> member_count: array<atomic<u32>>;

@group(0) @binding(1) var<storage, read> by_alone: array<Gaussian>;
@group(0) @binding(2) var<storage, read> by_alone_harmonics: array<f32>;
@group(0) @binding(3) var<storage, read_write> gaussian_gradients: array<Gaussian>;
@group(0) @binding(4) var<storage, read_write> harmonic_gradients: array<f32>;

@compute @workgroup_size(256)
fn gather_dynamic(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= temporal.len {
        return;
    }
    let entry = temporal.first + index;
    let copied = entry - temporal.first_alone;
    var gaussian = gaussians[entry];
    if is_dynamic(index) && gaussian.opacity > 0.0 {
        atomicAdd(&member_count[0], 1u);
    } else {
        gaussian.opacity = 0.0;
    }
    alone[copied] = gaussian;
    let stored = arrayLength(&harmonics) / arrayLength(&gaussians);
    for (var i = 0u; i < stored; i++) {
        alone_harmonics[copied * stored + i] = harmonics[entry * stored + i];
    }
}

// Adds the gradient by the copies to that by their originals; it is 0 for copies that are not drawn.
@compute @workgroup_size(256)
fn gather_dynamic_vjp(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= temporal.len {
        return;
    }
    let entry = temporal.first + index;
    let copied = entry - temporal.first_alone;
    let by = by_alone[copied];
    gaussian_gradients[entry].position += by.position;
    gaussian_gradients[entry].opacity += by.opacity;
    gaussian_gradients[entry].scale += by.scale;
    gaussian_gradients[entry].rotation += by.rotation;
    let stored = arrayLength(&harmonic_gradients) / arrayLength(&gaussian_gradients);
    for (var i = 0u; i < stored; i++) {
        harmonic_gradients[entry * stored + i] += by_alone_harmonics[copied * stored + i];
    }
}
