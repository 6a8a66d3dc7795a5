// Backward pass for devices without subgroups. The pixels of a tile process the list together, a few splats
// per round. Every thread stores its pixel's contribution to each splat, then the threads share the sums over
// pixels. No sum depends on the order in which threads run.

const ROUND: u32 = 4u;
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
    let found = upstream_of(pixel);
    var g = found.by_channel;
    var behind = found.behind;
    let summed_splat = thread / LANES;
    let lane = thread % LANES;
    var begin = range.x;
    for (; begin < range.y; begin += ROUND) {
        if (begin - range.x) % BATCH == 0u && !any_alive(thread) {
            break;
        }
        let was_alive = alive;
        for (var i = 0u; i < ROUND; i++) {
            var contribution = vec2<f32>();
            if begin + i < range.y && alive {
                let number = items[begin + i].x;
                let splat = splats[number];
                let before = transmittance;
                let q = geometry_of(splat, pixel).q;
                let drawn = blend(splat.opacity, q, &transmittance, &alive);
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
    leave_out(thread, begin, range.y);
}

// True if a splat of the round is a cone: only cones have more than five moments.
fn any_cone(begin: u32, list_end: u32) -> bool {
    var any = false;
    for (var item = begin; item < min(begin + ROUND, list_end); item++) {
        any = any || splats[items[item].x].shape == CONE;
    }
    return any;
}

// Adds up the lanes' sums and writes them as sums from number `first` on of the entries.
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

