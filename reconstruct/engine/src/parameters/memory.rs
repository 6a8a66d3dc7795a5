//! How much memory a number of Gaussians takes, before it is taken.

use crate::parameters::ArrayShape;

/// Bytes of a table of parameters: values, gradients and two moments, 4 bytes each.
pub fn table_bytes(gaussians: u64, arrays: &[ArrayShape]) -> u64 {
    let values: u64 = arrays.iter().map(|array| array.width as u64).sum();
    gaussians.saturating_mul(values).saturating_mul(16)
}

/// Bytes of training: the table; activated Gaussians and their gradients, which have the width of
/// the table's values once each; the density statistics; and what the renderer keeps of each visible
/// Gaussian and its entries in tile lists.
pub fn training_bytes(gaussians: u64, arrays: &[ArrayShape]) -> u64 {
    let table = table_bytes(gaussians, arrays);
    let instants = table / 2;
    table
        .saturating_add(instants)
        .saturating_add(gaussians.saturating_mul(8 + RENDERER_BYTES))
}

/// Bytes of one Gaussian in the renderer: projected, its gradient, and about four entries in tile
/// lists with theirs.
const RENDERER_BYTES: u64 = 400;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hundred_million_gaussians_take_more_than_60_gibibytes() {
        let arrays = [ArrayShape {
            name: "values",
            width: 14,
        }];
        let bytes = training_bytes(100_000_000, &arrays);
        assert!(bytes > 60 << 30, "{bytes}");
    }
}
