//! Rows of the loss in vectors: the separable window over a band of rows, keeping the last 11
//! filtered rows. Bands are worked on in strips, so that what is kept stays in the cache.

use std::ops::Range;

use fearless_simd::{Simd, f32x8, f64x4, prelude::*};

pub(super) const WINDOW: usize = 11;
pub(super) const RADIUS: usize = WINDOW / 2;
pub(super) const C1: f32 = 0.01 * 0.01;
pub(super) const C2: f32 = 0.03 * 0.03;
const LANES: usize = 8;
const CHANNELS: usize = 3;
/// Pixels across a strip. Whole vectors, whatever is left of the image: strips begin where the rows
/// of the maps have vectors.
const STRIP: usize = 256;

const _: () = assert!(STRIP.is_multiple_of(LANES));

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

    /// The strips of a row, from left to right.
    fn strips(self) -> impl Iterator<Item = Strip> {
        (0..self.width).step_by(STRIP).map(move |first| Strip {
            shape: self,
            first,
            width: STRIP.min(self.width - first),
        })
    }
}

/// Neighbouring columns of an image.
#[derive(Debug, Clone, Copy)]
struct Strip {
    shape: RowShape,
    /// First column.
    first: usize,
    /// Columns.
    width: usize,
}

impl Strip {
    /// The strip's values in a row.
    fn values(&self) -> Range<usize> {
        self.first * CHANNELS..(self.first + self.width) * CHANNELS
    }

    /// Values per row with padding to whole vectors.
    fn stride(&self) -> usize {
        self.values().len().next_multiple_of(LANES)
    }

    /// The strip's values in a row of [`RowShape::stride`], padding included.
    fn padded(&self) -> Range<usize> {
        let begin = self.first * CHANNELS;
        begin..begin + self.stride()
    }

    /// Copies the strip of a row with [`RADIUS`] pixels on either side, wrapped at the image's edges,
    /// and something beyond.
    fn wrap(&self, row: &[f32], padded: &mut Vec<f32>) {
        const MARGIN: usize = RADIUS * CHANNELS;
        let image_width = self.shape.width;
        padded.resize(self.stride() + 2 * MARGIN, 0.0);
        let values = self.values();
        let right_margin = MARGIN + values.len();
        padded[MARGIN..right_margin].copy_from_slice(&row[values]);
        for position in 0..RADIUS {
            let left = (image_width * RADIUS + self.first + position - RADIUS) % image_width;
            let right = (self.first + self.width + position) % image_width;
            let to = position * CHANNELS;
            padded[to..to + CHANNELS].copy_from_slice(&row[left * CHANNELS..][..CHANNELS]);
            padded[right_margin + to..][..CHANNELS]
                .copy_from_slice(&row[right * CHANNELS..][..CHANNELS]);
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
    /// Copies a row of both images in a strip, padded with zeros, and the weight of every value,
    /// padded with 0.
    #[inline(always)]
    fn copy_row(&self, strip: Strip, row: usize, lines: &mut Lines) {
        let begin = row * strip.shape.values();
        let values = begin + strip.values().start..begin + strip.values().end;
        for line in [&mut lines.render, &mut lines.target, &mut lines.weights] {
            line.clear();
        }
        lines.render.extend_from_slice(&self.render[values.clone()]);
        lines.target.extend_from_slice(&self.target[values.clone()]);
        if self.mask.is_empty() {
            lines.weights.resize(values.len(), 1.0);
        } else {
            let first = row * strip.shape.width + strip.first;
            let mask = &self.mask[first..first + strip.width];
            lines
                .weights
                .extend(mask.iter().flat_map(|&weight| [weight; CHANNELS]));
        }
        for line in [&mut lines.render, &mut lines.target, &mut lines.weights] {
            line.resize(strip.stride(), 0.0);
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

impl RowSums {
    pub(super) fn add(&mut self, other: &Self) {
        self.l1 += other.l1;
        self.squares += other.squares;
        self.similarity += other.similarity;
        self.weight += other.weight;
    }
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
        shape,
        window,
        pair,
        first_row,
    } = band;
    let stride = shape.stride();
    scratch.moments.reset(strip.stride());
    scratch.similarity.resize(strip.stride(), 0.0);
    for shifted in 0..sums.len() + 2 * RADIUS {
        // Row `first_row + shifted - RADIUS` of the image.
        match (first_row + shifted).checked_sub(RADIUS) {
            Some(row) if row < shape.height => {
                moments_of_row(simd, &band, strip, row, shifted, scratch);
            }
            _ => scratch.moments.clear(shifted),
        }
        let Some(out) = shifted.checked_sub(2 * RADIUS) else {
            continue;
        };
        let mut maps = derivatives[out * 3 * stride..(out + 1) * 3 * stride]
            .chunks_exact_mut(stride)
            .map(|map| &mut map[strip.padded()]);
        let mut maps: [&mut [f32]; 3] = std::array::from_fn(|_| maps.next().unwrap_or_default());
        similarity_row(simd, window, out, &mut maps, scratch);
        pair.copy_row(strip, first_row + out, &mut scratch.lines);
        sums[out].add(&row_sums(simd, &scratch.lines, &scratch.similarity));
        if !pair.mask.is_empty() {
            for map in maps {
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
    let [x, y, _] = &mut scratch.padded;
    strip.wrap(&pair.render[values.clone()], x);
    strip.wrap(&pair.target[values], y);
    let stride = strip.stride();
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
    [by_mean, by_square, by_product]: &mut [&mut [f32]; 3],
    scratch: &mut Scratch,
) {
    let starts = scratch.moments.starts(first);
    for at in (0..scratch.moments.stride).step_by(LANES) {
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
        shape,
        window,
        pair,
        first_row,
    } = band;
    let (stride, values) = (shape.stride(), shape.values());
    scratch.derivatives.reset(strip.stride());
    scratch.similarity.resize(strip.stride(), 0.0);
    let rows = gradient.len() / values;
    for shifted in 0..rows + 2 * RADIUS {
        match (first_row + shifted).checked_sub(RADIUS) {
            Some(row) if row < shape.height => {
                let maps = &derivatives[row * 3 * stride..(row + 1) * 3 * stride];
                for (map, padded) in maps.chunks_exact(stride).zip(&mut scratch.padded) {
                    strip.wrap(map, padded);
                }
                filter_row(simd, window, shifted, scratch);
            }
            _ => scratch.derivatives.clear(shifted),
        }
        let Some(out) = shifted.checked_sub(2 * RADIUS) else {
            continue;
        };
        pair.copy_row(strip, first_row + out, &mut scratch.lines);
        gradient_row(simd, window, out, weights, scratch);
        let begin = out * values;
        let row = &mut gradient[begin + strip.values().start..begin + strip.values().end];
        row.copy_from_slice(&scratch.similarity[..row.len()]);
    }
}

/// One row of the gradient.
#[inline(always)]
fn gradient_row<S: Simd>(
    simd: S,
    window: &[f32; WINDOW],
    first: usize,
    weights: Weights,
    scratch: &mut Scratch,
) {
    let starts = scratch.derivatives.starts(first);
    let lines = &scratch.lines;
    let zero = f32x8::splat(simd, 0.0);
    for at in (0..scratch.derivatives.stride).step_by(LANES) {
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
