// Products of matrices: a workgroup has 64 by 64 outputs, a thread 4 by 4 of them.

struct Product {
    rows: u32,
    inner: u32,
    columns: u32,
    // The inner dimension is dealt out to as many products, which follow each other in `out`.
    parts: u32,
    // Where the factors begin, and how far apart their values are in each dimension.
    left_begin: u32,
    left_row_stride: u32,
    left_inner_stride: u32,
    right_begin: u32,
    right_inner_stride: u32,
    right_column_stride: u32,
    // Where the row-major product begins.
    out_begin: u32,
    // Whether it is added to what is there.
    is_added: u32,
    // What happens to every value in the end.
    finish: u32,
}

// Nothing.
const FINISH_PLAIN: u32 = 0u;
// `beside` has a value per column, which is added.
const FINISH_OFFSET: u32 = 1u;
// The same, and what is below 0 becomes 0.
const FINISH_OFFSET_AND_CLIP: u32 = 2u;
// `beside` is as large as the product: where it is not above 0 the product becomes 0.
const FINISH_MASK: u32 = 3u;

@group(0) @binding(0) var<uniform> product: Product;
@group(0) @binding(1) var<storage, read> left: array<f32>;
@group(0) @binding(2) var<storage, read> right: array<f32>;
@group(0) @binding(3) var<storage, read> beside: array<f32>;
@group(0) @binding(4) var<storage, read_write> out: array<f32>;

// Steps of the inner dimension that are loaded at once.
const STEPS: u32 = 16u;
// Values between steps: not a multiple of the memory's banks.
const PITCH: u32 = SIDE + 1u;

// Step by step, the values of the workgroup's rows, and of its columns.
var<workgroup> left_tile: array<f32, STEPS * PITCH>;
var<workgroup> right_tile: array<f32, STEPS * PITCH>;

// Number `value` of a tile's 64 by 16 values as (line, step), such that neighbours lie side by side.
fn place(value: u32, step_stride: u32) -> vec2<u32> {
    if step_stride == 1u {
        return vec2(value / STEPS, value % STEPS);
    }
    return vec2(value % SIDE, value / SIDE);
}

fn load_tiles(first: vec2<u32>, step: u32, end: u32, thread: u32) {
    for (var value = thread; value < SIDE * STEPS; value += WORKGROUP) {
        let of_left = place(value, product.left_inner_stride);
        let row = first.y + of_left.x;
        let left_step = step + of_left.y;
        var loaded = 0.0;
        if row < product.rows && left_step < end {
            loaded = left[product.left_begin + row * product.left_row_stride
                + left_step * product.left_inner_stride];
        }
        left_tile[of_left.y * PITCH + of_left.x] = loaded;

        let of_right = place(value, product.right_inner_stride);
        let column = first.x + of_right.x;
        let right_step = step + of_right.y;
        loaded = 0.0;
        if column < product.columns && right_step < end {
            loaded = right[product.right_begin + column * product.right_column_stride
                + right_step * product.right_inner_stride];
        }
        right_tile[of_right.y * PITCH + of_right.x] = loaded;
    }
}

fn write(row: u32, column: u32, part: u32, sum: f32) {
    if row >= product.rows || column >= product.columns {
        return;
    }
    let index = row * product.columns + column;
    let at = product.out_begin + part * product.rows * product.columns + index;
    var value = sum;
    if product.is_added != 0u {
        value += out[at];
    }
    switch product.finish {
        case FINISH_OFFSET: {
            value += beside[column];
        }
        case FINISH_OFFSET_AND_CLIP: {
            value = max(value + beside[column], 0.0);
        }
        case FINISH_MASK: {
            value = select(0.0, value, beside[index] > 0.0);
        }
        default: {}
    }
    out[at] = value;
}

fn write_row(row: u32, first_column: u32, part: u32, sums: vec4<f32>) {
    write(row, first_column, part, sums.x);
    write(row, first_column + QUARTER, part, sums.y);
    write(row, first_column + 2u * QUARTER, part, sums.z);
    write(row, first_column + 3u * QUARTER, part, sums.w);
}

@compute @workgroup_size(256)
fn multiply(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let across = (product.columns + SIDE - 1u) / SIDE;
    let down = (product.rows + SIDE - 1u) / SIDE;
    let number = workgroup_number(group, groups);
    let part = number / (across * down);
    if part >= product.parts {
        return;
    }
    let first = vec2(number % across, (number / across) % down) * SIDE;
    let per_part = (product.inner + product.parts - 1u) / product.parts;
    let end = min(product.inner, (part + 1u) * per_part);

    // A thread's rows and columns are a quarter of the tile apart.
    let row = thread / QUARTER;
    let column = thread % QUARTER;
    var sums_0 = vec4<f32>();
    var sums_1 = vec4<f32>();
    var sums_2 = vec4<f32>();
    var sums_3 = vec4<f32>();
    for (var step = part * per_part; step < end; step += STEPS) {
        load_tiles(first, step, end, thread);
        workgroupBarrier();
        for (var i = 0u; i < STEPS; i++) {
            let l = i * PITCH + row;
            let r = i * PITCH + column;
            let values = vec4(
                right_tile[r],
                right_tile[r + QUARTER],
                right_tile[r + 2u * QUARTER],
                right_tile[r + 3u * QUARTER],
            );
            sums_0 += left_tile[l] * values;
            sums_1 += left_tile[l + QUARTER] * values;
            sums_2 += left_tile[l + 2u * QUARTER] * values;
            sums_3 += left_tile[l + 3u * QUARTER] * values;
        }
        workgroupBarrier();
    }
    write_row(first.y + row, first.x + column, part, sums_0);
    write_row(first.y + row + QUARTER, first.x + column, part, sums_1);
    write_row(first.y + row + 2u * QUARTER, first.x + column, part, sums_2);
    write_row(first.y + row + 3u * QUARTER, first.x + column, part, sums_3);
}
