// Losses on rendered feature maps, one thread per pixel (see maps.rs). Each adds its weighted value to a
// sum per workgroup and writes its gradient into the planes of the gradient by the image.

struct MapLosses {
    pixels: u32,
    // Number of pixels that count.
    counted: f32,
    // Number of leading velocity planes: 3 or 0.
    velocity_planes: u32,
    // 1 if velocities are not penalized inside the mask.
    masked: u32,
    // Weights; 0 disables a loss for a view.
    velocity_weight: f32,
    lifespan_weight: f32,
    opacity_weight: f32,
}

@group(0) @binding(0) var<uniform> maps: MapLosses;
// Colour (HWC), then transmittance, then feature planes.
@group(0) @binding(1) var<storage, read> image: array<f32>;
// 8 bits per channel, the highest byte is the mask; then a bit per pixel, set if it is ignored.
@group(0) @binding(2) var<storage, read> target_image: array<u32>;
@group(0) @binding(3) var<storage, read_write> upstream: array<f32>;
@group(0) @binding(4) var<storage, read_write> partials: array<f32>;

fn mask_of(pixel: u32) -> f32 {
    return unpack4x8unorm(target_image[pixel]).w;
}

fn is_ignored(pixel: u32) -> bool {
    return ((target_image[maps.pixels + pixel / 32u] >> (pixel % 32u)) & 1u) == 1u;
}

// Index in an image of a pixel's value in a feature plane.
fn feature_at(plane: u32, pixel: u32) -> u32 {
    return (4u + plane) * maps.pixels + pixel;
}

fn store_sum(value: f32, number: u32, thread: u32) {
    let sum = workgroup_sum(value, thread);
    if thread == 0u && number < arrayLength(&partials) {
        partials[number] = sum;
    }
}

// Velocities (Omni4DGS Eq. 9, PVG) and lifespans (PVG) of all Gaussians.
@compute @workgroup_size(256)
fn temporal_maps(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = workgroup_number(group, groups);
    let pixel = number * WORKGROUP + thread;
    var value = 0.0;
    if pixel < maps.pixels && is_ignored(pixel) {
        for (var plane = 0u; plane < maps.velocity_planes; plane++) {
            upstream[feature_at(plane, pixel)] = 0.0;
        }
        if maps.lifespan_weight > 0.0 {
            upstream[feature_at(maps.velocity_planes, pixel)] = 0.0;
        }
    } else if pixel < maps.pixels {
        // Without `max` a compiler may add the two constants first, whose rounding is a thousandth of OPACITY_EPSILON.
        let opacity = max(1.0 - image[3u * maps.pixels + pixel], 0.0) + OPACITY_EPSILON;
        let kept = select(1.0, 1.0 - mask_of(pixel), maps.masked == 1u);
        let by_velocity = maps.velocity_weight / (3.0 * maps.counted) * kept / opacity;
        for (var plane = 0u; plane < maps.velocity_planes; plane++) {
            let place = feature_at(plane, pixel);
            let velocity = image[place];
            value += by_velocity * abs(velocity);
            upstream[place] = by_velocity * sign(velocity);
        }
        if maps.lifespan_weight > 0.0 {
            let place = feature_at(maps.velocity_planes, pixel);
            let by_lifespan = maps.lifespan_weight / maps.counted / opacity;
            value -= by_lifespan * image[place];
            upstream[place] = -by_lifespan;
        }
    }
    store_sum(value, number, thread);
}

// Opacity of the dynamic Gaussians drawn alone, compared with the mask (Omni4DGS Eq. 6).
@compute @workgroup_size(256)
fn opacity_map(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = workgroup_number(group, groups);
    let pixel = number * WORKGROUP + thread;
    var value = 0.0;
    if pixel < maps.pixels {
        let place = feature_at(0u, pixel);
        let scale = select(maps.opacity_weight / maps.counted, 0.0, is_ignored(pixel));
        let error = image[place] - mask_of(pixel);
        value = scale * abs(error);
        upstream[place] = scale * sign(error);
    }
    store_sum(value, number, thread);
}
