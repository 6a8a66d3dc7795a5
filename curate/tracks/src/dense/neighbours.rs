//! Choice of the frames that a frame is compared with.

use glam::DVec3;
use omnilife_schemas::posed_view::PosedView;

/// Maximum number of frames to compare with.
pub(super) const MOST: usize = 4;
/// Maximum number of frames whose depths confirm those of one.
const MOST_WITNESSES: usize = 8;
/// Angle between the rays of two frames at which depth is measured best, degrees. Less is inaccurate, more looks
/// different and is hidden more often.
const BEST_DEGREES: f64 = 10.0;
/// Widths of the preference below and above it, degrees.
const SPREAD_DEGREES: [f64; 2] = [4.0, 12.0];
/// Smallest angle of parallax, degrees.
const LEAST_DEGREES: f64 = 0.5;
/// Number of sampled points.
const SAMPLES: usize = 300;
/// Least score; a lower one means another place, or no parallax.
const LEAST_SCORE: f64 = 0.02;

/// Views that give evidence on the depth of another one.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Neighbours {
    /// Views to compare with: up to [`MOST`], from before and after it if there are both, because places hidden from
    /// one side are seen from the other.
    pub(super) compared: Vec<usize>,
    /// Views that confirm the depths: those, and others, up to [`MOST_WITNESSES`].
    pub(super) witnesses: Vec<usize>,
}

/// Returns the neighbours of the view with this number. `seen` are points that it sees.
pub(super) fn neighbours(index: usize, views: &[PosedView], seen: &[DVec3]) -> Neighbours {
    let some: Vec<DVec3> = seen
        .iter()
        .copied()
        .step_by((seen.len() / SAMPLES).max(1))
        .collect();
    let mut scored: Vec<(usize, f64)> = (0..views.len())
        .filter(|&other| other != index)
        .map(|other| (other, score(&views[index], &views[other], &some)))
        .filter(|&(_, score)| score > LEAST_SCORE)
        .collect();
    scored.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    let on_side = |is_before: bool| {
        let of_side = scored
            .iter()
            .filter(move |&&(other, _)| (other < index) == is_before);
        of_side.take(MOST / 2).map(|&(other, _)| other)
    };
    let mut chosen: Vec<usize> = on_side(true).chain(on_side(false)).collect();
    for &(other, _) in &scored {
        if chosen.len() < MOST && !chosen.contains(&other) {
            chosen.push(other);
        }
    }
    let mut witnesses = chosen.clone();
    let others = scored.iter().map(|&(other, _)| other);
    witnesses.extend(others.filter(|other| !chosen.contains(other)));
    witnesses.truncate(MOST_WITNESSES);
    chosen.sort_unstable();
    witnesses.sort_unstable();
    Neighbours {
        compared: chosen,
        witnesses,
    }
}

/// Returns the mean preference for the angles under which both see points; 0 for points that one misses.
fn score(view: &PosedView, other: &PosedView, points: &[DVec3]) -> f64 {
    let of_point = |&point: &DVec3| {
        if other.pixel(point).is_none() {
            return 0.0;
        }
        let angle = (view.centre - point)
            .angle_between(other.centre - point)
            .to_degrees();
        if angle < LEAST_DEGREES {
            return 0.0;
        }
        let spread = SPREAD_DEGREES[usize::from(angle > BEST_DEGREES)];
        (-0.5 * ((angle - BEST_DEGREES) / spread).powi(2)).exp()
    };
    points.iter().map(of_point).sum::<f64>() / points.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, dvec3};
    use omnilife_schemas::camera::PinholeCamera;

    use super::*;

    fn view(x: f64) -> PosedView {
        PosedView {
            frame: 0,
            seconds: x,
            camera: PinholeCamera::with_horizontal_field_of_view(64, 48, 1.2).into(),
            to_world: DMat3::IDENTITY,
            centre: dvec3(x, 0.0, 0.0),
        }
    }

    /// At a depth of 10, 1.76 is the baseline under 10 degrees.
    #[test]
    fn frames_of_the_best_angle_on_both_sides_are_chosen() {
        let views: Vec<PosedView> = (0..21).map(|n| view(0.35 * f64::from(n))).collect();
        let points: Vec<DVec3> = (0..100)
            .map(|n| {
                dvec3(
                    3.5 + 0.1 * f64::from(n % 10 - 5),
                    0.02 * f64::from(n / 10),
                    10.0,
                )
            })
            .collect();
        let of_tenth = neighbours(10, &views, &points);
        let chosen = of_tenth.compared;
        assert_eq!(chosen.len(), MOST);
        assert_eq!(of_tenth.witnesses.len(), MOST_WITNESSES);
        assert!(
            chosen
                .iter()
                .all(|other| of_tenth.witnesses.contains(other))
        );
        assert!(
            chosen.iter().filter(|&&other| other < 10).count() == 2,
            "{chosen:?}"
        );
        assert!(
            chosen
                .iter()
                .all(|other| (4..=7).contains(&other.abs_diff(10))),
            "{chosen:?}"
        );
        let at_the_end = neighbours(0, &views, &points);
        assert_eq!(at_the_end.compared.len(), MOST);
        // Without parallax or overlap no frame is chosen.
        let hover = [view(0.0), view(1e-4), view(500.0)];
        assert_eq!(neighbours(0, &hover, &points), Neighbours::default());
    }
}
