//! Given path of a rigid object on the ground, with trained corrections.
//!
//! With the given centre `X(t)` and heading `h(t)`, and corrections `(d_k, a_k)` at knots that are uniform in
//! time, whose hat functions are `w_k`:
//!
//! ```text
//! centre(t) = X(t) + sum_k w_k(t) d_k       heading(t) = h(t) + sum_k w_k(t) a_k / r
//! ```
//!
//! `r` is a lever arm: the distance from the centre at which a step of `a_k` moves a point as far as a step
//! of `d_k`. One step size thus suits both.

use glam::{DVec3, Mat3, Quat, Vec3};
use omnilife_schemas::{
    Similarity,
    trajectory::{GroundAxes, ObjectPath},
};

/// Values of a correction: three of the centre, one of the heading.
pub const CORRECTION_VALUES: usize = 4;

/// Position and orientation of an object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidPose {
    /// Rotation from the object's axes (forward, left, up) to the world's.
    pub rotation: Mat3,
    /// The same rotation.
    pub quaternion: Quat,
    /// Centre, normalized units.
    pub centre: Vec3,
}

/// A path in a normalized scene.
#[derive(Debug, Clone, PartialEq)]
pub struct RigidPath {
    path: ObjectPath,
    axes: GroundAxes,
    knots: usize,
    lever: f32,
}

impl RigidPath {
    /// Creates the path of an object from world units, with `knots` knots of corrections (at least one).
    /// `lever` is its lever arm in normalized units.
    pub fn new(
        path: &ObjectPath,
        up: DVec3,
        lever: f32,
        knots: usize,
        normalization: &Similarity,
    ) -> Self {
        let mut path = path.clone();
        for coefficient in &mut path.centre.coefficients {
            let world = DVec3::from_array(*coefficient);
            *coefficient = normalization.normalize(world).to_array();
        }
        Self {
            path,
            axes: GroundAxes::new(up),
            knots: knots.max(1),
            lever: lever.max(f32::MIN_POSITIVE),
        }
    }

    /// Returns the number of values of its corrections.
    pub fn correction_len(&self) -> usize {
        CORRECTION_VALUES * self.knots
    }

    /// Returns the lever arm of the heading's corrections, normalized units.
    pub fn lever(&self) -> f32 {
        self.lever
    }

    /// Returns the begin and end of the path, seconds.
    pub fn range_seconds(&self) -> [f64; 2] {
        self.path.centre.range()
    }

    /// Returns the given path in world units.
    pub fn in_world(&self, normalization: &Similarity) -> ObjectPath {
        let mut path = self.path.clone();
        for coefficient in &mut path.centre.coefficients {
            let normalized = DVec3::from_array(*coefficient);
            *coefficient = normalization.restore(normalized).to_array();
        }
        path
    }

    /// Returns the unit vector that points up.
    pub fn up(&self) -> Vec3 {
        self.axes.to_world.z_axis.as_vec3()
    }

    /// Returns the knots of corrections before and after a time, and the weight of the latter.
    pub(crate) fn between_knots(&self, seconds: f64) -> ([usize; 2], f32) {
        let [begin, end] = self.path.centre.range();
        let pieces = self.knots - 1;
        if pieces == 0 || end <= begin {
            return ([0, 0], 0.0);
        }
        let at = ((seconds - begin) / (end - begin)).clamp(0.0, 1.0) * pieces as f64;
        let before = (at as usize).min(pieces - 1);
        ([before, before + 1], (at - before as f64) as f32)
    }

    /// Returns the correction at a time: three values of the centre and the heading in radians. `corrections`
    /// has [`CORRECTION_VALUES`] per knot.
    fn correction(&self, seconds: f64, corrections: &[f32]) -> (Vec3, f32) {
        let ([before, after], share) = self.between_knots(seconds);
        let value = |index: usize| {
            let [from, to] =
                [before, after].map(|knot| corrections[CORRECTION_VALUES * knot + index]);
            from + share * (to - from)
        };
        (
            Vec3::new(value(0), value(1), value(2)),
            value(3) / self.lever,
        )
    }

    /// Returns the pose at a time; `None` before and after the path.
    pub fn pose(&self, seconds: f64, corrections: &[f32]) -> Option<RigidPose> {
        let (centre, heading) = self.path.at(seconds)?;
        let (moved, turned) = self.correction(seconds, corrections);
        let rotation = self.axes.rotation(heading + f64::from(turned)).as_mat3();
        Some(RigidPose {
            rotation,
            quaternion: Quat::from_mat3(&rotation),
            centre: centre.as_vec3() + moved,
        })
    }

    /// Adds gradients by the centre and the heading (radians) at a time to those by the corrections.
    pub fn pose_vjp(&self, seconds: f64, by_centre: Vec3, by_heading: f32, gradients: &mut [f32]) {
        let ([before, after], share) = self.between_knots(seconds);
        let by = [
            by_centre.x,
            by_centre.y,
            by_centre.z,
            by_heading / self.lever,
        ];
        for (knot, weight) in [(before, 1.0 - share), (after, share)] {
            for (index, by) in by.iter().enumerate() {
                gradients[CORRECTION_VALUES * knot + index] += weight * by;
            }
        }
    }

    /// Subtracts the mean of the corrections: otherwise they and the shape that moves along the path could
    /// drift against each other.
    pub fn fix_gauge(&self, corrections: &mut [f32]) {
        for index in 0..CORRECTION_VALUES {
            let values = || (0..self.knots).map(|knot| CORRECTION_VALUES * knot + index);
            let sum: f64 = values().map(|at| f64::from(corrections[at])).sum();
            let mean = (sum / self.knots as f64) as f32;
            values().for_each(|at| corrections[at] -= mean);
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::dvec3;
    use omnilife_schemas::trajectory::{BSpline, nearest_turn};

    use super::*;

    fn path() -> RigidPath {
        let given = ObjectPath {
            centre: BSpline {
                degree: 3,
                knots: BSpline::uniform_knots(3, 5, 1.0, 7.0),
                coefficients: (0..5)
                    .map(|n| [f64::from(n), 0.3 * f64::from(n * n), 2.0])
                    .collect(),
            },
            heading_seconds: vec![1.0, 4.0, 7.0],
            headings: vec![3.0, -3.0, 2.5],
        };
        let normalization = Similarity::new([1.0, -2.0, 0.5], 0.25);
        RigidPath::new(
            &given,
            dvec3(0.1, 0.2, 1.0).normalize(),
            0.4,
            3,
            &normalization,
        )
    }

    #[test]
    fn corrections_move_and_turn_and_their_gradient_says_by_how_much() {
        let path = path();
        let corrections: Vec<f32> = (0..12).map(|n| 0.1 * (n as f32).sin()).collect();
        let (by_centre, by_heading) = (Vec3::new(0.7, -0.4, 1.1), 0.6_f32);
        // The heading is derived from the rotation, in f64.
        let loss = |corrections: &[f32], seconds: f64| {
            let pose = path.pose(seconds, corrections);
            let pose = pose.expect("within the path");
            let heading = path.axes.heading(pose.rotation.as_dmat3().x_axis);
            let heading = nearest_turn(heading, 3.0);
            f64::from(by_centre.dot(pose.centre)) + f64::from(by_heading) * heading
        };
        for seconds in [1.0, 1.7, 2.4, 4.0, 5.9, 7.0] {
            let mut gradients = vec![0.0; 12];
            path.pose_vjp(seconds, by_centre, by_heading, &mut gradients);
            for (index, gradient) in gradients.iter().enumerate() {
                let at = |step: f32| {
                    let mut moved = corrections.clone();
                    moved[index] += step;
                    loss(&moved, seconds)
                };
                let expected = (at(1e-2) - at(-1e-2)) / 2e-2;
                assert!(
                    (f64::from(*gradient) - expected).abs() < 1e-3,
                    "{index} at {seconds}: {gradient} against {expected}"
                );
            }
        }
        assert!(path.pose(0.99, &corrections).is_none() && path.pose(7.01, &corrections).is_none());
    }

    #[test]
    fn the_gauge_leaves_no_mean() {
        let path = path();
        let mut corrections: Vec<f32> = (0..12).map(|n| n as f32 * 0.37).collect();
        path.fix_gauge(&mut corrections);
        for index in 0..4 {
            let sum: f32 = (0..3).map(|knot| corrections[4 * knot + index]).sum();
            assert!(sum.abs() < 1e-6, "{sum}");
        }
    }
}
