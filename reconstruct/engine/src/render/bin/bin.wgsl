// Binning: for every tile, the splats whose footprint covers one of its pixel centres, near to far.
//
// Every splat, near to far, counts its tiles. The counts' prefix sums (scan.wgsl) number the (splat, tile)
// pairs, the entries, splat by splat. Entries are written with their tile as a key and sorted by it
// (sort.wgsl). The sort is stable, so every tile's list is near to far.

// Widening of footprints, pixels, against rounding in the extents.
const MARGIN: f32 = 0.01;

// The tiles of one splat in one row of tiles: two ranges, begin and end.
alias Columns = vec4<u32>;

// Per rank, near to far: distances and indices of the splats.
@group(0) @binding(1) var<storage, read> sorted_keys: array<u32>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> splats: array<Splat>;
// Per rank: number of entries; after the scan, index of the first. One more value closes the last.
@group(0) @binding(4) var<storage, read_write> entry_starts: array<u32>;
@group(0) @binding(5) var<storage, read> rays: array<vec2<f32>>;
@group(0) @binding(6) var<storage, read_write> entry_tiles: array<u32>;
@group(0) @binding(7) var<storage, read_write> entry_numbers: array<u32>;
@group(0) @binding(8) var<storage, read_write> entry_splats: array<u32>;

@group(0) @binding(1) var<storage, read> all_entry_starts: array<u32>;
@group(0) @binding(2) var<storage, read_write> status: Status;
@group(0) @binding(3) var<storage, read_write> entry_count: array<u32>;
// Workgroups with one thread per entry, then workgroups that sort a block of entries each; three dimensions
// each.
@group(0) @binding(4) var<storage, read_write> entry_workgroups: array<u32>;

@group(0) @binding(0) var<storage, read> count: array<u32>;
@group(0) @binding(1) var<storage, read> sorted_tiles: array<u32>;
@group(0) @binding(2) var<storage, read> sorted_numbers: array<u32>;
@group(0) @binding(3) var<storage, read> splats_of_entries: array<u32>;
// Per tile: begin and end of its list.
@group(0) @binding(4) var<storage, read_write> tile_ranges: array<vec2<u32>>;
// Concatenated tile lists: splat and entry.
@group(0) @binding(5) var<storage, read_write> items: array<vec2<u32>>;

fn tile_columns() -> u32 {
    return (view.width + TILE - 1u) / TILE;
}

// Rows of tiles with a pixel centre inside the footprint's height: begin and end.
fn splat_tile_rows(splat: Splat) -> vec2<u32> {
    let extent = splat.extent.y + MARGIN;
    let height = f32(view.height);
    let first = max(ceil(splat.centre.y - extent - 0.5), 0.0);
    let last = min(floor(splat.centre.y + extent - 0.5), height - 1.0);
    if last < 0.0 || first > last {
        return vec2<u32>();
    }
    return vec2(u32(first) / TILE, u32(last) / TILE + 1u);
}

// Columns of tiles in one row of tiles.
fn splat_tile_columns(splat: Splat, tile_row: u32) -> Columns {
    var sides = vec2(-splat.extent.x, splat.extent.x);
    if splat.shape == ELLIPSE {
        let top = f32(tile_row * TILE) + 0.5 - splat.centre.y;
        let bottom = f32(min((tile_row + 1u) * TILE, view.height)) - 0.5 - splat.centre.y;
        sides = ellipse_columns(splat, top, bottom);
    }
    return columns_between(splat.centre.x, sides.x, sides.y);
}

// Columns of tiles with a pixel centre between two offsets from a centre.
fn columns_between(centre: f32, left: f32, right: f32) -> Columns {
    let all = Columns(0u, tile_columns(), 0u, 0u);
    let width = f32(view.width);
    var begin = ceil(centre + left - MARGIN - 0.5);
    var end = floor(centre + right + MARGIN - 0.5) + 1.0;
    if view.camera != ERP {
        begin = max(begin, 0.0);
        end = min(end, width);
        if begin >= end {
            return Columns();
        }
        return Columns(u32(begin) / TILE, u32(end - 1.0) / TILE + 1u, 0u, 0u);
    }
    let has_gap = end - begin < width;
    if !has_gap {
        return all;
    }
    if begin >= end {
        return Columns();
    }
    // Exact for whole numbers, except for the last bit of the quotient.
    var wrapped = begin - floor(begin / width) * width;
    wrapped = select(wrapped, wrapped - width, wrapped >= width);
    wrapped = select(wrapped, wrapped + width, wrapped < 0.0);
    let end_wrapped = wrapped + (end - begin);
    if end_wrapped <= width {
        return Columns(u32(wrapped) / TILE, u32(end_wrapped - 1.0) / TILE + 1u, 0u, 0u);
    }
    let first = u32(wrapped) / TILE;
    let second_end = u32(end_wrapped - width - 1.0) / TILE + 1u;
    if second_end >= first {
        return all;
    }
    return Columns(first, tile_columns(), 0u, second_end);
}

// Leftmost and rightmost offset from the centre of the ellipse `q <= q_max` between the row offsets
// `top` and `bottom`.
fn ellipse_columns(splat: Splat, top: f32, bottom: f32) -> vec2<f32> {
    let q_max = largest_q(splat.opacity);
    // Row offset of the rightmost point of the whole ellipse; the leftmost is its mirror image.
    let y_right = splat.first.y * q_max / (splat.first.z * splat.extent.x);
    let at_top = ellipse_row(splat, q_max, top);
    let at_bottom = ellipse_row(splat, q_max, bottom);
    var left = min(at_top.x, at_bottom.x);
    var right = max(at_top.y, at_bottom.y);
    if top <= y_right && y_right <= bottom {
        right = splat.extent.x;
    }
    if top <= -y_right && -y_right <= bottom {
        left = -splat.extent.x;
    }
    return vec2(left, right);
}

// Leftmost and rightmost offset of the ellipse in one row.
fn ellipse_row(splat: Splat, q_max: f32, row: f32) -> vec2<f32> {
    let y = clamp(row, -splat.extent.y, splat.extent.y);
    let half = sqrt(max(q_max - y * y * splat.first.z, 0.0) * splat.second.x);
    return vec2(splat.first.y * y - half, splat.first.y * y + half);
}

// Reach of a cone: its footprint is where `sqrt(N) - root l <= 0`, and that changes by no more than
// `steepness` per unit of the ray.
struct Reach {
    // Negative if the footprint is everywhere.
    root: f32,
    steepness: f32,
}

fn reach_of(splat: Splat) -> Reach {
    let ratio = largest_ratio(splat.depth_variance, largest_q(splat.opacity));
    if ratio < 0.0 {
        return Reach(-1.0, 0.0);
    }
    let root = sqrt(ratio);
    let across = dot(splat.first, splat.first) + dot(splat.second, splat.second);
    return Reach(root, sqrt(across) + root * length(splat.third));
}

// True if a splat touches a tile that its rectangle touches.
fn touches(splat: Splat, reach: Reach, column: u32, row: u32) -> bool {
    if splat.shape == ELLIPSE || reach.root < 0.0 {
        return true;
    }
    let left = column * TILE;
    let top = row * TILE;
    let right = min(left + TILE, view.width) - 1u;
    let bottom = min(top + TILE, view.height) - 1u;
    let middle = ray_through((left + right) / 2u, (top + bottom) / 2u);
    // The farthest pixel of a tile is a corner, unless the tile spans a third of the sphere.
    var radius = 2.0;
    if view.camera != ERP || (right - left) * 3u < view.width {
        radius = max(
            max(distance(ray_through(left, top), middle), distance(ray_through(right, top), middle)),
            max(
                distance(ray_through(left, bottom), middle),
                distance(ray_through(right, bottom), middle),
            ),
        );
    }
    let across = vec2(dot(splat.first, middle), dot(splat.second, middle));
    let excess = length(across) - reach.root * dot(splat.third, middle);
    return excess <= reach.steepness * (radius * 1.001 + 1e-6);
}

@compute @workgroup_size(256)
fn count_entries(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let rank = workgroup_number(group, groups) * WORKGROUP + thread;
    if rank >= view.gaussians {
        return;
    }
    var entries = 0u;
    if sorted_keys[rank] != CULLED {
        let splat = splats[order[rank]];
        let reach = reach_of(splat);
        let rows = splat_tile_rows(splat);
        for (var row = rows.x; row < rows.y; row++) {
            let columns = splat_tile_columns(splat, row);
            for (var column = columns.x; column < columns.y; column++) {
                entries += u32(touches(splat, reach, column, row));
            }
            for (var column = columns.z; column < columns.w; column++) {
                entries += u32(touches(splat, reach, column, row));
            }
        }
    }
    entry_starts[rank] = entries;
}

// Most workgroups in one dimension.
const MOST_COLUMNS: u32 = 65535u;

// Writes the number of workgroups for `count` entries, `each` per workgroup.
fn note_workgroups(first: u32, count: u32, each: u32) {
    let workgroups = (count + each - 1u) / each;
    entry_workgroups[first] = min(workgroups, MOST_COLUMNS);
    entry_workgroups[first + 1u] = (workgroups + MOST_COLUMNS - 1u) / MOST_COLUMNS;
    entry_workgroups[first + 2u] = 1u;
}

// Writes the number of entries, and halts if they exceed the capacity.
@compute @workgroup_size(1)
fn check_room() {
    let entries = all_entry_starts[view.gaussians];
    let count = min(entries, view.entry_capacity);
    entry_count[0] = count;
    note_workgroups(0u, count, WORKGROUP);
    note_workgroups(3u, count, SORT_BLOCK);
    status.entries = max(status.entries, entries);
    if entries > view.entry_capacity && status.halted == RUNNING {
        status.halted = HALTED_FULL;
    }
}

@compute @workgroup_size(256)
fn write_entries(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let rank = workgroup_number(group, groups) * WORKGROUP + thread;
    if rank >= view.gaussians || sorted_keys[rank] == CULLED {
        return;
    }
    let splat = splats[order[rank]];
    let reach = reach_of(splat);
    let rows = splat_tile_rows(splat);
    var entry = entry_starts[rank];
    for (var row = rows.x; row < rows.y; row++) {
        let columns = splat_tile_columns(splat, row);
        for (var column = columns.x; column < columns.y; column++) {
            if touches(splat, reach, column, row) {
                write_entry(entry, row * tile_columns() + column, order[rank]);
                entry++;
            }
        }
        for (var column = columns.z; column < columns.w; column++) {
            if touches(splat, reach, column, row) {
                write_entry(entry, row * tile_columns() + column, order[rank]);
                entry++;
            }
        }
    }
}

fn write_entry(entry: u32, tile: u32, splat: u32) {
    if entry < view.entry_capacity {
        entry_tiles[entry] = tile;
        entry_numbers[entry] = entry;
        entry_splats[entry] = splat;
    }
}

// Writes the tiles' lists, and the range of each. The ranges of empty tiles stay zero.
@compute @workgroup_size(256)
fn find_tiles(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let item = workgroup_number(group, groups) * WORKGROUP + thread;
    if item >= count[0] {
        return;
    }
    let number = sorted_numbers[item];
    items[item] = vec2(splats_of_entries[number], number);
    let tile = sorted_tiles[item];
    if item == 0u || sorted_tiles[item - 1u] != tile {
        tile_ranges[tile].x = item;
    }
    if item + 1u == count[0] || sorted_tiles[item + 1u] != tile {
        tile_ranges[tile].y = item + 1u;
    }
}
