// Hash grids: features of positions, and gradients by the table and by the positions.

struct GridLevel {
    // Cells per unit.
    scale: f32,
    // Corners from one row of the table to the next.
    stride: u32,
    entries: u32,
    is_hashed: u32,
    // Number of entries of all coarser levels.
    first_entry: u32,
}

struct GridRows {
    // Number of positions, and values of each.
    rows: u32,
    dimensions: u32,
    levels: u32,
    // Features in use; the others are 0.
    used: u32,
    // Along each dimension, the value of a row of gradients to which that by the position is added, and its
    // factor.
    places: vec4<u32>,
    scales: vec4<f32>,
    // Values of such a row.
    width: u32,
}

// Consecutive levels whose gradients are summed at once.
struct LevelGroup {
    first: u32,
    levels: u32,
    first_entry: u32,
    entries: u32,
}

@group(0) @binding(0) var<uniform> grid: GridRows;
@group(0) @binding(1) var<storage, read> levels: array<GridLevel>;
@group(0) @binding(2) var<storage, read> positions: array<f32>;
@group(0) @binding(3) var<storage, read> table: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> features: array<vec4<f32>>;
@group(0) @binding(5) var<uniform> block: BlockRows;

@group(0) @binding(1) var<storage, read> all_by_features: array<vec4<f32>>;
// Bits of the largest gradient by a feature.
@group(0) @binding(2) var<storage, read_write> largest_found: atomic<u32>;

@group(0) @binding(3) var<storage, read> by_features: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> largest: u32;
// Sums of an entry: two words for each feature, the lower one first, then a bit for each refused feature.
@group(0) @binding(5) var<storage, read_write> sums: array<atomic<u32>>;
@group(0) @binding(6) var<uniform> summed: LevelGroup;

@group(0) @binding(0) var<uniform> finished: LevelGroup;
@group(0) @binding(1) var<storage, read> largest_of_all: u32;
@group(0) @binding(2) var<storage, read_write> finished_sums: array<u32>;
@group(0) @binding(3) var<storage, read_write> table_gradients: array<vec4<f32>>;

@group(0) @binding(4) var<storage, read> upstream: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> by_positions: array<f32>;

const CORNER_BITS = vec4<u32>(0u, 1u, 2u, 3u);

// A level's cell around a position.
struct Cell {
    first: vec4<u32>,
    fraction: vec4<f32>,
}

// A position, and zeros along the other axes.
fn position_of(row: u32) -> vec4<f32> {
    let first = row * grid.dimensions;
    var position = vec4(positions[first], positions[first + 1u], 0.0, 0.0);
    if grid.dimensions > 2u {
        position.z = positions[first + 2u];
    }
    if grid.dimensions > 3u {
        position.w = positions[first + 3u];
    }
    return position;
}

fn are_finite(values: vec4<f32>) -> bool {
    return is_finite(values.x) && is_finite(values.y) && is_finite(values.z) && is_finite(values.w);
}

fn cell_of(level: GridLevel, position: vec4<f32>) -> Cell {
    let at = clamp(position, vec4(0.0), vec4(1.0)) * level.scale + 0.5;
    let first = floor(at);
    return Cell(vec4<u32>(first), at - first);
}

// Entry of a cell's corner with the upper cell along the axes whose bits are set.
fn entry_of(level: GridLevel, cell: Cell, bits: u32) -> u32 {
    let corner = cell.first + ((vec4(bits) >> CORNER_BITS) & vec4(1u));
    if level.is_hashed != 0u {
        // Axes without a position have cell 0.
        let hash = corner * PRIMES;
        // Hashed levels have a power of two of entries.
        return level.first_entry + ((hash.x ^ hash.y ^ hash.z ^ hash.w) & (level.entries - 1u));
    }
    let stride = level.stride;
    let index = corner.x + stride * (corner.y + stride * (corner.z + stride * corner.w));
    return level.first_entry + index % level.entries;
}

fn weight_along(cell: Cell, bits: u32, axis: u32) -> f32 {
    let fraction = cell.fraction[axis];
    return select(1.0 - fraction, fraction, ((bits >> axis) & 1u) == 1u);
}

fn weight_of(cell: Cell, bits: u32) -> f32 {
    var weight = 1.0;
    for (var axis = 0u; axis < grid.dimensions; axis++) {
        weight *= weight_along(cell, bits, axis);
    }
    return weight;
}

// The features of a level that are in use; the others are 0.
fn in_use(level: u32, values: vec4<f32>) -> vec4<f32> {
    let numbers = vec4(FEATURES * level) + CORNER_BITS;
    return select(vec4(0.0), values, numbers < vec4(grid.used));
}

// Features of a block's positions; one thread per row and level.
@compute @workgroup_size(256)
fn encode(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    let row = index / grid.levels;
    if row >= block.rows {
        return;
    }
    let number = index % grid.levels;
    let position = position_of(block.first + row);
    var sum = vec4<f32>();
    if are_finite(position) && FEATURES * number < grid.used {
        let level = levels[number];
        let cell = cell_of(level, position);
        for (var bits = 0u; bits < (1u << grid.dimensions); bits++) {
            sum += weight_of(cell, bits) * table[entry_of(level, cell, bits)];
        }
    }
    features[index] = in_use(number, sum);
}

var<workgroup> largest_of: array<u32, WORKGROUP>;

// The largest finite gradient by a feature, which sets the unit of the sums; one thread per row and level.
@compute @workgroup_size(256)
fn find_largest(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    var found = 0u;
    if index < grid.rows * grid.levels {
        let by = all_by_features[index];
        for (var feature = 0u; feature < FEATURES; feature++) {
            if is_finite(by[feature]) {
                // Bits of positive numbers have the order of the numbers.
                found = max(found, bitcast<u32>(abs(by[feature])));
            }
        }
    }
    largest_of[thread] = found;
    workgroupBarrier();
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        if thread < half {
            largest_of[thread] = max(largest_of[thread], largest_of[thread + half]);
        }
        workgroupBarrier();
    }
    if thread == 0u {
        atomicMax(&largest_found, largest_of[0]);
    }
}

// 2^exponent, for exponents of normal numbers.
fn power_of_two(exponent: i32) -> f32 {
    return bitcast<f32>(u32(exponent + 127) << 23u);
}

// Multiplies by 2^exponent, in two steps: the power itself may be beyond the largest number.
fn scaled(value: f32, exponent: i32) -> f32 {
    let half = exponent / 2;
    return value * power_of_two(half) * power_of_two(exponent - half);
}

// Binary exponent by which gradients become whole numbers below 2^SUM_BITS.
fn sum_exponent(largest_bits: u32) -> i32 {
    return SUM_BITS + 126 - i32(largest_bits >> 23u);
}

// Adds a whole number below 2^SUM_BITS to two words. Sums of integers have the same bits in any order.
fn add_whole(at: u32, value: f32) {
    let whole = floor(abs(value));
    let upper = floor(whole * 2.3283064365386963e-10);
    var words = vec2(u32(whole - upper * 4294967296.0), u32(upper));
    if value < 0.0 {
        words = vec2(~words.x + 1u, ~words.y + select(0u, 1u, words.x == 0u));
    }
    let before = atomicAdd(&sums[at], words.x);
    let carry = select(0u, 1u, before + words.x < before);
    atomicAdd(&sums[at + 1u], words.y + carry);
}

// Sums of the gradients by the entries of some levels; one thread per row and level.
@compute @workgroup_size(256)
fn add_by_table(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    let row = index / summed.levels;
    if row >= grid.rows {
        return;
    }
    let number = summed.first + index % summed.levels;
    let by = in_use(number, by_features[row * grid.levels + number]);
    let position = position_of(row);
    if all(by == vec4<f32>()) || !are_finite(position) {
        return;
    }
    let exponent = sum_exponent(largest);
    let level = levels[number];
    let cell = cell_of(level, position);
    for (var bits = 0u; bits < (1u << grid.dimensions); bits++) {
        let at = SUM_WORDS * (entry_of(level, cell, bits) - summed.first_entry);
        let weight = weight_of(cell, bits);
        for (var feature = 0u; feature < FEATURES; feature++) {
            if is_finite(by[feature]) {
                add_whole(at + 2u * feature, scaled(weight * by[feature], exponent));
            } else {
                atomicOr(&sums[at + 2u * FEATURES], 1u << feature);
            }
        }
    }
}

// Writes the gradients by the entries of some levels, and sets the sums to 0; one thread per entry.
@compute @workgroup_size(256)
fn finish_by_table(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let entry = workgroup_number(group, groups) * WORKGROUP + thread;
    if entry >= finished.entries {
        return;
    }
    let at = SUM_WORDS * entry;
    let refused = finished_sums[at + 2u * FEATURES];
    var gradient = vec4<f32>();
    for (var feature = 0u; feature < FEATURES; feature++) {
        var lower = finished_sums[at + 2u * feature];
        var upper = finished_sums[at + 2u * feature + 1u];
        let is_negative = upper >= 0x80000000u;
        if is_negative {
            upper = ~upper + select(0u, 1u, lower == 0u);
            lower = ~lower + 1u;
        }
        let sum = f32(upper) * 4294967296.0 + f32(lower);
        let value = scaled(select(sum, -sum, is_negative), -sum_exponent(largest_of_all));
        // Bits of a NaN, which Adam refuses.
        let bits = select(bitcast<u32>(value), 0x7fc00000u, ((refused >> feature) & 1u) == 1u);
        gradient[feature] = bitcast<f32>(bits);
    }
    for (var word = 0u; word < SUM_WORDS; word++) {
        finished_sums[at + word] = 0u;
    }
    table_gradients[finished.first_entry + entry] = gradient;
}

// Adds the gradients by the positions, 0 along axes where they are clamped, to rows of gradients; one thread per
// row.
@compute @workgroup_size(256)
fn add_by_positions(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let row = workgroup_number(group, groups) * WORKGROUP + thread;
    if row >= grid.rows {
        return;
    }
    let position = position_of(row);
    if !are_finite(position) {
        return;
    }
    var gradient = vec4<f32>();
    for (var number = 0u; number < grid.levels; number++) {
        if FEATURES * number >= grid.used {
            break;
        }
        let level = levels[number];
        let by = in_use(number, upstream[row * grid.levels + number]);
        let cell = cell_of(level, position);
        for (var bits = 0u; bits < (1u << grid.dimensions); bits++) {
            let value = level.scale * dot(by, table[entry_of(level, cell, bits)]);
            for (var axis = 0u; axis < grid.dimensions; axis++) {
                var by_axis = select(-value, value, ((bits >> axis) & 1u) == 1u);
                for (var other = 0u; other < grid.dimensions; other++) {
                    if other != axis {
                        by_axis *= weight_along(cell, bits, other);
                    }
                }
                gradient[axis] += by_axis;
            }
        }
    }
    for (var axis = 0u; axis < grid.dimensions; axis++) {
        if position[axis] >= 0.0 && position[axis] <= 1.0 {
            by_positions[row * grid.width + grid.places[axis]] += grid.scales[axis] * gradient[axis];
        }
    }
}
