//! Vectorized rows of the loss: the separable window over a band of rows, keeping the last 11 filtered rows.
//! Bands are divided into strips, so that the kept rows stay in the cache.

use std::ops::Range;

use fearless_simd::{Simd, f32x8, f64x4, prelude::*};

use super::strips::{RowShape, Strip};

pub(super) const WINDOW: usize = 11;
pub(super) const RADIUS: usize = WINDOW / 2;
pub(super) const C1: f32 = 0.01 * 0.01;
pub(super) const C2: f32 = 0.03 * 0.03;
pub(super) const LANES: usize = 8;
pub(super) const CHANNELS: usize = 3;
/// Reach of the window to either side, in values.
pub(super) const MARGIN: usize = RADIUS * CHANNELS;
/// Values under the windows of one vector.
const REACH: usize = LANES + 2 * MARGIN;

/// One value of every map, for every lane.
type Maps<const MAPS: usize> = [[f32; LANES]; MAPS];

/// The last [`WINDOW`] rows of `MAPS` horizontally filtered maps.
#[derive(Debug, Default)]
struct Ring<const MAPS: usize> {
    rows: Vec<Maps<MAPS>>,
    vectors: usize,
}

impl<const MAPS: usize> Ring<MAPS> {
    fn reset(&mut self, vectors: usize) {
        self.vectors = vectors;
        self.rows.resize(WINDOW * vectors, [[0.0; LANES]; MAPS]);
    }

    /// Returns the range of row `row`, counted from `-RADIUS`.
    fn range(&self, row: usize) -> Range<usize> {
        let begin = row % WINDOW * self.vectors;
        begin..begin + self.vectors
    }

    fn row_mut(&mut self, row: usize) -> &mut [Maps<MAPS>] {
        let range = self.range(row);
        &mut self.rows[range]
    }

    /// Returns the rows `first .. first + WINDOW`.
    fn rows(&self, first: usize) -> [&[Maps<MAPS>]; WINDOW] {
        std::array::from_fn(|tap| &self.rows[self.range(first + tap)])
    }
}

/// Applies the vertical filter to one vector of the rows of a [`Ring`].
#[inline(always)]
fn filtered<S: Simd, const MAPS: usize>(
    simd: S,
    rows: &[&[Maps<MAPS>]; WINDOW],
    window: &[f32; WINDOW],
    at: usize,
) -> [f32x8<S>; MAPS] {
    let mut sums = [f32x8::splat(simd, 0.0); MAPS];
    for (row, &weight) in rows.iter().zip(window) {
        for (sum, &value) in sums.iter_mut().zip(&row[at]) {
            *sum = f32x8::simd_from(simd, value).mul_add(weight, *sum);
        }
    }
    sums
}

/// Applies the horizontal filter to the vector at `at` of a row of [`Strip::pad`].
#[inline(always)]
fn filtered_row<S: Simd>(simd: S, padded: &[f32], window: &[f32; WINDOW], at: usize) -> f32x8<S> {
    let mut sum = f32x8::splat(simd, 0.0);
    if let Some(values) = padded[at..].first_chunk::<REACH>() {
        for (tap, &weight) in window.iter().enumerate() {
            let value = f32x8::from_slice(simd, &values[tap * CHANNELS..tap * CHANNELS + LANES]);
            sum = value.mul_add(weight, sum);
        }
    }
    sum
}

/// Returns vector number `at` of a row, with zeros beyond its end.
#[inline(always)]
fn vector(row: &[f32], at: usize) -> [f32; LANES] {
    let values = &row[at * LANES..];
    values.first_chunk().copied().unwrap_or_else(|| {
        let mut padded = [0.0; LANES];
        padded[..values.len()].copy_from_slice(values);
        padded
    })
}

/// Memory for one band, reused.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    moments: Ring<4>,
    derivatives: Ring<3>,
    padded: [Vec<f32>; 4],
    /// Weight of every value of a row.
    weights: Vec<f32>,
}

/// The two images, and the weight of each pixel (empty: 1).
#[derive(Debug, Clone, Copy)]
pub(super) struct Pair<'a> {
    pub(super) render: &'a [f32],
    pub(super) target: &'a [f32],
    pub(super) mask: &'a [f32],
}

impl<'a> Pair<'a> {
    /// Returns a row of both images in a strip.
    fn rows(&self, strip: Strip, row: usize) -> [&'a [f32]; 2] {
        let begin = row * strip.shape.values();
        let values = begin + strip.values().start..begin + strip.values().end;
        [&self.render[values.clone()], &self.target[values]]
    }

    /// Writes the weight of every value of a row in a strip.
    fn weigh(&self, strip: Strip, row: usize, weights: &mut Vec<f32>) {
        weights.clear();
        if self.mask.is_empty() {
            weights.resize(strip.values().len(), 1.0);
        } else {
            let first = row * strip.shape.width + strip.first;
            let mask = &self.mask[first..first + strip.width];
            weights.extend(mask.iter().flat_map(|&weight| [weight; CHANNELS]));
        }
    }
}

/// A band of consecutive rows.
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

impl RowSums {
    pub(super) fn add(&mut self, other: &Self) {
        self.l1 += other.l1;
        self.squares += other.squares;
        self.similarity += other.similarity;
        self.weight += other.weight;
    }
}

/// Computes SSIM of the rows of a band. `derivatives` receives, row by row with [`RowShape::stride`], the
/// weighted `ds/dmx`, `ds/dE[x^2]`, `ds/dE[xy]` one after another.
#[inline(always)]
pub(super) fn similarity_band<S: Simd>(
    simd: S,
    band: Band<'_>,
    derivatives: &mut [f32],
    sums: &mut [RowSums],
    scratch: &mut Scratch,
) {
    sums.fill(RowSums::default());
    for strip in band.shape.strips() {
        similarity_strip(simd, band, strip, derivatives, sums, scratch);
    }
}

#[inline(always)]
fn similarity_strip<S: Simd>(
    simd: S,
    band: Band<'_>,
    strip: Strip,
    derivatives: &mut [f32],
    sums: &mut [RowSums],
    scratch: &mut Scratch,
) {
    let Band {
        shape, first_row, ..
    } = band;
    let stride = shape.stride();
    scratch.moments.reset(strip.vectors());
    for shifted in 0..sums.len() + 2 * RADIUS {
        // Row `first_row + shifted - RADIUS` of the image.
        match (first_row + shifted).checked_sub(RADIUS) {
            Some(row) if row < shape.height => {
                moments_of_row(simd, &band, strip, row, shifted, scratch);
            }
            _ => scratch.moments.row_mut(shifted).fill([[0.0; LANES]; 4]),
        }
        let Some(out) = shifted.checked_sub(2 * RADIUS) else {
            continue;
        };
        let mut maps = derivatives[out * 3 * stride..(out + 1) * 3 * stride]
            .chunks_exact_mut(stride)
            .map(|map| &mut map.as_chunks_mut::<LANES>().0[strip.padded()]);
        let mut maps = std::array::from_fn(|_| maps.next().unwrap_or_default());
        sums[out].add(&similarity_row(simd, &band, strip, out, &mut maps, scratch));
    }
}

#[inline(always)]
fn moments_of_row<S: Simd>(
    simd: S,
    band: &Band<'_>,
    strip: Strip,
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
    let [x, y, squares, products] = &mut scratch.padded;
    strip.pad(&pair.render[values.clone()], x);
    strip.pad(&pair.target[values], y);
    squares.resize(x.len(), 0.0);
    products.resize(x.len(), 0.0);
    let both = x.as_chunks::<LANES>().0.iter().zip(y.as_chunks().0);
    let out = squares
        .as_chunks_mut()
        .0
        .iter_mut()
        .zip(products.as_chunks_mut().0);
    for ((&x, &y), (square, product)) in both.zip(out) {
        let (x, y) = (f32x8::simd_from(simd, x), f32x8::simd_from(simd, y));
        *square = x.mul_add(x, y * y).into();
        *product = (x * y).into();
    }
    let padded = &scratch.padded;
    for (vector, out) in scratch.moments.row_mut(shifted).iter_mut().enumerate() {
        for (out, padded) in out.iter_mut().zip(padded) {
            *out = filtered_row(simd, padded, window, vector * LANES).into();
        }
    }
}

/// Computes one row of the map's derivatives, and the sums over the row.
#[inline(always)]
fn similarity_row<S: Simd>(
    simd: S,
    band: &Band<'_>,
    strip: Strip,
    out: usize,
    [by_mean, by_square, by_product]: &mut [&mut [[f32; LANES]]; 3],
    scratch: &mut Scratch,
) -> RowSums {
    let row = band.first_row + out;
    let [render, target] = band.pair.rows(strip, row);
    band.pair.weigh(strip, row, &mut scratch.weights);
    let moments = scratch.moments.rows(out);
    let mut sums = [f64x4::splat(simd, 0.0); 4];
    let by_each = by_mean
        .iter_mut()
        .zip(&mut **by_square)
        .zip(&mut **by_product);
    for (at, ((by_mean, by_square), by_product)) in by_each.enumerate() {
        let [x, y, squares, xy] = filtered(simd, &moments, band.window, at);
        let mean_product = x * y;
        let mean_squares = x * x + y * y;
        let a1 = mean_product * 2.0 + C1;
        let a2 = (xy - mean_product) * 2.0 + C2;
        let inverse_b1 = f32x8::splat(simd, 1.0) / (mean_squares + C1);
        let inverse_b2 = f32x8::splat(simd, 1.0) / (squares - mean_squares + C2);
        let by_both = inverse_b1 * inverse_b2;
        let s = a1 * a2 * by_both;
        let square = -s * inverse_b2;
        let product = a1 * by_both * 2.0;
        let mean =
            y * a2 * by_both * 2.0 - x * s * inverse_b1 * 2.0 - x * square * 2.0 - y * product;

        let weight = f32x8::simd_from(simd, vector(&scratch.weights, at));
        *by_mean = (mean * weight).into();
        *by_square = (square * weight).into();
        *by_product = (product * weight).into();
        let difference =
            f32x8::simd_from(simd, vector(render, at)) - f32x8::simd_from(simd, vector(target, at));
        let weighted = [
            difference.abs() * weight,
            difference * difference * weight,
            s * weight,
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

/// Factors of the two parts of the gradient.
#[derive(Debug, Clone, Copy)]
pub(super) struct Weights {
    pub(super) l1: f32,
    pub(super) similarity: f32,
}

/// Computes the gradient by the rows of a band of the render; `derivatives` are those of the whole image.
#[inline(always)]
pub(super) fn gradient_band<S: Simd>(
    simd: S,
    band: Band<'_>,
    weights: Weights,
    derivatives: &[f32],
    gradient: &mut [f32],
    scratch: &mut Scratch,
) {
    for strip in band.shape.strips() {
        gradient_strip(simd, band, strip, weights, derivatives, gradient, scratch);
    }
}

#[inline(always)]
fn gradient_strip<S: Simd>(
    simd: S,
    band: Band<'_>,
    strip: Strip,
    weights: Weights,
    derivatives: &[f32],
    gradient: &mut [f32],
    scratch: &mut Scratch,
) {
    let Band {
        shape, first_row, ..
    } = band;
    let (stride, values) = (shape.stride(), shape.values());
    scratch.derivatives.reset(strip.vectors());
    let rows = gradient.len() / values;
    for shifted in 0..rows + 2 * RADIUS {
        match (first_row + shifted).checked_sub(RADIUS) {
            Some(row) if row < shape.height => {
                let maps = &derivatives[row * 3 * stride..(row + 1) * 3 * stride];
                for (map, padded) in maps.chunks_exact(stride).zip(&mut scratch.padded) {
                    strip.pad(map, padded);
                }
                let padded = &scratch.padded;
                for (vector, out) in scratch.derivatives.row_mut(shifted).iter_mut().enumerate() {
                    for (out, padded) in out.iter_mut().zip(padded) {
                        *out = filtered_row(simd, padded, band.window, vector * LANES).into();
                    }
                }
            }
            _ => scratch.derivatives.row_mut(shifted).fill([[0.0; LANES]; 3]),
        }
        let Some(out) = shifted.checked_sub(2 * RADIUS) else {
            continue;
        };
        let begin = out * values;
        let row = &mut gradient[begin + strip.values().start..begin + strip.values().end];
        gradient_row(simd, &band, strip, out, weights, row, scratch);
    }
}

#[inline(always)]
fn gradient_row<S: Simd>(
    simd: S,
    band: &Band<'_>,
    strip: Strip,
    out: usize,
    weights: Weights,
    gradient: &mut [f32],
    scratch: &mut Scratch,
) {
    let row = band.first_row + out;
    let [render, target] = band.pair.rows(strip, row);
    band.pair.weigh(strip, row, &mut scratch.weights);
    let derivatives = scratch.derivatives.rows(out);
    let zero = f32x8::splat(simd, 0.0);
    for (at, gradient) in gradient.chunks_mut(LANES).enumerate() {
        let [by_mean, by_square, by_product] = filtered(simd, &derivatives, band.window, at);
        let [x, y, weight] =
            [render, target, &scratch.weights].map(|row| f32x8::simd_from(simd, vector(row, at)));
        let difference = x - y;
        let l1 = weight * weights.l1;
        let by_l1 = difference
            .simd_gt(0.0)
            .select(l1, difference.simd_lt(0.0).select(-l1, zero));
        let similarity = y.mul_add(by_product, (x * by_square).mul_add(2.0, by_mean));
        let sum: [f32; LANES] = similarity.mul_add(weights.similarity, by_l1).into();
        match gradient.first_chunk_mut() {
            Some(whole) => *whole = sum,
            None => gradient.copy_from_slice(&sum[..gradient.len()]),
        }
    }
}
