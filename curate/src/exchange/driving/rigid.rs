//! Rigid transforms between the frames of a vehicle, its sensors and the world.

use glam::{DMat3, DVec3};
use omnilife_schemas::Pose;

/// Transform `x -> rotation x + translation`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rigid {
    pub(super) rotation: DMat3,
    pub(super) translation: DVec3,
}

impl Rigid {
    /// Makes a transform of a matrix that is a rotation to 1e-3, which is orthonormalized; `None` for others, and for
    /// numbers that are not finite.
    pub(super) fn new(rotation: DMat3, translation: DVec3) -> Option<Self> {
        let pose = Pose::from_matrix(rotation, translation)?;
        Some(Self {
            rotation: DMat3::from_quat(pose.rotation()?),
            translation,
        })
    }

    /// Makes a transform of the first three rows of its 4x4 matrix, row by row.
    pub(super) fn from_rows(rows: [f64; 12]) -> Option<Self> {
        let [a, b, c, x, d, e, f, y, g, h, i, z] = rows;
        let rotation = DMat3::from_cols_array(&[a, d, g, b, e, h, c, f, i]);
        Self::new(rotation, DVec3::new(x, y, z))
    }

    /// Returns the transform that applies `first`, and then this one.
    pub(super) fn after(self, first: Self) -> Self {
        Self {
            rotation: self.rotation * first.rotation,
            translation: self.apply(first.translation),
        }
    }

    /// Returns the transform back.
    pub(super) fn inverse(self) -> Self {
        let rotation = self.rotation.transpose();
        Self {
            rotation,
            translation: -(rotation * self.translation),
        }
    }

    pub(super) fn apply(self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }

    /// Returns the pose of a camera whose frame is mapped to the world; `None` for numbers that are not finite.
    pub(super) fn pose(self) -> Option<Pose> {
        Pose::from_matrix(self.rotation, self.translation)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_transform_and_its_inverse_cancel_and_others_are_refused() {
        let rotation = DMat3::from_rotation_z(0.4) * DMat3::from_rotation_x(-1.1);
        let one = Rigid::new(rotation, DVec3::new(1.0, -2.0, 0.5));
        let other = Rigid::new(DMat3::from_rotation_y(0.3), DVec3::new(0.0, 4.0, 1.0));
        let (Some(one), Some(other)) = (one, other) else {
            panic!("both are rigid");
        };
        let point = DVec3::new(0.3, 0.7, -5.0);
        let there = one.after(other).apply(point);
        assert!(there.distance(one.apply(other.apply(point))) < 1e-12);
        assert!(one.after(other).inverse().apply(there).distance(point) < 1e-12);
        assert_eq!(Rigid::new(2.0 * rotation, DVec3::ZERO), None);
        assert_eq!(Rigid::from_rows([f64::NAN; 12]), None);
        let rows = [0.0, -1.0, 0.0, 5.0, 1.0, 0.0, 0.0, 6.0, 0.0, 0.0, 1.0, 7.0];
        let turned = Rigid::from_rows(rows).map(|rigid| rigid.apply(DVec3::X));
        assert!(turned.is_some_and(|found| found.distance(DVec3::new(5.0, 7.0, 7.0)) < 1e-12));
    }
}
