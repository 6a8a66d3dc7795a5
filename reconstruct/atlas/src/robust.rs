//! Standard deviation of signed errors, robustly.

use omnilife_schemas::statistics::robust_deviation;

/// Returns the standard deviation of errors by the median of their absolute values; 0 without errors.
pub(crate) fn sigma_of(errors: &[f64]) -> f64 {
    let sizes: Vec<f64> = errors.iter().map(|error| error.abs()).collect();
    robust_deviation(&sizes).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_have_no_sign() {
        assert_eq!(sigma_of(&[]), 0.0);
        let found = sigma_of(&[-2.0, 1e9, 1.0]);
        assert!((found - 2.0 * 1.4826).abs() < 1e-12, "{found}");
    }
}
