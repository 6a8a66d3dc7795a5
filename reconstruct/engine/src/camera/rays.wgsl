// Rays through the centres of all pixels, separated into columns and rows.

// `(x, z)` of every column, then `(scale, y)` of every row.
fn ray_through(column: u32, row: u32) -> vec3<f32> {
    let of_column = rays[column];
    let of_row = rays[view.width + row];
    return vec3(of_row.x * of_column.x, of_row.y, of_row.x * of_column.y);
}
