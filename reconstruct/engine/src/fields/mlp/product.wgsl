// Products of matrices: a workgroup of 256 threads computes a square of the product, a thread 4 by 4 of its
// values.

struct Product {
    // 1 if the inner dimension is the rows of the block: the sum is divided into the block's parts, one
    // product each, consecutive in `out`. Otherwise the rows of the product are those of the block.
    sums_rows: u32,
    // Length of the dimension that does not depend on the block.
    fixed_len: u32,
    columns: u32,
    // Offsets of the factors, and the strides of each dimension.
    left_begin: u32,
    left_row_stride: u32,
    left_inner_stride: u32,
    right_begin: u32,
    right_inner_stride: u32,
    right_column_stride: u32,
    // Offset of the row-major product.
    out_begin: u32,
    // 1 to add to the existing values.
    is_added: u32,
    // Final operation on every value.
    finish: u32,
}

// None.
const FINISH_PLAIN: u32 = 0u;
// Adds `beside`, one value per column.
const FINISH_OFFSET: u32 = 1u;
// Adds `beside` and clips at 0 (ReLU).
const FINISH_OFFSET_AND_CLIP: u32 = 2u;
// Sets values to 0 where `beside`, of the product's size, is not above 0.
const FINISH_MASK: u32 = 3u;

@group(0) @binding(0) var<uniform> product: Product;
@group(0) @binding(1) var<storage, read> left: array<f32>;
@group(0) @binding(2) var<storage, read> right: array<f32>;
@group(0) @binding(3) var<storage, read> beside: array<f32>;
@group(0) @binding(4) var<storage, read_write> out: array<f32>;
@group(0) @binding(5) var<uniform> block: BlockRows;

// Steps of the inner dimension loaded at once.
const STEPS: u32 = 16u;
// Rows, or columns, come in groups of four.
const GROUPS: u32 = SIDE / 4u;

// Values of the workgroup's rows, and of its columns, step by step.
var<workgroup> left_tile: array<vec4<f32>, STEPS * GROUPS>;
var<workgroup> right_tile: array<vec4<f32>, STEPS * GROUPS>;

fn rows() -> u32 {
    return select(block.rows, product.fixed_len, product.sums_rows != 0u);
}

fn inner_len() -> u32 {
    return select(product.fixed_len, block.rows, product.sums_rows != 0u);
}

fn parts() -> u32 {
    return select(1u, block.parts, product.sums_rows != 0u);
}

// The group and the step that a thread loads, such that neighbouring threads read adjacent values.
fn place(thread: u32, step_stride: u32) -> vec2<u32> {
    if step_stride == 1u {
        return vec2(thread / STEPS, thread % STEPS);
    }
    return vec2(thread % GROUPS, thread / GROUPS);
}

fn load_left(row: u32, step: u32) -> f32 {
    if row >= rows() {
        return 0.0;
    }
    return left[product.left_begin + row * product.left_row_stride
        + step * product.left_inner_stride];
}

fn load_right(step: u32, column: u32) -> f32 {
    if column >= product.columns {
        return 0.0;
    }
    return right[product.right_begin + column * product.right_column_stride
        + step * product.right_inner_stride];
}

// Loads the steps from `step` to `end`; one vector of each tile per thread.
fn load_tiles(first: vec2<u32>, step: u32, end: u32, thread: u32) {
    let of_left = place(thread, product.left_inner_stride);
    let row = first.y + 4u * of_left.x;
    let left_step = step + of_left.y;
    var loaded = vec4<f32>();
    if left_step < end {
        loaded = vec4(
            load_left(row, left_step),
            load_left(row + 1u, left_step),
            load_left(row + 2u, left_step),
            load_left(row + 3u, left_step),
        );
    }
    left_tile[of_left.y * GROUPS + of_left.x] = loaded;

    let of_right = place(thread, product.right_inner_stride);
    let column = first.x + 4u * of_right.x;
    let right_step = step + of_right.y;
    loaded = vec4<f32>();
    if right_step < end {
        loaded = vec4(
            load_right(right_step, column),
            load_right(right_step, column + 1u),
            load_right(right_step, column + 2u),
            load_right(right_step, column + 3u),
        );
    }
    right_tile[of_right.y * GROUPS + of_right.x] = loaded;
}

fn write(row: u32, column: u32, part: u32, sum: f32) {
    if row >= rows() || column >= product.columns {
        return;
    }
    let index = row * product.columns + column;
    let at = product.out_begin + part * rows() * product.columns + index;
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
    write(row, first_column + 1u, part, sums.y);
    write(row, first_column + 2u, part, sums.z);
    write(row, first_column + 3u, part, sums.w);
}

@compute @workgroup_size(256)
fn multiply(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let across = (product.columns + SIDE - 1u) / SIDE;
    let down = (rows() + SIDE - 1u) / SIDE;
    let number = workgroup_number(group, groups);
    let part = number / (across * down);
    if part >= parts() {
        return;
    }
    let first = vec2(number % across, (number / across) % down) * SIDE;
    let per_part = (inner_len() + parts() - 1u) / parts();
    let end = min(inner_len(), (part + 1u) * per_part);

    let row_group = thread / GROUPS;
    let column_group = thread % GROUPS;
    var sums_0 = vec4<f32>();
    var sums_1 = vec4<f32>();
    var sums_2 = vec4<f32>();
    var sums_3 = vec4<f32>();
    for (var step = part * per_part; step < end; step += STEPS) {
        load_tiles(first, step, end, thread);
        workgroupBarrier();
        for (var i = 0u; i < STEPS; i++) {
            let of_rows = left_tile[i * GROUPS + row_group];
            let of_columns = right_tile[i * GROUPS + column_group];
            sums_0 += of_rows.x * of_columns;
            sums_1 += of_rows.y * of_columns;
            sums_2 += of_rows.z * of_columns;
            sums_3 += of_rows.w * of_columns;
        }
        workgroupBarrier();
    }
    let row = first.y + 4u * row_group;
    let column = first.x + 4u * column_group;
    write_row(row, column, part, sums_0);
    write_row(row + 1u, column, part, sums_1);
    write_row(row + 2u, column, part, sums_2);
    write_row(row + 3u, column, part, sums_3);
}
