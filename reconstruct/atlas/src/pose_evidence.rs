//! Agreement of camera poses with scene points, by what the images show at them.
//!
//! A point has the same colour in two frames if point and poses are right. Over all points of a pair of frames, the
//! small motion of the second camera is found that explains the differences best, robustly: what it moves the points by
//! in the image is the error of the poses. A background at a wrong place does not enter.
//!
//! ```text
//! min sum w(e) e^2     e = I_b(p(X)) + grad I_b . dp/dX (omega x X + v) - (1 + gain) I_a - offset
//! ```

use glam::{DMat3, DQuat, DVec2, DVec3};
use omnilife_engine::camera::Camera;
use omnilife_schemas::{
    band_matrix::BandMatrix,
    statistics::{TUKEY, median, tukey_weight},
};
use rayon::prelude::*;

use super::{
    clip::{Clip, ClipFrame, project},
    initialize::{grey_at, pixel_at, seen_at},
    robust::sigma_of,
};

/// Pairs of frames, at most.
const PAIRS: usize = 12;
/// Frames from one to the other of a pair: one of this many parts of the clip, one frame at least.
const PARTS: usize = 16;
/// Points of a pair, at most and at least.
const MOST_POINTS: usize = 3000;
const LEAST_POINTS: usize = 200;
/// Side of a cell in which a point hides farther ones, pixels.
const CELL: usize = 4;
/// Ratio of depths from which a point is hidden.
const BEHIND: f64 = 1.05;
/// Steps, at most.
const STEPS: usize = 10;
/// Movement below which the steps end, pixels.
const STILL: f64 = 1e-3;
/// Unknowns: rotation, translation, gain, offset.
const UNKNOWNS: usize = 8;
/// Standard deviations of the unknowns without evidence: radians, median depths, shares.
const BELIEVED: [f64; UNKNOWNS] = [0.05, 0.05, 0.05, 0.05, 0.05, 0.05, 0.5, 0.5];
/// Minimum standard deviation of grey values' errors.
const LEAST_SIGMA: f64 = 0.005;
/// Errors beyond this share of the points' contrast do not agree.
const AGREEING: f64 = 0.5;
/// Minimum mean agreement of a pair that tells anything.
const LEAST_AGREEMENT: f64 = 0.4;
/// Maximum displacement of points under poses that agree with them, pixels.
const MOST_DISPLACED: f64 = 0.5;

/// Displacement of scene points in the images by the errors of poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseAgreement {
    /// Median over pairs of the root mean square displacement, pixels.
    pub displacement: f64,
    /// Median of its standard deviation by the images' errors, pixels.
    pub uncertainty: f64,
    /// Number of pairs that tell.
    pub pairs: usize,
    /// Median number of their points.
    pub points: usize,
}

impl PoseAgreement {
    /// Returns true if the poses need no correction.
    pub fn agrees(&self) -> bool {
        self.displacement <= MOST_DISPLACED
    }

    /// Returns the evidence in words.
    pub fn words(&self) -> String {
        format!(
            "the poses move {} scene points by {:.2} pixels against the images (uncertain by {:.2}, {} pairs of frames)",
            self.points, self.displacement, self.uncertainty, self.pairs
        )
    }
}

/// Judges the poses of a clip by scene points, normalized; `None` where these do not tell.
pub fn agreement(clip: &Clip, points: &[DVec3]) -> Option<PoseAgreement> {
    let count = clip.frames.len();
    if count < 2 || points.len() < LEAST_POINTS {
        return None;
    }
    let apart = (count / PARTS).max(1);
    let stride = (count - apart).div_ceil(PAIRS).max(1);
    let firsts: Vec<usize> = (0..count - apart).step_by(stride).collect();
    let found: Vec<OfPair> = firsts
        .into_par_iter()
        .filter_map(|first| of_pair(clip, points, [first, first + apart]))
        .collect();
    let displacements: Vec<f64> = found.iter().map(|pair| pair.displacement).collect();
    let uncertainties: Vec<f64> = found.iter().map(|pair| pair.uncertainty).collect();
    let counts: Vec<f64> = found.iter().map(|pair| pair.points as f64).collect();
    let uncertainty = median(&uncertainties)?;
    (uncertainty <= MOST_DISPLACED).then_some(PoseAgreement {
        displacement: median(&displacements)?,
        uncertainty,
        pairs: found.len(),
        points: median(&counts)? as usize,
    })
}

/// Agreement in one pair of frames.
struct OfPair {
    displacement: f64,
    uncertainty: f64,
    points: usize,
}

/// A point in two frames.
#[derive(Debug, Clone, Copy)]
struct Sighting {
    /// Position in the second camera's frame, over the median depth.
    at: DVec3,
    /// Grey value in the first frame.
    grey: f64,
}

fn of_pair(clip: &Clip, points: &[DVec3], [first, second]: [usize; 2]) -> Option<OfPair> {
    let [a, b] = [first, second].map(|number| &clip.frames[number]);
    let [in_a, in_b] = [a, b].map(|frame| visible(clip, frame, points));
    let both: Vec<usize> = (0..points.len())
        .filter(|&point| in_a[point] && in_b[point])
        .collect();
    if both.len() < LEAST_POINTS {
        return None;
    }
    let own = |point: usize| b.pose.rotation.transpose() * (points[point] - b.pose.centre);
    let depths: Vec<f64> = both.iter().map(|&point| own(point).length()).collect();
    let unit = median(&depths)?;
    let stride = both.len().div_ceil(MOST_POINTS);
    let sightings: Vec<Sighting> = both
        .iter()
        .step_by(stride)
        .filter_map(|&point| {
            let seen = seen_at(clip, a, points[point])?;
            Some(Sighting {
                at: own(point) / unit,
                grey: grey_at(clip, a, seen),
            })
        })
        .collect();
    let pair = Pair {
        clip,
        frame: b,
        sightings: &sightings,
    };
    pair.aligned()
}

/// Returns true for each point that a frame shows, outside of masks: in the image, with no nearer point beside it.
fn visible(clip: &Clip, frame: &ClipFrame, points: &[DVec3]) -> Vec<bool> {
    let [width, height] = clip.size();
    let columns = width.div_ceil(CELL);
    let mut nearest = vec![f64::INFINITY; columns * height.div_ceil(CELL)];
    let places: Vec<Option<(usize, f64)>> = points
        .iter()
        .map(|&point| {
            let pixel = pixel_at(clip, seen_at(clip, frame, point)?);
            let shows = frame.shows_scene(pixel) && !frame.is_covered(pixel);
            shows.then(|| {
                let cell = pixel / width / CELL * columns + pixel % width / CELL;
                (cell, point.distance(frame.pose.centre))
            })
        })
        .collect();
    for &(cell, depth) in places.iter().flatten() {
        nearest[cell] = nearest[cell].min(depth);
    }
    places
        .into_iter()
        .map(|place| place.is_some_and(|(cell, depth)| depth <= BEHIND * nearest[cell]))
        .collect()
}

/// Points of the first frame before the camera of the second.
struct Pair<'a> {
    clip: &'a Clip,
    frame: &'a ClipFrame,
    sightings: &'a [Sighting],
}

/// Correction of the second camera.
#[derive(Debug, Clone, Copy)]
struct Correction {
    rotation: DMat3,
    shift: DVec3,
    gain: f64,
    offset: f64,
}

/// Equation of a point: derivatives by the unknowns, and the difference that they explain.
struct Equation {
    row: [f64; UNKNOWNS],
    difference: f64,
    /// Derivatives of the position in the image by rotation and translation.
    place: [DVec2; 6],
}

impl Pair<'_> {
    /// Returns the place in the image of a position before the camera, if it is inside.
    fn place(&self, at: DVec3) -> Option<DVec2> {
        let place = project(&self.clip.camera, at)?;
        let [width, height] = self.clip.size().map(|side| side as f64);
        let is_inside = place.x >= 0.0 && place.y >= 0.0 && place.x <= width && place.y <= height;
        is_inside.then_some(place)
    }

    /// Returns the way from one place in the image to another, the short way around a panorama.
    fn way(&self, from: DVec2, to: DVec2) -> DVec2 {
        let way = to - from;
        match self.clip.camera {
            Camera::Erp(camera) => DVec2::new(camera.wrapped_column_distance(from.x, to.x), way.y),
            Camera::Pinhole(_) => way,
        }
    }

    /// Returns the derivatives of the place by a position, by central differences.
    fn by_position(&self, at: DVec3) -> Option<[DVec2; 3]> {
        let step = 1e-5 * at.length();
        let mut columns = [DVec2::ZERO; 3];
        for (column, axis) in columns.iter_mut().zip(DVec3::AXES) {
            let [before, after] =
                [-step, step].map(|by| project(&self.clip.camera, at + by * axis));
            *column = self.way(before?, after?) / (2.0 * step);
        }
        Some(columns)
    }

    fn equation(&self, one: &Sighting, correction: &Correction) -> Option<Equation> {
        let at = correction.rotation * one.at + correction.shift;
        let place = self.place(at)?;
        let columns = self.by_position(at)?;
        let by =
            |motion: DVec3| columns[0] * motion.x + columns[1] * motion.y + columns[2] * motion.z;
        let [x, y, z] = DVec3::AXES;
        let moves = [x.cross(at), y.cross(at), z.cross(at), x, y, z].map(by);
        let grey = |dx: f64, dy: f64| grey_at(self.clip, self.frame, place + DVec2::new(dx, dy));
        let gradient = 0.5
            * DVec2::new(
                grey(1.0, 0.0) - grey(-1.0, 0.0),
                grey(0.0, 1.0) - grey(0.0, -1.0),
            );
        let mut row = [0.0; UNKNOWNS];
        for (value, by) in row.iter_mut().zip(moves) {
            *value = -gradient.dot(by);
        }
        row[6] = one.grey;
        row[7] = 1.0;
        Some(Equation {
            row,
            difference: grey(0.0, 0.0) - one.grey,
            place: moves,
        })
    }

    fn equations(&self, correction: &Correction) -> Option<Vec<Equation>> {
        let equations: Vec<Equation> = self
            .sightings
            .iter()
            .filter_map(|one| self.equation(one, correction))
            .collect();
        (equations.len() >= LEAST_POINTS).then_some(equations)
    }

    /// Finds the motion of the camera that explains the differences; `None` where too few points agree under it.
    fn aligned(&self) -> Option<OfPair> {
        let mut correction = Correction {
            rotation: DMat3::IDENTITY,
            shift: DVec3::ZERO,
            gain: 0.0,
            offset: 0.0,
        };
        for _ in 0..STEPS {
            let equations = self.equations(&correction)?;
            let errors = errors(&equations, &correction);
            let sigma = sigma_at_least(&errors);
            let solution =
                normal(&equations, &errors, sigma).solve(&right(&equations, &errors, sigma))?;
            let &[a, b, c, x, y, z, gain, offset] = solution.first_chunk::<UNKNOWNS>()?;
            let turn = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(a, b, c)));
            correction.rotation = turn * correction.rotation;
            correction.shift = turn * correction.shift + DVec3::new(x, y, z);
            correction.gain = gain.clamp(-0.5, 1.0);
            correction.offset = offset;
            let moved = equations.iter().map(|equation| {
                let moves = equation.place.iter().zip(&solution);
                moves
                    .map(|(&by, &value)| by * value)
                    .sum::<DVec2>()
                    .length()
            });
            if moved.fold(0.0, f64::max) < STILL {
                break;
            }
        }
        self.judged(&correction)
    }

    fn judged(&self, correction: &Correction) -> Option<OfPair> {
        let equations = self.equations(correction)?;
        let errors = errors(&equations, correction);
        let count = equations.len() as f64;
        let greys = self.sightings.iter().map(|one| one.grey);
        let mean = greys.clone().sum::<f64>() / self.sightings.len() as f64;
        let variance = greys.map(|grey| (grey - mean).powi(2)).sum::<f64>();
        let contrast = (variance / self.sightings.len() as f64).sqrt();
        let limit = AGREEING * contrast / TUKEY;
        let agreement = errors
            .iter()
            .map(|&error| tukey_weight(error, limit))
            .sum::<f64>()
            / count;
        if agreement < LEAST_AGREEMENT {
            return None;
        }
        let sigma = sigma_at_least(&errors);
        let matrix = normal(&equations, &errors, sigma);
        let mut inverse = Vec::with_capacity(UNKNOWNS);
        for unknown in 0..UNKNOWNS {
            let mut unit = [0.0; UNKNOWNS];
            unit[unknown] = sigma * sigma;
            inverse.push(matrix.clone().solve(&unit)?);
        }
        let variance = |equation: &Equation| {
            let mut sum = 0.0;
            for (by, column) in equation.place.iter().zip(&inverse) {
                for (other, value) in equation.place.iter().zip(column) {
                    sum += by.dot(*other) * value;
                }
            }
            sum
        };
        let variances = equations.iter().map(variance).sum::<f64>() / count;
        let squares = self.sightings.iter().filter_map(|one| {
            let from = self.place(one.at)?;
            let to = self.place(correction.rotation * one.at + correction.shift)?;
            Some(self.way(from, to).length_squared())
        });
        let squares: Vec<f64> = squares.collect();
        Some(OfPair {
            displacement: (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt(),
            uncertainty: variances.sqrt(),
            points: equations.len(),
        })
    }
}

/// Returns what a correction of the light leaves of the differences.
fn errors(equations: &[Equation], correction: &Correction) -> Vec<f64> {
    equations
        .iter()
        .map(|one| one.difference - correction.gain * one.row[6] - correction.offset)
        .collect()
}

/// Returns the standard deviation of errors, at least that of the images.
fn sigma_at_least(errors: &[f64]) -> f64 {
    sigma_of(errors).max(LEAST_SIGMA)
}

fn normal(equations: &[Equation], errors: &[f64], sigma: f64) -> BandMatrix {
    let mut matrix = BandMatrix::new(UNKNOWNS, UNKNOWNS - 1);
    for (unknown, believed) in BELIEVED.into_iter().enumerate() {
        matrix.add(unknown, unknown, (sigma / believed).powi(2));
    }
    for (equation, &error) in equations.iter().zip(errors) {
        let weight = tukey_weight(error, sigma);
        for row in 0..UNKNOWNS {
            for column in 0..=row {
                matrix.add(
                    row,
                    column,
                    weight * equation.row[row] * equation.row[column],
                );
            }
        }
    }
    matrix
}

fn right(equations: &[Equation], errors: &[f64], sigma: f64) -> [f64; UNKNOWNS] {
    let mut right = [0.0; UNKNOWNS];
    for (equation, &error) in equations.iter().zip(errors) {
        let weighted = tukey_weight(error, sigma) * equation.difference;
        for (sum, value) in right.iter_mut().zip(equation.row) {
            *sum += weighted * value;
        }
    }
    right
}

#[cfg(test)]
mod tests;
