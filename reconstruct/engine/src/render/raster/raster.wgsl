// Rasterization: one workgroup per tile, one thread per pixel. Bindings and pixels are those of `tile.wgsl`.
// The backward pass has three forms, which differ in how they sum over pixels: `raster_vjp.wgsl`,
// `raster_vjp_subgroups.wgsl` and `raster_vjp_splats.wgsl`. Their sums are added up per splat here.

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
        load_batch(thread, begin, end);
        let was_alive = alive;
        for (var i = 0u; i < end && alive; i++) {
            let splat = batch_splats[i];
            let q = geometry_of(splat, pixel).q;
            let drawn = blend(splat.opacity, q, &transmittance, &alive);
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

// Adds up every splat's entries, always in the same order, and converts their moments to gradients.
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
    let splat = splats[number];
    var sums: array<f32, ENTRY_SUMS>;
    let end = min(entry_starts[rank + 1u], view.entry_capacity);
    for (var entry = entry_starts[rank]; entry < end; entry++) {
        for (var i = 0u; i < ENTRY_SUMS; i++) {
            // Moments that an ellipse lacks are not written.
            if splat.shape == CONE || i <= ELLIPSE_MOMENTS || i > MOMENTS {
                sums[i] += all_entry_sums[entry * ENTRY_SUMS + i];
            }
        }
    }
    splat_gradients[first] = select(DRAWN_ELLIPSE, DRAWN_CONE, splat.shape == CONE);
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
