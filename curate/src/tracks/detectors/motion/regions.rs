//! Regions of images: smoothed, without specks and gaps, and their connected parts.

use rayon::prelude::*;

/// Radii of the square windows that open and close what was found, pixels.
const OPENING: usize = 1;
const CLOSING: usize = 3;

/// Means over squares that reach `radius` pixels; NaN is left out, and stays where all are.
pub(super) fn blurred(values: &[f32], width: usize, radius: usize) -> Vec<f32> {
    let height = values.len() / width;
    let mut out = vec![f32::NAN; values.len()];
    out.par_chunks_mut(width)
        .enumerate()
        .for_each(|(row, out)| {
            for (column, out) in out.iter_mut().enumerate() {
                let (mut sum, mut count) = (0.0, 0);
                for row in row.saturating_sub(radius)..=(row + radius).min(height - 1) {
                    for column in column.saturating_sub(radius)..=(column + radius).min(width - 1) {
                        let value = values[row * width + column];
                        if !value.is_nan() {
                            sum += value;
                            count += 1;
                        }
                    }
                }
                if count > 0 {
                    *out = sum / count as f32;
                }
            }
        });
    out
}

/// Whether any (or, `all`, every) pixel of the square around each is set.
fn spread(mask: &[bool], width: usize, radius: usize, all: bool) -> Vec<bool> {
    let height = mask.len() / width;
    let pass = |mask: &[bool], along_rows: bool| -> Vec<bool> {
        (0..mask.len())
            .map(|pixel| {
                let (row, column) = (pixel / width, pixel % width);
                let (at, end, stride) = if along_rows {
                    (column, width, 1)
                } else {
                    (row, height, width)
                };
                let mut near = (at.saturating_sub(radius)..=(at + radius).min(end - 1))
                    .map(|other| mask[pixel + other * stride - at * stride]);
                if all {
                    near.all(|set| set)
                } else {
                    near.any(|set| set)
                }
            })
            .collect()
    };
    pass(&pass(mask, true), false)
}

/// Without specks, and without gaps.
pub(super) fn opened_and_closed(mask: &[bool], width: usize) -> Vec<bool> {
    let opened = spread(&spread(mask, width, OPENING, true), width, OPENING, false);
    spread(
        &spread(&opened, width, CLOSING, false),
        width,
        CLOSING,
        true,
    )
}

/// The largest connected piece of some pixels, without specks and gaps; only the part of the image around them
/// is looked at.
pub(super) fn largest_piece(pixels: &[usize], width: usize, height: usize) -> Option<Vec<usize>> {
    const MARGIN: usize = OPENING + CLOSING;
    let columns = || pixels.iter().map(|pixel| pixel % width);
    let rows = || pixels.iter().map(|pixel| pixel / width);
    let left = columns().min()?.saturating_sub(MARGIN);
    let top = rows().min()?.saturating_sub(MARGIN);
    let right = (columns().max()? + MARGIN + 1).min(width);
    let bottom = (rows().max()? + MARGIN + 1).min(height);
    let part = right - left;
    let mut mask = vec![false; part * (bottom - top)];
    for pixel in pixels {
        mask[(pixel / width - top) * part + pixel % width - left] = true;
    }
    let pieces = components(&opened_and_closed(&mask, part), part).into_iter();
    let in_image = |at: usize| (at / part + top) * width + at % part + left;
    let largest = pieces.max_by_key(Vec::len)?;
    Some(largest.into_iter().map(in_image).collect())
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
            let (row, column) = (pixel / width, pixel % width);
            for row in row.saturating_sub(1)..=(row + 1).min(height - 1) {
                for column in column.saturating_sub(1)..=(column + 1).min(width - 1) {
                    let neighbour = row * width + column;
                    if is_open[neighbour] {
                        is_open[neighbour] = false;
                        pixels.push(neighbour);
                    }
                }
            }
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
        assert_eq!(largest_piece(&pixels, width, height), largest);
        assert_eq!(largest.map(|piece| piece.len()), Some(81));
        assert_eq!(largest_piece(&[], width, height), None);
    }
}
