//! Stop of a run on gradients that are not finite.

use omnilife_engine::{model::TrainedArray, step::StepStatistics};

/// Maximum share of an array's gradient values that are not finite between two checks. Above it the run stops:
/// leaving values out does not fix the cause.
const NONFINITE_SHARE: f64 = 0.01;

/// Returns a description of the first array with more than [`NONFINITE_SHARE`] of its gradients not finite.
pub(super) fn too_many_nonfinite(
    arrays: &[TrainedArray],
    statistics: &StepStatistics,
) -> Option<String> {
    let each = arrays.iter().zip(&statistics.refused);
    each.into_iter().find_map(|(array, &refused)| {
        let all = array.values as f64 * statistics.steps as f64;
        (refused as f64 > NONFINITE_SHARE * all).then(|| {
            let percent = 100.0 * refused as f64 / all.max(1.0);
            let name = array.name;
            format!("{percent:.1} % of the gradients of {name} are not finite")
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_stops_when_many_gradients_of_an_array_are_not_finite() {
        let arrays = [("positions", 150), ("opacity_logits", 50)]
            .map(|(name, values)| TrainedArray { name, values });
        let statistics = |refused: [u64; 2]| StepStatistics {
            steps: 100,
            refused: refused.into(),
            ..StepStatistics::default()
        };
        // One percent of 100 steps of 50 Gaussians is 150 positions and 50 opacities.
        assert_eq!(too_many_nonfinite(&arrays, &statistics([150, 50])), None);
        let what = too_many_nonfinite(&arrays, &statistics([150, 51])).expect("too many");
        assert!(
            what.contains("opacity_logits") && what.contains("1.0 %"),
            "{what}"
        );
    }
}
