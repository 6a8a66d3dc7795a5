//! Splines of rotations (Neural Atlas Graphs `transforms/utils.py`): rotation vectors with the weights of the
//! splines of positions.
//!
//! ```text
//! S = exp( w1 log(q2 q1^-1) + w2 log(q2 q0^-1)/2 + w3 log(q3 q1^-1)/2 ) q1
//! ```
//!
//! Knots beyond the ends are mirrored: `q_-1 = (q0 q1^-1) q0`. Outside of the knots the last rotation per
//! step is extrapolated. `log` takes the shorter way, so that the sign of a quaternion has no effect.

use glam::{DMat3, DQuat, DVec3};

use super::{
    catmull_rom::{Knots, Place, fit_positions, hermite},
    dual::{Dual, Number},
};

/// A quaternion: x, y, z, w.
#[derive(Clone, Copy)]
struct Quaternion<T>([T; 4]);

impl<T: Number> Quaternion<T> {
    fn of(q: DQuat) -> Self {
        Self(q.to_array().map(T::constant))
    }

    fn conjugate(self) -> Self {
        let [x, y, z, w] = self.0;
        Self([-x, -y, -z, w])
    }

    fn times(self, other: Self) -> Self {
        let ([ax, ay, az, aw], [bx, by, bz, bw]) = (self.0, other.0);
        Self([
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ])
    }

    /// Returns the quaternion of a rotation vector.
    fn exp(vector: [T; 3]) -> Self {
        let [x, y, z] = vector;
        let square = x * x + y * y + z * z;
        let (factor, w) = if square.value() < 1e-8 {
            // Series of sin(a/2)/a and cos(a/2) in a^2, exact to the last bit here.
            let c = T::constant;
            (
                c(0.5) - square * c(1.0 / 48.0) + square * square * c(1.0 / 3840.0),
                c(1.0) - square * c(0.125) + square * square * c(1.0 / 384.0),
            )
        } else {
            let angle = square.sqrt();
            let half = angle * T::constant(0.5);
            (half.sin() / angle, half.cos())
        };
        Self([x * factor, y * factor, z * factor, w])
    }

    /// Returns the rotation vector, of at most half a turn.
    fn log(self) -> [T; 3] {
        let [x, y, z, w] = if self.0[3].value() < 0.0 {
            self.0.map(|value| -value)
        } else {
            self.0
        };
        let square = x * x + y * y + z * z;
        let factor = if square.value() < 1e-12 {
            // 2 asin(v)/v
            T::constant(2.0) + square * T::constant(1.0 / 3.0)
        } else {
            let v = square.sqrt();
            // atan2(v, w) has the derivative (w dv - v dw)/(v^2 + w^2).
            let norm = v.value().powi(2) + w.value().powi(2);
            let angle = v.value().atan2(w.value());
            let by_v = v.map(0.0, w.value() / norm);
            let by_w = w.map(0.0, -v.value() / norm);
            let angle = T::constant(angle) + by_v + by_w;
            T::constant(2.0) * angle / v
        };
        [x * factor, y * factor, z * factor]
    }

    /// Returns the rotation matrix, row by row.
    fn matrix(self) -> [[T; 3]; 3] {
        let [x, y, z, w] = self.0;
        let (one, two) = (T::constant(1.0), T::constant(2.0));
        [
            [
                one - two * (y * y + z * z),
                two * (x * y - z * w),
                two * (x * z + y * w),
            ],
            [
                two * (x * y + z * w),
                one - two * (x * x + z * z),
                two * (y * z - x * w),
            ],
            [
                two * (x * z - y * w),
                two * (y * z + x * w),
                one - two * (x * x + y * y),
            ],
        ]
    }
}

fn scaled<T: Number>(vector: [T; 3], factor: f64) -> [T; 3] {
    vector.map(|value| value * T::constant(factor))
}

fn added<T: Number>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    std::array::from_fn(|at| a[at] + b[at])
}

/// Returns the rotation vector from one quaternion to another.
fn step<T: Number>(from: Quaternion<T>, to: Quaternion<T>) -> [T; 3] {
    to.times(from.conjugate()).log()
}

/// Up to four knots around a time, and its position among them.
#[derive(Clone, Copy)]
enum Around {
    One(usize),
    /// Line through two knots, in steps from the first.
    Line([usize; 2], f64),
    /// Between the second and the third; `None` is a mirrored knot.
    Between([Option<usize>; 4], f64),
}

impl Around {
    fn of(knots: &Knots, time: f64) -> Self {
        if knots.count < 2 {
            return Self::One(0);
        }
        let last = knots.count - 1;
        match knots.place(time) {
            Place::Before(steps) => Self::Line([0, 1], steps),
            Place::Behind(steps) => Self::Line([last - 1, last], 1.0 + steps),
            Place::Within(knot, x) => {
                let around = [
                    knot.checked_sub(1),
                    Some(knot),
                    Some(knot + 1),
                    (knot + 2 <= last).then_some(knot + 2),
                ];
                Self::Between(around, x)
            }
        }
    }

    /// Returns the knots in the order in which [`Around::evaluate`] reads them.
    fn knots(&self) -> [Option<usize>; 4] {
        match *self {
            Self::One(knot) => [Some(knot), None, None, None],
            Self::Line([a, b], _) => [Some(a), Some(b), None, None],
            Self::Between(knots, _) => knots,
        }
    }

    /// Returns the rotation between knots whose quaternions `at` returns.
    fn evaluate<T: Number>(&self, at: impl Fn(usize) -> Quaternion<T>) -> Quaternion<T> {
        match *self {
            Self::One(knot) => at(knot),
            Self::Line([a, b], steps) => {
                let (a, b) = (at(a), at(b));
                Quaternion::exp(scaled(step(a, b), steps)).times(a)
            }
            Self::Between([before, from, to, behind], x) => {
                let [w1, w2, w3] = hermite(x);
                let (Some(from), Some(to)) = (from, to) else {
                    return Quaternion::of(DQuat::IDENTITY);
                };
                let (q1, q2) = (at(from), at(to));
                let q0 = before.map_or_else(|| q1.times(q2.conjugate()).times(q1), &at);
                let q3 = behind.map_or_else(|| q2.times(q1.conjugate()).times(q2), &at);
                let rotation = added(
                    scaled(step(q1, q2), w1),
                    added(
                        scaled(step(q0, q2), 0.5 * w2),
                        scaled(step(q1, q3), 0.5 * w3),
                    ),
                );
                Quaternion::exp(rotation).times(q1)
            }
        }
    }
}

/// Returns the rotation at a time between knots of unit quaternions.
pub fn rotation(knots: &Knots, rotations: &[DQuat], time: f64) -> DQuat {
    let at = |knot: usize| Quaternion::<f64>::of(rotations[knot]);
    let Quaternion(q) = Around::of(knots, time).evaluate(at);
    DQuat::from_array(q)
}

/// Returns the rotation at a time between knots `exp(factor v)` of rotation vectors `v`.
pub fn rotation_of_vectors(knots: &Knots, vectors: &[DVec3], factor: f64, time: f64) -> DQuat {
    let at = |knot: usize| Quaternion::exp((factor * vectors[knot]).to_array());
    let Quaternion(q) = Around::of(knots, time).evaluate(at);
    DQuat::from_array(q)
}

/// Adds the gradients by the vectors of [`rotation_of_vectors`] to `gradients`, from that by the matrix of
/// the rotation.
pub fn rotation_of_vectors_vjp(
    knots: &Knots,
    vectors: &[DVec3],
    factor: f64,
    time: f64,
    upstream: DMat3,
    gradients: &mut [DVec3],
) {
    let around = Around::of(knots, time);
    let taking_part = around.knots();
    let at = |knot: usize| {
        let place = taking_part.iter().position(|&other| other == Some(knot));
        let first = 3 * place.unwrap_or(0);
        let vector = (factor * vectors[knot]).to_array();
        let variables =
            std::array::from_fn(|axis| Dual::<12>::variable(vector[axis], first + axis));
        Quaternion::exp(variables)
    };
    let matrix = around.evaluate(at).matrix();
    for (place, knot) in taking_part.iter().enumerate() {
        let Some(knot) = *knot else { continue };
        let by_axis: [f64; 3] = std::array::from_fn(|axis| {
            let entries = (0..9).map(|at| (at / 3, at % 3));
            let terms = entries.map(|(row, column)| {
                upstream.col(column)[row] * matrix[row][column].by[3 * place + axis]
            });
            terms.sum()
        });
        gradients[knot] += factor * DVec3::from_array(by_axis);
    }
}

/// Fits the knots' rotations to samples `(time, rotation)`, by three Gauss-Newton steps with the derivative
/// of a spline of positions.
pub fn fit_rotations(knots: Knots, samples: &[(f64, DQuat)]) -> Vec<DQuat> {
    let nearest = |time: f64| {
        let distance = |sample: &&(f64, DQuat)| (sample.0 - time).abs();
        let found = samples
            .iter()
            .min_by(|a, b| distance(a).total_cmp(&distance(b)));
        found.map_or(DQuat::IDENTITY, |sample| sample.1)
    };
    let mut rotations: Vec<DQuat> = (0..knots.count)
        .map(|knot| nearest(knots.time(knot)))
        .collect();
    for _ in 0..3 {
        let residuals: Vec<(f64, DVec3)> = samples
            .iter()
            .map(|&(time, wanted)| {
                let found = Quaternion::<f64>::of(rotation(&knots, &rotations, time));
                let left = step(found, Quaternion::of(wanted));
                (time, DVec3::from_array(left))
            })
            .collect();
        let corrections = fit_positions(knots, &residuals);
        for (rotation, correction) in rotations.iter_mut().zip(corrections) {
            *rotation = (DQuat::from_scaled_axis(correction) * *rotation).normalize();
        }
    }
    rotations
}
