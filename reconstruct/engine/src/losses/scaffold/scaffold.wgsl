// Loss on the distances of centres from a fused surface (PanoGS, Eq. 9): adds its gradient; one thread per
// Gaussian.

struct ScaffoldLoss {
    // Origin of the field, and side of a voxel.
    origin: vec3<f32>,
    voxel: f32,
    // Number of Gaussians, and offset of their centres in the table, in values.
    len: u32,
    positions: u32,
    // Slots of the hash table of blocks, a power of two, less 1.
    last_slot: u32,
    // Offset of the opacities in the table, in values.
    opacities: u32,
    // Centres with a loss: 0 for none, 1 for all, 2 for those with a gradient by their opacity.
    takes_part: u32,
}

@group(0) @binding(0) var<uniform> scaffold: ScaffoldLoss;
@group(0) @binding(1) var<storage, read> values: array<f32>;
// Hash table: a block and its number; -1 in an empty slot.
@group(0) @binding(2) var<storage, read> blocks: array<vec4<i32>>;
// Mean distances at the voxels of each block; UNKNOWN where no view observed one.
@group(0) @binding(3) var<storage, read> distances: array<f32>;
@group(0) @binding(4) var<storage, read_write> gradients: array<f32>;
// Weight of each centre, per scene unit.
@group(0) @binding(5) var<storage, read> weights: array<f32>;

fn first_slot(block: vec3<i32>) -> u32 {
    let parts = bitcast<vec3<u32>>(block) * vec3(HASH_X, HASH_Y, HASH_Z);
    return (parts.x ^ parts.y ^ parts.z) & scaffold.last_slot;
}

// Number of a block; -1 for one that no view reached.
fn block_number(block: vec3<i32>) -> i32 {
    var slot = first_slot(block);
    for (var tried = 0u; tried <= scaffold.last_slot; tried++) {
        let found = blocks[slot];
        if found.w < 0 || all(found.xyz == block) {
            return found.w;
        }
        slot = (slot + 1u) & scaffold.last_slot;
    }
    return -1;
}

fn between(a: f32, b: f32, share: f32) -> f32 {
    return a + share * (b - a);
}

// Distance in w and its gradient by the point; UNKNOWN in w if one of the eight voxels was not observed.
fn field_at(place: vec3<f32>) -> vec4<f32> {
    let unknown = vec4(0.0, 0.0, 0.0, UNKNOWN);
    let scaled = (place - scaffold.origin) / scaffold.voxel - 0.5;
    let base = floor(scaled);
    for (var axis = 0u; axis < 3u; axis++) {
        // Beyond this, f32 cannot resolve voxels and i32 cannot count them.
        if !is_finite(base[axis]) || abs(base[axis]) >= 1e8 {
            return unknown;
        }
    }
    let fraction = scaled - base;
    let first = vec3<i32>(base);
    var corners: array<f32, 8>;
    var block = first >> vec3<u32>(BLOCK_BITS);
    var number = block_number(block);
    for (var corner = 0u; corner < 8u; corner++) {
        let voxel = first + vec3<i32>(vec3(corner & 1u, (corner >> 1u) & 1u, corner >> 2u));
        let own = voxel >> vec3<u32>(BLOCK_BITS);
        if any(own != block) {
            block = own;
            number = block_number(block);
        }
        if number < 0 {
            return unknown;
        }
        let local = vec3<u32>(voxel & vec3<i32>(BLOCK_SIDE - 1));
        let side = u32(BLOCK_SIDE);
        let distance = distances[u32(number) * side * side * side
            + local.x + side * (local.y + side * local.z)];
        if distance >= UNKNOWN {
            return unknown;
        }
        corners[corner] = distance;
    }
    let a = between(corners[0], corners[1], fraction.x);
    let b = between(corners[2], corners[3], fraction.x);
    let c = between(corners[4], corners[5], fraction.x);
    let d = between(corners[6], corners[7], fraction.x);
    let near = between(a, b, fraction.y);
    let far = between(c, d, fraction.y);
    let by_x = between(
        between(corners[1] - corners[0], corners[3] - corners[2], fraction.y),
        between(corners[5] - corners[4], corners[7] - corners[6], fraction.y),
        fraction.z,
    );
    let by_y = between(b - a, d - c, fraction.z);
    return vec4(
        vec3(by_x, by_y, far - near) / scaffold.voxel,
        between(near, far, fraction.z),
    );
}

// Derivative of Huber's loss of a signed distance, quadratic within `width` of 0.
fn huber_slope(distance: f32, width: f32) -> f32 {
    return select(sign(distance), distance / width, abs(distance) <= width);
}

@compute @workgroup_size(256)
fn add_scaffold(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= scaffold.len || scaffold.takes_part == 0u {
        return;
    }
    if scaffold.takes_part == 2u && gradients[scaffold.opacities + index] == 0.0 {
        return;
    }
    let centre = scaffold.positions + index * 3u;
    let field = field_at(vec3(values[centre], values[centre + 1u], values[centre + 2u]));
    if field.w >= UNKNOWN {
        return;
    }
    let slope = huber_slope(field.w, HUBER_VOXELS * scaffold.voxel);
    let by_centre = field.xyz * (weights[index] * slope);
    for (var axis = 0u; axis < 3u; axis++) {
        gradients[centre + axis] += by_centre[axis];
    }
}
