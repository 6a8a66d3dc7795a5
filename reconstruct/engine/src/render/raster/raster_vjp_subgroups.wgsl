// Backward pass for devices with subgroups. The pixels of a tile process the list together. Their
// contributions to a splat are summed in each subgroup that the splat reaches, without barriers. After a few
// splats the threads add up the subgroups' sums, in order. Two halves of the memory alternate, so that each
// of these rounds needs only one barrier.

// SUBGROUPS: the most subgroups of a workgroup; ROUND: splats between two barriers. Both depend on the
// device.

// [half][splat of the round][subgroup][sum]
var<workgroup> subgroup_sums: array<f32, 2u * ROUND * SUBGROUPS * ENTRY_SUMS>;
// [half][splat of the round][subgroup]: 1 if the splat reaches any of its pixels.
var<workgroup> is_reached: array<u32, 2u * ROUND * SUBGROUPS>;

@compute @workgroup_size(256)
fn composite_vjp(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
    @builtin(subgroup_id) subgroup: u32,
    @builtin(num_subgroups) subgroups: u32,
    @builtin(subgroup_invocation_id) lane: u32,
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
    var half = 0u;
    var begin = range.x;
    for (; begin < range.y; begin += BATCH) {
        if !any_alive(thread) {
            break;
        }
        let end = min(BATCH, range.y - begin);
        load_batch(thread, begin, end);
        let was_alive = alive;
        for (var round = 0u; round < end; round += ROUND) {
            let count = min(ROUND, end - round);
            for (var i = 0u; i < count; i++) {
                let splat = batch_splats[round + i];
                var by_log = 0.0;
                var weight = 0.0;
                var at: Geometry;
                if alive {
                    at = geometry_of(splat, pixel);
                    let before = transmittance;
                    let drawn = blend(splat.opacity, at.q, &transmittance, &alive);
                    weight = drawn.weight;
                    if weight > 0.0 {
                        var along = 0.0;
                        for (var channel = 0u; channel < CHANNELS; channel++) {
                            along += g[channel] * batch_channels[(round + i) * CHANNELS + channel];
                        }
                        behind -= weight * along;
                        let by_alpha = before * along - behind / (1.0 - drawn.alpha);
                        by_log = by_alpha * drawn.unclamped;
                    }
                }
                let reaches = subgroupAny(weight > 0.0);
                let part = (half * ROUND + i) * SUBGROUPS + subgroup;
                if reaches {
                    var moments: array<f32, MOMENTS>;
                    if by_log != 0.0 {
                        moments = moments_of(splat, at, by_log);
                    }
                    add_up(lane, part * ENTRY_SUMS, by_log);
                    let count_of_moments = select(MOMENTS, ELLIPSE_MOMENTS, splat.shape == ELLIPSE);
                    for (var moment = 0u; moment < count_of_moments; moment++) {
                        add_up(lane, part * ENTRY_SUMS + 1u + moment, moments[moment]);
                    }
                    for (var channel = 0u; channel < CHANNELS; channel++) {
                        let sum = part * ENTRY_SUMS + MOMENTS + 1u + channel;
                        add_up(lane, sum, weight * g[channel]);
                    }
                }
                if lane == 0u {
                    is_reached[part] = u32(reaches);
                }
            }
            workgroupBarrier();
            write_sums(thread, begin + round, count, half * ROUND, subgroups);
            half = 1u - half;
        }
        if was_alive && !alive {
            atomicSub(&alive_count, 1u);
        }
    }
    leave_out(thread, begin, range.y);
}

// Adds up over the threads of a subgroup; must be called by all of them.
fn add_up(lane: u32, place: u32, value: f32) {
    let sum = subgroupAdd(value);
    if lane == 0u {
        subgroup_sums[place] = sum;
    }
}

// Adds up the subgroups' sums of `count` splats of the list from number `first` on.
fn write_sums(thread: u32, first: u32, count: u32, first_row: u32, subgroups: u32) {
    for (var value = thread; value < count * ENTRY_SUMS; value += WORKGROUP) {
        let row = (first_row + value / ENTRY_SUMS) * SUBGROUPS;
        var sum = 0.0;
        for (var subgroup = 0u; subgroup < subgroups; subgroup++) {
            if is_reached[row + subgroup] != 0u {
                sum += subgroup_sums[(row + subgroup) * ENTRY_SUMS + value % ENTRY_SUMS];
            }
        }
        entry_sums[items[first + value / ENTRY_SUMS].y * ENTRY_SUMS + value % ENTRY_SUMS] = sum;
    }
}
