//! Robust errors: Tukey's weights, and the standard deviation by the median.

use omnilife_schemas::statistics::median;

/// Tukey's constant, for 95 % efficiency under normal errors.
pub(crate) const TUKEY: f64 = 4.685;
/// Standard deviation of normal errors over the median of their absolute values.
const SIGMA_OF_MEDIAN: f64 = 1.4826;

/// Returns Tukey's weight of an error, [0, 1], for a standard deviation of errors.
pub(crate) fn weight(error: f64, sigma: f64) -> f64 {
    let share = error / (TUKEY * sigma).max(f64::MIN_POSITIVE);
    let inside = 1.0 - share * share;
    if inside > 0.0 { inside * inside } else { 0.0 }
}

/// Returns the standard deviation of errors by the median of their absolute values; 0 without errors.
pub(crate) fn sigma_of(errors: &[f64]) -> f64 {
    let sizes: Vec<f64> = errors.iter().map(|error| error.abs()).collect();
    SIGMA_OF_MEDIAN * median(&sizes).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_fall_to_nothing_at_tukeys_constant() {
        for (share, expected) in [
            (0.0, 1.0),
            (0.5, 0.5625),
            (-0.5, 0.5625),
            (1.0, 0.0),
            (3.0, 0.0),
        ] {
            let found = weight(share * TUKEY * 0.2, 0.2);
            assert!((found - expected).abs() < 1e-12, "{share}: {found}");
        }
    }

    #[test]
    fn one_foreign_error_in_three_does_not_change_the_deviation() {
        assert_eq!(sigma_of(&[]), 0.0);
        let found = sigma_of(&[-2.0, 1e9, 1.0]);
        assert!((found - 2.0 * 1.4826).abs() < 1e-12, "{found}");
    }
}
