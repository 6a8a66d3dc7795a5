//! Errors of the poses of some views, from the displacements of scene points.
//!
//! A camera whose pose is slightly wrong sees every point slightly displaced. To first order the difference of
//! image and render at a point is minus the slope of the render times that displacement. The displacement is that
//! of a camera which rotates by `w` and moves by `t` (world frame). For a point in the unit direction `n` at the
//! distance `d`
//!
//! ```text
//! dn = -w x n - (t - n (n.t)) / d
//! ```
//!
//! Six numbers per view explain the differences at thousands of points. Robust least squares finds them,
//! iteratively reweighted with Cauchy's weights, which give moving objects and occluders little weight. An error
//! of a point in all views - a blurred edge, a colour - says nothing about a pose: medians over views are removed
//! first. The same holds for corrections that all views share, or that change in proportion to the camera's
//! position. A scene that the pilot fit has a percent too near looks like a path that is a percent too long.
//!
//! The evidence is the agreement of two halves of the points on a displacement. Neighbouring points err alike, so
//! that the covariance of a fit underestimates its error. But the halves lie in different directions, as the
//! squares of a chess-board: random errors differ between them. The product of their displacements is 0 on
//! average for exact poses, and its spread over the views gives the standard error.

use std::{f64::consts::TAU, fmt};

use glam::{DMat3, DVec3, Vec3};
use omnilife_schemas::{band_matrix::BandMatrix, statistics};
use serde::Serialize;

use crate::evidence::{LEAST_VIEWS, PER_MEDIAN, PILOT_ITERATIONS, pilot::WIDTH};
use omnilife_engine::camera::{Camera, pose::PoseCorrection};

/// Minimum displacement for refining poses, pixels of images that are [`WIDTH`] pixels wide. It is in the middle
/// between exact poses, 0.09 at most, and poses that are off by a tenth of a degree or two, 0.14 at least
/// (docs/results/evidence.md). In wider images it is the same angle and more pixels. In narrower ones it is as
/// many pixels: a fit shows no smaller part of one.
const LEAST_SHIFT_PIXELS: f64 = 0.12;
/// Minimum displacement for refining poses, pixels of the trained images, where that is the smaller angle: in images
/// 4096 pixels wide the other limit is two pixels. Refining exact poses costs nothing (docs/results/evidence.md).
const LEAST_TRAINED_SHIFT_PIXELS: f64 = 0.5;
/// Minimum mean of the products of agreeing halves, in its standard errors above 0.
const LEAST_STANDARD_ERRORS: f64 = 3.0;
/// Squares of the chess-board between the centre of the sphere and its surface, along each axis.
const SQUARES: f64 = 3.0;
/// Minimum number of observations for six numbers; of a half of the points, half as many.
const LEAST_OBSERVATIONS: usize = 50;
/// Rounds of reweighting.
const ROUNDS: usize = 8;
/// Ridge of the trend beside the cameras' path, over their mean square distance from its middle.
const PATH_RIDGE: f64 = 1e-3;
/// Minimum noise: residuals of an exact render still differ by rounding, grey levels of 1.
const LEAST_NOISE: f64 = 1e-6;
/// Minimum share of the evidence on a number of a twist that is independent of the others.
const LEAST_PIVOT: f64 = 1e-9;

/// Rotation (3, radians) and shift (3, normalized units) of a camera in the world.
type Twist = [f64; 6];

/// Observation of a point, as evidence of the pose of a view.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseObservation {
    /// Offset from the camera to the point, normalized units, world frame.
    offset: DVec3,
    /// Derivative of each channel of the render by the pose.
    slopes: [Twist; 3],
    /// Image minus render, by channel.
    residual: [f32; 3],
}

impl PoseObservation {
    /// Makes the observation of a point at `offset` from the camera (world frame). `by_point` are the derivatives
    /// of the channels of the render, from its place to its image after a motion of the point in the world.
    /// `residual` are the differences of image and render at its place. The content that moves into a place comes
    /// from the other side, so that the sign of the displacement is reversed.
    pub fn new(offset: Vec3, by_point: [Vec3; 3], residual: [f32; 3]) -> Self {
        let offset = offset.as_dvec3();
        let slopes = by_point.map(|by_point| {
            let by_point = by_point.as_dvec3();
            let (turn, shift) = (offset.cross(by_point), by_point);
            [turn.x, turn.y, turn.z, shift.x, shift.y, shift.z]
        });
        Self {
            offset,
            slopes,
            residual,
        }
    }

    /// Returns the index of its half of the points.
    fn half(&self) -> usize {
        let squares = (SQUARES * self.offset.normalize_or_zero()).floor();
        (squares.x + squares.y + squares.z).rem_euclid(2.0) as usize
    }

    /// Returns the derivative of the point's direction by each of the pose's numbers.
    fn displacements(&self) -> [DVec3; 6] {
        let distance = self.offset.length();
        let direction = self.offset / distance;
        let turned = |axis: DVec3| -axis.cross(direction);
        let moved = |axis: DVec3| -(axis - direction * direction.dot(axis)) / distance;
        let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z];
        [
            turned(x),
            turned(y),
            turned(z),
            moved(x),
            moved(y),
            moved(z),
        ]
    }
}

/// Errors of the poses.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct PoseEvidence {
    /// Number of views with enough evidence.
    pub views: usize,
    /// Root mean square displacement of the points by the corrections, chance included, radians.
    pub shift_radians: f64,
    /// Mean product of the displacements from two halves of the points, radians squared: the mean square without
    /// random errors. It may be below 0.
    pub agreed_square: f64,
    /// Standard error of that mean over the views.
    pub standard_error: f64,
    /// Ratio of shift to angle: a shift of the camera by this times an angle displaces the points as a rotation
    /// by the angle does, root mean square; normalized units.
    pub distance: f64,
    /// Width of the examined images, pixels.
    pub width: u32,
    /// Pixels of a full rotation at the scale of small angles in the image centre.
    #[serde(skip)]
    pub turn_pixels: f64,
    /// The same of the trained images.
    #[serde(skip)]
    pub trained_turn_pixels: f64,
    /// Correction of the pose of each input view; `None` without enough evidence.
    #[serde(skip)]
    pub corrections: Vec<Option<PoseCorrection>>,
}

impl PoseEvidence {
    /// Measures the errors from each view's observations of the same points; a view has the centre of its camera.
    /// `camera` is that of the examined images, `trained` that of the images of the training.
    pub fn of(
        mut views: Vec<(Vec3, Vec<Option<PoseObservation>>)>,
        camera: &Camera,
        trained: &Camera,
    ) -> Self {
        subtract_medians(&mut views);
        let whole = Estimates::of(&views, LEAST_OBSERVATIONS, |_| true);
        let halves = [0, 1]
            .map(|half| Estimates::of(&views, LEAST_OBSERVATIONS / 2, |seen| seen.half() == half));
        let corrections = whole
            .of_views
            .iter()
            .map(|one| Some(one.as_ref()?.correction()));
        let found: Vec<&Estimate> = whole.of_views.iter().flatten().collect();
        let left = found.len() as f64 - whole.taken_out;
        // In this form NaN is refused.
        let says_something = left >= 1.0;
        if !says_something {
            return Self::default();
        }
        let moved: f64 = found
            .iter()
            .map(|one| one.product(&one.twist, &one.twist))
            .sum();
        let displaced = |by: [usize; 3]| -> f64 {
            let squares = |one: &&Estimate| by.map(|k| one.displacement[k][k]).iter().sum::<f64>();
            found.iter().map(squares).sum()
        };
        let (agreed_square, standard_error) = agreement(&whole, &halves);
        Self {
            views: found.len(),
            distance: (displaced([0, 1, 2]) / displaced([3, 4, 5])).sqrt(),
            shift_radians: (moved / left).sqrt(),
            agreed_square,
            standard_error,
            width: camera.width(),
            turn_pixels: pixels_per_turn(camera),
            trained_turn_pixels: pixels_per_turn(trained),
            corrections: corrections.collect(),
        }
    }

    /// Returns the root mean square displacement without random errors, pixels at the images' centre.
    pub fn agreed_pixels(&self) -> f64 {
        self.agreed_square.max(0.0).sqrt() / TAU * self.turn_pixels
    }

    /// Returns true if the poses are worth refining.
    pub fn are_off(&self) -> bool {
        self.standard_error > 0.0
            && self.agreed_square >= LEAST_STANDARD_ERRORS * self.standard_error
            && self.agreed_pixels() >= self.limit_pixels()
    }

    /// Returns the minimum displacement for refining poses, pixels of the examined images.
    fn limit_pixels(&self) -> f64 {
        let of_fit = LEAST_SHIFT_PIXELS * (f64::from(self.width) / f64::from(WIDTH)).max(1.0);
        of_fit.min(LEAST_TRAINED_SHIFT_PIXELS * self.turn_pixels / self.trained_turn_pixels)
    }
}

/// Returns the pixels of a full rotation: the width of an ERP image; a pinhole shows the tangent of an angle.
fn pixels_per_turn(camera: &Camera) -> f64 {
    match camera {
        Camera::Erp(camera) => f64::from(camera.width),
        Camera::Pinhole(camera) => TAU * (camera.fx * camera.fy).sqrt(),
    }
}

impl fmt::Display for PoseEvidence {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Zero if fewer than two views have enough points in both halves.
        if self.standard_error <= 0.0 {
            return write!(
                out,
                "after {PILOT_ITERATIONS} static iterations too few views show enough points to say \
                 whether their poses are off"
            );
        }
        write!(
            out,
            "after {PILOT_ITERATIONS} static iterations, in images {} pixels wide, two halves of the \
             points of {} views agree that these lie {:.2} pixels from where they should by their \
             poses (limit {:.2}), {:.1} standard errors above chance (limit \
             {LEAST_STANDARD_ERRORS})",
            self.width,
            self.views,
            self.agreed_pixels(),
            self.limit_pixels(),
            self.agreed_square / self.standard_error
        )
    }
}

/// Returns the mean over the views of the product of the displacements from two halves of the points, and its
/// standard error.
fn agreement(whole: &Estimates, halves: &[Estimates; 2]) -> (f64, f64) {
    let views = whole
        .of_views
        .iter()
        .zip(&halves[0].of_views)
        .zip(&halves[1].of_views);
    let products: Vec<f64> = views
        .filter_map(|((whole, one), other)| {
            let (one, other) = (one.as_ref()?, other.as_ref()?);
            Some(whole.as_ref()?.product(&one.twist, &other.twist))
        })
        .collect();
    let count = products.len() as f64;
    let left = count - whole.taken_out;
    if left < 2.0 {
        return (0.0, 0.0);
    }
    let mean = products.iter().sum::<f64>() / left;
    let squares: f64 = products
        .iter()
        .map(|product| (product - mean).powi(2))
        .sum();
    (mean, (squares / (left * (left - 1.0))).sqrt())
}

/// Estimates of each view's pose by some of the points, without the part that a bent scene explains.
struct Estimates {
    /// `None` without enough observations.
    of_views: Vec<Option<Estimate>>,
    /// Degrees of freedom of a bent scene, in views.
    taken_out: f64,
}

impl Estimates {
    fn of(
        views: &[(Vec3, Vec<Option<PoseObservation>>)],
        least: usize,
        takes: impl Fn(&PoseObservation) -> bool,
    ) -> Self {
        let mut of_views: Vec<Option<Estimate>> = views
            .iter()
            .map(|(_, observations)| {
                let seen = observations.iter().flatten().filter(|seen| takes(seen));
                Estimate::of(&seen.collect::<Vec<_>>(), least)
            })
            .collect();
        let seen = views
            .iter()
            .zip(&of_views)
            .filter(|(_, found)| found.is_some());
        let centres: Vec<DVec3> = seen.map(|((centre, _), _)| centre.as_dvec3()).collect();
        let taken_out = subtract_trend(&centres, of_views.iter_mut().flatten().collect());
        Self {
            of_views,
            taken_out,
        }
    }
}

/// Removes from the twists the part that all views share, and the part that changes in proportion to the camera's
/// position. A scene that is slightly rotated, moved, scaled or sheared explains both. Returns the removed
/// degrees of freedom, in views.
fn subtract_trend(centres: &[DVec3], mut found: Vec<&mut Estimate>) -> f64 {
    let count = found.len().max(1) as f64;
    let mean = centres.iter().sum::<DVec3>() / count;
    let mut normal = DMat3::ZERO;
    for &centre in centres {
        let from = centre - mean;
        normal += DMat3::from_cols(from * from.x, from * from.y, from * from.z);
    }
    // Cameras on a line do not determine changes beside it.
    let ridge = PATH_RIDGE * normal.diagonal().element_sum();
    let inverse = (normal + DMat3::from_diagonal(DVec3::splat(ridge))).try_inverse();
    let mut trend = [(0.0, DVec3::ZERO); 6];
    for (k, (constant, slope)) in trend.iter_mut().enumerate() {
        *constant = found.iter().map(|one| one.twist[k]).sum::<f64>() / count;
        if let Some(inverse) = inverse {
            let pairs = centres.iter().zip(found.iter());
            let along: DVec3 = pairs
                .map(|(&centre, one)| (centre - mean) * (one.twist[k] - *constant))
                .sum();
            *slope = inverse * along;
        }
    }
    for (&centre, one) in centres.iter().zip(found.iter_mut()) {
        for (value, (constant, slope)) in one.twist.iter_mut().zip(trend) {
            *value -= constant + slope.dot(centre - mean);
        }
    }
    1.0 + inverse.map_or(0.0, |inverse| {
        3.0 - ridge * inverse.diagonal().element_sum()
    })
}

/// Removes from each residual its median over all views; points that few views see are left out.
fn subtract_medians(views: &mut [(Vec3, Vec<Option<PoseObservation>>)]) {
    let points = views
        .first()
        .map_or(0, |(_, observations)| observations.len());
    for point in 0..points {
        let mut medians = [f32::NAN; 3];
        for (channel, median) in medians.iter_mut().enumerate() {
            let residuals: Vec<f32> = views
                .iter()
                .filter_map(|(_, observations)| {
                    Some(observations[point].as_ref()?.residual[channel])
                })
                .collect();
            if residuals.len() >= LEAST_VIEWS {
                *median = statistics::median(&residuals).unwrap_or(0.0);
            }
        }
        for (_, observations) in views.iter_mut() {
            if medians[0].is_nan() {
                observations[point] = None;
            } else if let Some(observation) = &mut observations[point] {
                for (residual, median) in observation.residual.iter_mut().zip(medians) {
                    *residual -= median;
                }
            }
        }
    }
}

/// A view's correction.
struct Estimate {
    twist: Twist,
    /// Bilinear form of two twists: the mean of the product of their displacements.
    displacement: [Twist; 6],
}

/// Derivative of a channel of the render by the pose, and the difference of the image.
type Row<'a> = (&'a Twist, f64);

/// Returns the twist that explains residuals best, under Cauchy's weights by the residuals of another one; `None`
/// where they do not determine it.
fn refined(rows: &[Row<'_>], twist: &Twist) -> Option<Twist> {
    let left = |row: &Row<'_>| row.1 - dot(row.0, twist);
    let sizes: Vec<f32> = rows.iter().map(|row| left(row).abs() as f32).collect();
    let median = statistics::median(&sizes).unwrap_or(0.0);
    let scale = f64::from(PER_MEDIAN * median).max(LEAST_NOISE);
    let mut matrix = BandMatrix::new(6, 5).with_least_pivot(LEAST_PIVOT);
    let mut right = [0.0; 6];
    for row in rows {
        let residual = left(row);
        let weight = statistics::cauchy_weight(residual, scale);
        for (i, slope) in row.0.iter().enumerate() {
            right[i] += weight * slope * row.1;
            for (j, other) in row.0[..=i].iter().enumerate() {
                matrix.add(i, j, weight * slope * other);
            }
        }
    }
    matrix.solve(&right)?.try_into().ok()
}

impl Estimate {
    fn of(observations: &[&PoseObservation], least: usize) -> Option<Self> {
        if observations.len() < least {
            return None;
        }
        let rows: Vec<Row<'_>> = observations
            .iter()
            .flat_map(|observation| {
                observation
                    .slopes
                    .iter()
                    .zip(observation.residual.map(f64::from))
            })
            .collect();
        let mut twist = [0.0; 6];
        for _ in 0..ROUNDS {
            twist = refined(&rows, &twist)?;
        }
        Some(Self {
            twist,
            displacement: mean_displacement(observations),
        })
    }

    fn correction(&self) -> PoseCorrection {
        let [x, y, z, along_x, along_y, along_z] = self.twist.map(|value| value as f32);
        PoseCorrection {
            rotation: Vec3::new(x, y, z),
            centre: Vec3::new(along_x, along_y, along_z),
        }
    }

    /// Returns the mean product of the displacements of the points by two twists, radians squared.
    fn product(&self, one: &Twist, other: &Twist) -> f64 {
        (0..6)
            .map(|i| one[i] * dot(&self.displacement[i], other))
            .sum()
    }
}

fn mean_displacement(observations: &[&PoseObservation]) -> [Twist; 6] {
    let mut mean = [[0.0; 6]; 6];
    for observation in observations {
        let by = observation.displacements();
        for (row, one) in mean.iter_mut().zip(by) {
            for (value, other) in row.iter_mut().zip(by) {
                *value += one.dot(other) / observations.len() as f64;
            }
        }
    }
    mean
}

fn dot(one: &Twist, other: &Twist) -> f64 {
    one.iter().zip(other).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests;
