//! Corrections of the input views' poses, refined while a scene is trained.
//!
//! A correction is a world rotation `w` about the camera's centre, a rotation vector in radians, and a shift
//! `t` of the centre in normalized units ([`crate::render::project::by_camera`]):
//!
//! ```text
//! R' = exp(w^) R     (camera to world)        c' = c + t
//! ```
//!
//! Images of novel views must not influence their poses. Their corrections are interpolated between the
//! neighbouring input views in time, and scaled by a share in [0, 1]. It is the share with which
//! interpolation best predicts the corrections of the input views from those of their neighbours. A drift is
//! thus followed; a jitter, which neighbours do not predict, is not.
//!
//! Cameras and scene can move together without any image changing. The means of all rotations and of all
//! shifts are therefore kept at 0, so that the scene stays where the given poses have it on average.
//!
//! The gradient at a corrected pose is that by a further small rotation. It is used as the gradient by the
//! rotation vector; the relative error is half the angle of the correction.

use glam::Vec3;

use crate::camera::View;
use crate::camera::pose::PoseCorrection;
use crate::{
    parameters::{ParameterArray, ParameterTable, adam},
    render::project::by_camera::PoseGradient,
};

/// Name of the array of rotation vectors, radians.
pub const CAMERA_ROTATIONS: &str = "camera_rotations";
/// Name of the array of shifts of the centres, normalized units.
pub const CAMERA_CENTRES: &str = "camera_centres";

/// Corrections of all input views with the state of their optimization.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseCorrections {
    /// Times of the input views by index, seconds.
    times_seconds: Vec<f64>,
    /// Indices of the input views in order of time.
    by_time: Vec<usize>,
    /// [`CAMERA_ROTATIONS`] and [`CAMERA_CENTRES`], one row per input view.
    pub table: ParameterTable,
    /// Optimizer steps of each view so far.
    pub steps: Vec<u64>,
}

impl PoseCorrections {
    /// Creates zero corrections for input views at these times, by index.
    pub fn new(times_seconds: Vec<f64>) -> Self {
        let views = times_seconds.len();
        let mut by_time: Vec<usize> = (0..views).collect();
        by_time.sort_by(|&one, &other| times_seconds[one].total_cmp(&times_seconds[other]));
        let mut table = ParameterTable::new(views);
        for name in [CAMERA_ROTATIONS, CAMERA_CENTRES] {
            table.add(name, 3, vec![0.0; 3 * views], 0.0);
        }
        Self {
            times_seconds,
            by_time,
            table,
            steps: vec![0; views],
        }
    }

    /// Creates corrections of the same views with other values.
    pub fn with_values(&self, table: ParameterTable, steps: Vec<u64>) -> Self {
        Self {
            table,
            steps,
            ..self.clone()
        }
    }

    /// Returns the correction of an input view.
    pub fn of_view(&self, view: usize) -> PoseCorrection {
        let [rotation, centre] = [0, 1].map(|array| Vec3::from_slice(self.table.row(array, view)));
        PoseCorrection { rotation, centre }
    }

    /// Returns the correction of a time: an input view's own, or the scaled interpolation of its neighbours
    /// in time.
    pub fn at(&self, seconds: f64) -> PoseCorrection {
        let time = |place: usize| self.times_seconds[self.by_time[place]];
        let after = self
            .by_time
            .partition_point(|&view| self.times_seconds[view] < seconds);
        let Some(last) = self.by_time.len().checked_sub(1) else {
            return PoseCorrection::default();
        };
        if after <= last && time(after) == seconds {
            return self.of_view(self.by_time[after]);
        }
        let found = self.between(after.saturating_sub(1), after.min(last), seconds);
        let [of_rotation, of_centre] = self.predictable_shares();
        PoseCorrection {
            rotation: found.rotation * of_rotation,
            centre: found.centre * of_centre,
        }
    }

    /// Interpolates between two ranks in the order of time; outside of them takes the nearer one.
    fn between(&self, left: usize, right: usize, seconds: f64) -> PoseCorrection {
        let [from, to] = [left, right].map(|place| self.by_time[place]);
        let [begin, end] = [from, to].map(|view| self.times_seconds[view]);
        let share = if end > begin {
            ((seconds - begin) / (end - begin)).clamp(0.0, 1.0) as f32
        } else {
            0.0
        };
        let [from, to] = [from, to].map(|view| self.of_view(view));
        PoseCorrection {
            rotation: from.rotation.lerp(to.rotation, share),
            centre: from.centre.lerp(to.centre, share),
        }
    }

    /// Returns the factors in [0, 1] with which interpolated rotations and shifts are closest to the input
    /// views' own in least squares: `sum(own . interpolated) / sum(interpolated^2)`.
    fn predictable_shares(&self) -> [f32; 2] {
        let mut sums = [[0.0_f64; 2]; 2];
        for place in 1..self.by_time.len().saturating_sub(1) {
            let view = self.by_time[place];
            let own = self.of_view(view);
            let found = self.between(place - 1, place + 1, self.times_seconds[view]);
            let pairs = [(own.rotation, found.rotation), (own.centre, found.centre)];
            for ([together, alone], (own, found)) in sums.iter_mut().zip(pairs) {
                *together += f64::from(own.dot(found));
                *alone += f64::from(found.length_squared());
            }
        }
        sums.map(|[together, alone]| {
            if alone > 0.0 {
                (together / alone).clamp(0.0, 1.0) as f32
            } else {
                0.0
            }
        })
    }

    /// Returns the view with the correction of its time.
    pub fn apply(&self, view: &View) -> View {
        self.at(view.time_seconds).apply(view)
    }

    /// Takes a step of Adam on the correction of one view, with the view's step count and the step sizes of
    /// both arrays. Subtracts the new mean from all views. Gradient values that are not finite count as 0;
    /// returns their number per array.
    pub fn step(&mut self, view: usize, gradient: &PoseGradient, rates: [f32; 2]) -> [usize; 2] {
        self.steps[view] += 1;
        let corrections = adam::corrections(self.steps[view], adam::SecondMomentDecay::PUBLISHED);
        let gradients = [gradient.rotation, gradient.centre].map(|by| by.as_vec3().to_array());
        let mut refused = [0; 2];
        for (number, array) in self.table.arrays.iter_mut().enumerate() {
            let row = 3 * view..3 * view + 3;
            let before = Vec3::from_slice(&array.values[row.clone()]);
            let rate = corrections.rate(rates[number]);
            refused[number] = adam::cpu::step_values(
                [
                    &mut array.values[row.clone()],
                    &mut array.first_moments[row.clone()],
                    &mut array.second_moments[row.clone()],
                ],
                &gradients[number],
                rate,
                corrections,
            );
            let moved = Vec3::from_slice(&array.values[row]) - before;
            subtract_from_all(array, moved / self.times_seconds.len() as f32);
        }
        refused
    }
}

fn subtract_from_all(array: &mut ParameterArray, mean: Vec3) {
    for row in array.values.as_chunks_mut::<3>().0 {
        *row = (Vec3::from_array(*row) - mean).to_array();
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Mat3, vec3};
    use omnilife_schemas::camera::ErpCamera;

    use super::*;

    fn view(seconds: f64) -> View {
        let camera = ErpCamera::new(8, 4);
        View {
            camera: camera.into(),
            rotation: Mat3::from_euler(glam::EulerRot::XYZ, 0.3, -1.1, 0.2),
            centre: vec3(1.0, 2.0, 3.0),
            time_seconds: seconds,
        }
    }

    /// Returns corrections of three views, out of order.
    fn corrections() -> PoseCorrections {
        let mut corrections = PoseCorrections::new(vec![4.0, 0.0, 2.0]);
        corrections.table.arrays[0].values = vec![0.4, 0.0, 0.0, 0.0, 0.1, 0.0, 0.2, 0.0, 0.0];
        corrections.table.arrays[1].values = vec![4.0, 0.0, 1.0, 0.0, 0.0, 1.0, 2.0, 0.0, 1.0];
        corrections
    }

    #[test]
    fn moments_between_views_have_what_lies_between_their_corrections() {
        // Rotations that drift are predictable, alternating shifts are not.
        let mut corrections = PoseCorrections::new(vec![3.0, 0.0, 1.0, 2.0, 4.0]);
        corrections.table.arrays[0].values = [0.3, 0.0, 0.1, 0.2, 0.4]
            .map(|along| [along, 0.0, 0.5])
            .concat();
        corrections.table.arrays[1].values = [-1.0, 1.0, -1.0, 1.0, 1.0]
            .map(|along| [0.0, along, 0.0])
            .concat();
        for (seconds, along) in [
            (-1.0, 0.0),
            (0.0, 0.0),
            (0.5, 0.05),
            (2.25, 0.225),
            (3.0, 0.3),
            (9.0, 0.4),
        ] {
            let found = corrections.at(seconds);
            let expected = vec3(along, 0.0, 0.5);
            assert!(found.rotation.abs_diff_eq(expected, 1e-6), "{seconds}");
        }
        assert_eq!(corrections.at(2.25).centre, Vec3::ZERO);
        assert_eq!(corrections.at(2.0), corrections.of_view(3));
        let none = PoseCorrections::new(Vec::new());
        assert_eq!(none.at(1.0), PoseCorrection::default());
        let two = PoseCorrections::new(vec![0.0, 1.0]);
        assert_eq!(two.at(0.3), PoseCorrection::default());
    }

    #[test]
    fn a_correction_turns_the_camera_in_the_world() {
        let corrected = corrections().apply(&view(4.0));
        // The camera's old viewing direction is turned by 0.4 about x, and so is the new one.
        let looked = view(4.0).rotation.transpose() * Vec3::Z;
        let looks = corrected.rotation.transpose() * Vec3::Z;
        assert!(looks.abs_diff_eq(Mat3::from_rotation_x(0.4) * looked, 1e-6));
        assert!(corrected.centre.abs_diff_eq(vec3(5.0, 2.0, 4.0), 1e-6));
        let untouched = PoseCorrections::new(vec![0.0, 1.0]).apply(&view(0.5));
        assert_eq!(untouched, view(0.5));
    }

    #[test]
    fn only_the_view_that_was_drawn_moves_against_the_others() {
        let mut corrections = PoseCorrections::new(vec![0.0, 1.0, 2.0, 3.0]);
        let gradient = PoseGradient {
            rotation: DVec3::new(2.0, -3.0, 0.0),
            centre: DVec3::new(0.0, f64::NAN, 1e-3),
        };
        assert_eq!(corrections.step(2, &gradient, [0.4, 0.8]), [0, 1]);
        assert_eq!(corrections.steps, [0, 0, 1, 0]);
        // The first step of Adam is its step size, of which the mean takes a quarter.
        let moved = corrections.of_view(2);
        assert!(moved.rotation.abs_diff_eq(vec3(-0.3, 0.3, 0.0), 1e-5));
        assert!(moved.centre.abs_diff_eq(vec3(0.0, 0.0, -0.6), 1e-5));
        let other = corrections.of_view(0);
        assert!(other.rotation.abs_diff_eq(vec3(0.1, -0.1, 0.0), 1e-5));
        assert!(other.centre.abs_diff_eq(vec3(0.0, 0.0, 0.2), 1e-5));
        assert!(corrections.table.arrays[0].first_moments[..6] == [0.0; 6]);
    }
}
