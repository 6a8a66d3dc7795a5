// Copying of table rows: density control copies, removes and orders Gaussians.

struct RowMove {
    // Number of values of the new rows, and number of these rows.
    len: u32,
    rows: u32,
    arrays: u32,
    // 1 if moments are moved: those of a copy are zero.
    moments: u32,
    // Per array: values per Gaussian, and offsets in both tables.
    widths: array<vec4<u32>, 4>,
    old_begins: array<vec4<u32>, 4>,
    begins: array<vec4<u32>, 4>,
}

@group(0) @binding(0) var<uniform> row_move: RowMove;
// Old row of every new row, with the flag COPY for a copy.
@group(0) @binding(1) var<storage, read> sources: array<u32>;
@group(0) @binding(2) var<storage, read> old_values: array<f32>;
@group(0) @binding(3) var<storage, read_write> values: array<f32>;

const COPY: u32 = 0x80000000u;

@compute @workgroup_size(256)
fn move_rows(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let number = workgroup_number(group, groups) * WORKGROUP + thread;
    if number >= row_move.len {
        return;
    }
    var array_number = 0u;
    var width = row_move.widths[0].x;
    var in_array = number;
    while array_number + 1u < row_move.arrays && in_array >= width * row_move.rows {
        in_array -= width * row_move.rows;
        array_number++;
        width = row_move.widths[array_number / 4u][array_number % 4u];
    }
    let source = sources[in_array / width];
    let old = row_move.old_begins[array_number / 4u][array_number % 4u]
        + (source & ~COPY) * width + in_array % width;
    let is_lost = row_move.moments == 1u && (source & COPY) != 0u;
    let place = row_move.begins[array_number / 4u][array_number % 4u] + in_array;
    values[place] = select(old_values[old], 0.0, is_lost);
}
