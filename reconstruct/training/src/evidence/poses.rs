//! How far the poses of some views are off, by what scene points show beside where they should.
//!
//! A camera whose pose is slightly wrong sees every point a little beside its place. To first order the
//! difference of image and render at a point is minus the slope of the render times that displacement, and
//! the displacement is that of a camera which turns by `w` and moves by `t` (world frame): for a point
//! in the unit direction `n` at the distance `d`
//!
//! ```text
//! dn = -w x n - (t - n (n.t)) / d
//! ```
//!
//! Six numbers per view explain the differences at thousands of points: robust least squares finds
//! them, iteratively reweighted with Cauchy's weights, which leave what moves, and what hides a point,
//! without much say. What is wrong with a point in all views - a blurred edge, a colour - says nothing
//! of a pose: medians over views are taken out first. Corrections that are the same in all views, or
//! change in proportion to the place of the camera, say nothing either: a scene that the pilot fit has
//! a percent too near looks like a path that is a percent too long.
//!
//! The evidence is how far two halves of the points agree on a displacement. Neighbouring points err
//! alike, so that the covariance of a fit says too little of its error. But the halves lie in different
//! directions, as the squares of a chess-board: what is by chance in one is not in the other, the product
//! of their displacements is 0 on average for poses that are exact, and its spread over the views says how
//! near to 0.

use std::{f64::consts::TAU, fmt};

use glam::{DVec3, Vec3};
use omnilife_schemas::statistics;
use serde::Serialize;

use crate::evidence::{LEAST_VIEWS, PER_MEDIAN, PILOT_ITERATIONS, pilot::WIDTH};
use omnilife_engine::camera::{Camera, pose::PoseCorrection};

/// Displacement from which poses are worth refining, pixels of images that are [`WIDTH`] pixels wide: in the middle
/// between exact poses, 0.09 at most, and those that are off by a tenth of a degree or two, 0.14 at least
/// (docs/results/evidence.md). In wider images it is the same angle and more pixels; in narrower ones as many
/// pixels, for a fit shows no smaller part of one.
const LEAST_SHIFT_PIXELS: f64 = 0.12;
/// The halves agree when the mean of their products is this many of its standard errors above 0.
const LEAST_STANDARD_ERRORS: f64 = 3.0;
/// Squares of the chess-board between the centre of the sphere and its surface, along each axis.
const SQUARES: f64 = 3.0;
/// Fewer observations do not say six numbers; of a half of the points, half as many.
const LEAST_OBSERVATIONS: usize = 50;
/// Rounds of reweighting.
const ROUNDS: usize = 8;
/// Residuals of this many standard deviations have half their weight (Cauchy's: 95 % efficiency on
/// normal residuals).
const CAUCHY: f64 = 2.385;
/// Weight of no trend beside the cameras' path, over their mean square distance from its middle.
const PATH_RIDGE: f64 = 1e-3;
/// Residuals of a render without any noise still differ by rounding, grey levels of 1.
const LEAST_NOISE: f64 = 1e-6;

/// Turn (3, radians) and shift (3, normalized units) of a camera in the world.
type Twist = [f64; 6];

/// What a point says of the pose of a view that sees it.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseObservation {
    /// From the camera to the point, normalized units, world frame.
    offset: DVec3,
    /// How each channel of the render changes with the pose.
    slopes: [Twist; 3],
    /// Image minus render, by channel.
    residual: [f32; 3],
}

impl PoseObservation {
    /// Of a point at `offset` from the camera (world frame), how the channels of the render change from
    /// its place to where it would be seen if it moved in the world, and the differences of image and
    /// render at its place. What is seen there when the point moves comes from the other side: the sign
    /// of the displacement turns around.
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

    /// Which half of the points it belongs to.
    fn half(&self) -> usize {
        let squares = (SQUARES * self.offset.normalize_or_zero()).floor();
        (squares.x + squares.y + squares.z).rem_euclid(2.0) as usize
    }

    /// By how much the point's direction changes with each of the pose's numbers.
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

/// How far poses are off.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct PoseEvidence {
    /// Views that said something.
    pub views: usize,
    /// Root mean square displacement of the points by the corrections, chance included, radians.
    pub shift_radians: f64,
    /// Mean product of the displacements that two halves of the points say, radians squared: the mean
    /// square without what is by chance. It may be below 0.
    pub agreed_square: f64,
    /// Standard error of that mean over the views.
    pub standard_error: f64,
    /// A shift of the camera by this times an angle displaces the points as a turn by the angle does, root
    /// mean square; normalized units.
    pub distance: f64,
    /// Width of the images that were looked at, pixels.
    pub width: u32,
    /// Pixels at the image centre that a whole turn of small angles makes.
    #[serde(skip)]
    pub turn_pixels: f64,
    /// What would correct the pose of each view that was given; `None` where too little was seen.
    #[serde(skip)]
    pub corrections: Vec<Option<PoseCorrection>>,
}

impl PoseEvidence {
    /// From what every view, a camera at a centre, shows at the same points.
    pub fn of(mut views: Vec<(Vec3, Vec<Option<PoseObservation>>)>, camera: &Camera) -> Self {
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
        // Written so that NaN is refused.
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
            corrections: corrections.collect(),
        }
    }

    /// Root mean square displacement without what is by chance, pixels at the images' centre.
    pub fn agreed_pixels(&self) -> f64 {
        self.agreed_square.max(0.0).sqrt() / TAU * self.turn_pixels
    }

    /// Whether the poses are worth refining.
    pub fn are_off(&self) -> bool {
        self.standard_error > 0.0
            && self.agreed_square >= LEAST_STANDARD_ERRORS * self.standard_error
            && self.agreed_pixels() >= self.limit_pixels()
    }

    /// Returns the displacement from which poses are worth refining, pixels of the images that were looked at.
    fn limit_pixels(&self) -> f64 {
        LEAST_SHIFT_PIXELS * (f64::from(self.width) / f64::from(WIDTH)).max(1.0)
    }
}

/// The width of an ERP image; a pinhole shows the tangent of an angle.
fn pixels_per_turn(camera: &Camera) -> f64 {
    match camera {
        Camera::Erp(camera) => f64::from(camera.width),
        Camera::Pinhole(camera) => TAU * (camera.fx * camera.fy).sqrt(),
    }
}

impl fmt::Display for PoseEvidence {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        // Zero where fewer than two views have enough points in both halves.
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

/// Mean over the views of the product of the displacements that two halves of the points say, and its
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

/// What some of the points say of each view's pose, without what a bent scene explains.
struct Estimates {
    /// `None` where too little was seen.
    of_views: Vec<Option<Estimate>>,
    /// How many views' worth of freedom a bent scene takes.
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

/// Takes out of the twists what is the same in all views, and what changes in proportion to the place of
/// the camera: a scene that is turned, moved, scaled or sheared a little explains both. Returns how
/// many views' worth of freedom that was.
fn subtract_trend(centres: &[DVec3], mut found: Vec<&mut Estimate>) -> f64 {
    let count = found.len().max(1) as f64;
    let mean = centres.iter().sum::<DVec3>() / count;
    let mut normal = [[0.0; 3]; 3];
    for &centre in centres {
        let from = (centre - mean).to_array();
        for (row, one) in normal.iter_mut().zip(from) {
            for (value, other) in row.iter_mut().zip(from) {
                *value += one * other;
            }
        }
    }
    // Cameras on a line say nothing of what changes beside it.
    let ridge = PATH_RIDGE * (normal[0][0] + normal[1][1] + normal[2][2]);
    for (k, row) in normal.iter_mut().enumerate() {
        row[k] += ridge;
    }
    let inverse = inverted(&normal);
    let mut trend = [(0.0, DVec3::ZERO); 6];
    for (k, (constant, slope)) in trend.iter_mut().enumerate() {
        *constant = found.iter().map(|one| one.twist[k]).sum::<f64>() / count;
        if let Some(inverse) = &inverse {
            let pairs = centres.iter().zip(found.iter());
            let along: DVec3 = pairs
                .map(|(&centre, one)| (centre - mean) * (one.twist[k] - *constant))
                .sum();
            *slope = DVec3::from_array(inverse.map(|row| DVec3::from_array(row).dot(along)));
        }
    }
    for (&centre, one) in centres.iter().zip(found.iter_mut()) {
        for (value, (constant, slope)) in one.twist.iter_mut().zip(trend) {
            *value -= constant + slope.dot(centre - mean);
        }
    }
    1.0 + inverse.map_or(0.0, |inverse| {
        3.0 - ridge * (inverse[0][0] + inverse[1][1] + inverse[2][2])
    })
}

/// Takes out of each residual what it is over all views; points that few views see have no say.
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
    /// The mean of the product of two displacements is a bilinear form of their twists: this.
    displacement: [Twist; 6],
}

/// How a channel of the render changes with the pose, and by how much the image differs.
type Row<'a> = (&'a Twist, f64);

/// Normal equations under Cauchy's weights.
#[derive(Default)]
struct NormalEquations {
    matrix: [Twist; 6],
    right: Twist,
}

impl NormalEquations {
    /// Weighted by what `twist` leaves of the residuals.
    fn of(rows: &[Row<'_>], twist: &Twist) -> Self {
        let left = |row: &Row<'_>| row.1 - dot(row.0, twist);
        let sizes: Vec<f32> = rows.iter().map(|row| left(row).abs() as f32).collect();
        let median = statistics::median(&sizes).unwrap_or(0.0);
        let scale = f64::from(PER_MEDIAN * median).max(LEAST_NOISE);
        let mut sums = Self::default();
        for row in rows {
            let residual = left(row);
            let weight = 1.0 / (1.0 + (residual / (CAUCHY * scale)).powi(2));
            for (i, slope) in row.0.iter().enumerate() {
                sums.right[i] += weight * slope * row.1;
                for (value, other) in sums.matrix[i].iter_mut().zip(row.0) {
                    *value += weight * slope * other;
                }
            }
        }
        sums
    }
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
            let equations = NormalEquations::of(&rows, &twist);
            let inverse = inverted(&equations.matrix)?;
            twist = std::array::from_fn(|i| dot(&inverse[i], &equations.right));
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

    /// Mean product of the displacements of the points by two twists, radians squared.
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

/// The inverse of a symmetric matrix by Gauss and Jordan, which needs no pivots where it is positive
/// definite; `None` where it is not, or nearly not.
fn inverted<const N: usize>(matrix: &[[f64; N]; N]) -> Option<[[f64; N]; N]> {
    let of = |value: &dyn Fn(usize, usize) -> f64| -> [[f64; N]; N] {
        std::array::from_fn(|row| std::array::from_fn(|column| value(row, column)))
    };
    let scale: [f64; N] = std::array::from_fn(|k| matrix[k][k].sqrt().recip());
    let mut left = of(&|row, column| matrix[row][column] * scale[row] * scale[column]);
    let mut right = of(&|row, column| if row == column { 1.0 } else { 0.0 });
    for pivot in 0..N {
        let size = left[pivot][pivot];
        // With a diagonal of 1; written so that NaN is refused.
        let is_definite = size > 1e-9;
        if !is_definite {
            return None;
        }
        for side in [&mut left, &mut right] {
            side[pivot] = side[pivot].map(|value| value / size);
        }
        for row in (0..N).filter(|&row| row != pivot) {
            let factor = left[row][pivot];
            for side in [&mut left, &mut right] {
                let pivots = side[pivot];
                for (value, of_pivot) in side[row].iter_mut().zip(pivots) {
                    *value -= factor * of_pivot;
                }
            }
        }
    }
    Some(of(&|row, column| {
        right[row][column] * scale[row] * scale[column]
    }))
}

#[cfg(test)]
mod tests;
