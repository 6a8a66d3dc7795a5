//! Direct alignment of a rigid patch: the motion in a plane with which an image shows the values of a template.
//!
//! Source: Baker and Matthews, "Lucas-Kanade 20 Years On: A Unifying Framework", IJCV 2004, the inverse
//! compositional algorithm of Section 3.2, with weights by Cauchy's loss. For points `x_i` with values `T_i`, whose
//! derivatives by the motion are `J_i`, and an image `I` of the moved object:
//!
//! ```text
//! r_i = I(W(x_i; p)) - T_i - bias        s = 1.4826 median |r_i|       w_i = 1 / (1 + (r_i / (2.385 s))^2)
//! H = sum w_i J_i J_i^T                  q = H^-1 sum w_i J_i r_i      W(p) <- W(p) o W(q)^-1
//! ```
//!
//! `W` turns and shifts a point in the plane of its first two coordinates. The bias of a channel is the median of its
//! differences: brighter light moves nothing. Weights keep out whatever hides the object in one of the images.
//!
//! The atlas has an alignment of its own (`reconstruct/atlas/src/initialize/tracking/alignment.rs`): its similarity has
//! a scale and its brightness a gain. This one has the rigid motion of a patch on the ground, and its covariance.

use glam::{DMat3, DVec2, DVec3};
use omnilife_schemas::{
    band_matrix::BandMatrix,
    statistics::{cauchy_weight, median, robust_deviation},
};

/// Channels of a value.
pub const CHANNELS: usize = 3;

/// Maximum number of steps.
const ITERATIONS: usize = 40;
/// Longest step, pixels.
const LONGEST_STEP: f64 = 1.0;
/// Length of a step after which the motion is found, pixels.
const CONVERGED: f64 = 0.02;
/// Minimum share of a template that an image must show.
const LEAST_SEEN: f64 = 0.6;
/// Minimum standard deviation of a difference, levels of 255: that of rounding in both images.
const LEAST_DEVIATION: f64 = 0.5;
/// Minimum share of a diagonal entry that a pivot must exceed: a straight edge alone tells no shift along it.
const LEAST_PIVOT: f64 = 1e-4;

/// Motion in a plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanarMotion {
    /// Shift after the turn.
    pub shift: DVec2,
    /// Turn about the origin, radians.
    pub turn: f64,
}

impl PlanarMotion {
    /// Rest.
    pub const IDENTITY: Self = Self {
        shift: DVec2::ZERO,
        turn: 0.0,
    };

    /// Returns the place to which a point moves.
    pub fn apply(&self, point: DVec2) -> DVec2 {
        DVec2::from_angle(self.turn).rotate(point) + self.shift
    }

    /// Returns this motion after another one.
    #[must_use]
    pub fn after(&self, first: &Self) -> Self {
        Self {
            shift: self.apply(first.shift),
            turn: self.turn + first.turn,
        }
    }

    /// Returns the motion back.
    #[must_use]
    pub fn inverse(&self) -> Self {
        Self {
            shift: -DVec2::from_angle(-self.turn).rotate(self.shift),
            turn: -self.turn,
        }
    }
}

/// Point of a template.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TemplatePoint {
    /// Place in the object's coordinates, of which the first two are in the plane of the motion.
    pub position: DVec3,
    /// Values of the channels, levels of 255.
    pub values: [f64; CHANNELS],
    /// Derivatives of each channel by the shift along both axes and by the turn, levels per unit and per radian.
    pub slopes: [DVec3; CHANNELS],
}

/// Points of a rigid object with their values in one image.
#[derive(Debug, Clone, PartialEq)]
pub struct Template {
    points: Vec<TemplatePoint>,
    resolution: f64,
    lever: f64,
}

/// Motion with which an image shows a template.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Alignment {
    /// The motion.
    pub motion: PlanarMotion,
    /// Covariance of the shift (units squared) and of the turn (radians squared). The channels of a pixel count as
    /// one measurement.
    pub covariance: DMat3,
    /// Mean absolute difference, levels of 255.
    pub residual: f64,
    /// Correlation of the image's values with the template's, in [-1, 1].
    pub correlation: f64,
}

/// Difference of an image from a point of a template.
struct Difference {
    point: usize,
    /// Differences of the channels without their bias.
    values: [f64; CHANNELS],
    /// Values of the image.
    seen: [f64; CHANNELS],
}

impl Template {
    /// Creates a template of points; a pixel of the images is about `resolution` units wide on the object.
    pub fn new(points: Vec<TemplatePoint>, resolution: f64) -> Self {
        let squares = points.iter().map(|point| point.position.truncate());
        let squares: f64 = squares.map(DVec2::length_squared).sum();
        let lever = (squares / points.len().max(1) as f64).sqrt();
        Self {
            points,
            resolution,
            lever,
        }
    }

    /// Returns the motion with which an image shows the template, from a first guess. `sample` returns the image's
    /// values at a place in the object's coordinates, and `None` where the image does not show it. `None` where too
    /// little is visible, the template tells no motion or the steps do not converge.
    pub fn align(
        &self,
        begin: PlanarMotion,
        sample: impl Fn(DVec3) -> Option<[f64; CHANNELS]>,
    ) -> Option<Alignment> {
        let mut motion = begin;
        for _ in 0..ITERATIONS {
            let equations = Equations::new(self, &self.differences(&motion, &sample)?);
            let step = equations.inverse()? * equations.right;
            let way = self.way(step);
            let step =
                step * (LONGEST_STEP * self.resolution / way.max(f64::MIN_POSITIVE)).min(1.0);
            let inner = PlanarMotion {
                shift: step.truncate(),
                turn: step.z,
            };
            motion = motion.after(&inner.inverse());
            if way < CONVERGED * self.resolution {
                return self.found(motion, &sample);
            }
        }
        None
    }

    /// Returns the mean absolute difference of an image from the template at a motion, levels of 255; `None` where
    /// too little is visible.
    pub fn residual(
        &self,
        motion: &PlanarMotion,
        sample: impl Fn(DVec3) -> Option<[f64; CHANNELS]>,
    ) -> Option<f64> {
        Some(mean_absolute(&self.differences(motion, &sample)?))
    }

    /// Returns the way of a typical point in a step.
    fn way(&self, step: DVec3) -> f64 {
        step.truncate().length().hypot(self.lever * step.z)
    }

    fn found(
        &self,
        motion: PlanarMotion,
        sample: &impl Fn(DVec3) -> Option<[f64; CHANNELS]>,
    ) -> Option<Alignment> {
        let differences = self.differences(&motion, sample)?;
        let equations = Equations::new(self, &differences);
        Some(Alignment {
            motion,
            covariance: equations.inverse()? * (CHANNELS as f64 * equations.variance()),
            residual: mean_absolute(&differences),
            correlation: self.correlation(&differences),
        })
    }

    /// Returns the differences without their bias; `None` where too little is visible.
    fn differences(
        &self,
        motion: &PlanarMotion,
        sample: &impl Fn(DVec3) -> Option<[f64; CHANNELS]>,
    ) -> Option<Vec<Difference>> {
        let seen = self
            .points
            .iter()
            .enumerate()
            .filter_map(|(number, point)| {
                let moved = motion.apply(point.position.truncate());
                let seen = sample(moved.extend(point.position.z))?;
                Some(Difference {
                    point: number,
                    values: std::array::from_fn(|channel| seen[channel] - point.values[channel]),
                    seen,
                })
            });
        let mut differences: Vec<Difference> = seen.collect();
        let is_enough = differences.len() as f64 >= LEAST_SEEN * self.points.len() as f64;
        if !is_enough || differences.is_empty() {
            return None;
        }
        for channel in 0..CHANNELS {
            let of_channel = differences.iter().map(|one| one.values[channel]);
            let bias = median(&of_channel.collect::<Vec<f64>>())?;
            for one in &mut differences {
                one.values[channel] -= bias;
            }
        }
        Some(differences)
    }

    fn correlation(&self, differences: &[Difference]) -> f64 {
        let count = differences.len() as f64;
        let (mut both, mut of_template, mut of_image) = (0.0, 0.0, 0.0);
        for channel in 0..CHANNELS {
            let values =
                |one: &Difference| (self.points[one.point].values[channel], one.seen[channel]);
            let pairs = differences.iter().map(values);
            let [mean, mean_seen] = pairs
                .clone()
                .fold([0.0; 2], |sum, pair| [sum[0] + pair.0, sum[1] + pair.1])
                .map(|sum| sum / count);
            for (value, seen) in pairs {
                both += (value - mean) * (seen - mean_seen);
                of_template += (value - mean).powi(2);
                of_image += (seen - mean_seen).powi(2);
            }
        }
        both / (of_template * of_image).sqrt().max(f64::MIN_POSITIVE)
    }
}

fn mean_absolute(differences: &[Difference]) -> f64 {
    let sum: f64 = sizes(differences).sum();
    sum / (CHANNELS * differences.len()).max(1) as f64
}

fn sizes(differences: &[Difference]) -> impl Iterator<Item = f64> + '_ {
    differences.iter().flat_map(|one| one.values.map(f64::abs))
}

/// Weighted normal equations of a step.
struct Equations {
    information: DMat3,
    right: DVec3,
    squares: f64,
    weight: f64,
}

impl Equations {
    fn new(template: &Template, differences: &[Difference]) -> Self {
        let sizes: Vec<f64> = sizes(differences).collect();
        let deviation = robust_deviation(&sizes).unwrap_or(0.0).max(LEAST_DEVIATION);
        let mut all = Self {
            information: DMat3::ZERO,
            right: DVec3::ZERO,
            squares: 0.0,
            weight: 0.0,
        };
        for one in differences {
            let slopes = template.points[one.point].slopes;
            for (slope, value) in slopes.into_iter().zip(one.values) {
                let weight = cauchy_weight(value, deviation);
                let weighted = slope * weight;
                let outer =
                    DMat3::from_cols(weighted * slope.x, weighted * slope.y, weighted * slope.z);
                all.information += outer;
                all.right += weighted * value;
                all.squares += weight * value * value;
                all.weight += weight;
            }
        }
        all
    }

    /// Returns the variance of a difference, at least that of rounding.
    fn variance(&self) -> f64 {
        (self.squares / self.weight.max(f64::MIN_POSITIVE)).max(LEAST_DEVIATION.powi(2))
    }

    /// Returns the inverse of the information; `None` where it is singular.
    fn inverse(&self) -> Option<DMat3> {
        let mut matrix = BandMatrix::new(3, 2).with_least_pivot(LEAST_PIVOT);
        let columns = self.information.to_cols_array_2d();
        for (column, values) in columns.iter().enumerate() {
            for (row, value) in values.iter().enumerate().skip(column) {
                matrix.add(row, column, *value);
            }
        }
        // Rows of the inverse, which is symmetric.
        let rows = matrix.solve(&[DVec3::X, DVec3::Y, DVec3::Z])?;
        let [x, y, z]: [DVec3; 3] = rows.try_into().ok()?;
        Some(DMat3::from_cols(x, y, z))
    }
}

#[cfg(test)]
mod tests {
    use glam::dvec2;

    use super::*;

    const PIXEL: f64 = 0.1;

    /// Returns the values of a painted plane, and their derivatives along x and y.
    fn painted(at: DVec2) -> ([f64; 3], [DVec2; 3]) {
        let waves = [
            (dvec2(2.1, 0.6), 0.3),
            (dvec2(-0.7, 1.9), 1.1),
            (dvec2(1.2, 1.4), 2.0),
        ];
        let value = |(wave, phase): (DVec2, f64)| 120.0 + 60.0 * (wave.dot(at) + phase).sin();
        let slope = |(wave, phase): (DVec2, f64)| wave * (60.0 * (wave.dot(at) + phase).cos());
        (waves.map(value), waves.map(slope))
    }

    fn template() -> Template {
        let places =
            (0..21 * 9).map(|n| PIXEL * dvec2(f64::from(n % 21) - 10.0, f64::from(n / 21) - 4.0));
        let point = |at: DVec2| {
            let (values, slopes) = painted(at);
            TemplatePoint {
                position: at.extend(0.4),
                values,
                slopes: slopes.map(|slope| slope.extend(slope.dot(at.perp()))),
            }
        };
        Template::new(places.map(point).collect(), PIXEL)
    }

    fn truth() -> PlanarMotion {
        PlanarMotion {
            shift: dvec2(0.17, -0.11),
            turn: 0.06,
        }
    }

    /// Returns a number of [-1, 1] that looks random.
    fn noise(number: u32) -> f64 {
        let mixed = number.wrapping_mul(2_654_435_761) ^ 0x9e37_79b9;
        let mixed = (mixed ^ (mixed >> 15)).wrapping_mul(0x85eb_ca6b);
        f64::from(mixed ^ (mixed >> 13)) / f64::from(u32::MAX) * 2.0 - 1.0
    }

    #[test]
    fn motions_compose_and_come_back() {
        let (one, other, point) = (
            truth(),
            PlanarMotion {
                shift: dvec2(2.0, 1.0),
                turn: 1.2,
            },
            dvec2(0.3, -4.0),
        );
        let both = one.after(&other).apply(point);
        assert!((both - one.apply(other.apply(point))).length() < 1e-12);
        assert!((one.inverse().apply(one.apply(point)) - point).length() < 1e-12);
    }

    #[test]
    fn the_motion_comes_back_behind_things_and_in_other_light() {
        let back = truth().inverse();
        // A quarter of the object is behind a pole, and the image is brighter.
        let sample = |at: DVec3| {
            assert_eq!(at.z, 0.4);
            let is_hidden = (0.1..0.6).contains(&at.x);
            let values = painted(back.apply(at.truncate())).0;
            Some(values.map(|value| if is_hidden { 250.0 } else { value + 14.0 }))
        };
        let template = template();
        let found = template
            .align(PlanarMotion::IDENTITY, sample)
            .expect("converges");
        let error = found.motion.shift - truth().shift;
        assert!(error.length() < 0.1 * PIXEL, "{error}");
        assert!((found.motion.turn - truth().turn).abs() < 0.01, "{found:?}");
        let before = template
            .residual(&PlanarMotion::IDENTITY, sample)
            .expect("visible");
        assert!(found.residual < before, "{} of {before}", found.residual);
    }

    #[test]
    fn an_exact_image_is_found_exactly() {
        let back = truth().inverse();
        let sample = |at: DVec3| Some(painted(back.apply(at.truncate())).0);
        let found = template()
            .align(PlanarMotion::IDENTITY, sample)
            .expect("converges");
        let error = found.motion.shift - truth().shift;
        assert!(error.length() < CONVERGED * PIXEL, "{error}");
        assert!((found.motion.turn - truth().turn).abs() < 1e-3);
        assert!(
            found.correlation > 0.999 && found.residual < 0.5,
            "{found:?}"
        );
    }

    #[test]
    fn the_covariance_is_the_spread_of_what_noise_does() {
        let grey = |values: [f64; 3]| [values.iter().sum::<f64>() / 3.0; 3];
        let mut template = template();
        for point in &mut template.points {
            point.values = grey(point.values);
            point.slopes = [point.slopes.iter().sum::<DVec3>() / 3.0; 3];
        }
        let draws = 60_u32;
        let mut squares = DVec3::ZERO;
        let mut expected = DVec3::ZERO;
        for draw in 0..draws {
            let mut template = template.clone();
            for (number, point) in (0..).zip(&mut template.points) {
                // The same in all channels, so that a pixel is one measurement.
                let noise = 12.0 * noise(draw * 100_003 + number);
                point.values = point.values.map(|value| value + noise);
            }
            let sample = |at: DVec3| Some(grey(painted(at.truncate()).0));
            let found = template
                .align(PlanarMotion::IDENTITY, sample)
                .expect("converges");
            let error = found.motion.shift.extend(found.motion.turn);
            squares += error * error;
            let covariance = found.covariance;
            expected += DVec3::new(
                covariance.x_axis.x,
                covariance.y_axis.y,
                covariance.z_axis.z,
            );
        }
        let ratio = squares / expected;
        assert!(
            ratio.min_element() > 0.3 && ratio.max_element() < 3.0,
            "{ratio}"
        );
    }

    #[test]
    fn nothing_is_found_where_nothing_is_told() {
        let painted_all = |at: DVec3| Some(painted(at.truncate()).0);
        let hidden = |at: DVec3| (at.x > 0.5).then(|| painted(at.truncate()).0);
        assert!(
            template()
                .align(PlanarMotion::IDENTITY, painted_all)
                .is_some()
        );
        assert!(template().align(PlanarMotion::IDENTITY, hidden).is_none());
        let mut edge = template();
        for point in &mut edge.points {
            // Stripes along x: no shift along them.
            let value = 120.0 + 60.0 * (2.0 * point.position.y).sin();
            let slope = 120.0 * (2.0 * point.position.y).cos();
            point.values = [value; 3];
            point.slopes = [DVec3::new(0.0, slope, slope * point.position.x); 3];
        }
        let striped = |at: DVec3| Some([120.0 + 60.0 * (2.0 * at.y).sin(); 3]);
        assert!(edge.align(PlanarMotion::IDENTITY, striped).is_none());
    }
}
