// Rows of a table from those of another: density control copies, removes and orders Gaussians.

struct RowMove {
    // Values of the new table, and its Gaussians.
    len: u32,
    rows: u32,
    // Gaussians of the old table.
    old_rows: u32,
    arrays: u32,
    // By array: where it ends in the new table, its values for each Gaussian, and whether its moments
    // are forgotten.
    ends: array<vec4<u32>, 4>,
    widths: array<vec4<u32>, 4>,
    forgets: array<vec4<u32>, 4>,
}

@group(0) @binding(0) var<uniform> row_move: RowMove;
// Of every new row: the old row, and above it whether the row is a copy, which has no moments.
@group(0) @binding(1) var<storage, read> sources: array<u32>;
@group(0) @binding(2) var<storage, read> old_values: array<f32>;
@group(0) @binding(3) var<storage, read> old_first_moments: array<f32>;
@group(0) @binding(4) var<storage, read> old_second_moments: array<f32>;
@group(0) @binding(5) var<storage, read_write> values: array<f32>;
@group(0) @binding(6) var<storage, read_write> first_moments: array<f32>;
@group(0) @binding(7) var<storage, read_write> second_moments: array<f32>;

const COPY: u32 = 0x80000000u;

@compute @workgroup_size(256)
fn move_rows(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let index = workgroup_number(group, groups) * WORKGROUP + thread;
    if index >= row_move.len {
        return;
    }
    var array_number = 0u;
    while array_number + 1u < row_move.arrays
        && index >= row_move.ends[array_number / 4u][array_number % 4u] {
        array_number++;
    }
    let width = row_move.widths[array_number / 4u][array_number % 4u];
    let end = row_move.ends[array_number / 4u][array_number % 4u];
    let begin = end - width * row_move.rows;
    // Arrays before this one have as many values for each Gaussian in both tables.
    let old_begin = begin / max(row_move.rows, 1u) * row_move.old_rows;
    let row = (index - begin) / width;
    let source = sources[row];
    let old = old_begin + (source & ~COPY) * width + (index - begin) % width;
    values[index] = old_values[old];
    let forgets = row_move.forgets[array_number / 4u][array_number % 4u] == 1u;
    let keeps = (source & COPY) == 0u && !forgets;
    first_moments[index] = select(0.0, old_first_moments[old], keeps);
    second_moments[index] = select(0.0, old_second_moments[old], keeps);
}
