//! 3x3 convolutions of stride one as matrix products: Winograd's minimal filtering F(4x4, 3x3)
//! (Lavin and Gray, "Fast algorithms for convolutional neural networks", 2016, section 4.3).
//!
//! A tile of 4x4 outputs depends on a patch of 6x6 inputs. Patch and kernel are transformed to 36 positions, at each of
//! which the convolution is a product over channels; the inverse transform of the products gives the tile. 36
//! multiplications replace 144.
//!
//! Any operation between the two transforms that is linear and the same for all pixels, such as a convolution over
//! time, may be applied to the products as well.

/// Side of a tile of outputs, pixels.
pub const TILE: usize = 4;
/// Side of the patch of inputs that a tile depends on, pixels.
pub const PATCH: usize = TILE + 2;
/// Positions at which products are taken.
pub const POSITIONS: usize = PATCH * PATCH;
/// Number of values that are transformed together.
const LANES: usize = 8;

type Lanes = [f32; LANES];

/// The matrix G of the paper: interpolation points 0, 1, -1, 2, -2 and infinity.
const KERNEL: [[f64; 3]; PATCH] = [
    [1.0 / 4.0, 0.0, 0.0],
    [-1.0 / 6.0, -1.0 / 6.0, -1.0 / 6.0],
    [-1.0 / 6.0, 1.0 / 6.0, -1.0 / 6.0],
    [1.0 / 24.0, 1.0 / 12.0, 1.0 / 6.0],
    [1.0 / 24.0, -1.0 / 12.0, 1.0 / 6.0],
    [0.0, 0.0, 1.0],
];

/// Returns `G g G^T` of a row-major 3x3 kernel, in f64.
pub fn transform_kernel(kernel: [f64; 9]) -> [f64; POSITIONS] {
    let mut transformed = [0.0; POSITIONS];
    for (row, left) in KERNEL.iter().enumerate() {
        for (column, right) in KERNEL.iter().enumerate() {
            for y in 0..3 {
                for x in 0..3 {
                    transformed[row * PATCH + column] += left[y] * kernel[y * 3 + x] * right[x];
                }
            }
        }
    }
    transformed
}

/// Computes `B^T d B` for many independent patches at once.
///
/// `patch[6 y + x]` holds the values of all of them at one pixel; `None` is a pixel outside the
/// image, zero. `transformed[p]` receives position p in the same order.
///
/// # Panics
/// When a slice is shorter than those of `transformed`, or there are not 36 of them.
#[multiversion::multiversion(targets("x86_64+avx2+fma", "x86_64+avx"))]
pub fn transform_patches(patch: &[Option<&[f32]>; POSITIONS], transformed: &mut [&mut [f32]]) {
    assert_eq!(transformed.len(), POSITIONS, "positions of a patch");
    let count = transformed[0].len();
    let mut begin = 0;
    while begin < count {
        let lanes = LANES.min(count - begin);
        let mut rows = [[[0.0; LANES]; PATCH]; PATCH];
        for y in 0..PATCH {
            let mut line = [[0.0; LANES]; PATCH];
            for x in 0..PATCH {
                if let Some(values) = patch[y * PATCH + x] {
                    load(&values[begin..begin + lanes], &mut line[x]);
                }
            }
            rows[y] = transform_inputs(&line);
        }
        for x in 0..PATCH {
            let column = transform_inputs(&column_of(&rows, x));
            for (y, values) in column.iter().enumerate() {
                transformed[y * PATCH + x][begin..begin + lanes].copy_from_slice(&values[..lanes]);
            }
        }
        begin += lanes;
    }
}

/// Computes `A^T m A` for many independent tiles at once: from products at 36 positions to 4x4 outputs, to which `bias`
/// is added, channel by channel; negative values then become zero.
///
/// `tile[4 y + x]` receives the values of one pixel in the order of those of `products`, channels
/// fastest; `None` is a pixel outside the image.
///
/// # Panics
/// When slices differ in length, when there are not 36 positions and 16 outputs, or when the channels are not a
/// multiple of eight.
#[multiversion::multiversion(targets("x86_64+avx2+fma", "x86_64+avx"))]
pub fn transform_products_rectified(
    products: &[&[f32]],
    bias: &[f32],
    tile: &mut [Option<&mut [f32]>],
) {
    assert_eq!(products.len(), POSITIONS, "positions of a tile");
    assert_eq!(tile.len(), TILE * TILE, "pixels of a tile");
    let count = products[0].len();
    assert_eq!(bias.len() % LANES, 0, "channels come in eights");
    assert_eq!(count % bias.len(), 0, "values come in whole pixels");
    let mut channel = 0;
    for begin in (0..count).step_by(LANES) {
        let mut rows = [[[0.0; LANES]; TILE]; PATCH];
        for y in 0..PATCH {
            let mut line = [[0.0; LANES]; PATCH];
            for x in 0..PATCH {
                load(&products[y * PATCH + x][begin..begin + LANES], &mut line[x]);
            }
            rows[y] = transform_outputs(&line);
        }
        let mut offsets = [0.0; LANES];
        load(&bias[channel..channel + LANES], &mut offsets);
        channel = (channel + LANES) % bias.len();
        for x in 0..TILE {
            let column = transform_outputs(&column_of(&rows, x));
            for (y, values) in column.iter().enumerate() {
                if let Some(pixel) = &mut tile[y * TILE + x] {
                    let pixel = &mut pixel[begin..begin + LANES];
                    for lane in 0..LANES {
                        pixel[lane] = (values[lane] + offsets[lane]).max(0.0);
                    }
                }
            }
        }
    }
}

/// Applies [`transform_patches`] to one patch whose pixels all lie in `values`: rows `row_len` apart, pixels of
/// `channels` values one behind the other. Position p goes to `transformed[p * spacing..]`.
///
/// # Panics
/// When the channels are not a multiple of eight, or a slice is too short.
#[multiversion::multiversion(targets("x86_64+avx2+fma", "x86_64+avx"))]
pub(crate) fn transform_patch(
    values: &[f32],
    [row_len, channels]: [usize; 2],
    transformed: &mut [f32],
    spacing: usize,
) {
    let pixel = |at: usize| &values[at / PATCH * row_len + at % PATCH * channels..][..channels];
    let mut pixels: [&[Lanes]; POSITIONS] = [&[]; POSITIONS];
    for (at, blocks) in pixels.iter_mut().enumerate() {
        let (whole, rest) = pixel(at).as_chunks();
        assert!(rest.is_empty(), "channels come in eights");
        *blocks = whole;
    }
    for (block, _) in pixels[0].iter().enumerate() {
        let mut rows = [[[0.0; LANES]; PATCH]; PATCH];
        for y in 0..PATCH {
            let mut line = [[0.0; LANES]; PATCH];
            for x in 0..PATCH {
                line[x] = pixels[y * PATCH + x][block];
            }
            rows[y] = transform_inputs(&line);
        }
        for x in 0..PATCH {
            let column = transform_inputs(&column_of(&rows, x));
            for (y, values) in column.iter().enumerate() {
                let at = (y * PATCH + x) * spacing + block * LANES;
                transformed[at..at + LANES].copy_from_slice(values);
            }
        }
    }
}

/// Applies [`transform_products_rectified`] to one tile: position p of a pixel's channels is at `products[p *
/// spacing..]`. The tile starts at value `left` of every line of `lines`; outputs beyond the lines or their values are
/// dropped.
///
/// # Panics
/// When the channels are not a multiple of eight, or `products` is too short.
#[multiversion::multiversion(targets("x86_64+avx2+fma", "x86_64+avx"))]
pub(crate) fn transform_tile_rectified(
    products: &[f32],
    spacing: usize,
    bias: &[f32],
    lines: &mut [&mut [f32]],
    left: usize,
) {
    let channels = bias.len();
    let mut positions: [&[Lanes]; POSITIONS] = [&[]; POSITIONS];
    for (at, blocks) in positions.iter_mut().enumerate() {
        let (whole, rest) = products[at * spacing..][..channels].as_chunks();
        assert!(rest.is_empty(), "channels come in eights");
        *blocks = whole;
    }
    let (offsets, _) = bias.as_chunks::<LANES>();
    for (block, offsets) in offsets.iter().enumerate() {
        let mut rows = [[[0.0; LANES]; TILE]; PATCH];
        for y in 0..PATCH {
            let mut line = [[0.0; LANES]; PATCH];
            for x in 0..PATCH {
                line[x] = positions[y * PATCH + x][block];
            }
            rows[y] = transform_outputs(&line);
        }
        for x in 0..TILE {
            let column = transform_outputs(&column_of(&rows, x));
            let at = left + x * channels + block * LANES;
            for (line, values) in lines.iter_mut().zip(&column) {
                if let Some(pixel) = line.get_mut(at..at + LANES) {
                    for lane in 0..LANES {
                        pixel[lane] = (values[lane] + offsets[lane]).max(0.0);
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn load(values: &[f32], lanes: &mut Lanes) {
    for (lane, value) in lanes.iter_mut().zip(values) {
        *lane = *value;
    }
}

/// Returns a column of transformed rows. A loop, because `map` would be a call to code without vectors.
#[inline(always)]
fn column_of<const WIDTH: usize>(rows: &[[Lanes; WIDTH]; PATCH], x: usize) -> [Lanes; PATCH] {
    let mut column = [[0.0; LANES]; PATCH];
    for (lanes, row) in column.iter_mut().zip(rows) {
        *lanes = row[x];
    }
    column
}

/// Rows of `B^T`.
#[inline(always)]
fn transform_inputs(d: &[Lanes; PATCH]) -> [Lanes; PATCH] {
    let mut t = [[0.0; LANES]; PATCH];
    for l in 0..LANES {
        let [d0, d1, d2, d3, d4, d5] = [d[0][l], d[1][l], d[2][l], d[3][l], d[4][l], d[5][l]];
        let (even, odd) = (d4 - 4.0 * d2, d3 - 4.0 * d1);
        let (even_two, odd_two) = (d4 - d2, 2.0 * (d3 - d1));
        t[0][l] = 4.0 * d0 - 5.0 * d2 + d4;
        t[1][l] = even + odd;
        t[2][l] = even - odd;
        t[3][l] = even_two + odd_two;
        t[4][l] = even_two - odd_two;
        t[5][l] = 4.0 * d1 - 5.0 * d3 + d5;
    }
    t
}

/// Rows of `A^T`.
#[inline(always)]
fn transform_outputs(m: &[Lanes; PATCH]) -> [Lanes; TILE] {
    let mut t = [[0.0; LANES]; TILE];
    for l in 0..LANES {
        let [m0, m1, m2, m3, m4, m5] = [m[0][l], m[1][l], m[2][l], m[3][l], m[4][l], m[5][l]];
        let (sum, difference) = (m1 + m2, m1 - m2);
        let (sum_two, difference_two) = (m3 + m4, m3 - m4);
        t[0][l] = m0 + sum + sum_two;
        t[1][l] = difference + 2.0 * difference_two;
        t[2][l] = sum + 4.0 * sum_two;
        t[3][l] = difference + 8.0 * difference_two + m5;
    }
    t
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tile_is_what_plain_loops_give() {
        const COUNT: usize = 16;
        let value = |at: usize| ((at * 37 + 11) % 101) as f32 / 50.0 - 1.0;
        let pixels: Vec<Vec<f32>> = (0..POSITIONS)
            .map(|pixel| (0..COUNT).map(|i| value(pixel * COUNT + i)).collect())
            .collect();
        let kernel: [f64; 9] = std::array::from_fn(|at| f64::from(value(7 * at + 3)));
        let bias: Vec<f32> = (0..8).map(|at| value(at + 500)).collect();

        // The pixel at the upper left lies outside the image.
        let patch: [Option<&[f32]>; POSITIONS] =
            std::array::from_fn(|at| (at > 0).then(|| pixels[at].as_slice()));
        let mut transformed = vec![vec![0.0; COUNT]; POSITIONS];
        let mut slices: Vec<&mut [f32]> = transformed.iter_mut().map(Vec::as_mut_slice).collect();
        transform_patches(&patch, &mut slices);
        for (values, factor) in transformed.iter_mut().zip(transform_kernel(kernel)) {
            values.iter_mut().for_each(|value| *value *= factor as f32);
        }
        let products: Vec<&[f32]> = transformed.iter().map(Vec::as_slice).collect();
        let mut tile = vec![vec![0.0; COUNT]; TILE * TILE];
        let mut outputs: Vec<Option<&mut [f32]>> = tile
            .iter_mut()
            .map(|pixel| Some(pixel.as_mut_slice()))
            .collect();
        transform_products_rectified(&products, &bias, &mut outputs);

        for (at, values) in tile.iter().enumerate() {
            for (i, &found) in values.iter().enumerate() {
                let mut expected = f64::from(bias[i % 8]);
                for dy in 0..3 {
                    for dx in 0..3 {
                        let pixel = (at / TILE + dy) * PATCH + at % TILE + dx;
                        if pixel > 0 {
                            expected += kernel[dy * 3 + dx] * f64::from(pixels[pixel][i]);
                        }
                    }
                }
                let expected = expected.max(0.0);
                assert!(
                    (f64::from(found) - expected).abs() < 1e-5,
                    "{found} {expected}"
                );
            }
        }
    }
}
