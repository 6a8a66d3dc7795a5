//! Refit of a path: its control points and headings move to where views see the object.
//!
//! With the basis functions `B_k` of the path's spline, corrections `c_t` of the centre and their weights `w_t`, moves
//! `d_k` of the control points minimize
//!
//! ```text
//! sum_t w_t v_t |sum_k B_k(t) d_k - c_t|^2 + PULL sum_k |d_k - 2 d_(k+1) + d_(k+2)|^2 + RIDGE sum_k |d_k|^2
//! w_t = f^2 / (s_t^2 + f^2)     v_t = 1 / (1 + (r_t / (2.385 s))^2)     s = max(1.4826 median r_t, f)
//! ```
//!
//! `s_t` is the standard deviation of a correction, `f` the error of the model itself and `r_t` the distance from the
//! correction times the root of `w_t`. `v_t` keeps out corrections that no smooth motion explains. Headings are the
//! same with hat functions between their samples.

use glam::DVec3;
use omnilife_schemas::{
    band_matrix::BandMatrix,
    statistics::{cauchy_weight, robust_deviation},
    trajectory::{BSpline, ObjectPath},
};

/// Weight of an even correction beside that of an exact measurement: parts without views continue their neighbours'.
const PULL: f64 = 1e-2;
/// Weight of no correction beside that of an exact measurement.
const RIDGE: f64 = 1e-4;
/// Rounds of weights by residuals.
const ROUNDS: usize = 8;

/// Correction of an object's pose at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PoseCorrection {
    pub(super) seconds: f64,
    /// Offset of the centre, world units.
    pub(super) offset: DVec3,
    /// Turn of the heading, radians.
    pub(super) turn: f64,
    /// Variance of the offset along an axis, world units squared.
    pub(super) offset_variance: f64,
    /// Variance of the turn, radians squared.
    pub(super) turn_variance: f64,
}

/// Measurement of a sum of unknowns from number `first` on.
struct Row {
    first: usize,
    shares: Vec<f64>,
    target: DVec3,
    weight: f64,
}

impl Row {
    /// Returns the distance of the sum from its target.
    fn distance(&self, unknowns: &[DVec3]) -> f64 {
        let parts = self.shares.iter().zip(&unknowns[self.first..]);
        let sum: DVec3 = parts.map(|(share, value)| *value * *share).sum();
        (sum - self.target).length()
    }
}

/// Returns a path with corrections; `None` where they determine none. `place_error` (world units) and `heading_error`
/// (radians) are the errors that a correction has beside its own.
pub(super) fn refit(
    path: &ObjectPath,
    corrections: &[PoseCorrection],
    [place_error, heading_error]: [f64; 2],
) -> Option<ObjectPath> {
    let rows = corrections.iter().map(|one| {
        let (first, shares) = of_spline(&path.centre, one.seconds);
        Row {
            first,
            shares,
            target: one.offset,
            weight: weight(one.offset_variance, place_error),
        }
    });
    let moves = solve(
        &rows.collect::<Vec<_>>(),
        path.centre.coefficients.len(),
        place_error,
    )?;
    let rows = corrections.iter().map(|one| {
        let (first, shares) = of_samples(&path.heading_seconds, one.seconds);
        Row {
            first,
            shares,
            target: DVec3::X * one.turn,
            weight: weight(one.turn_variance, heading_error),
        }
    });
    let turns = solve(
        &rows.collect::<Vec<_>>(),
        path.headings.len(),
        heading_error,
    )?;
    let mut refit = path.clone();
    for (coefficient, by) in refit.centre.coefficients.iter_mut().zip(moves) {
        *coefficient = (DVec3::from_array(*coefficient) + by).to_array();
    }
    for (heading, by) in refit.headings.iter_mut().zip(turns) {
        *heading += by.x;
    }
    Some(refit)
}

/// Returns the weight of a measurement of a variance, beside a common error.
fn weight(variance: f64, error: f64) -> f64 {
    error.powi(2) / (variance + error.powi(2)).max(f64::MIN_POSITIVE)
}

/// Returns the control points that a spline mixes at a time.
fn of_spline(spline: &BSpline, seconds: f64) -> (usize, Vec<f64>) {
    let weights = spline.weights(seconds);
    (weights.first, weights.values[..=spline.degree].to_vec())
}

/// Returns the samples between which a time is: one alone before the first and after the last of them.
fn of_samples(times: &[f64], seconds: f64) -> (usize, Vec<f64>) {
    let after = times.partition_point(|&time| time <= seconds);
    let Some(before) = after.checked_sub(1) else {
        return (0, vec![1.0]);
    };
    let Some(next) = times.get(after) else {
        return (before, vec![1.0]);
    };
    let share = (seconds - times[before]) / (next - times[before]);
    (before, vec![1.0 - share, share])
}

/// Returns the unknowns; `error` is the least scale of the residuals' weights.
fn solve(rows: &[Row], unknowns: usize, error: f64) -> Option<Vec<DVec3>> {
    let mut factors = vec![1.0; rows.len()];
    let mut found = Vec::new();
    for _ in 0..ROUNDS {
        found = weighted(rows, &factors, unknowns)?;
        let distance = |row: &Row| row.weight.sqrt() * row.distance(&found);
        let distances: Vec<f64> = rows.iter().map(distance).collect();
        let deviation = robust_deviation(&distances)?.max(error);
        for (factor, distance) in factors.iter_mut().zip(&distances) {
            *factor = cauchy_weight(*distance, deviation);
        }
    }
    let is_finite = found.iter().all(|one: &DVec3| one.is_finite());
    is_finite.then_some(found)
}

/// Solves the normal equations for one set of weights.
fn weighted(rows: &[Row], factors: &[f64], unknowns: usize) -> Option<Vec<DVec3>> {
    // Splines of degree 3 mix four control points.
    let mut matrix = BandMatrix::new(unknowns, 3);
    let mut right = vec![DVec3::ZERO; unknowns];
    for (row, factor) in rows.iter().zip(factors) {
        let weight = row.weight * factor;
        for (a, share) in row.shares.iter().enumerate() {
            right[row.first + a] += row.target * (weight * share);
            for (b, other) in row.shares[..=a].iter().enumerate() {
                matrix.add(row.first + a, row.first + b, weight * share * other);
            }
        }
    }
    let second = [1.0, -2.0, 1.0];
    for first in 0..unknowns.saturating_sub(2) {
        for a in 0..3 {
            for b in 0..=a {
                matrix.add(first + a, first + b, PULL * second[a] * second[b]);
            }
        }
    }
    (0..unknowns).for_each(|at| matrix.add(at, at, RIDGE));
    matrix.solve(&right)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a path and the true one, which winds about it by up to half a metre.
    fn paths() -> [ObjectPath; 2] {
        let coefficients = |sway: f64| {
            let place = move |n: i32| {
                let at = f64::from(n);
                [
                    3.0 * at,
                    0.2 * at * at + sway * (0.8 * at).sin(),
                    sway * (0.5 * at).cos(),
                ]
            };
            (0..8).map(place).collect::<Vec<[f64; 3]>>()
        };
        let path = |sway: f64| ObjectPath {
            centre: BSpline {
                degree: 3,
                knots: BSpline::uniform_knots(3, 8, 1.0, 11.0),
                coefficients: coefficients(sway),
            },
            heading_seconds: vec![2.0, 5.0, 8.0, 10.0],
            headings: vec![0.1, 0.3 + 0.1 * sway, 0.5 - 0.2 * sway, 0.6],
        };
        [path(0.0), path(0.5)]
    }

    fn corrections(given: &ObjectPath, truth: &ObjectPath) -> Vec<PoseCorrection> {
        let at = |step: i32| {
            let seconds = 1.0 + 0.5 * f64::from(step);
            PoseCorrection {
                seconds,
                offset: truth.centre.position(seconds) - given.centre.position(seconds),
                turn: truth.heading(seconds) - given.heading(seconds),
                offset_variance: 1e-4,
                turn_variance: 1e-6,
            }
        };
        (0..=20).map(at).collect()
    }

    /// Returns the greatest distance and the greatest difference of headings.
    fn errors(one: &ObjectPath, other: &ObjectPath) -> [f64; 2] {
        let times = (0..=100).map(|step| 1.0 + 0.1 * f64::from(step));
        times.fold([0.0; 2], |[place, heading]: [f64; 2], at| {
            let away = one.centre.position(at).distance(other.centre.position(at));
            let turned = (one.heading(at) - other.heading(at)).abs();
            [place.max(away), heading.max(turned)]
        })
    }

    #[test]
    fn the_refit_path_is_the_true_one() {
        let [given, truth] = paths();
        let [far, turned] = errors(&given, &truth);
        assert!(far > 0.3 && turned > 0.05, "{far} {turned}");
        let corrections = corrections(&given, &truth);
        let found = refit(&given, &corrections, [0.05, 0.01]).expect("determined");
        let [place, heading] = errors(&found, &truth);
        assert!(
            place < 0.1 * far && heading < 0.1 * turned,
            "{place} {heading}"
        );
        assert_eq!(found.fault(), None);
    }

    #[test]
    fn wild_and_uncertain_corrections_move_little() {
        let [given, truth] = paths();
        let [far, _] = errors(&given, &truth);
        let mut corrections = corrections(&given, &truth);
        corrections[7].offset += DVec3::new(-2.0, 3.0, 0.0);
        let found = refit(&given, &corrections, [0.05, 0.01]).expect("determined");
        assert!(errors(&found, &truth)[0] < 0.3 * far);
        // Every second one is wrong by a metre and says so.
        for one in corrections.iter_mut().step_by(2) {
            one.offset += DVec3::Y;
            one.offset_variance = 100.0;
        }
        let found = refit(&given, &corrections, [0.05, 0.01]).expect("determined");
        assert!(errors(&found, &truth)[0] < 0.3 * far);
    }

    #[test]
    fn times_without_views_go_on_as_their_neighbours() {
        let [given, _] = paths();
        let constant = given.clone().shifted(DVec3::new(0.4, -0.2, 0.0));
        let mut corrections = corrections(&given, &constant);
        corrections.retain(|one| !(3.0..9.5).contains(&one.seconds));
        let found = refit(&given, &corrections, [0.05, 0.01]).expect("determined");
        assert!(
            errors(&found, &constant)[0] < 0.02,
            "{:?}",
            errors(&found, &constant)
        );
    }

    #[test]
    fn short_paths_are_refit_and_nothing_from_nothing() {
        let [given, _] = paths();
        let still = ObjectPath {
            centre: BSpline {
                degree: 0,
                knots: BSpline::uniform_knots(0, 1, 1.0, 2.0),
                coefficients: vec![[1.0, 2.0, 3.0]],
            },
            heading_seconds: vec![1.0],
            headings: vec![0.0],
        };
        let one = PoseCorrection {
            seconds: 1.5,
            offset: DVec3::X,
            turn: 0.1,
            offset_variance: 0.0,
            turn_variance: 0.0,
        };
        let found = refit(&still, &[one], [0.05, 0.01]).expect("determined");
        assert!((found.centre.position(1.0).x - 2.0).abs() < 1e-3);
        assert!((found.headings[0] - 0.1).abs() < 1e-3);
        assert_eq!(refit(&given, &[], [0.05, 0.01]), None);
    }
}
