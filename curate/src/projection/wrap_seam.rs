//! Test for continuity across the left and right edge.

use omnilife_schemas::statistics;
use std::f64::consts::PI;

use super::{ProjectionTest, median_over};
use crate::video::Rgb8Image;

/// Differences, in 8-bit levels, between far and neighbouring columns below which an image is too plain for the test.
const LEAST_CONTRAST_LEVELS: f64 = 1.5;

/// Pairs of columns at either edge that measure the detail of the image there.
const EDGE_PAIRS: usize = 4;

/// The wrap seam of the whole image.
pub(super) const WHOLE: ProjectionTest = ProjectionTest {
    id: "wrap-seam",
    summary: "Difference of the last and the first column on the scale on which neighbouring \
              columns are 0 and distant ones are 1. An ERP's edges are neighbours.",
    limit: 0.3,
    at_most: "the left and the right edge are neighbours",
    above: "the image breaks at its left and right edge",
    measure: |_, samples| median_over(samples, |image| seam(image, image.width)),
};

/// The wrap seam of the left half, for side-by-side stereo.
pub(super) const LEFT_HALF: ProjectionTest = ProjectionTest {
    id: "wrap-seam-left-half",
    summary: "The wrap seam of the left half alone: side-by-side ERP images wrap each in itself.",
    limit: 0.3,
    at_most: "the left half wraps in itself",
    above: "the left half does not wrap in itself",
    measure: |_, samples| median_over(samples, |image| seam(image, image.width / 2)),
};

/// Returns the seam of the leftmost `width` columns.
fn seam(image: &Rgb8Image, width: usize) -> Option<f64> {
    if width < 16 {
        return None;
    }
    let shares = row_shares(image.height);
    let column_difference = |a, b| column_difference(image, &shares, a, b);
    let neighbours: Vec<f64> = (0..width - 1)
        .map(|x| column_difference(x, x + 1))
        .collect();
    let distant: Vec<f64> = (0..width)
        .step_by(4)
        .flat_map(|x| [width / 4, width / 3, width / 2].map(|shift| (x, (x + shift) % width)))
        .map(|(a, b)| column_difference(a, b))
        .collect();
    // Detail may be rich or poor at the edges; a real seam continues it.
    let at_edges: Vec<f64> = neighbours[..EDGE_PAIRS]
        .iter()
        .chain(&neighbours[neighbours.len() - EDGE_PAIRS..])
        .copied()
        .collect();
    let near = statistics::median(&neighbours)?.max(statistics::median(&at_edges)?);
    let far = statistics::median(&distant)?;
    (far - near >= LEAST_CONTRAST_LEVELS)
        .then(|| ((column_difference(width - 1, 0) - near) / (far - near)).max(0.0))
}

/// Returns weights of the rows: the cosine of their latitude, so that the poles, which always agree, do not dominate.
fn row_shares(height: usize) -> Vec<f64> {
    let cosine = |y: usize| ((0.5 - (y as f64 + 0.5) / height as f64) * PI).cos();
    let total: f64 = (0..height).map(cosine).sum();
    (0..height).map(|y| cosine(y) / total).collect()
}

/// Returns the mean absolute difference of two columns in 8-bit levels.
fn column_difference(image: &Rgb8Image, shares: &[f64], a: usize, b: usize) -> f64 {
    shares
        .iter()
        .enumerate()
        .map(|(y, share)| {
            let (one, other) = (image.pixel(a, y), image.pixel(b, y));
            let difference: u32 = one
                .iter()
                .zip(other)
                .map(|(&p, q)| u32::from(p.abs_diff(q)))
                .sum();
            share * f64::from(difference) / 3.0
        })
        .sum()
}
