//! One factor for the distances of each view, from the agreement of the views.
//!
//! A place `x` that view k shows at the distance `D_k` is seen by view j at `|x - c_j|`; the distance of j itself
//! is `D_j`. With the logarithms `a` of the factors,
//!
//! ```text
//! r = log(D_j e^{a_j} / |x - c_j|),   a_j - t a_k = -median(r),
//! t = median((x - c_k) . (x - c_j) / |x - c_j|^2)
//! ```
//!
//! for every pair, in the least squares sense, with a sum of 0: the common error of all views is the scale of the
//! world.

use omnilife_schemas::{band_matrix::BandMatrix, statistics::median};

use super::{lift::DistanceView, pairs::ScaledViews};

/// Maximum difference of two views' places on one surface.
const LARGEST_LOG_RATIO: f64 = 0.1;
/// Minimum number of common places of a pair of views.
const LEAST_SIGHTINGS: usize = 200;
/// Minimum ratio of a pivot to the diagonal; a smaller one is a rounding error.
const LEAST_PIVOT: f64 = 1e-12;
/// Number of systems, each with the factors found before.
const ROUNDS: usize = 3;

/// The factors of some views.
#[derive(Debug, Clone, PartialEq)]
pub struct ScaleFit {
    /// Logarithm of each view's factor; they sum up to 0 in each group.
    pub log_scales: Vec<f64>,
    /// Median of the relative differences between views without factors; `None` where no two share enough places.
    pub disagreement_before: Option<f64>,
    /// Median of the relative differences with the factors.
    pub disagreement_after: Option<f64>,
    /// Views that share enough places, directly or through others.
    pub groups: Vec<Vec<usize>>,
}

/// Equation of a pair of views.
struct Equation {
    first: usize,
    second: usize,
    slope: f64,
    log_ratio: f64,
    differences: Vec<f64>,
}

/// Fits the factors.
pub fn fit_scales(views: &[DistanceView<'_>]) -> ScaleFit {
    let mut log_scales = vec![0.0; views.len()];
    let mut equations = equations(views, &log_scales);
    let disagreement_before = disagreement(&equations);
    let groups = groups(views.len(), &equations);
    for _ in 0..ROUNDS {
        // Undetermined factors stay; the disagreement measures their fit.
        let Some(step) = solved(views.len(), &equations, &groups) else {
            break;
        };
        for (scale, step) in log_scales.iter_mut().zip(step) {
            *scale += step;
        }
        equations = self::equations(views, &log_scales);
    }
    ScaleFit {
        log_scales,
        disagreement_before,
        disagreement_after: disagreement(&equations),
        groups,
    }
}

fn equations(views: &[DistanceView<'_>], log_scales: &[f64]) -> Vec<Equation> {
    let scaled = ScaledViews { views, log_scales };
    let of_pair = |first, second, mut sightings: Vec<super::pairs::Sighting>| {
        sightings.retain(|sighting| sighting.log_ratio.abs() < LARGEST_LOG_RATIO);
        if sightings.len() < LEAST_SIGHTINGS {
            return None;
        }
        let slopes: Vec<f64> = sightings.iter().map(|s| s.slope).collect();
        let log_ratios: Vec<f64> = sightings.iter().map(|s| s.log_ratio).collect();
        Some(Equation {
            first,
            second,
            slope: median(&slopes)?,
            log_ratio: median(&log_ratios)?,
            differences: sightings.iter().map(|s| s.log_ratio.abs()).collect(),
        })
    };
    scaled.of_pairs(of_pair).into_iter().flatten().collect()
}

fn disagreement(equations: &[Equation]) -> Option<f64> {
    let all = equations.iter().flat_map(|equation| &equation.differences);
    let all: Vec<f64> = all.copied().collect();
    median(&all)
}

/// Returns the groups of views that equations connect.
fn groups(count: usize, equations: &[Equation]) -> Vec<Vec<usize>> {
    let mut label: Vec<usize> = (0..count).collect();
    for equation in equations {
        let [a, b] = [equation.first, equation.second].map(|view| label[view]);
        for of in &mut label {
            if *of == a.max(b) {
                *of = a.min(b);
            }
        }
    }
    let of = |group: usize| (0..count).filter(|&view| label[view] == group).collect();
    let groups: Vec<Vec<usize>> = (0..count).map(of).collect();
    groups
        .into_iter()
        .filter(|group| !group.is_empty())
        .collect()
}

/// Solves least squares by the normal equations. In each group the sum of 0 has the weight of all pairs together.
/// `None` if that does not determine all factors.
fn solved(count: usize, equations: &[Equation], groups: &[Vec<usize>]) -> Option<Vec<f64>> {
    let mut matrix = BandMatrix::new(count, count.saturating_sub(1)).with_least_pivot(LEAST_PIVOT);
    let mut right = vec![0.0; count];
    let mut add = |row: &[(usize, f64)], value: f64| {
        for &(a, by_a) in row {
            right[a] += by_a * value;
            for &(b, by_b) in row.iter().filter(|&&(b, _)| b <= a) {
                matrix.add(a, b, by_a * by_b);
            }
        }
    };
    for equation in equations {
        let row = [(equation.second, 1.0), (equation.first, -equation.slope)];
        add(&row, -equation.log_ratio);
    }
    let weight = (equations.len().max(1) as f64).sqrt();
    for group in groups {
        let row: Vec<(usize, f64)> = group.iter().map(|&view| (view, weight)).collect();
        add(&row, 0.0);
    }
    matrix.solve(&right)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_system_is_solved_and_groups_are_apart() {
        // Truth: 0.02, -0.02 in one group, 0.01, -0.01 in another, and a view alone.
        let truth = [0.02, -0.02, 0.01, -0.01, 0.0];
        let equation = |first: usize, second: usize, slope: f64| Equation {
            first,
            second,
            slope,
            log_ratio: -(truth[second] - slope * truth[first]),
            differences: vec![0.02],
        };
        let equations = [
            equation(0, 1, 0.9),
            equation(1, 0, 0.8),
            equation(2, 3, 0.95),
            equation(3, 2, 1.1),
        ];
        let groups = groups(5, &equations);
        assert_eq!(groups, [vec![0, 1], vec![2, 3], vec![4]]);
        let found = solved(5, &equations, &groups).expect("definite");
        for (found, expected) in found.iter().zip(truth) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        assert_eq!(disagreement(&equations), Some(0.02));
        assert_eq!(disagreement(&[]), None);
    }
}
