//! The velocity of Omni4DGS: a radial and a tangential part, weighted by latitude (Eq. 3).
//!
//! ```text
//! muhat = (mu - c) / |mu - c|      y = muhat . down      cos lat = sqrt(1 - y^2)
//! w_t = (cos lat)^gamma            w_r = 1 - w_t
//! literal:    v = w_r v_r + w_t v_t                                        (3)
//! projected:  v = muhat muhat^T v_r + (I - muhat muhat^T) v_t
//! ```
//!
//! The paper takes `muhat_y` of the Gaussian's centre in the world, which presumes that the origin is at the
//! cameras and that the world's y axis is vertical. Here `c` and `down` are an [`Observer`]: either the mean
//! camera with the mean vertical of all cameras, or the camera of the view.
//!
//! In the literal form `v_r` and `v_t` are two free vectors. Their sum expresses no more than one vector
//! would, and Adam steps no differently: it removes the scale of a gradient, and the weights sum to one. The
//! projected form makes one radial and the other tangential. Weighting them as well would prevent radial
//! motion on the equator; in this form the weights therefore scale the gradients only.
//!
//! No gradient flows through the weights: for `gamma < 1` their slope is infinite at the poles.

use glam::Vec3;
use serde::{Deserialize, Serialize};

/// Decomposition of a velocity into two.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Decomposition {
    /// Exponent of the cosine of the latitude.
    pub gamma: f32,
    /// Interpretation of Eq. 3.
    pub form: VelocityForm,
    /// Origin of directions.
    pub origin: DirectionOrigin,
}

/// Interpretation of Eq. 3.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VelocityForm {
    /// Weighted sum of two free vectors.
    Literal,
    /// Radial part of one vector plus tangential part of the other.
    Projected,
}

/// Origin of directions to Gaussians.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DirectionOrigin {
    /// The mean camera: the origin of a normalized scene.
    World,
    /// The camera of the view. A Gaussian's velocity then depends on the view.
    Camera,
}

/// Observer of decomposed velocities.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observer {
    /// Position, normalized units.
    pub centre: Vec3,
    /// Unit vector from zenith to nadir.
    pub down: Vec3,
}

/// Least distance at which the direction to a point is defined; nearer points count as on the equator.
pub(crate) const LEAST_DISTANCE: f32 = 1e-6;
/// Least cosine of the latitude: with a weight of 0 a velocity could never change.
pub(crate) const LEAST_COSINE: f32 = 1e-3;
/// Least weight at which a velocity gets a gradient: below it, Adam would amplify rounding to full steps.
pub const LEAST_WEIGHT: f32 = 1e-3;

impl Observer {
    /// Returns the unit direction to a point; zero at the observer itself.
    pub fn direction(&self, point: Vec3) -> Vec3 {
        let offset = point - self.centre;
        let distance = offset.length();
        if distance > LEAST_DISTANCE {
            offset / distance
        } else {
            Vec3::ZERO
        }
    }
}

/// Velocity weights of one Gaussian.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VelocityWeights {
    direction: Vec3,
    /// `w_r`.
    pub radial: f32,
    /// `w_t`.
    pub tangential: f32,
    form: VelocityForm,
}

impl Decomposition {
    /// Returns the weights of a Gaussian centred at `point`.
    pub fn at(&self, observer: &Observer, point: Vec3) -> VelocityWeights {
        let direction = observer.direction(point);
        // `1 - y^2` cancels in f32 within a thousandth of a radian of the poles; the cross product's length
        // is the same cosine, accurate to the last bits.
        let cosine = if direction == Vec3::ZERO {
            1.0
        } else {
            direction.cross(observer.down).length()
        };
        let tangential = cosine.clamp(LEAST_COSINE, 1.0).powf(self.gamma);
        VelocityWeights {
            direction,
            radial: 1.0 - tangential,
            tangential,
            form: self.form,
        }
    }
}

impl VelocityWeights {
    /// Combines a radial and a tangential velocity.
    pub fn combine(&self, radial: Vec3, tangential: Vec3) -> Vec3 {
        match self.form {
            VelocityForm::Literal => radial * self.radial + tangential * self.tangential,
            VelocityForm::Projected => {
                self.direction * self.direction.dot(radial - tangential) + tangential
            }
        }
    }

    /// Returns gradients by the radial and the tangential velocity from that by their combination. In the
    /// projected form they are scaled by the weights.
    pub fn combine_vjp(&self, velocity: Vec3) -> [Vec3; 2] {
        let (along, across) = match self.form {
            VelocityForm::Literal => (velocity, velocity),
            VelocityForm::Projected => {
                let along = self.direction * self.direction.dot(velocity);
                (along, velocity - along)
            }
        };
        let weighted = |gradient: Vec3, weight: f32| {
            if weight < LEAST_WEIGHT {
                Vec3::ZERO
            } else {
                gradient * weight
            }
        };
        [
            weighted(along, self.radial),
            weighted(across, self.tangential),
        ]
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use proptest::prelude::*;

    use super::*;

    const ABOVE: Observer = Observer {
        centre: Vec3::new(0.1, -0.2, 0.3),
        down: Vec3::Z,
    };

    fn decomposition(gamma: f32, form: VelocityForm) -> Decomposition {
        Decomposition {
            gamma,
            form,
            origin: DirectionOrigin::World,
        }
    }

    proptest! {
        #[test]
        fn velocity_and_gradients_are_those_of_equation_3(
            point in prop::array::uniform3(-3.0..3.0_f64),
            velocities in prop::array::uniform6(-1.0..1.0_f64),
            upstream in prop::array::uniform3(-1.0..1.0_f64),
            gamma in 0.2..2.0_f64,
        ) {
            let [radial, tangential] = [0, 3].map(|at| DVec3::from_slice(&velocities[at..at + 3]));
            let upstream = DVec3::from_array(upstream);
            let offset = DVec3::from_array(point) - ABOVE.centre.as_dvec3();
            prop_assume!(offset.length() > 0.1);
            let n = offset.normalize();
            let w_t = n.x.hypot(n.y).max(1e-3).powf(gamma);
            let literal = |r: DVec3, t: DVec3| r * (1.0 - w_t) + t * w_t;
            let projected = |r: DVec3, t: DVec3| n * n.dot(r) + (t - n * n.dot(t));
            for form in [VelocityForm::Literal, VelocityForm::Projected] {
                let weights = decomposition(gamma as f32, form)
                    .at(&ABOVE, DVec3::from_array(point).as_vec3());
                let combine = |r: DVec3, t: DVec3| match form {
                    VelocityForm::Literal => literal(r, t),
                    VelocityForm::Projected => projected(r, t),
                };
                let velocity = weights.combine(radial.as_vec3(), tangential.as_vec3());
                let error = (velocity.as_dvec3() - combine(radial, tangential)).length();
                prop_assert!(error < 1e-5, "{form:?}: {error}");
                let gradients = weights.combine_vjp(upstream.as_vec3());
                // The map is linear: the gradient by a component is the upstream gradient applied to its unit
                // vector.
                for (axis, unit) in DVec3::AXES.into_iter().enumerate() {
                    let by_radial = combine(unit, DVec3::ZERO).dot(upstream);
                    let by_tangential = combine(DVec3::ZERO, unit).dot(upstream);
                    let scale = match form {
                        VelocityForm::Literal => [1.0, 1.0],
                        VelocityForm::Projected => [1.0 - w_t, w_t],
                    };
                    let of_radial = if 1.0 - w_t < 1e-3 { 0.0 } else { scale[0] * by_radial };
                    for (found, expected) in [
                        (gradients[0][axis], of_radial),
                        (gradients[1][axis], scale[1] * by_tangential),
                    ] {
                        let error = (f64::from(found) - expected).abs();
                        prop_assert!(error < 1.1e-3, "{form:?}: {found} {expected}");
                    }
                }
            }
        }
    }

    #[test]
    fn weights_run_from_tangential_on_the_equator_to_radial_at_the_poles() {
        let decomposition = decomposition(0.5, VelocityForm::Literal);
        let at = |offset: Vec3| decomposition.at(&ABOVE, ABOVE.centre + offset);
        assert_eq!((at(Vec3::X).tangential, at(Vec3::Y).radial), (1.0, 0.0));
        let pole = at(Vec3::NEG_Z * 4.0);
        assert!((pole.tangential - 1e-3_f32.sqrt()).abs() < 1e-6, "{pole:?}");
        let half = at(Vec3::new(1.0, 0.0, 3.0_f32.sqrt()));
        assert!((half.tangential - 0.5_f32.sqrt()).abs() < 1e-5, "{half:?}");
        // All values stay finite where no direction is defined.
        for offset in [Vec3::ZERO, Vec3::splat(1e-9)] {
            assert_eq!(at(offset).tangential, 1.0);
        }
    }

    #[test]
    fn weights_beside_the_poles_are_those_of_the_angle() {
        let decomposition = decomposition(1.0, VelocityForm::Literal);
        for angle in [0.1, 0.02, 5e-3, 1.3e-3, 1.01e-3_f64] {
            for pole in [-1.0, 1.0] {
                let observer = Observer {
                    centre: Vec3::ZERO,
                    down: Vec3::Y,
                };
                let (sin, cos) = angle.sin_cos();
                let point = DVec3::new(0.6 * sin, pole * cos, 0.8 * sin) * 3.0;
                let found = decomposition.at(&observer, point.as_vec3()).tangential;
                let error = (f64::from(found) / sin - 1.0).abs();
                assert!(error < 1e-5, "{angle}: {found}, off by {error}");
            }
        }
    }

    #[test]
    fn a_velocity_without_weight_gets_no_gradient() {
        let weights = decomposition(1.0, VelocityForm::Literal).at(&ABOVE, ABOVE.centre + Vec3::X);
        assert_eq!(weights.combine_vjp(Vec3::ONE), [Vec3::ZERO, Vec3::ONE]);
        let steep = decomposition(2.0, VelocityForm::Literal).at(&ABOVE, ABOVE.centre + Vec3::Z);
        assert_eq!(steep.combine_vjp(Vec3::ONE)[1], Vec3::ZERO);
    }
}
