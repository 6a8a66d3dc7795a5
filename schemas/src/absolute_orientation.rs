//! Rotations between two sets of vectors by least squares, and eigenvectors of small symmetric matrices.
//!
//! The rotation is the quaternion of Horn (Closed-form solution of absolute orientation using unit quaternions, 1987).

use std::array;

use glam::{DQuat, DVec3};

/// Sweeps of Jacobi rotations at most; five are usual.
const SWEEPS: usize = 40;

/// Returns the rotation that best takes the first vectors of pairs to the second, and the gap of
/// [`largest_eigenvector`], which is 0 where the vectors leave the rotation open.
pub fn best_rotation(pairs: impl Iterator<Item = (DVec3, DVec3)>) -> (DQuat, f64) {
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

/// Returns the eigenvector (w, x, y, z) of the largest eigenvalue of a symmetric matrix as a unit quaternion, and the
/// gap to the next eigenvalue as a share of the largest absolute one.
pub fn largest_eigenvector(matrix: [[f64; 4]; 4]) -> (DQuat, f64) {
    let (values, vectors) = eigen(matrix);
    let mut order = [0, 1, 2, 3];
    order.sort_by(|&a, &b| values[b].total_cmp(&values[a]));
    let [first, second, .., last] = order;
    let largest = values[first].abs().max(values[last].abs());
    let gap = (values[first] - values[second]) / largest.max(f64::MIN_POSITIVE);
    let [w, x, y, z] = vectors.map(|row| row[first]);
    (DQuat::from_xyzw(x, y, z, w).normalize(), gap)
}

/// Returns the eigenvalues of a symmetric matrix, and its eigenvectors as columns, by Jacobi rotations.
pub fn eigen<const N: usize>(mut matrix: [[f64; N]; N]) -> ([f64; N], [[f64; N]; N]) {
    let mut vectors = [[0.0; N]; N];
    for (index, row) in vectors.iter_mut().enumerate() {
        row[index] = 1.0;
    }
    for _ in 0..SWEEPS {
        let mut is_diagonal = true;
        for p in 0..N {
            for q in p + 1..N {
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
    (array::from_fn(|index| matrix[index][index]), vectors)
}

fn turn_entries<const N: usize>(row: &mut [f64; N], p: usize, q: usize, [cosine, sine]: [f64; 2]) {
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
        let (values, _) = eigen([[2.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, -4.0]]);
        for expected in [1.0, 3.0, -4.0] {
            assert!(values.iter().any(|value| (value - expected).abs() < 1e-12));
        }
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
        assert!(gap < 1e-9, "{gap}");
    }
}
