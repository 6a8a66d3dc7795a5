// Layers of rays, nearest first: colours, their loss, and gradients by the layers.

struct RayBatch {
    rays: u32,
    // Number of objects with a target for their opacity.
    objects: u32,
    // Weight of a channel's absolute error, and of an opacity's.
    colour_weight: f32,
    mask_weight: f32,
}

@group(0) @binding(0) var<uniform> batch: RayBatch;
// First hit of each ray, and the end of the last one.
@group(0) @binding(1) var<storage, read> begins: array<u32>;
// Layer and surface of each hit.
@group(0) @binding(2) var<storage, read> hits: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> layers: array<vec4<f32>>;

@group(0) @binding(4) var<storage, read_write> colours: array<vec4<f32>>;

// Colours, with an unused value.
@group(0) @binding(4) var<storage, read> targets: array<vec4<f32>>;
// Share of a ray that an object covers, below 0 if unknown.
@group(0) @binding(5) var<storage, read> covered: array<f32>;
@group(0) @binding(6) var<storage, read_write> by_layers: array<vec4<f32>>;
// Loss without that of missed objects, and mean squared error.
@group(0) @binding(7) var<storage, read_write> losses: array<vec2<f32>>;

@compute @workgroup_size(256)
fn compose(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let ray = workgroup_number(group, groups) * WORKGROUP + thread;
    if ray >= batch.rays {
        return;
    }
    var colour = vec3<f32>();
    var transmittance = 1.0;
    for (var hit = begins[ray]; hit < begins[ray + 1u]; hit++) {
        let layer = layers[hits[hit].x];
        colour += transmittance * layer.w * layer.xyz;
        transmittance *= 1.0 - layer.w;
    }
    colours[ray] = vec4(colour, 1.0 - transmittance);
}

// Losses of a ray, and the gradients by its layers without a division: an opaque layer has one too.
@compute @workgroup_size(256)
fn compose_vjp(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let ray = workgroup_number(group, groups) * WORKGROUP + thread;
    if ray >= batch.rays {
        return;
    }
    let begin = begins[ray];
    let end = begins[ray + 1u];
    var colour = vec3<f32>();
    var transmittance = 1.0;
    for (var hit = begin; hit < end; hit++) {
        let number = hits[hit].x;
        let layer = layers[number];
        // The colour behind a layer is known later.
        by_layers[number] = vec4(vec3(transmittance * layer.w), transmittance);
        colour += transmittance * layer.w * layer.xyz;
        transmittance *= 1.0 - layer.w;
    }
    let error = colour - targets[ray].xyz;
    let upstream = batch.colour_weight * sign(error);
    var loss = batch.colour_weight * dot(abs(error), vec3(1.0));
    var behind = vec3<f32>();
    for (var hit = end; hit > begin; hit--) {
        let number = hits[hit - 1u].x;
        let object = hits[hit - 1u].y;
        let layer = layers[number];
        let by = by_layers[number];
        var by_opacity = by.w * dot(upstream, layer.xyz - behind);
        behind = layer.w * layer.xyz + (1.0 - layer.w) * behind;
        if object < batch.objects {
            let share = covered[ray * batch.objects + object];
            if share >= 0.0 {
                let excess = layer.w - share;
                // The host counts an object as missed; here it is hit.
                loss += batch.mask_weight * (abs(excess) - share);
                by_opacity += batch.mask_weight * sign(excess);
            }
        }
        by_layers[number] = vec4(by.xyz * upstream, by_opacity);
    }
    losses[ray] = vec2(loss, dot(error, error) * batch.colour_weight);
}
