//! Regions of images: smoothed, without specks and gaps, and their connected parts.

use rayon::prelude::*;

use crate::tracks::detectors::pixels_around::around;

/// Radii of the square windows for opening and closing masks, pixels.
const OPENING: usize = 1;
const CLOSING: usize = 3;

/// Returns means over each pixel and those beside it; NaN is left out, and stays if all are.
pub(super) fn blurred(values: &[f32], width: usize) -> Vec<f32> {
    let height = values.len() / width;
    let mut out = vec![f32::NAN; values.len()];
    // With a column before and one behind the row's.
    let scratch = || [0; 2].map(|_| vec![0.0; width + 2]);
    let row = |[sums, counts]: &mut [Vec<f32>; 2], (row, out): (usize, &mut [f32])| {
        let [inner_sums, inner_counts] =
            [&mut *sums, &mut *counts].map(|values| &mut values[1..=width]);
        inner_sums.fill(0.0);
        inner_counts.fill(0.0);
        for row in row.saturating_sub(1)..=(row + 1).min(height - 1) {
            add_known(
                &values[row * width..(row + 1) * width],
                inner_sums,
                inner_counts,
            );
        }
        means_of_three(sums, counts, out);
    };
    out.par_chunks_mut(width)
        .enumerate()
        .for_each_init(scratch, row);
    out
}

/// Adds known values of a row to sums and counts.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn add_known(row: &[f32], sums: &mut [f32], counts: &mut [f32]) {
    for ((sum, count), value) in sums.iter_mut().zip(counts).zip(row) {
        let is_known = !value.is_nan();
        *sum += if is_known { *value } else { 0.0 };
        *count += if is_known { 1.0 } else { 0.0 };
    }
}

/// Computes means over three neighbours from sums of so many values; NaN without any.
#[multiversion::multiversion(targets("x86_64+avx2"))]
fn means_of_three(sums: &[f32], counts: &[f32], out: &mut [f32]) {
    let neighbours = sums.windows(3).zip(counts.windows(3));
    for (out, (sums, counts)) in out.iter_mut().zip(neighbours) {
        // 0 / 0 is NaN.
        *out = (sums[0] + sums[1] + sums[2]) / (counts[0] + counts[1] + counts[2]);
    }
}

/// Returns for each pixel whether any (or, with `all`, every) pixel of the square around it is set.
fn spread(mask: &[bool], width: usize, radius: usize, all: bool) -> Vec<bool> {
    let mut along_rows = mask.to_vec();
    let rows = along_rows.chunks_exact_mut(width);
    for (out, row) in rows.zip(mask.chunks_exact(width)) {
        for step in 1..=radius.min(width - 1) {
            combine(&mut out[step..], &row[..width - step], all);
            combine(&mut out[..width - step], &row[step..], all);
        }
    }
    let mut out = along_rows.clone();
    for step in 1..=radius.min(mask.len() / width - 1) {
        let end = mask.len() - step * width;
        combine(&mut out[step * width..], &along_rows[..end], all);
        combine(&mut out[..end], &along_rows[step * width..], all);
    }
    out
}

/// Sets (or, with `all`, keeps) pixels that another mask has as well.
fn combine(mask: &mut [bool], other: &[bool], all: bool) {
    let both = mask.iter_mut().zip(other);
    if all {
        both.for_each(|(set, other)| *set &= other);
    } else {
        both.for_each(|(set, other)| *set |= other);
    }
}

/// Removes specks, then gaps.
pub(super) fn opened_and_closed(mask: &[bool], width: usize) -> Vec<bool> {
    let opened = spread(&spread(mask, width, OPENING, true), width, OPENING, false);
    spread(
        &spread(&opened, width, CLOSING, false),
        width,
        CLOSING,
        true,
    )
}

/// The part of an image around some pixels, as a mask with their places in the image.
struct Part {
    left: usize,
    top: usize,
    width: usize,
    mask: Vec<bool>,
}

impl Part {
    /// Cuts it out with so many pixels around them, as far as the image goes.
    fn around(pixels: &[usize], margin: usize, [width, height]: [usize; 2]) -> Option<Self> {
        let columns = || pixels.iter().map(|pixel| pixel % width);
        let rows = || pixels.iter().map(|pixel| pixel / width);
        let left = columns().min()?.saturating_sub(margin);
        let top = rows().min()?.saturating_sub(margin);
        let right = (columns().max()? + margin + 1).min(width);
        let bottom = (rows().max()? + margin + 1).min(height);
        let part = right - left;
        let mut mask = vec![false; part * (bottom - top)];
        for pixel in pixels {
            mask[(pixel / width - top) * part + pixel % width - left] = true;
        }
        Some(Self {
            left,
            top,
            width: part,
            mask,
        })
    }

    /// Returns a pixel of the part in an image of some width.
    fn in_image(&self, at: usize, width: usize) -> usize {
        (at / self.width + self.top) * width + at % self.width + self.left
    }
}

/// Returns the connected pieces of some pixels, without specks and gaps, the largest first; only the part of the image
/// around them is processed.
pub(super) fn pieces(pixels: &[usize], width: usize, height: usize) -> Vec<Vec<usize>> {
    const MARGIN: usize = OPENING + CLOSING;
    let Some(part) = Part::around(pixels, MARGIN, [width, height]) else {
        return Vec::new();
    };
    let found = components(&opened_and_closed(&part.mask, part.width), part.width).into_iter();
    let in_image = |at: usize| part.in_image(at, width);
    let mut pieces: Vec<Vec<usize>> = found
        .map(|piece| piece.into_iter().map(in_image).collect())
        .collect();
    pieces.sort_by_key(|piece| std::cmp::Reverse(piece.len()));
    pieces
}

/// Least number of pixels of a core.
const LEAST_CORE: usize = 8;
/// Largest share of the bounding box that the boxes of separated parts may cover.
const MOST_OF_BOX: f64 = 0.9;

/// Separates connected pixels at a neck: they are eroded by up to `deepest` pixels until more than one core is left,
/// and every pixel goes to the nearest core. Parts have at least `least_pixels`.
pub(super) fn separated(
    pixels: Vec<usize>,
    width: usize,
    least_pixels: f64,
    deepest: usize,
) -> Vec<Vec<usize>> {
    if (pixels.len() as f64) < 2.0 * least_pixels {
        return vec![pixels];
    }
    let height = pixels.iter().max().map_or(0, |last| last / width + 1);
    let Some(part) = Part::around(&pixels, 0, [width, height]) else {
        return vec![pixels];
    };
    let mut rest = part.mask.clone();
    for _ in 0..deepest {
        rest = eaten(&rest, part.width);
        let mut cores = components(&rest, part.width);
        cores.retain(|core| core.len() >= LEAST_CORE);
        if cores.is_empty() {
            break;
        }
        if cores.len() == 1 {
            continue;
        }
        let grown = grown(&part, &cores);
        let is_enough = |piece: &Vec<usize>| piece.len() as f64 >= least_pixels;
        let area = |pixels: &[usize]| {
            let columns = || pixels.iter().map(|pixel| pixel % part.width);
            let rows = || pixels.iter().map(|pixel| pixel / part.width);
            let side = |low: Option<usize>, high: Option<usize>| {
                high.zip(low)
                    .map_or(0.0, |(high, low)| (high - low + 1) as f64)
            };
            side(columns().min(), columns().max()) * side(rows().min(), rows().max())
        };
        let boxes: f64 = grown.iter().map(|piece| area(piece)).sum();
        let whole: Vec<usize> = (0..part.mask.len()).filter(|&at| part.mask[at]).collect();
        if grown.iter().all(is_enough) && boxes <= MOST_OF_BOX * area(&whole) {
            return grown
                .into_iter()
                .map(|piece| {
                    piece
                        .into_iter()
                        .map(|at| part.in_image(at, width))
                        .collect()
                })
                .flat_map(|piece| separated(piece, width, least_pixels, deepest))
                .collect();
        }
    }
    vec![pixels]
}

/// Erodes a mask: pixels with all eight neighbours stay.
fn eaten(mask: &[bool], width: usize) -> Vec<bool> {
    let height = mask.len() / width;
    let is_inside = |at: usize| {
        let (row, column) = (at / width, at % width);
        let is_border = row == 0 || column == 0 || row + 1 == height || column + 1 == width;
        !is_border
            && (row - 1..=row + 1).all(|row| {
                let first = row * width + column - 1;
                mask[first..first + 3].iter().all(|set| *set)
            })
    };
    (0..mask.len()).map(is_inside).collect()
}

/// Assigns every pixel of a part to the core from which it is reached first.
fn grown(part: &Part, cores: &[Vec<usize>]) -> Vec<Vec<usize>> {
    let (width, height) = (part.width, part.mask.len() / part.width);
    let mut is_open = part.mask.clone();
    let mut pieces: Vec<Vec<usize>> = cores.to_vec();
    cores.iter().flatten().for_each(|&at| is_open[at] = false);
    let mut borders = pieces.clone();
    while borders.iter().any(|border| !border.is_empty()) {
        for (piece, border) in pieces.iter_mut().zip(&mut borders) {
            let mut next = Vec::new();
            for &at in border.iter() {
                around(at, [width, height], |neighbour| {
                    if is_open[neighbour] {
                        is_open[neighbour] = false;
                        next.push(neighbour);
                    }
                });
            }
            piece.extend(&next);
            *border = next;
        }
    }
    pieces
}

/// Pixels of the connected components (8 neighbours).
pub(super) fn components(mask: &[bool], width: usize) -> Vec<Vec<usize>> {
    let height = mask.len() / width;
    let mut is_open = mask.to_vec();
    let mut all = Vec::new();
    for first in 0..mask.len() {
        if !is_open[first] {
            continue;
        }
        is_open[first] = false;
        let mut pixels = vec![first];
        let mut next = 0;
        while let Some(&pixel) = pixels.get(next) {
            next += 1;
            around(pixel, [width, height], |neighbour| {
                if is_open[neighbour] {
                    is_open[neighbour] = false;
                    pixels.push(neighbour);
                }
            });
        }
        all.push(pixels);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn components_are_connected_and_specks_go() {
        let width = 20;
        let mut mask = vec![false; 20 * 12];
        for (row, column) in
            [(2..6, 3..9), (3..6, 12..18)]
                .into_iter()
                .flat_map(|(rows, columns)| {
                    rows.flat_map(move |row| columns.clone().map(move |column| (row, column)))
                })
        {
            mask[row * width + column] = true;
        }
        mask[width * 11] = true;
        let opened = spread(&spread(&mask, width, 1, true), width, 1, false);
        let mut sizes: Vec<usize> = components(&opened, width).iter().map(Vec::len).collect();
        sizes.sort_unstable();
        assert_eq!(sizes, [18, 24]);
        // The two are near enough to be closed into one.
        assert_eq!(components(&opened_and_closed(&mask, width), width).len(), 1);
    }

    #[test]
    fn squares_around_pixels_reach_as_far_as_the_image() {
        let (width, height) = (11, 7);
        let mask: Vec<bool> = (0..width * height).map(|at| at * 29 % 7 < 3).collect();
        let values: Vec<f32> = (0..width * height)
            .map(|at| if at * 31 % 5 < 3 { f32::NAN } else { at as f32 })
            .collect();
        let square = |at: usize, radius: usize| {
            let (row, column) = (at / width, at % width);
            let rows = row.saturating_sub(radius)..=(row + radius).min(height - 1);
            rows.flat_map(move |row| {
                let columns = column.saturating_sub(radius)..=(column + radius).min(width - 1);
                columns.map(move |column| row * width + column)
            })
        };
        for radius in [1, 3, 20] {
            let [any, all] = [false, true].map(|all| spread(&mask, width, radius, all));
            for at in 0..mask.len() {
                assert_eq!(any[at], square(at, radius).any(|at| mask[at]));
                assert_eq!(all[at], square(at, radius).all(|at| mask[at]));
            }
        }
        let blurred = blurred(&values, width);
        for (at, blurred) in blurred.into_iter().enumerate() {
            let known: Vec<f32> = square(at, 1)
                .map(|at| values[at])
                .filter(|value| !value.is_nan())
                .collect();
            let mean = known.iter().sum::<f32>() / known.len() as f32;
            let is_same = (blurred - mean).abs() < 1e-4 || blurred.is_nan() && mean.is_nan();
            assert!(is_same, "{blurred} {mean}");
        }
    }

    #[test]
    fn a_piece_is_the_same_as_in_the_whole_image() {
        let (width, height) = (40, 25);
        // Two blobs, one with a hole and touching the border, and a speck.
        let is_set = |x: usize, y: usize| {
            (x < 9 && (5..14).contains(&y) && (x, y) != (4, 8))
                || ((20..26).contains(&x) && (10..15).contains(&y))
                || (x, y) == (33, 20)
        };
        let pixels: Vec<usize> = (0..width * height)
            .filter(|pixel| is_set(pixel % width, pixel / width))
            .collect();
        let mut mask = vec![false; width * height];
        pixels.iter().for_each(|&pixel| mask[pixel] = true);
        let whole = components(&opened_and_closed(&mask, width), width);
        let largest = whole.into_iter().max_by_key(Vec::len);
        let found = pieces(&pixels, width, height);
        assert_eq!(found.first(), largest.as_ref());
        assert_eq!(largest.map(|piece| piece.len()), Some(81));
        assert!(pieces(&[], width, height).is_empty());
    }

    #[test]
    fn what_hangs_together_by_a_neck_is_told_apart() {
        let width = 60;
        // Two rectangles side by side, the second farther on, that touch along a few pixels.
        let of = |columns: std::ops::Range<usize>, rows: std::ops::Range<usize>| {
            rows.flat_map(move |row| columns.clone().map(move |column| row * width + column))
        };
        let (one, other) = (of(2..32, 3..15), of(26..56, 15..27));
        let both: Vec<usize> = one.clone().chain(other.clone()).collect();
        let mut apart = separated(both.clone(), width, 100.0, 8);
        assert_eq!(apart.len(), 2);
        apart.sort_by_key(|piece| piece.iter().min().copied());
        for (piece, truth) in apart
            .iter()
            .zip([one.clone().collect(), other.collect::<Vec<_>>()])
        {
            let own = piece.iter().filter(|at| truth.contains(at)).count();
            assert!(own as f64 > 0.93 * truth.len() as f64 && piece.len() < truth.len() + 30);
        }
        assert_eq!(apart.iter().map(Vec::len).sum::<usize>(), both.len());
        // One vehicle stays one, however it is eroded, and so do parts that are too small.
        assert_eq!(separated(one.collect(), width, 100.0, 8).len(), 1);
        assert_eq!(separated(both, width, 400.0, 8).len(), 1);
    }
}
