// Dropout of Gaussians: a step leaves out a share of them. The twin of dropout.rs.

@group(0) @binding(0) var<uniform> dropout: StepDropout;
@group(0) @binding(1) var<storage, read_write> gaussians: array<Gaussian>;
@group(0) @binding(2) var<storage, read_write> gradients: array<Gaussian>;

struct StepDropout {
    // Number of Gaussians.
    len: u32,
    // Hash of the seed and the iteration.
    step: u32,
    // Share that is dropped, in [0, 1).
    share: f32,
}

// PCG-RXS-M-XS of 32 bits (Jarzynski and Olano, JCGT 2020).
fn pcg(input: u32) -> u32 {
    let state = input * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

// Factor of an opacity: 0, or one over the share that is kept.
fn drawn_weight(entry: u32) -> f32 {
    let random = f32(pcg(entry ^ dropout.step) >> 8u) / 16777216.0;
    return select(1.0 / (1.0 - dropout.share), 0.0, random < dropout.share);
}

@compute @workgroup_size(256)
fn drop_out(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let entry = workgroup_number(group, groups) * WORKGROUP + thread;
    if entry < dropout.len {
        gaussians[entry].opacity *= drawn_weight(entry);
    }
}

// Turns gradients by the scaled opacities into those by the original ones, which it restores.
@compute @workgroup_size(256)
fn drop_out_vjp(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let entry = workgroup_number(group, groups) * WORKGROUP + thread;
    if entry >= dropout.len {
        return;
    }
    let weight = drawn_weight(entry);
    gradients[entry].opacity *= weight;
    if weight > 0.0 {
        gaussians[entry].opacity /= weight;
    }
}
