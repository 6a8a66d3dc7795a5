//! Least-squares alignment of camera centres: Horn's quaternions (1987) with Umeyama's scale (1991).

use glam::{DQuat, DVec3};
use omnilife_schemas::{Pose, records::PoseAlignment};

/// Sweeps of Jacobi rotations at most; five are usual.
const SWEEPS: usize = 40;
/// The rotation is open where the largest eigenvalue exceeds the next one by no more than this share of it. Centres on
/// a line have such a pair.
const LEAST_GAP: f64 = 1e-6;
/// Centres whose spread is below this share of their distance from the origin, or of 1, are in one place.
const LEAST_SPREAD: f64 = 1e-9;

/// `x_reference = scale * rotation * x_estimated + offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Alignment {
    pub(super) scale: f64,
    pub(super) rotation: DQuat,
    pub(super) offset: DVec3,
}

impl Alignment {
    /// Returns an estimated pose in the world of the reference; `None` without a rotation.
    pub(super) fn apply(&self, pose: &Pose) -> Option<Pose> {
        let centre = self.scale * (self.rotation * pose.centre()) + self.offset;
        Some(Pose::new(self.rotation * pose.rotation()?, centre))
    }
}

/// Part of an alignment that centres alone leave open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Degeneracy {
    /// The centres are on a line: a turn about it is open.
    Line,
    /// The reference stays in one place: rotation and scale are open.
    ReferenceStands,
    /// The estimated centres are in one place, and those of the reference are not: the scale is open.
    EstimateStands,
}

/// Aligns estimated poses to those of the reference, in pairs of (estimated, reference). Where the centres leave the
/// rotation open, it is that of the cameras (their mean, Markley 2007).
///
/// Returns `None` without pairs or for poses that are not valid.
pub(super) fn align(
    pairs: &[(Pose, Pose)],
    kind: PoseAlignment,
) -> Option<(Alignment, Option<Degeneracy>)> {
    if pairs.is_empty() || pairs.iter().any(|(a, b)| !a.is_valid() || !b.is_valid()) {
        return None;
    }
    let count = pairs.len() as f64;
    let means = [
        pairs.iter().map(|(a, _)| a.centre()).sum::<DVec3>() / count,
        pairs.iter().map(|(_, b)| b.centre()).sum::<DVec3>() / count,
    ];
    let centred: Vec<[DVec3; 2]> = (pairs.iter())
        .map(|(a, b)| [a.centre() - means[0], b.centre() - means[1]])
        .collect();
    let stands = [0, 1].map(|side| {
        let squared: f64 = centred.iter().map(|pair| pair[side].length_squared()).sum();
        (squared / count).sqrt() <= LEAST_SPREAD * means[side].length().max(1.0)
    });
    let (rotation, gap) = best_rotation(centred.iter().map(|[a, b]| (*a, *b)));
    let degeneracy = match stands {
        [_, true] => Some(Degeneracy::ReferenceStands),
        [true, false] => Some(Degeneracy::EstimateStands),
        [false, false] => (gap <= LEAST_GAP).then_some(Degeneracy::Line),
    };
    let rotation = match degeneracy {
        None => rotation,
        Some(_) => mean_turn(pairs)?,
    };
    let scale = match (kind, degeneracy) {
        (PoseAlignment::Rigid, _)
        | (_, Some(Degeneracy::ReferenceStands | Degeneracy::EstimateStands)) => 1.0,
        (PoseAlignment::Similarity, _) => {
            let along: f64 = centred.iter().map(|[a, b]| b.dot(rotation * *a)).sum();
            let spread: f64 = centred.iter().map(|[a, _]| a.length_squared()).sum();
            // A reflected line: no scale below zero.
            (along / spread).max(0.0)
        }
    };
    let alignment = Alignment {
        scale,
        rotation,
        offset: means[1] - scale * (rotation * means[0]),
    };
    Some((alignment, degeneracy))
}

/// Returns the mean of the rotations that take the estimated cameras to those of the reference.
fn mean_turn(pairs: &[(Pose, Pose)]) -> Option<DQuat> {
    let mut sum = [[0.0; 4]; 4];
    for (estimated, reference) in pairs {
        let turn = reference.rotation()? * estimated.rotation()?.inverse();
        let q = [turn.w, turn.x, turn.y, turn.z];
        for (row, a) in sum.iter_mut().zip(q) {
            for (entry, b) in row.iter_mut().zip(q) {
                *entry += a * b;
            }
        }
    }
    Some(largest_eigenvector(sum).0)
}

/// Returns the rotation that best takes the first vectors of pairs to the second, and the relative gap between the two
/// largest eigenvalues of Horn's matrix.
fn best_rotation(pairs: impl Iterator<Item = (DVec3, DVec3)>) -> (DQuat, f64) {
    let mut s = [[0.0; 3]; 3];
    for (from, to) in pairs {
        for (row, a) in s.iter_mut().zip(from.to_array()) {
            for (entry, b) in row.iter_mut().zip(to.to_array()) {
                *entry += a * b;
            }
        }
    }
    let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = s;
    largest_eigenvector([
        [xx + yy + zz, yz - zy, zx - xz, xy - yx],
        [yz - zy, xx - yy - zz, xy + yx, zx + xz],
        [zx - xz, xy + yx, yy - xx - zz, yz + zy],
        [xy - yx, zx + xz, yz + zy, zz - xx - yy],
    ])
}

/// Returns the eigenvector (w, x, y, z) of the largest eigenvalue of a symmetric matrix, by Jacobi rotations, and the
/// gap to the next eigenvalue as a share of the largest absolute one.
fn largest_eigenvector(mut matrix: [[f64; 4]; 4]) -> (DQuat, f64) {
    let mut vectors = [[0.0; 4]; 4];
    for (index, row) in vectors.iter_mut().enumerate() {
        row[index] = 1.0;
    }
    for _ in 0..SWEEPS {
        let mut is_diagonal = true;
        for p in 0..3 {
            for q in p + 1..4 {
                let off = matrix[p][q];
                if off.abs() <= f64::EPSILON * 0.1 * (matrix[p][p].abs() + matrix[q][q].abs()) {
                    continue;
                }
                is_diagonal = false;
                let theta = (matrix[q][q] - matrix[p][p]) / (2.0 * off);
                let tangent = theta.signum() / (theta.abs() + theta.hypot(1.0));
                let cosine = 1.0 / tangent.hypot(1.0);
                let turn = [cosine, tangent * cosine];
                for row in &mut matrix {
                    turn_entries(row, p, q, turn);
                }
                let [mut upper, mut lower] = [matrix[p], matrix[q]];
                for (a, b) in upper.iter_mut().zip(&mut lower) {
                    (*a, *b) = (turn[0] * *a - turn[1] * *b, turn[1] * *a + turn[0] * *b);
                }
                (matrix[p], matrix[q]) = (upper, lower);
                for row in &mut vectors {
                    turn_entries(row, p, q, turn);
                }
            }
        }
        if is_diagonal {
            break;
        }
    }
    let mut order = [0, 1, 2, 3];
    order.sort_by(|&a, &b| matrix[b][b].total_cmp(&matrix[a][a]));
    let [first, second, .., last] = order;
    let largest = matrix[first][first].abs().max(matrix[last][last].abs());
    let gap = (matrix[first][first] - matrix[second][second]) / largest.max(f64::MIN_POSITIVE);
    let [w, x, y, z] = vectors.map(|row| row[first]);
    (DQuat::from_xyzw(x, y, z, w).normalize(), gap)
}

fn turn_entries(row: &mut [f64; 4], p: usize, q: usize, [cosine, sine]: [f64; 2]) {
    let (a, b) = (row[p], row[q]);
    (row[p], row[q]) = (cosine * a - sine * b, sine * a + cosine * b);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eigenvectors_are_those_of_the_matrix() {
        let matrix = [
            [4.0, 1.0, -2.0, 0.5],
            [1.0, 2.0, 0.0, 1.0],
            [-2.0, 0.0, 3.0, -1.0],
            [0.5, 1.0, -1.0, -6.0],
        ];
        let (q, gap) = largest_eigenvector(matrix);
        let vector = [q.w, q.x, q.y, q.z];
        let product = matrix.map(|row| row.iter().zip(vector).map(|(a, b)| a * b).sum::<f64>());
        let value: f64 = product.iter().zip(vector).map(|(a, b)| a * b).sum();
        for (found, expected) in product.iter().zip(vector) {
            assert!((found - value * expected).abs() < 1e-12);
        }
        assert!(value > 5.0 && gap > 0.1, "{value} {gap}");
    }

    #[test]
    fn any_rotation_between_vectors_is_found() {
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, 2.1, -0.7, 3.0);
        let vectors = [
            DVec3::X,
            DVec3::new(0.2, 1.0, -3.0),
            DVec3::new(-1.0, 0.4, 0.3),
        ];
        let (found, gap) = best_rotation(vectors.iter().map(|&v| (v, turn * v)));
        assert!(found.angle_between(turn) < 1e-7 && gap > 1e-3);
        let line = [1.0, -2.0, 0.5].map(|step| step * DVec3::new(1.0, 2.0, 3.0));
        let (_, gap) = best_rotation(line.iter().map(|&v| (v, turn * v)));
        assert!(gap < LEAST_GAP, "{gap}");
    }
}
