// Backward pass with a thread per splat (Taming-3DGS, Faster-GS). Each thread adds up a splat's sums over the
// pixels of a tile in its registers, so that no sum is taken over threads. Thread i takes every 64th splat of
// the list, from number i on.
//
// A pixel needs its splats in order. The tile's pixels are therefore divided into as many slots as there are
// threads, and each thread is one slot behind the thread before it: at every moment each slot belongs to one
// thread, and reaches the splats in their order. The first thread follows the last one, with its next splat.
// State is kept for the pixels of one tile alone, in workgroup memory.

// Threads of a workgroup, and slots of a tile.
const LANES: u32 = 64u;
const PIXELS: u32 = TILE * TILE;
const PIXELS_OF_SLOT: u32 = PIXELS / LANES;

// Per pixel: transmittance, 0 once the pixel has stopped, and contribution of the splats behind.
var<workgroup> states: array<vec2<f32>, PIXELS>;
// [channel][pixel]: dL/dC.
var<workgroup> pixel_gradients: array<f32, CHANNELS * PIXELS>;

// Splat of a thread.
struct OwnSplat {
    splat: Splat,
    channels: array<f32, CHANNELS>,
    sums: array<f32, ENTRY_SUMS>,
}

@compute @workgroup_size(64)
fn composite_vjp(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let tile = workgroup_number(group, groups);
    if tile >= arrayLength(&tile_ranges) {
        return;
    }
    let range = tile_ranges[tile];
    for (var number = thread; number < PIXELS; number += LANES) {
        start_pixel(tile, number);
    }
    let rounds = (range.y - range.x + LANES - 1u) / LANES;
    // The last thread finishes its last splat LANES - 1 moments after the first one.
    let moments = min(rounds, 1u) * ((rounds + 1u) * LANES - 1u);
    var item = range.x + thread;
    var is_busy = false;
    var own: OwnSplat;
    for (var moment = 0u; moment < moments; moment++) {
        if moment % LANES == 0u && !any_alive(thread) {
            break;
        }
        let slot = (moment + LANES - thread) % LANES;
        if slot == 0u && item < range.y {
            is_busy = true;
            start_splat(items[item].x, &own);
        }
        if is_busy {
            for (var part = 0u; part < PIXELS_OF_SLOT; part++) {
                // Neighbouring threads have neighbouring pixels.
                add_pixel(tile, part * LANES + slot, &own);
            }
            if slot == LANES - 1u {
                write_sums(items[item].y, &own);
                is_busy = false;
                item += LANES;
            }
        }
        workgroupBarrier();
    }
    // All pixels have stopped: sums of splats that are under way are complete, those of others are zero.
    if is_busy {
        write_sums(items[item].y, &own);
        item += LANES;
    }
    own.sums = array<f32, ENTRY_SUMS>();
    for (; item < range.y; item += LANES) {
        write_sums(items[item].y, &own);
    }
}

fn start_pixel(tile: u32, number: u32) {
    let pixel = pixel_of(tile, number);
    var found = upstream_of(pixel);
    for (var channel = 0u; channel < CHANNELS; channel++) {
        pixel_gradients[channel * PIXELS + number] = found.by_channel[channel];
    }
    states[number] = vec2(f32(pixel.is_inside), found.behind);
    if pixel.is_inside {
        atomicAdd(&alive_count, 1u);
    }
}

fn start_splat(number: u32, own: ptr<function, OwnSplat>) {
    (*own).splat = splats[number];
    for (var channel = 0u; channel < CHANNELS; channel++) {
        (*own).channels[channel] = channels[number * CHANNELS + channel];
    }
    (*own).sums = array<f32, ENTRY_SUMS>();
}

// Moves a pixel behind a splat, and adds the pixel to the splat's sums.
fn add_pixel(tile: u32, number: u32, own: ptr<function, OwnSplat>) {
    let before = states[number];
    if before.x == 0.0 {
        return;
    }
    let at = geometry_of((*own).splat, pixel_of(tile, number));
    var transmittance = before.x;
    var alive = true;
    let drawn = blend((*own).splat.opacity, at.q, &transmittance, &alive);
    if !alive {
        states[number].x = 0.0;
        atomicSub(&alive_count, 1u);
        return;
    }
    if !(drawn.weight > 0.0) {
        return;
    }
    var along = 0.0;
    for (var channel = 0u; channel < CHANNELS; channel++) {
        let by_channel = pixel_gradients[channel * PIXELS + number];
        along += by_channel * (*own).channels[channel];
        (*own).sums[MOMENTS + 1u + channel] += drawn.weight * by_channel;
    }
    let behind = before.y - drawn.weight * along;
    states[number] = vec2(transmittance, behind);
    let by_alpha = before.x * along - behind / (1.0 - drawn.alpha);
    let by_log = by_alpha * drawn.unclamped;
    (*own).sums[0] += by_log;
    var added = moments_of((*own).splat, at, by_log);
    for (var moment = 0u; moment < ELLIPSE_MOMENTS; moment++) {
        (*own).sums[1u + moment] += added[moment];
    }
    if (*own).splat.shape == CONE {
        for (var moment = ELLIPSE_MOMENTS; moment < MOMENTS; moment++) {
            (*own).sums[1u + moment] += added[moment];
        }
    }
}

fn write_sums(entry: u32, own: ptr<function, OwnSplat>) {
    for (var i = 0u; i < ENTRY_SUMS; i++) {
        entry_sums[entry * ENTRY_SUMS + i] = (*own).sums[i];
    }
}
