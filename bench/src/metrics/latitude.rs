//! Weight of a row of an ERP image.

use std::f64::consts::PI;

/// Returns the cosine of the latitude of the centres of a row's pixels, positive: `w_j = cos((j + 1/2 - H/2) pi / H)`
/// (Sun, Lu and Yu 2017).
pub(super) fn cosine(row: usize, height: usize) -> f64 {
    let rows = height as f64;
    ((row as f64 + 0.5 - 0.5 * rows) * PI / rows).cos()
}
