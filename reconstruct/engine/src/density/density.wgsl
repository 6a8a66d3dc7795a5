// Density control, one thread per Gaussian: selects clones, splits and prunes, and places the new rows.
//
// Rows are first numbered in an extended table: the existing Gaussians, then the clones, then the children of
// splits, each in the order of their parents. This table is virtual: rows are copied only after it is decided
// which of them stay.

struct DensityStep {
    // Gaussians, and the capacity of the table.
    rows: u32,
    capacity: u32,
    // Clones, and rows of the extended table.
    clones: u32,
    extended_rows: u32,
    // Rows of the new table.
    new_rows: u32,
    // Number of Gaussians that may be cloned or split.
    room: u32,
    // Children of a split.
    siblings: u32,
    // Number of all views; the views whose latitudes a threshold depends on.
    views: u32,
    first_view: u32,
    threshold_views: u32,
    // Offsets of the arrays in the table, in values.
    positions: u32,
    log_scales: u32,
    quaternions: u32,
    opacity_logits: u32,
    peaks: u32,
    log_lifespans: u32,
    // 1 if Gaussians have their own times; 1 if splits shorten lifespans.
    has_times: u32,
    shortens: u32,
    // 1 if Gaussians are pruned by size.
    prunes_sizes: u32,
    threshold_equator: f32,
    threshold_pole: f32,
    // In units of length.
    clone_size: f32,
    prune_size: f32,
    // The unit; 0 selects the distance from the nearest view, at least `least_distance`.
    unit_length: f32,
    least_distance: f32,
    prune_opacity: f32,
    prune_logit: f32,
    // Threshold of density control in time: |dL/dtau| per frame, frames.
    time_threshold: f32,
    clone_lifespan: f32,
    // Half the clip, and the largest distance of a peak from its middle; frames.
    half_clip: f32,
    farthest_peak: f32,
    // Centre of the sphere along which Gaussians are ordered.
    centre: vec3<f32>,
}

struct DensityView {
    // Rows of the world-to-camera rotation, each with one coordinate of the camera centre in w.
    rotation_and_centre: array<vec4<f32>, 3>,
    // 1 for a view with poles (ERP).
    is_erp: vec4<f32>,
}

// Child of a split. Before placement, position and peak time hold draws from the standard normal
// distribution.
struct Child {
    position: vec3<f32>,
    peak: f32,
    log_scales: vec3<f32>,
    log_lifespan: f32,
}

const KEEP: u32 = 0u;
const CLONE: u32 = 1u;
const SPLIT: u32 = 2u;

// Key of a Gaussian below its threshold.
const NO_CANDIDATE: u32 = 0xffffffffu;
// Flag in the number of an old row: the row is copied.
const COPY: u32 = 0x80000000u;

// Bindings 0 and 1 are the temporal parameters and the table's values.
@group(0) @binding(2) var<uniform> density: DensityStep;

@group(0) @binding(3) var<storage, read> views: array<DensityView>;
@group(0) @binding(4) var<storage, read> gradient_sums: array<f32>;
@group(0) @binding(5) var<storage, read> view_counts: array<u32>;
@group(0) @binding(6) var<storage, read_write> keys: array<u32>;
@group(0) @binding(7) var<storage, read_write> items: array<u32>;

@group(0) @binding(4) var<storage, read> sorted_keys: array<u32>;
@group(0) @binding(5) var<storage, read> sorted_items: array<u32>;
@group(0) @binding(6) var<storage, read_write> growth: array<u32>;
// One number: Gaussians that grow because of their image-space gradient.
@group(0) @binding(7) var<storage, read_write> grown: array<atomic<u32>>;

@group(0) @binding(4) var<storage, read> grows: array<u32>;
// Parent of each extended row, the number of a Gaussian.
@group(0) @binding(5) var<storage, read> origins: array<u32>;
@group(0) @binding(6) var<storage, read_write> children: array<Child>;
// 1 for each extended row that stays; after the scan, the number of staying rows before it.
@group(0) @binding(7) var<storage, read_write> stays: array<u32>;

@group(0) @binding(3) var<storage, read> places_of_kept: array<u32>;
@group(0) @binding(4) var<storage, read> placed_children: array<Child>;

// Binding of kernels that read no values.
@group(0) @binding(0) var<uniform> decided: DensityStep;
@group(0) @binding(1) var<storage, read> decided_growth: array<u32>;
// Clones per Gaussian, then children per Gaussian; after the scan, their row offsets past the Gaussians.
@group(0) @binding(2) var<storage, read_write> copies: array<u32>;
@group(0) @binding(3) var<storage, read_write> copied_origins: array<u32>;

@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> ordered_origins: array<u32>;
@group(0) @binding(3) var<storage, read_write> sources: array<u32>;
@group(0) @binding(2) var<storage, read> moved_children: array<Child>;
@group(0) @binding(3) var<storage, read_write> moved_values: array<f32>;

// Comparison that is false for NaN, even if the compiler assumes that no NaN exists.
fn is_at_least(value: f32, limit: f32) -> bool {
    return !is_nan(value) && !is_nan(limit) && value >= limit;
}

// A NaN opacity or size fails the comparison and is pruned.
fn is_useful(opacity_logit: f32, largest_log_scale: f32, position: vec3<f32>) -> bool {
    return is_at_least(opacity_logit, density.prune_logit)
        && (density.prunes_sizes == 0u
            || is_at_most(largest_log_scale, position, density.prune_size));
}

// Selects the Gaussians to clone or split. Keys fall as the ratio of gradient to threshold rises.
@compute @workgroup_size(256)
fn find_candidates(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= density.rows {
        return;
    }
    let position = table_vector(temporal.positions, index);
    let seen = view_counts[index];
    let mean = gradient_sums[index] / f32(max(seen, 1u));
    keys[index] = key_of_excess(seen, mean / threshold(position));
    items[index] = index;
}

fn key_of_excess(seen: u32, excess: f32) -> u32 {
    // A NaN statistic fails the comparison and changes nothing.
    return select(NO_CANDIDATE, ~bitcast<u32>(excess), seen > 0u && is_at_least(excess, 1.0));
}

// Gradient at which a Gaussian at `position` is cloned or split.
fn threshold(position: vec3<f32>) -> f32 {
    if density.threshold_equator == density.threshold_pole {
        return density.threshold_equator;
    }
    var sum = 0.0;
    for (var view = 0u; view < density.threshold_views; view++) {
        sum += cos_latitude(position, density.first_view + view);
    }
    let cosine = sum / f32(density.threshold_views);
    return density.threshold_equator
        + (1.0 - cosine) * (density.threshold_pole - density.threshold_equator);
}

fn centre_of(view: u32) -> vec3<f32> {
    return vec3(
        views[view].rotation_and_centre[0].w,
        views[view].rotation_and_centre[1].w,
        views[view].rotation_and_centre[2].w,
    );
}

// Cosine of the latitude at which a view sees a point.
fn cos_latitude(position: vec3<f32>, view: u32) -> f32 {
    if views[view].is_erp.x == 0.0 {
        return 1.0;
    }
    let offset = position - centre_of(view);
    let x = dot(views[view].rotation_and_centre[0].xyz, offset);
    let y = dot(views[view].rotation_and_centre[1].xyz, offset);
    let z = dot(views[view].rotation_and_centre[2].xyz, offset);
    return length(vec2(x, z)) / max(length(vec3(x, y, z)), 1.17549435e-38);
}

// Takes the candidates with the largest ratios until the room is used up. Small ones are cloned, large ones
// split.
@compute @workgroup_size(256)
fn grow_in_space(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let rank = workgroup_number(group, groups) * WORKGROUP + thread;
    if rank >= min(density.rows, density.room) || sorted_keys[rank] == NO_CANDIDATE {
        return;
    }
    let index = sorted_items[rank];
    let position = table_vector(temporal.positions, index);
    let is_small = is_at_most(largest_of(index), position, density.clone_size);
    growth[index] = select(SPLIT, CLONE, is_small);
    atomicAdd(&grown[0], 1u);
}

// Writes the number of rows that each Gaussian adds.
@compute @workgroup_size(256)
fn count_copies(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= decided.capacity {
        return;
    }
    var grows = KEEP;
    if index < decided.rows {
        grows = decided_growth[index];
    }
    copies[index] = select(0u, 1u, grows == CLONE);
    copies[decided.capacity + index] = select(0u, decided.siblings, grows == SPLIT);
}

// Writes the parent of each extended row.
@compute @workgroup_size(256)
fn append_copies(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= decided.rows {
        return;
    }
    copied_origins[index] = index;
    let grows = decided_growth[index];
    if grows == CLONE {
        copied_origins[decided.rows + copies[index]] = index;
    } else if grows == SPLIT {
        let first = decided.rows + copies[decided.capacity + index];
        for (var sibling = 0u; sibling < decided.siblings; sibling++) {
            copied_origins[first + sibling] = index;
        }
    }
}

// Places the children, and marks the extended rows that stay.
@compute @workgroup_size(256)
fn judge_rows(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let row = workgroup_number(group, groups) * WORKGROUP + thread;
    if row >= density.extended_rows {
        return;
    }
    let origin = origins[row];
    var position = table_vector(temporal.positions, origin);
    var largest = largest_of(origin);
    var parameters = TemporalParameters(0.0, ENDLESS, vec3<f32>());
    if density.has_times == 1u {
        parameters = parameters_of(origin);
    }
    let first_child = density.rows + density.clones;
    if row >= first_child {
        let child = placed_child(origin, children[row - first_child], parameters);
        children[row - first_child] = child;
        position = child.position;
        largest = largest_scale(child.log_scales);
        parameters.peak = child.peak;
        if temporal.log_lifespans != NONE {
            parameters.lifespan = exp(child.log_lifespan);
        }
    }
    let is_parent = row < density.rows && grows[row] == SPLIT;
    let opacity_logit = values[temporal.opacity_logits + origin];
    let stays_there = !is_parent && is_useful(opacity_logit, largest, position)
        && (density.has_times == 0u || is_seen(opacity_logit, parameters));
    stays[row] = select(0u, 1u, stays_there);
}

fn log_scales_of(index: u32) -> vec3<f32> {
    return table_vector(density.log_scales, index);
}

// Largest of three numbers, ignoring NaN.
fn largest_scale(log_scales: vec3<f32>) -> f32 {
    var largest = log_scales.x;
    for (var axis = 1u; axis < 3u; axis++) {
        if is_nan(largest) || is_at_least(log_scales[axis], largest) {
            largest = log_scales[axis];
        }
    }
    return largest;
}

fn largest_of(index: u32) -> f32 {
    return largest_scale(log_scales_of(index));
}

// True if the largest axis of a Gaussian is at most `limit` units; false for NaN.
fn is_at_most(largest_log_scale: f32, position: vec3<f32>, limit: f32) -> bool {
    if is_nan(largest_log_scale) {
        return false;
    }
    let largest = exp(largest_log_scale);
    if density.unit_length > 0.0 {
        return largest / density.unit_length <= limit;
    }
    return largest <= limit * density.least_distance
        || is_at_least(limit * nearest(position), largest);
}

// Distance from the nearest view; NaN for a NaN position.
fn nearest(position: vec3<f32>) -> f32 {
    var least = bitcast<f32>(0x7f7fffffu);
    for (var view = 0u; view < density.views; view++) {
        let offset = position - centre_of(view);
        let squared = dot(offset, offset);
        if is_nan(squared) {
            return squared;
        }
        least = min(least, squared);
    }
    return sqrt(least);
}

// Random position inside the ellipsoid of a Gaussian.
fn scattered(index: u32, normals: vec3<f32>) -> vec3<f32> {
    let first = density.quaternions + 4u * index;
    var q = vec4(values[first + 1u], values[first + 2u], values[first + 3u], values[first]);
    let squared = dot(q, q);
    if squared > 1e-24 {
        q *= 1.0 / sqrt(squared);
    } else {
        q = vec4(0.0, 0.0, 0.0, 1.0);
    }
    let along = normals * exp(log_scales_of(index));
    let twice = q.xyz + q.xyz;
    let xx = q.x * twice.x;
    let yy = q.y * twice.y;
    let zz = q.z * twice.z;
    let xy = q.x * twice.y;
    let xz = q.x * twice.z;
    let yz = q.y * twice.z;
    let wx = q.w * twice.x;
    let wy = q.w * twice.y;
    let wz = q.w * twice.z;
    let offset = vec3(1.0 - (yy + zz), xy + wz, xz - wy) * along.x
        + vec3(xy - wz, 1.0 - (xx + zz), yz + wx) * along.y
        + vec3(xz + wy, yz - wx, 1.0 - (xx + yy)) * along.z;
    return table_vector(temporal.positions, index) + offset;
}

// Compacts the extended rows that stay, with their keys on the Z-order curve.
@compute @workgroup_size(256)
fn keep_rows(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let row = workgroup_number(group, groups) * WORKGROUP + thread;
    if row >= density.extended_rows {
        return;
    }
    let place = places_of_kept[row];
    if places_of_kept[row + 1u] == place {
        return;
    }
    let first_child = density.rows + density.clones;
    var position: vec3<f32>;
    if row >= first_child {
        position = placed_children[row - first_child].position;
    } else {
        position = table_vector(temporal.positions, origins[row]);
    }
    keys[place] = z_order(position - density.centre);
    items[place] = row;
}

// Writes the old row of each row of the new table.
@compute @workgroup_size(256)
fn write_sources(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let place = workgroup_number(group, groups) * WORKGROUP + thread;
    if place >= decided.new_rows {
        return;
    }
    let row = order[place];
    sources[place] = ordered_origins[row] | select(0u, COPY, row >= decided.rows);
}

// Writes the values of children that differ from their parents'.
@compute @workgroup_size(256)
fn write_children(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let place = workgroup_number(group, groups) * WORKGROUP + thread;
    if place >= decided.new_rows {
        return;
    }
    let row = order[place];
    let first_child = decided.rows + decided.clones;
    if row < first_child {
        return;
    }
    let child = moved_children[row - first_child];
    let position = decided.positions + 3u * place;
    let log_scales = decided.log_scales + 3u * place;
    for (var axis = 0u; axis < 3u; axis++) {
        moved_values[position + axis] = child.position[axis];
        moved_values[log_scales + axis] = child.log_scales[axis];
    }
    if decided.peaks != NONE {
        moved_values[decided.peaks + place] = child.peak;
    }
    if decided.log_lifespans != NONE {
        moved_values[decided.log_lifespans + place] = child.log_lifespan;
    }
}
