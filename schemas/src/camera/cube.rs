//! Cube around a camera: six square perspective views that show the whole sphere once.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DMat3, DVec3};

use super::PinholeCamera;

/// Face of the cube.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CubeFace {
    /// Name of its direction, seen from the camera that looks to the front.
    pub name: &'static str,
    /// Rotation from the face's axes (x right, y down, z forward) to the camera's.
    pub to_camera: DMat3,
}

/// Faces: front first, then by turning right, then up and down as seen by turning from the front.
pub const CUBE_FACES: [CubeFace; 6] = [
    face("front", DVec3::X, DVec3::Y, DVec3::Z),
    face("right", DVec3::NEG_Z, DVec3::Y, DVec3::X),
    face("back", DVec3::NEG_X, DVec3::Y, DVec3::NEG_Z),
    face("left", DVec3::Z, DVec3::Y, DVec3::NEG_X),
    face("up", DVec3::X, DVec3::Z, DVec3::NEG_Y),
    face("down", DVec3::X, DVec3::NEG_Z, DVec3::Y),
];

const fn face(name: &'static str, right: DVec3, down: DVec3, forward: DVec3) -> CubeFace {
    CubeFace {
        name,
        to_camera: DMat3::from_cols(right, down, forward),
    }
}

/// Returns the camera of a face that is `side` pixels wide and high.
pub fn face_camera(side: u32) -> PinholeCamera {
    PinholeCamera::with_horizontal_field_of_view(side, side, FRAC_PI_2)
}

/// Returns the side in pixels of a face with the angular resolution, in its middle, of the equator of an
/// equirectangular image of this width: `width / pi`.
pub fn side_of_equal_resolution(erp_width: u32) -> u32 {
    ((f64::from(erp_width) / PI).round() as u32).max(1)
}

#[cfg(test)]
mod tests {
    use glam::dvec2;

    use super::*;
    use crate::camera::CameraModel;

    #[test]
    fn faces_are_turns_and_every_direction_is_on_one() {
        for face in CUBE_FACES {
            assert!(
                (face.to_camera.determinant() - 1.0).abs() < 1e-12,
                "{face:?}"
            );
        }
        let camera = face_camera(64);
        let erp = crate::camera::ErpCamera::new(91, 45);
        for pixel in 0..91 * 45 {
            let centre = dvec2(f64::from(pixel % 91) + 0.5, f64::from(pixel / 91) + 0.5);
            let direction = erp.unproject(centre);
            let faces = CUBE_FACES.iter().filter(|face| {
                camera
                    .project(face.to_camera.transpose() * direction)
                    .is_some_and(|at| {
                        at.cmpge(dvec2(0.0, 0.0)).all() && at.cmple(dvec2(64.0, 64.0)).all()
                    })
            });
            assert!(faces.count() >= 1, "{direction}");
        }
        assert_eq!(side_of_equal_resolution(512), 163);
    }
}
