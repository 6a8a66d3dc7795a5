//! Cubic Hermite splines with Catmull-Rom tangents over equidistant knots (Neural Atlas Graphs, supplement
//! A.1; `transforms/utils.py`).
//!
//! ```text
//! S = p1 + w1 (p2 - p1) + w2 (p2 - p0)/2 + w3 (p3 - p1)/2
//! w1 = 3x^2 - 2x^3        w2 = x^3 - 2x^2 + x        w3 = x^3 - x^2
//! ```
//!
//! Knots beyond the ends are mirrored: `p_-1 = 2 p_0 - p_1`. Outside of the knots the line through the last
//! two is extrapolated. One knot is a constant. A spline is linear in its knots: its value is a weighted sum
//! of a few of them.

use glam::DVec3;
use omnilife_schemas::band_matrix::BandMatrix;

/// Equidistant knots.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Knots {
    /// Time of the first knot.
    pub first: f64,
    /// Time of the last knot.
    pub last: f64,
    /// Number of knots, 1 or more.
    pub count: usize,
}

/// Weights of the knots at a time; all other knots have weight 0.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct KnotWeights {
    /// Indices of the knots.
    pub knots: [usize; 4],
    /// Weights of the knots, with sum 1.
    pub weights: [f64; 4],
}

/// Position of a time among the knots.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Place {
    /// After this knot, by a share in [0, 1] of the step to the next.
    Within(usize, f64),
    /// Before the first knot, in steps from it; negative.
    Before(f64),
    /// After the last knot, in steps from it.
    Behind(f64),
}

impl Knots {
    /// Creates `count` knots on [0, 1].
    pub fn unit(count: usize) -> Self {
        Self {
            first: 0.0,
            last: 1.0,
            count,
        }
    }

    /// Creates knots of offsets: one more beyond each end of `inner` knots on [0, 1], so that no time there
    /// needs mirrored knots. A single inner knot has its neighbours at -1 and 1.
    pub fn with_neighbours(inner: usize) -> Self {
        let step = if inner > 1 {
            1.0 / (inner - 1) as f64
        } else {
            1.0
        };
        let last = if inner > 1 { 1.0 + step } else { 1.0 };
        Self {
            first: -step,
            last,
            count: inner.max(1) + 2,
        }
    }

    /// Returns the time of a knot.
    pub fn time(&self, knot: usize) -> f64 {
        if self.count < 2 {
            return self.first;
        }
        self.first + (self.last - self.first) * knot as f64 / (self.count - 1) as f64
    }

    /// Returns the position of a time among two knots or more.
    pub(super) fn place(&self, time: f64) -> Place {
        let steps = (time - self.first) / (self.last - self.first) * (self.count - 1) as f64;
        if time < self.first {
            return Place::Before(steps);
        }
        if time > self.last {
            return Place::Behind(steps - (self.count - 1) as f64);
        }
        let knot = (steps.floor().max(0.0) as usize).min(self.count - 2);
        Place::Within(knot, steps - knot as f64)
    }

    /// Returns the weights of the knots at a time.
    pub fn weights(&self, time: f64) -> KnotWeights {
        let mut found = KnotWeights::default();
        if self.count < 2 {
            found.weights[0] = 1.0;
            return found;
        }
        let last = self.count - 1;
        match self.place(time) {
            Place::Before(steps) => {
                found.knots[..2].copy_from_slice(&[0, 1]);
                found.weights[..2].copy_from_slice(&[1.0 - steps, steps]);
            }
            Place::Behind(steps) => {
                found.knots[..2].copy_from_slice(&[last - 1, last]);
                found.weights[..2].copy_from_slice(&[-steps, 1.0 + steps]);
            }
            Place::Within(knot, x) => {
                let [w1, w2, w3] = hermite(x);
                let mut weights = [-0.5 * w2, 1.0 - w1 - 0.5 * w3, w1 + 0.5 * w2, 0.5 * w3];
                if knot == 0 {
                    // p0 = 2 p1 - p2
                    weights[1] += 2.0 * weights[0];
                    weights[2] -= weights[0];
                    weights[0] = 0.0;
                }
                if knot + 1 == last {
                    // p3 = 2 p2 - p1
                    weights[2] += 2.0 * weights[3];
                    weights[1] -= weights[3];
                    weights[3] = 0.0;
                }
                let at = [knot.saturating_sub(1), knot, knot + 1, (knot + 2).min(last)];
                found = KnotWeights { knots: at, weights };
            }
        }
        found
    }

    /// Returns the position at a time.
    pub fn position(&self, positions: &[DVec3], time: f64) -> DVec3 {
        self.weights(time).sum(positions)
    }
}

impl KnotWeights {
    /// Returns the weighted sum of the knots' values.
    pub fn sum(&self, values: &[DVec3]) -> DVec3 {
        let terms = self.knots.iter().zip(self.weights);
        terms
            .filter(|&(_, weight)| weight != 0.0)
            .map(|(&knot, weight)| weight * values[knot])
            .sum()
    }
}

/// Returns the weights of `p2 - p1` and of the two tangents at `x` in [0, 1].
pub(super) fn hermite(x: f64) -> [f64; 3] {
    let (square, cube) = (x * x, x * x * x);
    [
        3.0 * square - 2.0 * cube,
        cube - 2.0 * square + x,
        cube - square,
    ]
}

/// Fits the knots' positions to samples `(time, position)`, by least squares.
///
/// Second differences of neighbouring knots are penalized with a thousandth of a sample's weight, so that
/// knots without samples follow their neighbours.
pub fn fit_positions(knots: Knots, samples: &[(f64, DVec3)]) -> Vec<DVec3> {
    let count = knots.count;
    let mut matrix = BandMatrix::new(count, 3);
    let mut right = vec![DVec3::ZERO; count];
    for &(time, position) in samples {
        let at = knots.weights(time);
        let terms = at.knots.into_iter().zip(at.weights);
        let terms = terms.filter(|&(_, weight)| weight != 0.0);
        for (row, weight) in terms.clone() {
            for (column, other) in terms.clone().filter(|&(column, _)| column <= row) {
                matrix.add(row, column, weight * other);
            }
            right[row] += weight * position;
        }
    }
    const STIFFNESS: f64 = 1e-3;
    for first in 0..count.saturating_sub(2) {
        for (row, weight) in [1.0, -2.0, 1.0].into_iter().enumerate() {
            for (column, other) in [1.0, -2.0, 1.0].into_iter().enumerate().take(row + 1) {
                matrix.add(first + row, first + column, STIFFNESS * weight * other);
            }
        }
    }
    // Two knots and one sample: nothing else determines the second.
    for knot in 0..count {
        matrix.add(knot, knot, 1e-12 * samples.len().max(1) as f64);
    }
    let solution = matrix.solve(&right);
    solution.unwrap_or_else(|| vec![DVec3::NAN; count])
}
