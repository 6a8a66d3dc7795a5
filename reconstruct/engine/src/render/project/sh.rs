//! Real spherical harmonics up to degree 3 in the order and with the signs of 3DGS
//! (`utils/sh_utils.py`, `forward.cu` `computeColorFromSH`), and their derivative by the direction.

use glam::{Vec3, vec3};

use crate::gaussians::{SH_C0, sh_rest_count};

const C1: f32 = 0.488_602_52;
const C2: [f32; 3] = [1.092_548_4, 0.315_391_57, 0.546_274_2];
const C3: [f32; 5] = [
    0.590_043_6,
    2.890_611_4,
    0.457_045_8,
    0.373_176_33,
    1.445_305_7,
];

/// Returns the non-constant harmonics at a unit direction. Only the first `sh_rest_count(degree)` are set.
pub fn basis(degree: usize, direction: Vec3) -> [f32; 15] {
    let mut values = [0.0; 15];
    let [x, y, z] = direction.to_array();
    if degree >= 1 {
        values[..3].copy_from_slice(&[-C1 * y, C1 * z, -C1 * x]);
    }
    if degree >= 2 {
        values[3..8].copy_from_slice(&[
            C2[0] * x * y,
            -C2[0] * y * z,
            C2[1] * (2.0 * z * z - x * x - y * y),
            -C2[0] * x * z,
            C2[2] * (x * x - y * y),
        ]);
    }
    if degree >= 3 {
        let (xx, yy, zz) = (x * x, y * y, z * z);
        values[8..].copy_from_slice(&[
            -C3[0] * y * (3.0 * xx - yy),
            C3[1] * x * y * z,
            -C3[2] * y * (4.0 * zz - xx - yy),
            C3[3] * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
            -C3[2] * x * (4.0 * zz - xx - yy),
            C3[4] * z * (xx - yy),
            -C3[0] * x * (xx - 3.0 * yy),
        ]);
    }
    values
}

/// Computes the VJP of [`basis`]: the gradient by the direction (as a free vector) from gradients by the
/// values.
fn basis_vjp(degree: usize, direction: Vec3, g: &[f32; 15]) -> Vec3 {
    let [x, y, z] = direction.to_array();
    let mut gradient = Vec3::ZERO;
    if degree >= 1 {
        gradient += C1 * vec3(-g[2], -g[0], g[1]);
    }
    if degree >= 2 {
        gradient += C2[0]
            * vec3(
                g[3] * y - g[6] * z,
                g[3] * x - g[4] * z,
                -g[4] * y - g[6] * x,
            );
        gradient += C2[1] * g[5] * vec3(-2.0 * x, -2.0 * y, 4.0 * z);
        gradient += C2[2] * g[7] * vec3(2.0 * x, -2.0 * y, 0.0);
    }
    if degree >= 3 {
        let (xx, yy, zz) = (x * x, y * y, z * z);
        gradient -= C3[0] * g[8] * vec3(6.0 * x * y, 3.0 * (xx - yy), 0.0);
        gradient += C3[1] * g[9] * vec3(y * z, x * z, x * y);
        gradient -= C3[2] * g[10] * vec3(-2.0 * x * y, 4.0 * zz - xx - 3.0 * yy, 8.0 * y * z);
        gradient += C3[3] * g[11] * vec3(-6.0 * x * z, -6.0 * y * z, 6.0 * zz - 3.0 * (xx + yy));
        gradient -= C3[2] * g[12] * vec3(4.0 * zz - 3.0 * xx - yy, -2.0 * x * y, 8.0 * x * z);
        gradient += C3[4] * g[13] * vec3(2.0 * x * z, -2.0 * y * z, xx - yy);
        gradient -= C3[0] * g[14] * vec3(3.0 * (xx - yy), -6.0 * x * y, 0.0);
    }
    gradient
}

/// Returns the gradient by a point relative to the camera, from that by the colour of the harmonics in its
/// direction. `rest` holds at least `sh_rest_count(degree)` coefficients.
pub(super) fn position_vjp(
    degree: usize,
    point: Vec3,
    rest: &[[f32; 3]],
    colour: [f32; 3],
) -> Vec3 {
    if degree == 0 {
        return Vec3::ZERO;
    }
    let distance = point.length();
    let direction = point / distance;
    let mut by_value = [0.0; 15];
    for (by_value, coefficient) in by_value[..sh_rest_count(degree)].iter_mut().zip(rest) {
        *by_value = colour.iter().zip(coefficient).map(|(a, b)| a * b).sum();
    }
    let by_direction = basis_vjp(degree, direction, &by_value);
    // d(p/|p|): remove the part along p, divide by the length.
    (by_direction - direction * by_direction.dot(direction)) / distance
}

/// Returns the colour of harmonics in a unit direction: `max(1/2 + sum_k Y_k c_k, 0)`. `rest` holds at least
/// `sh_rest_count(degree)` coefficients.
pub(super) fn colour(
    degree: usize,
    direction: Vec3,
    constant: [f32; 3],
    rest: &[[f32; 3]],
) -> [f32; 3] {
    let values = basis(degree, direction);
    std::array::from_fn(|channel| {
        let sum: f32 = values[..sh_rest_count(degree)]
            .iter()
            .zip(rest)
            .map(|(value, coefficient)| value * coefficient[channel])
            .sum();
        (0.5 + SH_C0 * constant[channel] + sum).max(0.0)
    })
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    #[test]
    fn harmonics_are_orthonormal() {
        // A product of two harmonics of degree 3 is a polynomial of degree 6. A fine Fibonacci sphere
        // integrates it well enough to detect a wrong constant.
        const COUNT: usize = 20_000;
        let mut sums = [[0.0_f64; 15]; 15];
        for index in 0..COUNT {
            let y = 1.0 - 2.0 * (index as f64 + 0.5) / COUNT as f64;
            let (sin, cos) = (index as f64 * 2.399_963_229_728_653).sin_cos();
            let rho = (1.0 - y * y).sqrt();
            let values = basis(3, DVec3::new(rho * cos, y, rho * sin).as_vec3());
            for (row, a) in sums.iter_mut().zip(values) {
                for (sum, b) in row.iter_mut().zip(values) {
                    *sum += f64::from(a * b) * 4.0 * std::f64::consts::PI / COUNT as f64;
                }
            }
        }
        for (i, row) in sums.iter().enumerate() {
            for (j, sum) in row.iter().enumerate() {
                let expected = if i == j { 1.0 } else { 0.0 };
                assert!((sum - expected).abs() < 1e-3, "<{i}, {j}> = {sum}");
            }
        }
    }

    #[test]
    fn vjp_is_the_derivative() {
        let weights: [f32; 15] = std::array::from_fn(|k| (k as f32 * 1.7).sin() + 0.3);
        let direction = vec3(0.36, -0.48, 0.8);
        for degree in 0..=3 {
            let value = |direction: Vec3| -> f32 {
                basis(degree, direction)
                    .iter()
                    .zip(weights)
                    .map(|(value, weight)| value * weight)
                    .sum()
            };
            let mut used = [0.0; 15];
            let count = sh_rest_count(degree);
            used[..count].copy_from_slice(&weights[..count]);
            let gradient = basis_vjp(degree, direction, &used);
            for axis in 0..3 {
                let mut step = Vec3::ZERO;
                step[axis] = 1e-2;
                // Polynomials of degree 3: the error of the central difference is a few h^2.
                let expected = (value(direction + step) - value(direction - step)) / 2e-2;
                assert!(
                    (gradient[axis] - expected).abs() < 3e-3,
                    "degree {degree} axis {axis}"
                );
            }
        }
    }
}
