//! Distortion of lenses as COLMAP, nerfstudio and OpenMVG model it.
//!
//! A direction `(x, y, 1)` is projected to a place `u` of the image plane ([`Projection`]), which the terms below move.
//! With `q = |u|^2` and `(a, b) = u`:
//!
//! ```text
//! c  = (1 + k1 q + k2 q^2 + ... + k6 q^6) / (1 + d1 q + d2 q^2 + d3 q^3)
//! a' = a c + 2 p1 a b + p2 (q + 2 a^2) + s1 q + s2 q^2
//! b' = b c + 2 p2 a b + p1 (q + 2 b^2) + s3 q + s4 q^2
//! ```
//!
//! (COLMAP, `src/colmap/sensor/models.h`; a model has some of these terms. Its `RAD_TAN_THIN_PRISM_FISHEYE` applies the
//! terms with p and s to the result of the radial ones.)

use glam::{DMat2, DVec2, dvec2};

/// Maximum number of Newton steps that undo the terms.
const STEPS: usize = 50;
/// Step of its numerical derivatives.
const DERIVATIVE_STEP: f64 = 1e-7;
/// Number of places between the middle and another one at which their order is checked.
const ORDERED_PLACES: u32 = 16;
/// Largest angle to the axis of a place at depth 1, radians.
const LARGEST_ANGLE: f64 = 1.57;

/// Projection of directions to the image plane, before the terms of a distortion. All have a magnification
/// of 1 in the middle.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Projection {
    /// Straight lines stay straight.
    #[default]
    Perspective,
    /// The distance from the middle is the angle to the axis.
    Equidistant,
    /// `atan(2 r tan(omega / 2)) / omega` (COLMAP's `FOV`), where `r` is the distance in perspective;
    /// its magnification in the middle is `2 tan(omega / 2) / omega`.
    FieldOfView {
        /// Radians.
        omega: f64,
    },
    /// `r = d / (1 + k d^2)` for a distance `d` (COLMAP's `DIVISION`).
    Division {
        /// Its coefficient.
        k: f64,
    },
    /// `(x, y) / (alpha sqrt(beta r^2 + 1) + 1 - alpha)` (COLMAP's `EUCM`).
    ExtendedUnified {
        /// From 0 to 1.
        alpha: f64,
        /// Positive.
        beta: f64,
    },
}

/// A lens in the image plane. Terms that a model does not have are 0.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Distortion {
    /// Projection before the terms.
    pub projection: Projection,
    /// k1 to k6.
    pub radial: [f64; 6],
    /// d1 to d3.
    pub divisor: [f64; 3],
    /// p1 and p2.
    pub tangential: [f64; 2],
    /// s1 to s4.
    pub prism: [f64; 4],
    /// True if the terms with p and s apply to the result of the radial terms.
    pub is_sequential: bool,
}

impl Projection {
    /// Returns the place of a direction, by its place at depth 1.
    fn project(self, p: DVec2) -> DVec2 {
        let r = p.length();
        if r == 0.0 {
            return p;
        }
        match self {
            Self::Perspective => p,
            Self::Equidistant => p * (r.atan() / r),
            Self::FieldOfView { omega } => {
                p * ((2.0 * r * (0.5 * omega).tan()).atan() / (r * omega))
            }
            Self::Division { k } => p * (2.0 / (1.0 + (1.0 - 4.0 * r * r * k).sqrt())),
            Self::ExtendedUnified { alpha, beta } => {
                p / (alpha * (beta * r * r + 1.0).sqrt() + 1.0 - alpha)
            }
        }
    }

    /// Returns the place at depth 1 that is projected to a place; NaN without one.
    fn unproject(self, u: DVec2) -> DVec2 {
        let d = u.length();
        if d == 0.0 {
            return u;
        }
        match self {
            Self::Perspective => u,
            Self::Equidistant if d < LARGEST_ANGLE => u * (d.tan() / d),
            Self::FieldOfView { omega } if d * omega < LARGEST_ANGLE => {
                u * ((d * omega).tan() / (2.0 * d * (0.5 * omega).tan()))
            }
            Self::Equidistant | Self::FieldOfView { .. } => DVec2::NAN,
            Self::Division { k } => u / (1.0 + k * d * d),
            Self::ExtendedUnified { alpha, beta } => {
                let root = (1.0 - (2.0 * alpha - 1.0) * beta * d * d).sqrt();
                let depth = (1.0 - alpha * alpha * beta * d * d) / (alpha * root + 1.0 - alpha);
                u / depth
            }
        }
    }

    /// Returns the kind and its numbers.
    fn numbers(self) -> [f64; 3] {
        match self {
            Self::Perspective => [0.0, 0.0, 0.0],
            Self::Equidistant => [1.0, 0.0, 0.0],
            Self::FieldOfView { omega } => [2.0, omega, 0.0],
            Self::Division { k } => [3.0, k, 0.0],
            Self::ExtendedUnified { alpha, beta } => [4.0, alpha, beta],
        }
    }
}

impl Distortion {
    /// Returns the place in the image plane of a direction, by its place at depth 1.
    pub(super) fn distorted(&self, p: DVec2) -> DVec2 {
        self.moved(self.projection.project(p))
    }

    /// Returns the place at depth 1 of the direction shown at a place; NaN if the terms cannot be undone.
    pub(super) fn straightened(&self, seen: DVec2) -> DVec2 {
        let mut place = seen;
        for _ in 0..STEPS {
            let missing = seen - self.moved(place);
            if missing.length() < 1e-15 {
                break;
            }
            let along = |step: DVec2| {
                (self.moved(place + step) - self.moved(place - step)) / (2.0 * DERIVATIVE_STEP)
            };
            let jacobian = DMat2::from_cols(
                along(dvec2(DERIVATIVE_STEP, 0.0)),
                along(dvec2(0.0, DERIVATIVE_STEP)),
            );
            place += jacobian.inverse() * missing;
        }
        self.projection.unproject(place)
    }

    /// Moves a place of the image plane by the terms.
    fn moved(&self, u: DVec2) -> DVec2 {
        let q = u.length_squared();
        let series = |terms: &[f64]| 1.0 + q * terms.iter().rev().fold(0.0, |sum, k| k + q * sum);
        let radial = u * (series(&self.radial) / series(&self.divisor));
        let place = if self.is_sequential { radial } else { u };
        let (DVec2 { x, y }, q) = (place, place.length_squared());
        let ([p1, p2], [s1, s2, s3, s4]) = (self.tangential, self.prism);
        radial
            + dvec2(
                2.0 * p1 * x * y + p2 * (q + 2.0 * x * x) + q * (s1 + q * s2),
                2.0 * p2 * x * y + p1 * (q + 2.0 * y * y) + q * (s3 + q * s4),
            )
    }

    /// Returns true if places between the middle and that of a direction keep their order; beyond that the terms do not
    /// describe a lens.
    pub(super) fn keeps_order(&self, p: DVec2) -> bool {
        let u = self.projection.project(p);
        let along = |step: u32| {
            let share = f64::from(step) / f64::from(ORDERED_PLACES);
            self.moved(share * u).dot(u)
        };
        u.is_finite()
            && (0..ORDERED_PLACES).all(|step| along(step) < along(step + 1) || u == DVec2::ZERO)
    }

    pub(in crate::poses) fn numbers(self) -> impl Iterator<Item = f64> {
        (self.projection.numbers().into_iter())
            .chain(self.radial)
            .chain(self.divisor)
            .chain(self.tangential)
            .chain(self.prism)
            .chain([f64::from(u8::from(self.is_sequential))])
    }
}
