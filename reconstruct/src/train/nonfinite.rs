//! When gradients that are not finite stop a run.

use omnilife_engine::parameters::ArrayShape;
use omnilife_engine::step::StepSums;

/// Share of an array's gradient values that may be not finite between two looks. Above it a run is
/// not worth its time: something is wrong that leaving values out does not mend.
const REFUSED_SHARE: f64 = 0.01;

/// The first array of which more than [`REFUSED_SHARE`] of the gradients were not finite, in words;
/// `gaussians` says how many have an array.
pub(super) fn too_much_refused(
    arrays: &[ArrayShape],
    gaussians: impl Fn(usize) -> usize,
    sums: &StepSums,
) -> Option<String> {
    arrays
        .iter()
        .zip(&sums.refused)
        .enumerate()
        .find_map(|(number, (array, &refused))| {
            let all = (array.width * gaussians(number)) as f64 * sums.steps as f64;
            (refused as f64 > REFUSED_SHARE * all).then(|| {
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
        let arrays = [("positions", 3), ("opacity_logits", 1)]
            .map(|(name, width)| ArrayShape { name, width });
        let sums = |refused: [u64; 2]| StepSums {
            steps: 100,
            refused: refused.into(),
            ..StepSums::default()
        };
        // One percent of 100 steps of 50 Gaussians is 150 positions and 50 opacities.
        assert_eq!(too_much_refused(&arrays, |_| 50, &sums([150, 50])), None);
        let what = too_much_refused(&arrays, |_| 50, &sums([150, 51])).expect("too many");
        assert!(
            what.contains("opacity_logits") && what.contains("1.0 %"),
            "{what}"
        );
    }
}
