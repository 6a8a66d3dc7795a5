//! Order statistics.

/// Quantile `share` in [0, 1] (nearest rank, NaN sorted last) of values; `None` of none.
pub fn quantile(values: &[f64], share: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let rank = (share * sorted.len().saturating_sub(1) as f64).round() as usize;
    sorted.get(rank).copied()
}

/// Median (nearest rank) of values; `None` of none.
pub fn median(values: &[f64]) -> Option<f64> {
    quantile(values, 0.5)
}

/// Quantile `share` of the values whose times lie within `reach_seconds` of that of `index`.
/// `times` is sorted and as long as `values`.
pub fn local_quantile(
    times: &[f64],
    values: &[f32],
    index: usize,
    reach_seconds: f64,
    share: f64,
) -> f32 {
    let centre = times[index];
    let first = times.partition_point(|&time| time < centre - reach_seconds);
    let last = times.partition_point(|&time| time <= centre + reach_seconds);
    let mut window = values[first..last].to_vec();
    let rank = (share * (window.len() - 1) as f64).round() as usize;
    let (_, value, _) = window.select_nth_unstable_by(rank, f32::total_cmp);
    *value
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_nearest_ranks() {
        let values = [5.0, 1.0, 4.0, 2.0, 3.0];
        assert_eq!(median(&values), Some(3.0));
        assert_eq!(quantile(&values, 0.9), Some(5.0));
        assert_eq!(quantile(&values, 0.0), Some(1.0));
        assert_eq!(median(&[]), None);
    }

    #[test]
    fn local_quantiles_see_only_their_window() {
        let times = [0.0, 1.0, 2.0, 3.0, 100.0];
        let values = [1.0, 2.0, 3.0, 4.0, 99.0];
        assert_eq!(local_quantile(&times, &values, 1, 1.0, 0.5), 2.0);
        assert_eq!(local_quantile(&times, &values, 4, 1.0, 0.5), 99.0);
    }
}
