//! Plane through the scene's points, as the cameras see it.
//!
//! On a plane, inverse depth is linear in the image: `1 / z = a x + b y + c` at the tangent coordinates `x`, `y` of a
//! camera. An error of inverse depth times focal length and baseline is a parallax in pixels, and that is what a
//! background at a wrong place shows. So planes are judged by it: most points within a pixel.

use glam::{DVec2, DVec3};
use omnilife_schemas::{band_matrix::BandMatrix, statistics::median};

/// Minimum number of points for a plane.
const LEAST_POINTS: usize = 50;
/// Number of drawn planes.
const DRAWS: usize = 300;
/// Refinements by the points that agree.
const REFINEMENTS: usize = 5;
/// Maximum tolerance, over the median inverse depth: where cameras hardly move, everything is within a pixel.
pub const MOST_TOLERANCE: f64 = 0.05;
/// Minimum inverse depth of the plane in view, over the median: the horizon is not on a plane.
const LEAST_INVERSE_DEPTH: f64 = 0.05;
/// Share by which more points have to agree for a tilt.
const CLEARLY: f64 = 1.05;

/// Plane of the points `X` with `normal . X = 1`, in the coordinates of a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InversePlane {
    /// Inverse depth by `x`, by `y`, and at the middle.
    pub normal: DVec3,
    /// Share of the points within the tolerance.
    pub agreeing: f64,
    /// Tolerance of inverse depth: that of the call, or less where that is more than 5 % of the median.
    pub tolerance: f64,
    /// Number of points.
    pub points: usize,
    /// True if it is not parallel to the image.
    pub is_tilted: bool,
}

/// Point as a camera sees it.
#[derive(Debug, Clone, Copy)]
struct Sighting {
    at: DVec2,
    inverse_depth: f64,
}

/// Fits a plane to points in the coordinates of a camera.
///
/// `tolerance` is the error of inverse depth that moves a point by a pixel, infinite where cameras do not move.
/// `borders` are the tangent coordinates of the image's borders: the plane is in front of the camera there. `None`
/// with too few points in front of the camera.
pub fn fitted(points: &[DVec3], tolerance: f64, borders: &[DVec2]) -> Option<InversePlane> {
    let (low, high) = borders
        .iter()
        .fold((DVec2::MAX, DVec2::MIN), |(low, high), &at| {
            (low.min(at), high.max(at))
        });
    let seen: Vec<Sighting> = points
        .iter()
        .filter(|point| point.z > 0.0)
        .map(|point| Sighting {
            at: point.truncate() / point.z,
            inverse_depth: 1.0 / point.z,
        })
        .filter(|one| one.at.cmpge(low).all() && one.at.cmple(high).all())
        .filter(|one| one.inverse_depth.is_finite())
        .collect();
    if seen.len() < LEAST_POINTS {
        return None;
    }
    let depths: Vec<f64> = seen.iter().map(|one| one.inverse_depth).collect();
    let middle = median(&depths)?;
    let tolerance = tolerance.min(MOST_TOLERANCE * middle);
    let is_in_front = |normal: &DVec3| {
        let mut all = borders.iter();
        all.all(|at| normal.dot(at.extend(1.0)) >= LEAST_INVERSE_DEPTH * middle)
    };
    let best = |drawn: &mut dyn Iterator<Item = DVec3>| {
        let judged = drawn
            .filter(&is_in_front)
            .map(|normal| (cost(&seen, normal, tolerance), normal));
        judged.min_by(|a, b| a.0.total_cmp(&b.0))
    };
    let count = seen.len();
    let drawn = |draw: usize| seen[index(draw, count)];
    let parallel =
        best(&mut (0..DRAWS).map(|draw| DVec3::new(0.0, 0.0, drawn(draw).inverse_depth)));
    let tilted = best(&mut (0..DRAWS).filter_map(|draw| {
        let three = [3 * draw, 3 * draw + 1, 3 * draw + 2].map(&drawn);
        through(three.iter().map(|&one| (one, 1.0)), 3)
    }));
    let refine = |found: (f64, DVec3), unknowns: usize| {
        let mut found = found;
        for _ in 0..REFINEMENTS {
            let agreeing = seen
                .iter()
                .filter(|one| error(one, found.1).abs() < tolerance)
                .map(|&one| (one, 1.0));
            let next = through(agreeing, unknowns).filter(&is_in_front);
            let next = next.map(|normal| (cost(&seen, normal, tolerance), normal));
            match next.filter(|next| next.0 < found.0) {
                Some(next) => found = next,
                None => break,
            }
        }
        let agreeing = seen
            .iter()
            .filter(|one| error(one, found.1).abs() < tolerance);
        InversePlane {
            normal: found.1,
            agreeing: agreeing.count() as f64 / count as f64,
            tolerance,
            points: count,
            is_tilted: unknowns == 3,
        }
    };
    let parallel = parallel.map(|found| refine(found, 1));
    let tilted = tilted.map(|found| refine(found, 3));
    match (parallel, tilted) {
        (Some(parallel), Some(tilted)) if tilted.agreeing <= CLEARLY * parallel.agreeing => {
            Some(parallel)
        }
        (parallel, tilted) => tilted.or(parallel),
    }
}

/// Returns a point's number for a draw. A multiplicative hash decides: points may be in any order, and runs repeat.
fn index(draw: usize, count: usize) -> usize {
    let hash = (draw as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    ((hash >> 20) % count as u64) as usize
}

/// Returns the error of inverse depth of a plane at a point.
fn error(one: &Sighting, normal: DVec3) -> f64 {
    normal.dot(one.at.extend(1.0)) - one.inverse_depth
}

/// Returns the sum of errors over the tolerance, each 1 at most.
fn cost(seen: &[Sighting], normal: DVec3, tolerance: f64) -> f64 {
    let errors = seen.iter().map(|one| error(one, normal).abs() / tolerance);
    errors.map(|error| error.min(1.0)).sum()
}

/// Returns the plane of least squares of inverse depth through weighted points. With one unknown it is parallel to
/// the image.
fn through(points: impl Iterator<Item = (Sighting, f64)>, unknowns: usize) -> Option<DVec3> {
    let first = 3 - unknowns;
    let mut matrix = BandMatrix::new(unknowns, unknowns - 1).with_least_pivot(1e-9);
    let mut right = vec![0.0; unknowns];
    for (one, weight) in points {
        let terms = one.at.extend(1.0).to_array();
        for row in first..3 {
            for column in first..=row {
                let value = weight * terms[row] * terms[column];
                matrix.add(row - first, column - first, value);
            }
            right[row - first] += weight * terms[row] * one.inverse_depth;
        }
    }
    let solution = matrix.solve(&right)?;
    let mut normal = [0.0; 3];
    normal[first..].copy_from_slice(&solution);
    let normal = DVec3::from_array(normal);
    normal.is_finite().then_some(normal)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns points of a plane, with as many others before it as `others` says.
    fn points(normal: DVec3, others: usize) -> Vec<DVec3> {
        let place = |number: usize| {
            let at = |step: f64| (number as f64 * step).fract() - 0.5;
            DVec2::new(at(0.618_034), at(0.754_878)).extend(1.0)
        };
        let on_plane = (0..400).map(|number| place(number) / normal.dot(place(number)));
        let before = (0..others).map(|number| {
            let at = place(number);
            (0.4 + 0.4 * (number as f64 * 0.569_84).fract()) * at / normal.dot(at)
        });
        on_plane.chain(before).collect()
    }

    const BORDERS: [DVec2; 4] = [
        DVec2::new(-0.5, -0.5),
        DVec2::new(0.5, -0.5),
        DVec2::new(-0.5, 0.5),
        DVec2::new(0.5, 0.5),
    ];

    #[test]
    fn a_tilted_ground_is_found_among_houses() {
        let normal = DVec3::new(0.02, 0.15, 0.25);
        let found = fitted(&points(normal, 250), 1e-3, &BORDERS).expect("enough points");
        assert!(found.normal.distance(normal) < 1e-3, "{found:?}");
        assert!(found.is_tilted);
        assert_eq!(found.tolerance, 1e-3);
        assert!((found.agreeing - 400.0 / 650.0).abs() < 0.05, "{found:?}");
    }

    #[test]
    fn a_wall_is_parallel_and_the_horizon_is_on_no_plane() {
        let wall = DVec3::new(0.0, 0.0, 0.2);
        let found = fitted(&points(wall, 100), 1e-3, &BORDERS).expect("enough points");
        assert!(!found.is_tilted && found.normal.distance(wall) < 1e-3);
        // Cameras that do not move: the tolerance is a share of the median inverse depth.
        let still = fitted(&points(wall, 100), f64::INFINITY, &BORDERS).expect("enough points");
        assert!((still.tolerance - 0.01).abs() < 1e-9, "{still:?}");
        // Ground below a horizon that is in view: no plane in front of the camera has it.
        let ground = DVec3::new(0.0, 0.5, 0.02);
        let below: Vec<DVec3> = points(ground, 0)
            .into_iter()
            .filter(|point| point.z > 0.0 && point.z < 40.0)
            .collect();
        let found = fitted(&below, 1e-3, &BORDERS).expect("enough points");
        let least = BORDERS.map(|at| found.normal.dot(at.extend(1.0)));
        assert!(least.iter().all(|&inverse| inverse > 0.0), "{found:?}");
        assert_eq!(fitted(&below[..10], 1e-3, &BORDERS), None);
    }
}
