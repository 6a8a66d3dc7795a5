//! How much memory a number of Gaussians takes, before it is taken.

use crate::{error::ReconstructError, gaussians::ArrayShape, process};

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

/// Refuses work that does not fit. `purpose` says what would be made.
///
/// Where the system does not say what it has left (elsewhere than on Linux) nothing is refused.
///
/// # Errors
/// With both figures, when `bytes` is more than what is left.
pub fn require(bytes: u64, purpose: &str) -> Result<(), ReconstructError> {
    match process::available_memory_bytes() {
        Some(available) if bytes > available => Err(ReconstructError::Memory {
            purpose: purpose.to_owned(),
            gibibytes: gibibytes(bytes),
            available_gibibytes: gibibytes(available),
        }),
        _ => Ok(()),
    }
}

fn gibibytes(bytes: u64) -> f64 {
    bytes as f64 / f64::from(1 << 30)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hundred_million_gaussians_are_refused_with_the_figure() {
        let arrays = [ArrayShape {
            name: "values",
            width: 14,
        }];
        let bytes = training_bytes(100_000_000, &arrays);
        assert!(bytes > 60 << 30, "{bytes}");
        let message = require(u64::MAX, "100,000,000 Gaussians")
            .expect_err("no machine has that much")
            .to_string();
        assert!(
            message.contains("100,000,000 Gaussians") && message.contains("GiB"),
            "{message}"
        );
        require(1 << 20, "a few Gaussians").expect("a mebibyte is left");
    }
}
