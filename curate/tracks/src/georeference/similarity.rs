//! Similarity between two sets of points, robust against mistakes.
//!
//! The rotation is the quaternion of Horn (Closed-form solution of absolute orientation using unit quaternions, 1987),
//! the scale that of Umeyama (Least-squares estimation of transformation parameters, 1991). Points are weighted anew
//! by their residuals (Cauchy) until mistakes have no weight, and left out beyond four robust standard deviations.

use glam::{DQuat, DVec3};
use omnilife_schemas::{
    absolute_orientation::{best_rotation, eigen},
    statistics::median,
};

/// Minimum number of points.
pub const LEAST_POINTS: usize = 4;
/// Rounds of weighting.
const ROUNDS: usize = 30;
/// Standard deviations of a normal distribution in its median absolute value.
const DEVIATIONS: f64 = 1.4826;
/// Robust standard deviations from which on a point is a mistake.
const MISTAKE: f64 = 4.0;
/// Smallest ratio of the two larger extents of points that fix a rotation.
const LEAST_WIDTH: f64 = 0.03;
/// Smallest second extent, in units of the residuals.
const LEAST_RESIDUALS: f64 = 3.0;

/// `to = scale R from + offset`.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedSimilarity {
    /// Scale.
    pub scale: f64,
    /// Rotation.
    pub rotation: DQuat,
    /// Offset.
    pub offset: DVec3,
    /// Residual of each point.
    pub residuals: Vec<f64>,
    /// True for the points that were used.
    pub is_used: Vec<bool>,
}

/// Fits a similarity from points to others.
///
/// # Errors
/// When there are too few points, or all are on a line, about which any rotation would fit: one line.
pub fn fitted(from: &[DVec3], to: &[DVec3]) -> Result<FittedSimilarity, String> {
    let count = from.len().min(to.len());
    if count < LEAST_POINTS {
        return Err(format!(
            "{count} recorded positions are at frames with poses, at least {LEAST_POINTS} must be"
        ));
    }
    let mut weights = vec![1.0; count];
    let mut fit = weighted(from, to, &weights)?;
    for _ in 0..ROUNDS {
        let reach = 2.0 * deviation(&fit.residuals);
        for (weight, residual) in weights.iter_mut().zip(&fit.residuals) {
            *weight = 1.0 / (1.0 + (residual / reach).powi(2));
        }
        fit = weighted(from, to, &weights)?;
    }
    let limit = MISTAKE * deviation(&fit.residuals);
    let is_used: Vec<bool> = fit.residuals.iter().map(|&one| one <= limit).collect();
    for (weight, &is_used) in weights.iter_mut().zip(&is_used) {
        *weight = f64::from(u8::from(is_used));
    }
    let fit = weighted(from, to, &weights)?;
    refuse_line(to, &weights, &fit)?;
    Ok(FittedSimilarity { is_used, ..fit })
}

/// Returns the robust standard deviation of residuals; above 0, so that exact points have weights.
fn deviation(residuals: &[f64]) -> f64 {
    (DEVIATIONS * median(residuals).unwrap_or(0.0)).max(1e-6)
}

/// Fits a similarity by weighted least squares.
fn weighted(from: &[DVec3], to: &[DVec3], weights: &[f64]) -> Result<FittedSimilarity, String> {
    let [middle_from, middle_to] = [from, to].map(|points| middle(points, weights));
    let centred = || {
        let pairs = from.iter().zip(to).zip(weights);
        pairs.map(move |((&from, &to), &weight)| (from - middle_from, to - middle_to, weight))
    };
    let extent: f64 = centred()
        .map(|(from, _, weight)| weight * from.length_squared())
        .sum();
    if extent.is_nan() || extent <= 0.0 {
        return Err("all cameras are in one place".to_owned());
    }
    let (rotation, _) = best_rotation(centred().map(|(from, to, weight)| (weight * from, to)));
    let along: f64 = centred()
        .map(|(from, to, weight)| weight * to.dot(rotation * from))
        .sum();
    let scale = along / extent;
    if !scale.is_finite() || scale <= 0.0 {
        return Err("recorded positions and cameras have nothing in common".to_owned());
    }
    let offset = middle_to - scale * (rotation * middle_from);
    let residuals = from.iter().zip(to);
    let residuals = residuals.map(|(&from, &to)| (scale * (rotation * from) + offset).distance(to));
    Ok(FittedSimilarity {
        scale,
        rotation,
        offset,
        residuals: residuals.collect(),
        is_used: vec![true; weights.len()],
    })
}

fn middle(points: &[DVec3], weights: &[f64]) -> DVec3 {
    let sum: DVec3 = points
        .iter()
        .zip(weights)
        .map(|(&point, &weight)| weight * point)
        .sum();
    sum / weights.iter().sum::<f64>()
}

fn refuse_line(points: &[DVec3], weights: &[f64], fit: &FittedSimilarity) -> Result<(), String> {
    let middle = middle(points, weights);
    let total: f64 = weights.iter().sum();
    let mut covariance = [[0.0; 3]; 3];
    let mut squares = 0.0;
    for ((&point, &weight), residual) in points.iter().zip(weights).zip(&fit.residuals) {
        let own = (point - middle).to_array();
        for (row, a) in covariance.iter_mut().zip(own) {
            for (entry, b) in row.iter_mut().zip(own) {
                *entry += weight * a * b / total;
            }
        }
        squares += weight * residual * residual / total;
    }
    let mut extents = eigen(covariance).0.map(|value| value.max(0.0).sqrt());
    extents.sort_by(|a, b| b.total_cmp(a));
    let [length, width, _] = extents;
    if width < LEAST_WIDTH * length || width < LEAST_RESIDUALS * squares.sqrt() {
        return Err(format!(
            "the cameras' path is a line ({length:.1} m along, {width:.1} m across, {:.1} m off the recorded \
             positions): the turn about it is not determined",
            squares.sqrt()
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use glam::dvec3;

    use super::*;

    fn path() -> Vec<DVec3> {
        (0..40)
            .map(|n| {
                let angle = 0.1 * f64::from(n);
                dvec3(
                    3.0 * angle.cos(),
                    2.0 * angle.sin(),
                    0.2 * (3.0 * angle).sin(),
                )
            })
            .collect()
    }

    fn moved(points: &[DVec3]) -> Vec<DVec3> {
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -2.0, 1.1);
        let moved = |&point: &DVec3| 17.5 * (turn * point) + dvec3(120.0, -40.0, 8.0);
        points.iter().map(moved).collect()
    }

    #[test]
    fn a_similarity_is_found_and_mistakes_are_left_out() {
        let from = path();
        let mut to = moved(&from);
        let exact = fitted(&from, &to).expect("a similarity");
        assert!((exact.scale - 17.5).abs() < 1e-9);
        assert!(exact.residuals.iter().all(|&residual| residual < 1e-9));
        to[5] += dvec3(80.0, 0.0, 30.0);
        to[20] -= dvec3(0.0, 60.0, 0.0);
        let robust = fitted(&from, &to).expect("a similarity");
        assert!((robust.scale - 17.5).abs() < 1e-6, "{}", robust.scale);
        let left_out: Vec<usize> = (0..40).filter(|&at| !robust.is_used[at]).collect();
        assert_eq!(left_out, [5, 20]);
        assert!((robust.residuals[20] - 60.0).abs() < 1e-3);
    }

    #[test]
    fn lines_and_too_few_points_are_refused() {
        let line: Vec<DVec3> = (0..20).map(|n| dvec3(f64::from(n), 0.0, 1.0)).collect();
        let message = fitted(&line, &moved(&line)).expect_err("a line");
        assert!(message.contains("is a line"), "{message}");
        // A line with the noise of a receiver.
        let noisy: Vec<DVec3> = moved(&line)
            .into_iter()
            .zip(0..)
            .map(|(point, n)| point + 30.0 * dvec3(f64::from(n).sin(), f64::from(3 * n).cos(), 0.0))
            .collect();
        assert!(fitted(&line, &noisy).is_err());
        let message = fitted(&line[..3], &line[..3]).expect_err("too few");
        assert!(message.contains("at least 4"), "{message}");
        let still = vec![DVec3::ONE; 8];
        assert!(fitted(&still, &still).is_err());
    }
}
