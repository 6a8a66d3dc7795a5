//! `trajectory-spline`: the path of an object from its detections.
//!
//! A cubic B-spline `S(t)` in space is fitted to the detections in pixels `p_t` and to their distances `d_t`, under
//! Huber's loss (Eq. 1 of "dynamic urban scenes from UAV video", whose free displacements are the residuals here: as
//! printed, an interpolating spline makes it 0):
//!
//! ```text
//! sum_t rho(|proj(S(t)) - p_t| / sigma_p) + rho((|S(t) - c_t| / d_t - 1) / sigma_d)
//! rho(r) = r^2 up to 1.5, then 3 |r| - 1.5^2
//! ```
//!
//! Knots are clamped and uniform in time. The number of coefficients `n` minimizes `BIC = sum rho + 3 n ln(3 T)` for
//! `T` detections. Fewer than four give a spline of lower degree. Pixels are compared as angles between rays over the
//! angle of a pixel there, which is the same for any camera and has no seam.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};
use omnilife_schemas::{
    band_matrix::BandMatrix, camera::Camera, posed_view::PosedView, trajectory::BSpline,
};

/// Standard deviation of the middle of a detection, radians: two pixels of a pinhole that shows 65 degrees in 640 of
/// them. What is missing of a vehicle in its box is a part of the vehicle, at any resolution.
const SIGMA_RADIANS: f64 = 0.004;
/// Minimum of it, pixels: borders are those of pixels.
const LEAST_SIGMA_PIXELS: f64 = 0.5;
/// Beyond this many standard deviations residuals count linearly.
const HUBER: f64 = 1.5;
const ITERATIONS: usize = 25;
/// Weight of an even path, over that of a detection, at the start of the fit.
const LIFT_PULL: f64 = 1e-6;

/// A detection's measurement of its object's place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation<'a> {
    /// The frame.
    pub view: &'a PosedView,
    /// Middle of the box, pixels.
    pub pixel: DVec2,
    /// Distance from the camera.
    pub distance: f64,
    /// Factor on its standard deviations; 1 for a whole box.
    pub slack: f64,
}

impl Observation<'_> {
    /// Returns the middle of its box, lifted to its distance.
    pub fn position(&self) -> DVec3 {
        self.view.centre + self.view.ray(self.pixel) * self.distance
    }
}

/// A fitted path.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedPath {
    /// The path.
    pub spline: BSpline,
    /// Root mean square of the residuals, in standard deviations.
    pub residual: f64,
    /// Criterion for the number of coefficients.
    pub bic: f64,
}

/// Fits a path to observations in order of time, at least one. `sigma_distance` is the relative standard
/// deviation of distances.
pub fn fit(observations: &[Observation<'_>], sigma_distance: f64) -> Option<FittedPath> {
    let count = observations.len();
    let (first, last) = (observations.first()?, observations.last()?);
    if last.view.seconds - first.view.seconds < LEAST_SPAN_SECONDS {
        // Simultaneous detections give the place of the vehicle and not its motion.
        return fit_with(observations, 0, 1, sigma_distance);
    }
    let degree = count.checked_sub(1)?.min(3);
    let share = |share: f64| (share * count as f64).round() as usize;
    let mut sizes: Vec<usize> = [
        4,
        share(0.2),
        share(0.25),
        share(1.0 / 3.0),
        share(0.5),
        share(2.0 / 3.0),
    ]
    .map(|size| size.clamp(degree + 1, count.max(degree + 1)))
    .to_vec();
    sizes.sort_unstable();
    sizes.dedup();
    let fits = sizes
        .into_iter()
        .filter_map(|size| fit_with(observations, degree, size, sigma_distance));
    fits.min_by(|a, b| a.bic.total_cmp(&b.bic))
}

/// Largest interval of simultaneous observations, seconds; a path lasts at least as long.
const LEAST_SPAN_SECONDS: f64 = 1e-3;

/// Fits a path with this many coefficients.
pub fn fit_with(
    observations: &[Observation<'_>],
    degree: usize,
    coefficients: usize,
    sigma_distance: f64,
) -> Option<FittedPath> {
    let (first, last) = (observations.first()?, observations.last()?);
    let begin = first.view.seconds;
    let end = last.view.seconds.max(begin + LEAST_SPAN_SECONDS);
    let mut spline = BSpline {
        degree,
        knots: BSpline::uniform_knots(degree, coefficients, begin, end),
        coefficients: vec![[0.0; 3]; coefficients],
    };
    lift(&mut spline, observations, LIFT_PULL)?;
    let mut loss = total_loss(&spline, observations, sigma_distance);
    let mut damping = 1e-4;
    for _ in 0..ITERATIONS {
        let Some(tried) = stepped(&spline, observations, sigma_distance, damping) else {
            damping *= 10.0;
            continue;
        };
        let of_tried = total_loss(&tried, observations, sigma_distance);
        if of_tried < loss {
            let gain = loss - of_tried;
            (spline, loss) = (tried, of_tried);
            damping = (0.2 * damping).max(1e-9);
            if gain < 1e-9 * loss.max(1e-9) {
                break;
            }
        } else {
            damping *= 10.0;
            if damping > 1e9 {
                break;
            }
        }
    }
    let values = (3 * observations.len()) as f64;
    loss.is_finite().then(|| FittedPath {
        bic: loss + (3 * coefficients) as f64 * values.ln(),
        residual: (loss / values).sqrt(),
        spline,
    })
}

/// Fits the spline to the lifted places by least squares, as a start; `pull` is the weight of [`smooth`]. It is solved
/// around the first of them. So the pull on few coefficients is to no place in the world, and coordinates of millions
/// of units lose no digits.
fn lift(spline: &mut BSpline, observations: &[Observation<'_>], pull: f64) -> Option<()> {
    let reach = 3 * spline.degree + 2;
    let size = spline.coefficients.len();
    let origin = observations.first()?.position();
    let mut matrix = BandMatrix::new(3 * size, reach);
    let mut right = vec![0.0; 3 * size];
    for observation in observations {
        let weights = spline.weights(observation.view.seconds);
        let position = observation.position() - origin;
        for a in 0..=spline.degree {
            for axis in 0..3 {
                let row = 3 * (weights.first + a) + axis;
                right[row] += weights.values[a] * position[axis];
                for b in 0..=a {
                    matrix.add(
                        row,
                        3 * (weights.first + b) + axis,
                        weights.values[a] * weights.values[b],
                    );
                }
            }
        }
    }
    smooth(&mut matrix, spline, pull, &mut right, None);
    let solved = matrix.solve(&right)?;
    let (places, _) = solved.as_chunks::<3>();
    let in_world = |&place: &[f64; 3]| (origin + DVec3::from_array(place)).to_array();
    spline.coefficients = places.iter().map(in_world).collect();
    Some(())
}

/// Adds a weak pull of each coefficient to the middle of its neighbours: parts without detections continue evenly. With
/// existing coefficients, the gradient of the pull goes to `right`.
fn smooth(
    matrix: &mut BandMatrix,
    spline: &BSpline,
    weight: f64,
    right: &mut [f64],
    at: Option<&[[f64; 3]]>,
) {
    let size = spline.coefficients.len();
    if spline.degree < 2 {
        (0..3 * size).for_each(|row| matrix.add(row, row, weight * 1e-3));
        return;
    }
    let second = [1.0, -2.0, 1.0];
    for first in 0..size - 2 {
        for axis in 0..3 {
            let bend: f64 = at.map_or(0.0, |at| {
                (0..3).map(|n| second[n] * at[first + n][axis]).sum()
            });
            for a in 0..3 {
                right[3 * (first + a) + axis] -= weight * second[a] * bend;
                for b in 0..=a {
                    matrix.add(
                        3 * (first + a) + axis,
                        3 * (first + b) + axis,
                        weight * second[a] * second[b],
                    );
                }
            }
        }
    }
}

/// Returns the standard deviation of the middle of a detection, pixels.
fn sigma_pixels(camera: &Camera) -> f64 {
    let per_radian = match camera {
        Camera::Erp(camera) => f64::from(camera.width) / TAU,
        Camera::Pinhole(camera) => (camera.fx * camera.fy).sqrt(),
    };
    (SIGMA_RADIANS * per_radian).max(LEAST_SIGMA_PIXELS)
}

/// Residuals of an observation in standard deviations, with their derivatives by the place.
fn residuals(
    position: DVec3,
    observation: &Observation<'_>,
    sigma_distance: f64,
) -> [(f64, DVec3); 3] {
    let view = observation.view;
    let offset = position - view.centre;
    let distance = offset.length().max(f64::MIN_POSITIVE);
    let direction = offset / distance;
    let ray = view.ray(observation.pixel);
    let steps = view.ray_steps(observation.pixel);
    let sigma_pixels = sigma_pixels(&view.camera);
    let across = steps.map(|step| {
        let length = step.length().max(f64::MIN_POSITIVE);
        // Orthogonal to the ray: a step along it has no effect.
        let axis = step / length;
        let axis = (axis - ray * ray.dot(axis)).normalize_or_zero();
        let scale = 1.0 / (length * sigma_pixels * observation.slack);
        let by_place = (axis - direction * direction.dot(axis)) / distance;
        (axis.dot(direction) * scale, by_place * scale)
    });
    let scale = 1.0 / (observation.distance * sigma_distance * observation.slack);
    [
        across[0],
        across[1],
        ((distance - observation.distance) * scale, direction * scale),
    ]
}

fn huber(residual: f64) -> f64 {
    let size = residual.abs();
    if size <= HUBER {
        size * size
    } else {
        2.0 * HUBER * size - HUBER * HUBER
    }
}

fn total_loss(spline: &BSpline, observations: &[Observation<'_>], sigma_distance: f64) -> f64 {
    observations
        .iter()
        .map(|observation| {
            let position = spline.position(observation.view.seconds);
            let all = residuals(position, observation, sigma_distance);
            all.iter()
                .map(|(residual, _)| huber(*residual))
                .sum::<f64>()
        })
        .sum()
}

/// Takes one step of Levenberg and Marquardt on the reweighted residuals.
fn stepped(
    spline: &BSpline,
    observations: &[Observation<'_>],
    sigma_distance: f64,
    damping: f64,
) -> Option<BSpline> {
    let size = spline.coefficients.len();
    let mut matrix = BandMatrix::new(3 * size, 3 * spline.degree + 2);
    let mut right = vec![0.0; 3 * size];
    for observation in observations {
        let weights = spline.weights(observation.view.seconds);
        let position = spline.position(observation.view.seconds);
        for (residual, by_place) in residuals(position, observation, sigma_distance) {
            let robust = (HUBER / residual.abs().max(HUBER)).min(1.0);
            for a in 0..=spline.degree {
                for i in 0..3 {
                    let row = 3 * (weights.first + a) + i;
                    let by_row = weights.values[a] * by_place[i];
                    right[row] -= robust * residual * by_row;
                    for b in 0..=a {
                        for j in 0..3 {
                            let column = 3 * (weights.first + b) + j;
                            if column <= row {
                                let product = by_row * weights.values[b] * by_place[j];
                                matrix.add(row, column, robust * product);
                            }
                        }
                    }
                }
            }
        }
    }
    let scale = (0..3 * size)
        .map(|row| matrix.diagonal(row))
        .fold(0.0, f64::max);
    smooth(
        &mut matrix,
        spline,
        1e-9 * scale,
        &mut right,
        Some(&spline.coefficients),
    );
    for row in 0..3 * size {
        let own = matrix.diagonal(row);
        matrix.add(row, row, damping * own.max(1e-9 * scale));
    }
    let step = matrix.solve(&right)?;
    let mut tried = spline.clone();
    for (value, step) in tried.coefficients.as_flattened_mut().iter_mut().zip(step) {
        *value += step;
    }
    Some(tried)
}

#[cfg(test)]
mod tests;
