// Rasterization: one workgroup per tile, one thread per pixel.

@group(0) @binding(1) var<storage, read> tile_ranges: array<vec2<u32>>;
// Tile lists one after another: splat and entry.
@group(0) @binding(2) var<storage, read> items: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read> rays: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read> splats: array<Splat>;
// Of every splat: colour, then features.
@group(0) @binding(5) var<storage, read> channels: array<f32>;
// The rendered image: colour (HWC, background included), then the transmittance, then the feature
// planes. A gradient by it is laid out in the same way; that of the transmittance is not looked at.
@group(0) @binding(6) var<storage, read_write> image: array<f32>;

@group(0) @binding(6) var<storage, read> rendered: array<f32>;
@group(0) @binding(7) var<storage, read> upstream: array<f32>;
// Sums over a splat's pixels in a tile, ENTRY_SUMS per entry: of dL/d(ln alpha), ten of its moments
// that the shape asks for (see `moments_of`), by the channels.
@group(0) @binding(8) var<storage, read_write> entry_sums: array<f32>;

// By rank, near to far.
@group(0) @binding(1) var<storage, read> sorted_keys: array<u32>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> entry_starts: array<u32>;
@group(0) @binding(5) var<storage, read> all_entry_sums: array<f32>;
// SUMS per splat; see project.wgsl.
@group(0) @binding(6) var<storage, read_write> splat_gradients: array<f32>;

fn pixel_count() -> u32 {
    return view.width * view.height;
}

// A thread's pixel.
struct Pixel {
    column: u32,
    row: u32,
    index: u32,
    is_inside: bool,
}

// Where a pixel's value of a channel stands in an image.
fn place_of(pixel: u32, channel: u32) -> u32 {
    return select((channel + 1u) * pixel_count() + pixel, pixel * 3u + channel, channel < 3u);
}

fn pixel_of(tile: u32, thread: u32) -> Pixel {
    let columns = (view.width + TILE - 1u) / TILE;
    let column = (tile % columns) * TILE + thread % TILE;
    let row = (tile / columns) * TILE + thread / TILE;
    return Pixel(
        column,
        row,
        row * view.width + column,
        column < view.width && row < view.height,
    );
}

// What q is made of in a pixel.
struct Geometry {
    q: f32,
    // Ellipse: offset along the row from the row's middle, and offset in rows from the centre.
    // Cone: f_1.r, f_2.r.
    offset: vec2<f32>,
    // Cone: the ray, l, N and l^2 + eps N.
    ray: vec3<f32>,
    along: f32,
    n: f32,
    denominator: f32,
}

fn geometry_of(splat: Splat, pixel: Pixel) -> Geometry {
    if splat.shape == ELLIPSE {
        var offset = vec2(f32(pixel.column), f32(pixel.row)) + 0.5 - splat.centre;
        if view.camera == ERP {
            // The short way around the seam.
            let width = f32(view.width);
            offset.x -= width * (f32(offset.x > 0.5 * width) - f32(offset.x < -0.5 * width));
        }
        offset.x -= splat.first.y * offset.y;
        let q = offset.x * offset.x * splat.first.x + offset.y * offset.y * splat.first.z;
        return Geometry(q, offset, vec3<f32>(), 0.0, 0.0, 0.0);
    }
    let ray = ray_through(pixel.column, pixel.row);
    let offset = vec2(dot(splat.first, ray), dot(splat.second, ray));
    let along = max(dot(splat.third, ray), 0.0);
    let n = dot(offset, offset);
    let denominator = along * along + splat.depth_variance * n;
    // Infinite behind the camera: there alpha is zero.
    var q = 1e30;
    if n < 1e4 * denominator {
        q = n / denominator;
    }
    return Geometry(q, offset, ray, along, n, denominator);
}

// The moments of dL/d(ln alpha) that a splat's shape asks for. Ellipse: x, y, x^2, xy, y^2. Cone:
// with D = l^2 + eps N, dq/dN = l^2 / D^2, dq/dl = -2 l N / D^2, dq/deps = -N^2 / D^2.
fn moments_of(splat: Splat, at: Geometry, by_log: f32) -> array<f32, MOMENTS> {
    if splat.shape == ELLIPSE {
        let x = by_log * at.offset.x;
        let y = by_log * at.offset.y;
        return array(x, y, x * at.offset.x, y * at.offset.x, y * at.offset.y, 0.0, 0.0, 0.0, 0.0, 0.0);
    }
    let by_square = by_log / (at.denominator * at.denominator);
    let by_n = -by_square * at.along * at.along;
    let by_first = by_n * at.offset.x * at.ray;
    let by_second = by_n * at.offset.y * at.ray;
    let by_third = by_square * at.n * at.along * at.ray;
    return array(
        by_first.x,
        by_first.y,
        by_first.z,
        by_second.x,
        by_second.y,
        by_second.z,
        by_third.x,
        by_third.y,
        by_third.z,
        0.5 * by_square * at.n * at.n,
    );
}

// What a splat does in a pixel.
struct Blend {
    alpha: f32,
    // Before the clamp at 0.99, which the gradient ignores.
    unclamped: f32,
    // T alpha
    weight: f32,
}

// Blends a splat into a pixel unless the pixel has to stop before it.
fn blend(
    splat: Splat,
    pixel: Pixel,
    transmittance: ptr<function, f32>,
    alive: ptr<function, bool>,
) -> Blend {
    if !*alive {
        return Blend();
    }
    let unclamped = splat.opacity * exp(-0.5 * geometry_of(splat, pixel).q);
    let alpha = min(unclamped, ALPHA_MAX);
    if alpha < ALPHA_MIN {
        return Blend();
    }
    let next = *transmittance * (1.0 - alpha);
    if next < TRANSMITTANCE_MIN {
        *alive = false;
        return Blend();
    }
    let weight = *transmittance * alpha;
    *transmittance = next;
    return Blend(alpha, unclamped, weight);
}

// Moments of dL/d(ln alpha) that a shape asks for, at most.
const MOMENTS: u32 = 10u;
// Splats that a workgroup loads together.
const BATCH: u32 = 64u;

var<workgroup> batch_splats: array<Splat, BATCH>;
var<workgroup> batch_channels: array<f32, BATCH * CHANNELS>;
var<workgroup> alive_count: atomic<u32>;
var<workgroup> alive_at_start: u32;

// Whether any pixel of the tile still takes splats; the same in all threads.
fn any_alive(thread: u32) -> bool {
    workgroupBarrier();
    if thread == 0u {
        alive_at_start = atomicLoad(&alive_count);
    }
    return workgroupUniformLoad(&alive_at_start) > 0u;
}

@compute @workgroup_size(256)
fn composite(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let tile = workgroup_number(group, groups);
    if tile >= arrayLength(&tile_ranges) {
        return;
    }
    let range = tile_ranges[tile];
    let pixel = pixel_of(tile, thread);
    var alive = pixel.is_inside;
    if alive {
        atomicAdd(&alive_count, 1u);
    }
    var transmittance = 1.0;
    var sums: array<f32, CHANNELS>;
    for (var begin = range.x; begin < range.y; begin += BATCH) {
        if !any_alive(thread) {
            break;
        }
        let end = min(BATCH, range.y - begin);
        if thread < end {
            batch_splats[thread] = splats[items[begin + thread].x];
        }
        for (var value = thread; value < end * CHANNELS; value += WORKGROUP) {
            let number = items[begin + value / CHANNELS].x;
            batch_channels[value] = channels[number * CHANNELS + value % CHANNELS];
        }
        workgroupBarrier();
        let was_alive = alive;
        for (var i = 0u; i < end && alive; i++) {
            let drawn = blend(batch_splats[i], pixel, &transmittance, &alive);
            if drawn.weight > 0.0 {
                for (var channel = 0u; channel < CHANNELS; channel++) {
                    sums[channel] += drawn.weight * batch_channels[i * CHANNELS + channel];
                }
            }
        }
        if was_alive && !alive {
            atomicSub(&alive_count, 1u);
        }
    }
    if !pixel.is_inside {
        return;
    }
    for (var channel = 0u; channel < 3u; channel++) {
        image[place_of(pixel.index, channel)] = sums[channel] + transmittance * view.background[channel];
    }
    image[3u * pixel_count() + pixel.index] = transmittance;
    for (var channel = 3u; channel < CHANNELS; channel++) {
        image[place_of(pixel.index, channel)] = sums[channel];
    }
}

// Backward. Pixels walk the list together, a few splats a round: every thread leaves what its pixel
// has to say about each of them, then the threads share out the sums over pixels. No sum depends on
// the order in which threads run.
const ROUND: u32 = 4u;
// Splats after which a tile looks whether any of its pixels takes more.
const LOOK_INTERVAL: u32 = 64u;
// Threads that sum up one splat.
const LANES: u32 = WORKGROUP / ROUND;
// Sums taken at once.
const SUMS_AT_ONCE: u32 = 6u;
// Pieces into which the lanes' sums are cut.
const PIECES: u32 = 8u;

// [splat of the round][pixel]: T alpha and dL/d(ln alpha).
var<workgroup> contributions: array<vec2<f32>, ROUND * WORKGROUP>;
// [sum][splat of the round][lane]
var<workgroup> lane_sums: array<f32, SUMS_AT_ONCE * WORKGROUP>;
// [sum][splat of the round][piece]
var<workgroup> piece_sums: array<f32, SUMS_AT_ONCE * ROUND * PIECES>;

@compute @workgroup_size(256)
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
    let pixel = pixel_of(tile, thread);
    var alive = pixel.is_inside;
    if alive {
        atomicAdd(&alive_count, 1u);
    }
    var transmittance = 1.0;
    // What the splats behind and the background contribute to g . C.
    var behind = 0.0;
    var g: array<f32, CHANNELS>;
    if pixel.is_inside {
        for (var channel = 0u; channel < CHANNELS; channel++) {
            let place = place_of(pixel.index, channel);
            g[channel] = upstream[place];
            behind += g[channel] * rendered[place];
        }
    }
    let summed_splat = thread / LANES;
    let lane = thread % LANES;
    for (var begin = range.x; begin < range.y; begin += ROUND) {
        if (begin - range.x) % LOOK_INTERVAL == 0u && !any_alive(thread) {
            break;
        }
        let was_alive = alive;
        for (var i = 0u; i < ROUND; i++) {
            var contribution = vec2<f32>();
            if begin + i < range.y && alive {
                let number = items[begin + i].x;
                let splat = splats[number];
                let before = transmittance;
                let drawn = blend(splat, pixel, &transmittance, &alive);
                if drawn.weight > 0.0 {
                    var along = 0.0;
                    for (var channel = 0u; channel < CHANNELS; channel++) {
                        along += g[channel] * channels[number * CHANNELS + channel];
                    }
                    behind -= drawn.weight * along;
                    let by_alpha = before * along - behind / (1.0 - drawn.alpha);
                    contribution = vec2(drawn.weight, by_alpha * drawn.unclamped);
                }
            }
            contributions[i * WORKGROUP + thread] = contribution;
        }
        if was_alive && !alive {
            atomicSub(&alive_count, 1u);
        }
        workgroupBarrier();

        let item = begin + summed_splat;
        var splat: Splat;
        if item < range.y {
            splat = splats[items[item].x];
        }
        var by_log_sum = 0.0;
        var moments: array<f32, MOMENTS>;
        for (var i = 0u; i < ROUND; i++) {
            let summed = i * LANES + lane;
            let by_log = contributions[summed_splat * WORKGROUP + summed].y;
            if by_log != 0.0 {
                let summed_pixel = pixel_of(tile, summed);
                let added = moments_of(splat, geometry_of(splat, summed_pixel), by_log);
                by_log_sum += by_log;
                for (var moment = 0u; moment < MOMENTS; moment++) {
                    moments[moment] += added[moment];
                }
            }
        }
        let first_sums = array(
            by_log_sum, moments[0], moments[1], moments[2], moments[3], moments[4],
        );
        add_up(thread, first_sums, begin, range.y, 0u, SUMS_AT_ONCE);
        if any_cone(begin, range.y) {
            let more_sums = array(
                moments[5], moments[6], moments[7], moments[8], moments[9], 0.0,
            );
            add_up(thread, more_sums, begin, range.y, SUMS_AT_ONCE, MOMENTS + 1u - SUMS_AT_ONCE);
        }
        for (var first = 0u; first < CHANNELS; first += SUMS_AT_ONCE) {
            let here = min(SUMS_AT_ONCE, CHANNELS - first);
            var sums: array<f32, SUMS_AT_ONCE>;
            for (var i = 0u; i < ROUND; i++) {
                let summed = pixel_of(tile, i * LANES + lane);
                let weight = contributions[summed_splat * WORKGROUP + i * LANES + lane].x;
                if weight > 0.0 {
                    for (var channel = 0u; channel < here; channel++) {
                        sums[channel] += weight * upstream[place_of(summed.index, first + channel)];
                    }
                }
            }
            add_up(thread, sums, begin, range.y, MOMENTS + 1u + first, here);
        }
    }
}

// Whether a splat of the round is a cone: only they have more than five moments.
fn any_cone(begin: u32, list_end: u32) -> bool {
    var any = false;
    for (var item = begin; item < min(begin + ROUND, list_end); item++) {
        any = any || splats[items[item].x].shape == CONE;
    }
    return any;
}

// Adds up the lanes' sums and writes them as sums number `first` and following of the entries.
fn add_up(
    thread: u32,
    sums: array<f32, SUMS_AT_ONCE>,
    begin: u32,
    list_end: u32,
    first: u32,
    count: u32,
) {
    var mine = sums;
    for (var i = 0u; i < count; i++) {
        lane_sums[i * WORKGROUP + thread] = mine[i];
    }
    workgroupBarrier();
    if thread < count * ROUND * PIECES {
        var sum = 0.0;
        for (var i = 0u; i < LANES / PIECES; i++) {
            sum += lane_sums[thread * (LANES / PIECES) + i];
        }
        piece_sums[thread] = sum;
    }
    workgroupBarrier();
    if thread < count * ROUND {
        var sum = 0.0;
        for (var i = 0u; i < PIECES; i++) {
            sum += piece_sums[thread * PIECES + i];
        }
        let item = begin + thread % ROUND;
        if item < list_end {
            entry_sums[items[item].y * ENTRY_SUMS + first + thread / ROUND] = sum;
        }
    }
}

// Adds up every splat's entries, always in the same order, and turns their moments into gradients.
@compute @workgroup_size(256)
fn sum_entries(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let rank = workgroup_number(group, groups) * WORKGROUP + thread;
    if rank >= view.gaussians {
        return;
    }
    let number = order[rank];
    let first = number * SUMS;
    if sorted_keys[rank] == CULLED {
        for (var i = 0u; i < SUMS; i++) {
            splat_gradients[first + i] = 0.0;
        }
        return;
    }
    var sums: array<f32, ENTRY_SUMS>;
    let end = min(entry_starts[rank + 1u], view.entry_capacity);
    for (var entry = entry_starts[rank]; entry < end; entry++) {
        for (var i = 0u; i < ENTRY_SUMS; i++) {
            sums[i] += all_entry_sums[entry * ENTRY_SUMS + i];
        }
    }
    let splat = splats[number];
    splat_gradients[first] = 1.0;
    splat_gradients[first + 11u] = sums[0];
    if splat.shape == ELLIPSE {
        // ln alpha = const - q/2, q = x^2 a + y^2 c with x = dx - slope dy, y = dy.
        let x = splat.first.x * sums[1];
        let y = splat.first.z * sums[2];
        splat_gradients[first + 1u] = x;
        splat_gradients[first + 2u] = y - splat.first.y * x;
        splat_gradients[first + 3u] = -0.5 * sums[3];
        splat_gradients[first + 4u] = splat.first.x * sums[4];
        splat_gradients[first + 5u] = -0.5 * sums[5];
    } else {
        for (var i = 0u; i < MOMENTS; i++) {
            splat_gradients[first + 1u + i] = sums[1u + i];
        }
    }
    for (var channel = 0u; channel < CHANNELS; channel++) {
        splat_gradients[first + 14u + channel] = sums[MOMENTS + 1u + channel];
    }
}
