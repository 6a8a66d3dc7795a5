//! Rows of the loss in vectors: the separable window over a band of rows, keeping the last 11
//! filtered rows.

use fearless_simd::{Simd, f32x8, f64x4, prelude::*};

pub(super) const WINDOW: usize = 11;
pub(super) const RADIUS: usize = WINDOW / 2;
pub(super) const C1: f32 = 0.01 * 0.01;
pub(super) const C2: f32 = 0.03 * 0.03;
const LANES: usize = 8;
const CHANNELS: usize = 3;

/// Rows of one size, as long as whole vectors.
#[derive(Debug, Clone, Copy)]
pub(super) struct RowShape {
    /// Pixels per row.
    pub(super) width: usize,
    /// Rows of the image.
    pub(super) height: usize,
}

impl RowShape {
    /// Values per row.
    pub(super) fn values(&self) -> usize {
        self.width * CHANNELS
    }

    /// Values per row with padding to whole vectors.
    pub(super) fn stride(&self) -> usize {
        self.values().next_multiple_of(LANES)
    }

    /// Copies a row with [`RADIUS`] wrapped pixels on either side, and something beyond.
    fn wrap(&self, row: &[f32], padded: &mut Vec<f32>) {
        const MARGIN: usize = RADIUS * CHANNELS;
        padded.resize(self.stride() + 2 * MARGIN, 0.0);
        let values = self.values();
        padded[MARGIN..MARGIN + values].copy_from_slice(&row[..values]);
        for position in 0..RADIUS {
            let left = (self.width * RADIUS + position - RADIUS) % self.width * CHANNELS;
            let right = position % self.width * CHANNELS;
            let to = position * CHANNELS;
            padded[to..to + CHANNELS].copy_from_slice(&row[left..left + CHANNELS]);
            let to = MARGIN + values + to;
            padded[to..to + CHANNELS].copy_from_slice(&row[right..right + CHANNELS]);
        }
    }
}

/// The last [`WINDOW`] rows of `MAPS` horizontally filtered maps.
#[derive(Debug, Default)]
struct Ring<const MAPS: usize> {
    rows: Vec<f32>,
    stride: usize,
}

impl<const MAPS: usize> Ring<MAPS> {
    fn reset(&mut self, stride: usize) {
        self.stride = stride;
        self.rows.resize(WINDOW * MAPS * stride, 0.0);
    }

    /// The place of row `row` (counted from `-RADIUS`) of a map.
    fn at(&self, row: usize, map: usize) -> usize {
        (row % WINDOW * MAPS + map) * self.stride
    }

    fn clear(&mut self, row: usize) {
        let begin = self.at(row, 0);
        self.rows[begin..begin + MAPS * self.stride].fill(0.0);
    }

    /// The vertical filter at one place, over rows `first .. first + WINDOW`.
    #[inline(always)]
    fn filtered<S: Simd>(
        &self,
        simd: S,
        starts: &[usize; WINDOW],
        window: &[f32; WINDOW],
        at: usize,
    ) -> [f32x8<S>; MAPS] {
        let mut sums = [f32x8::splat(simd, 0.0); MAPS];
        for (start, &weight) in starts.iter().zip(window) {
            for (map, sum) in sums.iter_mut().enumerate() {
                let value = load(simd, &self.rows, start + map * self.stride + at);
                *sum = value.mul_add(weight, *sum);
            }
        }
        sums
    }

    fn starts(&self, first: usize) -> [usize; WINDOW] {
        std::array::from_fn(|tap| self.at(first + tap, 0))
    }
}

#[inline(always)]
fn load<S: Simd>(simd: S, values: &[f32], at: usize) -> f32x8<S> {
    f32x8::from_slice(simd, &values[at..at + LANES])
}

/// Memory for one band, reused.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    moments: Ring<5>,
    derivatives: Ring<3>,
    padded: [Vec<f32>; 3],
    similarity: Vec<f32>,
    lines: Lines,
}

/// The two images, and the weight of each pixel (empty: 1).
#[derive(Debug, Clone, Copy)]
pub(super) struct Pair<'a> {
    pub(super) render: &'a [f32],
    pub(super) target: &'a [f32],
    pub(super) mask: &'a [f32],
}

impl Pair<'_> {
    /// Copies a row of both images, padded with zeros, and the weight of every value, padded with 0.
    #[inline(always)]
    fn copy_row(&self, shape: RowShape, row: usize, lines: &mut Lines) {
        let values = row * shape.values()..(row + 1) * shape.values();
        for line in [&mut lines.render, &mut lines.target, &mut lines.weights] {
            line.clear();
        }
        lines.render.extend_from_slice(&self.render[values.clone()]);
        lines.target.extend_from_slice(&self.target[values]);
        if self.mask.is_empty() {
            lines.weights.resize(shape.values(), 1.0);
        } else {
            let mask = &self.mask[row * shape.width..(row + 1) * shape.width];
            lines
                .weights
                .extend(mask.iter().flat_map(|&weight| [weight; CHANNELS]));
        }
        for line in [&mut lines.render, &mut lines.target, &mut lines.weights] {
            line.resize(shape.stride(), 0.0);
        }
    }
}

/// One row of whole vectors.
#[derive(Debug, Default)]
struct Lines {
    render: Vec<f32>,
    target: Vec<f32>,
    weights: Vec<f32>,
}

/// Some consecutive rows to work on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Band<'a> {
    pub(super) shape: RowShape,
    pub(super) window: &'a [f32; WINDOW],
    pub(super) pair: Pair<'a>,
    pub(super) first_row: usize,
}

/// Sums over one row, weighted by the mask.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct RowSums {
    pub(super) l1: f64,
    pub(super) squares: f64,
    pub(super) similarity: f64,
    pub(super) weight: f64,
}

/// SSIM of the rows of a band. `derivatives` receives, row by row with [`RowShape::stride`], the
/// weighted `ds/dmx`, `ds/dE[x^2]`, `ds/dE[xy]` one after another.
#[inline(always)]
pub(super) fn similarity_band<S: Simd>(
    simd: S,
    band: Band<'_>,
    derivatives: &mut [f32],
    sums: &mut [RowSums],
    scratch: &mut Scratch,
) {
    let Band {
        shape,
        window,
        pair,
        first_row,
    } = band;
    let stride = shape.stride();
    scratch.moments.reset(stride);
    scratch.similarity.resize(stride, 0.0);
    let rows = sums.len();
    for shifted in 0..rows + 2 * RADIUS {
        // Row `first_row + shifted - RADIUS` of the image.
        match (first_row + shifted).checked_sub(RADIUS) {
            Some(row) if row < shape.height => {
                moments_of_row(simd, &band, row, shifted, scratch);
            }
            _ => scratch.moments.clear(shifted),
        }
        let Some(out) = shifted.checked_sub(2 * RADIUS) else {
            continue;
        };
        let row = first_row + out;
        let maps = &mut derivatives[out * 3 * stride..(out + 1) * 3 * stride];
        similarity_row(simd, window, out, maps, scratch);
        pair.copy_row(shape, row, &mut scratch.lines);
        sums[out] = row_sums(simd, &scratch.lines, &scratch.similarity);
        if !pair.mask.is_empty() {
            for map in maps.chunks_exact_mut(stride) {
                for (derivative, weight) in map.iter_mut().zip(&scratch.lines.weights) {
                    *derivative *= weight;
                }
            }
        }
    }
}

#[inline(always)]
fn row_sums<S: Simd>(simd: S, lines: &Lines, similarity: &[f32]) -> RowSums {
    let mut sums = [f64x4::splat(simd, 0.0); 4];
    for at in (0..similarity.len()).step_by(LANES) {
        let weight = load(simd, &lines.weights, at);
        let difference = load(simd, &lines.render, at) - load(simd, &lines.target, at);
        let weighted = [
            difference.abs() * weight,
            difference * difference * weight,
            load(simd, similarity, at) * weight,
            weight,
        ];
        for (sum, values) in sums.iter_mut().zip(weighted) {
            let (low, high) = values.widen();
            *sum += low + high;
        }
    }
    let [l1, squares, similarity, weight] = sums.map(f64x4::reduce_sum);
    RowSums {
        l1,
        squares,
        similarity,
        weight,
    }
}

#[inline(always)]
fn moments_of_row<S: Simd>(
    simd: S,
    band: &Band<'_>,
    row: usize,
    shifted: usize,
    scratch: &mut Scratch,
) {
    let Band {
        shape,
        window,
        pair,
        ..
    } = *band;
    let values = row * shape.values()..(row + 1) * shape.values();
    let [x, y, _] = &mut scratch.padded;
    shape.wrap(&pair.render[values.clone()], x);
    shape.wrap(&pair.target[values], y);
    let stride = shape.stride();
    let begin = scratch.moments.at(shifted, 0);
    let out = &mut scratch.moments.rows[begin..begin + 5 * stride];
    for at in (0..stride).step_by(LANES) {
        let mut sums = [f32x8::splat(simd, 0.0); 5];
        for (tap, &weight) in window.iter().enumerate() {
            let x = load(simd, x, at + tap * CHANNELS);
            let y = load(simd, y, at + tap * CHANNELS);
            let (weighted_x, weighted_y) = (x * weight, y * weight);
            sums[0] += weighted_x;
            sums[1] += weighted_y;
            sums[2] = weighted_x.mul_add(x, sums[2]);
            sums[3] = weighted_y.mul_add(y, sums[3]);
            sums[4] = weighted_x.mul_add(y, sums[4]);
        }
        for (map, sum) in sums.iter().enumerate() {
            sum.store_slice(&mut out[map * stride + at..map * stride + at + LANES]);
        }
    }
}

/// One row of the map and of its derivatives.
#[inline(always)]
fn similarity_row<S: Simd>(
    simd: S,
    window: &[f32; WINDOW],
    first: usize,
    maps: &mut [f32],
    scratch: &mut Scratch,
) {
    let stride = scratch.moments.stride;
    let starts = scratch.moments.starts(first);
    let (by_mean, rest) = maps.split_at_mut(stride);
    let (by_square, by_product) = rest.split_at_mut(stride);
    for at in (0..stride).step_by(LANES) {
        let [x, y, xx, yy, xy] = scratch.moments.filtered(simd, &starts, window, at);
        let mean_product = x * y;
        let mean_squares = x * x + y * y;
        let a1 = mean_product * 2.0 + C1;
        let a2 = (xy - mean_product) * 2.0 + C2;
        let inverse_b1 = f32x8::splat(simd, 1.0) / (mean_squares + C1);
        let inverse_b2 = f32x8::splat(simd, 1.0) / (xx + yy - mean_squares + C2);
        let by_both = inverse_b1 * inverse_b2;
        let s = a1 * a2 * by_both;
        let square = -s * inverse_b2;
        let product = a1 * by_both * 2.0;
        let mean =
            y * a2 * by_both * 2.0 - x * s * inverse_b1 * 2.0 - x * square * 2.0 - y * product;
        let place = at..at + LANES;
        s.store_slice(&mut scratch.similarity[place.clone()]);
        mean.store_slice(&mut by_mean[place.clone()]);
        square.store_slice(&mut by_square[place.clone()]);
        product.store_slice(&mut by_product[place]);
    }
}

/// Factors of the two parts of the gradient.
#[derive(Debug, Clone, Copy)]
pub(super) struct Weights {
    pub(super) l1: f32,
    pub(super) similarity: f32,
}

/// The gradient by the rows of a band of the render; `derivatives` are those of the whole image.
#[inline(always)]
pub(super) fn gradient_band<S: Simd>(
    simd: S,
    band: Band<'_>,
    weights: Weights,
    derivatives: &[f32],
    gradient: &mut [f32],
    scratch: &mut Scratch,
) {
    let Band {
        shape,
        window,
        pair,
        first_row,
    } = band;
    let (stride, values) = (shape.stride(), shape.values());
    scratch.derivatives.reset(stride);
    scratch.similarity.resize(stride, 0.0);
    let rows = gradient.len() / values;
    for shifted in 0..rows + 2 * RADIUS {
        match (first_row + shifted).checked_sub(RADIUS) {
            Some(row) if row < shape.height => {
                let maps = &derivatives[row * 3 * stride..(row + 1) * 3 * stride];
                for (map, padded) in maps.chunks_exact(stride).zip(&mut scratch.padded) {
                    shape.wrap(map, padded);
                }
                filter_row(simd, window, shifted, scratch);
            }
            _ => scratch.derivatives.clear(shifted),
        }
        let Some(out) = shifted.checked_sub(2 * RADIUS) else {
            continue;
        };
        let row = first_row + out;
        let starts = scratch.derivatives.starts(out);
        pair.copy_row(shape, row, &mut scratch.lines);
        let lines = &scratch.lines;
        let zero = f32x8::splat(simd, 0.0);
        for at in (0..stride).step_by(LANES) {
            let [by_mean, by_square, by_product] =
                scratch.derivatives.filtered(simd, &starts, window, at);
            let (x, y) = (load(simd, &lines.render, at), load(simd, &lines.target, at));
            let difference = x - y;
            let l1 = load(simd, &lines.weights, at) * weights.l1;
            let by_l1 = difference
                .simd_gt(0.0)
                .select(l1, difference.simd_lt(0.0).select(-l1, zero));
            let similarity = y.mul_add(by_product, (x * by_square).mul_add(2.0, by_mean));
            let sum = similarity.mul_add(weights.similarity, by_l1);
            sum.store_slice(&mut scratch.similarity[at..at + LANES]);
        }
        gradient[out * values..(out + 1) * values].copy_from_slice(&scratch.similarity[..values]);
    }
}

#[inline(always)]
fn filter_row<S: Simd>(simd: S, window: &[f32; WINDOW], shifted: usize, scratch: &mut Scratch) {
    let stride = scratch.derivatives.stride;
    for (map, padded) in scratch.padded.iter().enumerate() {
        let begin = scratch.derivatives.at(shifted, map);
        let out = &mut scratch.derivatives.rows[begin..begin + stride];
        for at in (0..stride).step_by(LANES) {
            let mut sum = f32x8::splat(simd, 0.0);
            for (tap, &weight) in window.iter().enumerate() {
                sum = load(simd, padded, at + tap * CHANNELS).mul_add(weight, sum);
            }
            sum.store_slice(&mut out[at..at + LANES]);
        }
    }
}
