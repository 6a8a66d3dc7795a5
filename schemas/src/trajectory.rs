//! Paths of rigid objects through a scene: position and heading at a time.
//!
//! A position is a clamped B-spline over time; a heading is linear between samples, the short way around. Headings
//! are angles in the ground plane, see [`GroundAxes`].

use glam::{DMat3, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A B-spline in space over time, clamped: it begins at its first coefficient and ends at its last.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BSpline {
    /// Degree of its pieces, 0 to 3.
    pub degree: usize,
    /// Knots in seconds, not decreasing; as many as coefficients, the degree and 1.
    pub knots: Vec<f64>,
    /// Coefficients in world units.
    pub coefficients: Vec<[f64; 3]>,
}

/// Weights of the coefficients that a spline mixes at a time, from number `first` on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SplineWeights {
    /// Number of the first coefficient.
    pub first: usize,
    /// One weight for each of `degree + 1` coefficients; the others are 0.
    pub values: [f64; 4],
}

impl BSpline {
    /// Returns clamped knots, uniform in time from `begin` to `end`, of a spline with this number of coefficients.
    pub fn uniform_knots(degree: usize, coefficients: usize, begin: f64, end: f64) -> Vec<f64> {
        let pieces = coefficients.saturating_sub(degree).max(1);
        let inner = (0..=pieces).map(|knot| begin + (end - begin) * knot as f64 / pieces as f64);
        let before = std::iter::repeat_n(begin, degree);
        let after = std::iter::repeat_n(end, degree);
        before.chain(inner).chain(after).collect()
    }

    /// Extends the spline by straight lines of this many seconds before and after it, at the speed of its ends.
    #[must_use]
    pub fn extended(mut self, before: f64, after: f64) -> Self {
        let [begin, end] = self.range();
        // Coefficients of a line: evenly along it, as knots of full multiplicity join the pieces.
        let line = |from: DVec3, velocity: DVec3, seconds: f64, degree: usize| {
            (1..=degree).map(move |step| {
                (from + velocity * (seconds * step as f64 / degree as f64)).to_array()
            })
        };
        if self.degree == 0 {
            return self;
        }
        let of_ends = [begin, end].map(|time| (self.position(time), self.velocity(time)));
        if before > 0.0 {
            let (from, velocity) = of_ends[0];
            let mut added: Vec<[f64; 3]> = line(from, velocity, -before, self.degree).collect();
            added.reverse();
            self.coefficients.splice(0..0, added);
            self.knots[0] = begin - before;
            self.knots.splice(0..0, vec![begin - before; self.degree]);
        }
        if after > 0.0 {
            let (from, velocity) = of_ends[1];
            self.coefficients
                .extend(line(from, velocity, after, self.degree));
            if let Some(last) = self.knots.last_mut() {
                *last = end + after;
            }
            self.knots
                .extend(std::iter::repeat_n(end + after, self.degree));
        }
        self
    }

    /// Returns why the parts do not make a spline; `None` where they do.
    pub fn fault(&self) -> Option<String> {
        let (knots, coefficients) = (self.knots.len(), self.coefficients.len());
        if self.degree > 3 {
            return Some(format!(
                "has the degree {}, expected at most 3",
                self.degree
            ));
        }
        if coefficients <= self.degree || knots != coefficients + self.degree + 1 {
            return Some(format!(
                "has {knots} knots and {coefficients} coefficients at degree {}",
                self.degree
            ));
        }
        let numbers = self.knots.iter().chain(self.coefficients.as_flattened());
        if numbers.clone().any(|number| !number.is_finite()) {
            return Some("has a number that is not finite".to_owned());
        }
        let falls = self.knots.windows(2).any(|pair| pair[1] < pair[0]);
        falls.then(|| "has knots that decrease".to_owned())
    }

    /// Returns the first and last instant, seconds.
    pub fn range(&self) -> [f64; 2] {
        [self.knots[0], self.knots[self.knots.len() - 1]]
    }

    /// Returns the weights of the coefficients at a time, which is clamped to the range (de Boor's basis functions by
    /// their recurrence).
    pub fn weights(&self, seconds: f64) -> SplineWeights {
        weights(&self.knots, self.degree, seconds)
    }

    /// Returns the position at a time.
    pub fn position(&self, seconds: f64) -> DVec3 {
        let weights = self.weights(seconds);
        let coefficients = self.coefficients[weights.first..].iter();
        coefficients
            .zip(weights.values)
            .map(|(&coefficient, weight)| DVec3::from_array(coefficient) * weight)
            .sum()
    }

    /// Returns the velocity, units per second; zero for a spline of degree 0.
    pub fn velocity(&self, seconds: f64) -> DVec3 {
        let Some(lower) = self.degree.checked_sub(1) else {
            return DVec3::ZERO;
        };
        // The derivative is a spline of one degree less over the inner knots.
        let knots = &self.knots[1..self.knots.len() - 1];
        let weights = weights(knots, lower, seconds);
        (0..=lower)
            .map(|step| {
                let number = weights.first + step;
                let span = self.knots[number + self.degree + 1] - self.knots[number + 1];
                if span <= 0.0 {
                    return DVec3::ZERO;
                }
                let [from, to] =
                    [number, number + 1].map(|n| DVec3::from_array(self.coefficients[n]));
                (to - from) * (self.degree as f64 / span * weights.values[step])
            })
            .sum()
    }
}

/// Returns the basis functions of the piece that holds `seconds`.
fn weights(knots: &[f64], degree: usize, seconds: f64) -> SplineWeights {
    let last = knots.len() - degree - 2;
    let piece = knots.partition_point(|&knot| knot <= seconds);
    let piece = piece.saturating_sub(1).clamp(degree, last);
    let seconds = seconds.clamp(knots[0], knots[knots.len() - 1]);
    let mut values = [0.0; 4];
    values[0] = 1.0;
    for order in 1..=degree {
        let mut carried = 0.0;
        for index in 0..order {
            let right = knots[piece + index + 1] - seconds;
            let left = seconds - knots[piece + 1 + index - order];
            let share = if right + left > 0.0 {
                values[index] / (right + left)
            } else {
                0.0
            };
            values[index] = carried + right * share;
            carried = left * share;
        }
        values[order] = carried;
    }
    SplineWeights {
        first: piece - degree,
        values,
    }
}

/// Axes of a plane: two along it and its normal, which points up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroundAxes {
    /// Columns: towards heading 0, towards heading pi/2, up.
    pub to_world: DMat3,
}

impl GroundAxes {
    /// Returns the axes of a plane whose normal is the unit vector `up`. Heading 0 is the world's x along the plane,
    /// or its y where x is nearer to up.
    pub fn new(up: DVec3) -> Self {
        let along = if up.x.abs() < up.y.abs().max(0.9) {
            DVec3::X
        } else {
            DVec3::Y
        };
        let first = (along - up * along.dot(up)).normalize_or_zero();
        Self {
            to_world: DMat3::from_cols(first, up.cross(first), up),
        }
    }

    /// Returns the camera-like rotation of a box with this heading: columns forward, left, up.
    pub fn rotation(&self, heading_radians: f64) -> DMat3 {
        self.to_world * DMat3::from_rotation_z(heading_radians)
    }

    /// Returns the heading of a direction.
    pub fn heading(&self, direction: DVec3) -> f64 {
        let [first, second, _] = self.to_world.to_cols_array_2d().map(DVec3::from_array);
        direction.dot(second).atan2(direction.dot(first))
    }
}

/// Adds whole turns to `angle` so that it is as near as possible to `reference`, radians.
pub fn nearest_turn(angle: f64, reference: f64) -> f64 {
    let turns = (angle - reference) / std::f64::consts::TAU;
    angle - turns.round() * std::f64::consts::TAU
}

/// Position and heading of an object over the time at which they are known.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ObjectPath {
    /// Centre of its box.
    pub centre: BSpline,
    /// Instants of the headings in seconds, increasing; one at least.
    pub heading_seconds: Vec<f64>,
    /// Headings in the ground plane at those instants, radians.
    pub headings: Vec<f64>,
}

impl ObjectPath {
    /// Returns why the parts do not make a path; `None` where they do.
    pub fn fault(&self) -> Option<String> {
        let times = &self.heading_seconds;
        let is_sound = !times.is_empty()
            && times.len() == self.headings.len()
            && times.windows(2).all(|pair| pair[0] < pair[1])
            && times
                .iter()
                .chain(&self.headings)
                .all(|number| number.is_finite());
        let headings = (!is_sound).then(|| "has headings at no increasing instants".to_owned());
        self.centre.fault().or(headings)
    }

    /// Returns centre and heading (radians) at a time; `None` before the first and after the last instant.
    pub fn at(&self, seconds: f64) -> Option<(DVec3, f64)> {
        let [begin, end] = self.centre.range();
        (begin <= seconds && seconds <= end)
            .then(|| (self.centre.position(seconds), self.heading(seconds)))
    }

    /// Returns the heading at a time: constant before the first and after the last sample.
    pub fn heading(&self, seconds: f64) -> f64 {
        let after = self
            .heading_seconds
            .partition_point(|&time| time <= seconds);
        let Some(before) = after.checked_sub(1) else {
            return self.headings[0];
        };
        let Some(&next) = self.heading_seconds.get(after) else {
            return self.headings[before];
        };
        let (from, begin) = (self.headings[before], self.heading_seconds[before]);
        let to = nearest_turn(self.headings[after], from);
        from + (to - from) * (seconds - begin) / (next - begin)
    }

    /// Returns the path `seconds` later.
    #[must_use]
    pub fn delayed(mut self, seconds: f64) -> Self {
        let times = self.centre.knots.iter_mut();
        times
            .chain(&mut self.heading_seconds)
            .for_each(|time| *time += seconds);
        self
    }

    /// Returns the path moved by an offset.
    #[must_use]
    pub fn shifted(mut self, offset: DVec3) -> Self {
        for coefficient in &mut self.centre.coefficients {
            *coefficient = (DVec3::from_array(*coefficient) + offset).to_array();
        }
        self
    }

    /// Returns the path of the object turned in its place by an angle about up, radians: it goes where it went.
    #[must_use]
    pub fn turned(mut self, turn_radians: f64) -> Self {
        for heading in &mut self.headings {
            *heading += turn_radians;
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use glam::dvec3;

    use super::*;

    fn spline() -> BSpline {
        BSpline {
            degree: 3,
            knots: BSpline::uniform_knots(3, 7, 2.0, 10.0),
            coefficients: (0..7)
                .map(|n| [f64::from(n), (f64::from(n) * 1.3).sin(), 0.5])
                .collect(),
        }
    }

    #[test]
    fn weights_are_a_partition_of_one_and_reach_the_ends() {
        let spline = spline();
        assert_eq!(spline.fault(), None);
        for step in 0..=80 {
            let weights = spline.weights(2.0 + 0.1 * f64::from(step)).values;
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-14);
            assert!(weights.iter().all(|&weight| weight > -1e-15));
        }
        assert_eq!(spline.position(2.0), dvec3(0.0, 0.0, 0.5));
        assert!((spline.position(10.0).x - 6.0).abs() < 1e-12);
        assert_eq!(spline.position(99.0), spline.position(10.0));
    }

    #[test]
    fn a_velocity_is_the_derivative() {
        for degree in 1..=3 {
            let spline = BSpline {
                degree,
                knots: BSpline::uniform_knots(degree, 7, 2.0, 10.0),
                ..spline()
            };
            for step in 1..40 {
                // Not at a knot, where a spline of degree 1 has no derivative.
                let at = 2.0 + 0.2 * f64::from(step) + 0.013;
                let h = 1e-6;
                let by_difference = (spline.position(at + h) - spline.position(at - h)) / (2.0 * h);
                let error = (spline.velocity(at) - by_difference).length();
                assert!(error < 1e-8, "degree {degree} at {at}: {error}");
            }
        }
    }

    #[test]
    fn short_splines_are_points_and_lines() {
        for count in 1..4 {
            let spline = BSpline {
                degree: count - 1,
                knots: BSpline::uniform_knots(count - 1, count, 1.0, 1.0 + count as f64),
                coefficients: (0..count).map(|n| [n as f64, 0.0, 0.0]).collect(),
            };
            assert_eq!(spline.fault(), None);
            assert!(spline.position(1.5).is_finite() && spline.velocity(1.5).is_finite());
        }
        let broken = BSpline {
            knots: vec![0.0; 5],
            ..spline()
        };
        assert!(
            broken
                .fault()
                .is_some_and(|fault| fault.contains("5 knots"))
        );
    }

    #[test]
    fn headings_go_the_short_way_around() {
        let path = ObjectPath {
            centre: spline(),
            heading_seconds: vec![3.0, 5.0],
            headings: vec![PI - 0.1, -PI + 0.1],
        };
        assert_eq!(path.fault(), None);
        assert!((nearest_turn(path.heading(4.0), 0.0).abs() - PI).abs() < 1e-12);
        assert!((path.heading(2.0) - (PI - 0.1)).abs() < 1e-12);
        assert!(path.at(1.9).is_none() && path.at(10.1).is_none() && path.at(10.0).is_some());
        assert!((nearest_turn(7.0, 0.0) - (7.0 - TAU)).abs() < 1e-15);
    }

    #[test]
    fn axes_are_right_handed_for_any_up() {
        for up in [
            DVec3::Z,
            DVec3::X,
            DVec3::Y,
            -DVec3::Y,
            dvec3(0.3, -0.8, 0.2).normalize(),
        ] {
            let axes = GroundAxes::new(up);
            assert!((axes.to_world.determinant() - 1.0).abs() < 1e-12, "{up}");
            let forward = axes.rotation(0.7).x_axis;
            assert!((axes.heading(forward) - 0.7).abs() < 1e-12, "{up}");
        }
    }

    #[test]
    fn paths_are_delayed_moved_and_turned() {
        let path = ObjectPath {
            centre: spline(),
            heading_seconds: vec![2.0],
            headings: vec![0.0],
        };
        let later = path.clone().delayed(3.0);
        let error = later.centre.position(9.0) - path.centre.position(6.0);
        assert!(error.length() < 1e-12);
        let offset = dvec3(1.0, 2.0, 0.0);
        let moved = path.clone().shifted(offset).turned(PI);
        for seconds in [2.0, 6.0, 9.0] {
            let step = moved.centre.position(seconds) - path.centre.position(seconds);
            assert!((step - offset).length() < 1e-12, "{seconds} s: {step}");
        }
        assert!((moved.heading(5.0) - PI).abs() < 1e-12);
    }

    #[test]
    fn an_extended_spline_is_the_same_and_goes_on_straight() {
        for degree in 1..=3 {
            let spline = BSpline {
                degree,
                knots: BSpline::uniform_knots(degree, 6, 1.0, 7.0),
                coefficients: (0..6)
                    .map(|n| [f64::from(n), 0.3 * f64::from(n * n), 2.0])
                    .collect(),
            };
            let extended = spline.clone().extended(0.5, 2.0);
            assert_eq!(extended.fault(), None);
            assert_eq!(extended.range(), [0.5, 9.0]);
            for step in 0..=60 {
                let time = 1.0 + 0.1 * f64::from(step);
                let error = extended.position(time).distance(spline.position(time));
                assert!(error < 1e-9, "{degree} at {time}: {error}");
            }
            for (time, end) in [(0.6, 1.0), (8.5, 7.0)] {
                let line = spline.position(end) + spline.velocity(end) * (time - end);
                assert!(
                    extended.position(time).distance(line) < 1e-9,
                    "{degree} {time}"
                );
            }
            assert_eq!(spline.clone().extended(0.0, 0.0), spline);
        }
    }
}
