//! Changes of axes of Gaussians with their harmonics.
//!
//! Files of this program have x to the right, y down and z forward, as in 3DGS and COLMAP. SPZ and glTF have y
//! up. [`FileAxes`] has those of a file in any other position.

use std::f64::consts::TAU;

use glam::{DMat3, DQuat, DVec3};
use omnilife_engine::{gaussians::MAX_SH_DEGREE, render::project::sh};

/// Axes whose sign changes that of a harmonic: x, y and z of all but the constant one, in their order.
const ODD: [[bool; 3]; 15] = {
    const fn of(x: u8, y: u8, z: u8) -> [bool; 3] {
        [x == 1, y == 1, z == 1]
    }
    [
        of(0, 1, 0),
        of(0, 0, 1),
        of(1, 0, 0),
        of(1, 1, 0),
        of(0, 1, 1),
        of(0, 0, 0),
        of(1, 0, 1),
        of(0, 0, 0),
        of(0, 1, 0),
        of(1, 1, 1),
        of(0, 1, 0),
        of(0, 0, 1),
        of(1, 0, 0),
        of(0, 0, 1),
        of(1, 0, 0),
    ]
};

/// A half rotation about an axis: the other two change their sign. It is its own inverse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct HalfTurn([f32; 3]);

impl HalfTurn {
    /// From y down and z forward to y up and z back.
    pub(super) const ABOUT_X: Self = Self([1.0, -1.0, -1.0]);
    /// From x right and y down to x left and y up.
    pub(super) const ABOUT_Z: Self = Self([-1.0, -1.0, 1.0]);

    /// Rotates a position.
    pub(super) fn place(self, place: [f32; 3]) -> [f32; 3] {
        let Self([a, b, c]) = self;
        let [x, y, z] = place;
        [a * x, b * y, c * z]
    }

    /// Rotates a Gaussian's rotation (w, x, y, z). Its own axes change their signs too, which does not affect its
    /// covariance.
    pub(super) fn rotation(self, quaternion: [f32; 4]) -> [f32; 4] {
        let [w, x, y, z] = quaternion;
        let [x, y, z] = self.place([x, y, z]);
        [w, x, y, z]
    }

    /// Returns the signs of the harmonics but the constant one.
    pub(super) fn harmonics(self) -> [f32; 15] {
        ODD.map(|odd| {
            let changed = odd.iter().zip(self.0).filter(|(odd, _)| **odd);
            changed.map(|(_, sign)| sign).product()
        })
    }
}

/// Directions of a file's axes in the world: a rotation by quarter turns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FileAxes {
    to_world: DQuat,
}

impl FileAxes {
    /// Parses the world's axes that the file's x, y and z point along, such as `x,-z,y`.
    ///
    /// # Errors
    /// With the reason in one line, for other text, an axis that is named twice, and axes that mirror a scene.
    pub fn parse(text: &str) -> Result<Self, String> {
        let columns: Option<Vec<DVec3>> = text.split(',').map(direction).collect();
        let Some(&[x, y, z]) = columns.as_deref() else {
            return Err("expected three of x, y, z, -x, -y and -z, such as x,-z,y".to_owned());
        };
        let to_world = DMat3::from_cols(x, y, z);
        match to_world.determinant() {
            volume if volume > 0.5 => Ok(Self {
                to_world: DQuat::from_mat3(&to_world),
            }),
            volume if volume < -0.5 => Err(format!("{text} mirrors the scene: change one sign")),
            _ => Err(format!("{text} names an axis twice")),
        }
    }

    /// Returns the rotation from the file's axes to the world's.
    pub fn to_world(self) -> DQuat {
        self.to_world
    }
}

/// Returns the direction of an axis with its sign.
fn direction(word: &str) -> Option<DVec3> {
    let word = word.trim();
    let (sign, axis) = match word.strip_prefix('-') {
        Some(axis) => (-1.0, axis),
        None => (1.0, word),
    };
    match axis {
        "x" => Some(sign * DVec3::X),
        "y" => Some(sign * DVec3::Y),
        "z" => Some(sign * DVec3::Z),
        _ => None,
    }
}

/// Degree of the polynomial on the sphere that is integrated: two harmonics of degree 3.
const NODES: [(f64, f64); 4] = [
    (-0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
    (-0.339_981_043_584_856_26, 0.652_145_154_862_546_2),
    (0.339_981_043_584_856_26, 0.652_145_154_862_546_2),
    (0.861_136_311_594_052_6, 0.347_854_845_137_453_85),
];
const STEPS: u32 = 8;

/// A rotation of harmonics up to degree 3.
#[derive(Debug, Clone, PartialEq)]
pub struct HarmonicTurn {
    /// One square matrix per degree from 1 on, `2 degree + 1` wide.
    by_degree: [[[f64; 7]; 7]; MAX_SH_DEGREE],
}

impl HarmonicTurn {
    /// Returns the matrices of a unit quaternion: integrals over the sphere of `Y_k(d) Y_m(R^-1 d)`, by a quadrature that
    /// is exact for them (Gauss and Legendre in z, equal steps around it).
    pub fn new(rotation: DQuat) -> Self {
        let back = rotation.inverse();
        let mut by_degree = [[[0.0; 7]; 7]; MAX_SH_DEGREE];
        for (z, weight) in NODES {
            let radius = (1.0 - z * z).sqrt();
            for step in 0..STEPS {
                let angle = TAU * f64::from(step) / f64::from(STEPS);
                let direction = DVec3::new(radius * angle.cos(), radius * angle.sin(), z);
                let turned = sh::basis(MAX_SH_DEGREE, direction.as_vec3());
                let before = sh::basis(MAX_SH_DEGREE, (back * direction).as_vec3());
                let share = weight * TAU / f64::from(STEPS);
                for (degree, matrix) in (1..).zip(&mut by_degree) {
                    let of_degree = degree * degree - 1..(degree + 1) * (degree + 1) - 1;
                    for (row, turned) in matrix.iter_mut().zip(&turned[of_degree.clone()]) {
                        for (to, before) in row.iter_mut().zip(&before[of_degree.clone()]) {
                            *to += share * f64::from(*turned) * f64::from(*before);
                        }
                    }
                }
            }
        }
        Self { by_degree }
    }

    /// Rotates the coefficients of a Gaussian but the constant one, of whole degrees.
    pub fn apply(&self, coefficients: &mut [[f32; 3]]) {
        let mut rest = coefficients;
        for (degree, matrix) in (1..).zip(&self.by_degree) {
            let width = 2 * degree + 1;
            if rest.len() < width {
                return;
            }
            let (of_degree, others) = rest.split_at_mut(width);
            let mut before = [[0.0; 3]; 7];
            before[..width].copy_from_slice(of_degree);
            for (to, row) in of_degree.iter_mut().zip(matrix) {
                *to = [0, 1, 2].map(|channel| {
                    let terms = row.iter().zip(&before[..width]);
                    let sum: f64 = terms.map(|(a, b)| a * f64::from(b[channel])).sum();
                    sum as f32
                });
            }
            rest = others;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn harmonics() -> [[f32; 3]; 15] {
        std::array::from_fn(|k| [0, 1, 2].map(|channel| ((7 * k + channel) as f32).sin()))
    }

    fn colour(coefficients: &[[f32; 3]], direction: DVec3) -> f32 {
        let values = sh::basis(MAX_SH_DEGREE, direction.as_vec3());
        values.iter().zip(coefficients).map(|(y, c)| y * c[1]).sum()
    }

    #[test]
    fn turned_harmonics_have_the_colour_of_the_turned_direction() {
        let rotation = DQuat::from_xyzw(0.3, -0.5, 0.1, 0.7).normalize();
        for count in [3, 8, 15] {
            let before = harmonics();
            let mut after = before;
            HarmonicTurn::new(rotation).apply(&mut after[..count]);
            for direction in [DVec3::X, DVec3::new(0.6, 0.0, -0.8), DVec3::NEG_Y] {
                let [was, is] = [
                    colour(&before[..count], direction),
                    colour(&after[..count], rotation * direction),
                ];
                assert!((was - is).abs() < 1e-5, "{count}: {was} {is}");
            }
        }
    }

    #[test]
    fn axes_of_files_are_turns_to_the_world() {
        let down = FileAxes::parse("x, -z, y").map(|axes| axes.to_world() * DVec3::Y);
        assert!(down.is_ok_and(|down| down.distance(DVec3::NEG_Z) < 1e-12));
        let ahead = FileAxes::parse("-y,-z,x").map(|axes| axes.to_world() * DVec3::Z);
        assert!(ahead.is_ok_and(|ahead| ahead.distance(DVec3::X) < 1e-12));
        for (text, reason) in [
            ("x,y,-z", "mirrors the scene"),
            ("x,y,-y", "names an axis twice"),
            ("x,y", "expected three of"),
            ("x,y,w", "expected three of"),
            ("x,y,z,x", "expected three of"),
        ] {
            let refused = FileAxes::parse(text).map(drop);
            assert!(refused.is_err_and(|found| found.contains(reason)), "{text}");
        }
    }

    #[test]
    fn half_turns_are_turns() {
        for (half, axis) in [(HalfTurn::ABOUT_X, DVec3::X), (HalfTurn::ABOUT_Z, DVec3::Z)] {
            let rotation = DQuat::from_axis_angle(axis, TAU / 2.0);
            let mut turned = harmonics();
            HarmonicTurn::new(rotation).apply(&mut turned);
            for ((was, sign), is) in harmonics().iter().zip(half.harmonics()).zip(turned) {
                assert!(
                    (sign * was[0] - is[0]).abs() < 1e-5,
                    "{was:?} {sign} {is:?}"
                );
            }
            let place = rotation * DVec3::new(1.0, 2.0, 3.0);
            let found = half.place([1.0, 2.0, 3.0]).map(f64::from);
            assert!(place.distance(DVec3::from_array(found)) < 1e-9);
        }
    }
}
