//! Memory estimates per number of Gaussians.

use crate::parameters::ArrayShape;

/// Returns the bytes of a table of parameters: values, gradients and two moments, 4 bytes each.
pub fn table_bytes(gaussians: u64, arrays: &[ArrayShape]) -> u64 {
    let values: u64 = arrays.iter().map(|array| array.width as u64).sum();
    gaussians.saturating_mul(values).saturating_mul(16)
}

/// Returns the bytes of training: table, activated Gaussians and their gradients (each as wide as the table's
/// values), density statistics, and the renderer's data per visible Gaussian with its tile entries.
pub fn training_bytes(gaussians: u64, arrays: &[ArrayShape]) -> u64 {
    let table = table_bytes(gaussians, arrays);
    let instants = table / 2;
    table
        .saturating_add(instants)
        .saturating_add(gaussians.saturating_mul(8 + RENDERER_BYTES))
}

/// Bytes per Gaussian in the renderer: projection, its gradient, and about four tile entries with theirs.
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
