//! Camera poses as matrices: a `NumPy` array of N x 4 x 4 or N x 3 x 4, f32 or f64, a matrix for every frame in their
//! order.
//!
//! The axes of the camera are x right, y down, z forward. The file does not tell camera-to-world from world-to-camera,
//! so the direction is stated beside it ([`PoseConvention`]).
//!
//! Networks write them, `PanoVGGT` for one: `poses/all_poses.npy` holds its `camera_poses` (`YijingGuo-June/PanoVGGT`,
//! `inference.py`, commit 1925645), N x 4 x 4 in f32. They are camera-to-world, and the ray of pixel (u, v) is ours,
//! with centres at half pixels (`stdcall0/PanoVGGT`, `panovggt/models/panovggt_model.py`, commit 0f38571:
//! `_get_direction_vectors` and `world_points`).
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::path::Path;

use glam::{DMat3, DVec3};
use omnilife_schemas::{
    Pose, npy,
    records::PoseConvention,
    store::{self, StoreError},
};

/// Maximum file size, bytes: half a million poses.
const MOST_BYTES: u64 = 64 << 20;
/// Tolerance of the last row of a rigid motion.
const LAST_ROW_TOLERANCE: f64 = 1e-6;

/// Reads the pose of every frame.
///
/// # Errors
/// When the file is missing, too large or no array of matrices, or a matrix is not finite or not a rotation with a
/// place. Names the file and the matrix.
pub fn read(path: &Path, convention: PoseConvention) -> Result<Vec<Pose>, StoreError> {
    let bytes = store::read_limited(path, MOST_BYTES)?;
    from_bytes(&bytes, convention).map_err(|reason| StoreError::malformed(path, reason))
}

/// Reads the bytes of a file.
///
/// # Errors
/// The reason, as in [`read`].
pub fn from_bytes(bytes: &[u8], convention: PoseConvention) -> Result<Vec<Pose>, String> {
    let array = npy::from_bytes(bytes)?;
    match array.shape.as_slice() {
        [_, 4, 4] => {
            let (matrices, _) = array.values.as_chunks::<16>();
            let numbered = matrices.iter().enumerate();
            numbered
                .map(|(number, [rows @ .., a, b, c, d])| {
                    let is_last = [(a, 0.0_f64), (b, 0.0), (c, 0.0), (d, 1.0)]
                        .iter()
                        .all(|(value, expected)| (*value - expected).abs() <= LAST_ROW_TOLERANCE);
                    if is_last {
                        pose(number, rows, convention)
                    } else {
                        Err(format!(
                            "the last row of matrix {number} is [{a}, {b}, {c}, {d}], expected [0, 0, 0, 1]"
                        ))
                    }
                })
                .collect()
        }
        [_, 3, 4] => {
            let (matrices, _) = array.values.as_chunks::<12>();
            let numbered = matrices.iter().enumerate();
            numbered
                .map(|(number, rows)| pose(number, rows, convention))
                .collect()
        }
        _ => Err(format!(
            "is of shape {:?}, expected (frames, 4, 4) or (frames, 3, 4)",
            array.shape
        )),
    }
}

/// Returns the pose of three rows of a matrix.
fn pose(number: usize, rows: &[f64; 12], convention: PoseConvention) -> Result<Pose, String> {
    if let Some(value) = rows.iter().find(|value| !value.is_finite()) {
        return Err(format!("matrix {number} has the entry {value}"));
    }
    let [a, b, c, x, d, e, f, y, g, h, i, z] = *rows;
    // Columns of the rotation.
    let rotation = DMat3::from_cols_array(&[a, d, g, b, e, h, c, f, i]);
    let (to_world, centre) = match convention {
        PoseConvention::CameraToWorld => (rotation, DVec3::new(x, y, z)),
        PoseConvention::WorldToCamera => {
            let to_world = rotation.transpose();
            (to_world, to_world.mul_vec3(DVec3::new(-x, -y, -z)))
        }
    };
    Pose::from_matrix(to_world, centre)
        .ok_or_else(|| format!("matrix {number} is not a rotation with a place"))
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

    use glam::DQuat;

    use super::*;

    /// Returns the rows of a matrix, four each.
    fn rows(pose: &Pose, convention: PoseConvention) -> [f32; 12] {
        let to_world = DMat3::from_quat(pose.rotation().unwrap());
        let (rotation, place) = match convention {
            PoseConvention::CameraToWorld => (to_world, pose.centre()),
            PoseConvention::WorldToCamera => {
                let to_camera = to_world.transpose();
                (to_camera, -(to_camera * pose.centre()))
            }
        };
        let at = |row: usize, column: usize| match column {
            3 => place[row] as f32,
            _ => rotation.col(column)[row] as f32,
        };
        std::array::from_fn(|entry| at(entry / 4, entry % 4))
    }

    fn bytes(shape: &[usize], values: &[f32]) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        npy::write_f32(&path, shape, values).unwrap();
        std::fs::read(path).unwrap()
    }

    #[test]
    fn both_conventions_and_both_shapes_give_the_pose() {
        let truth = [0.0, 0.7, 2.5].map(|t| {
            let turn = DQuat::from_euler(glam::EulerRot::YXZ, t, 0.3 - t, 0.1);
            Pose::new(turn, DVec3::new(t, -2.0, 0.25 * t))
        });
        for convention in [PoseConvention::CameraToWorld, PoseConvention::WorldToCamera] {
            let of_three: Vec<f32> = truth
                .iter()
                .flat_map(|pose| rows(pose, convention))
                .collect();
            let (matrices, _) = of_three.as_chunks::<12>();
            let of_four: Vec<f32> = matrices
                .iter()
                .flat_map(|rows| rows.iter().copied().chain([0.0, 0.0, 0.0, 1.0]))
                .collect();
            for bytes in [bytes(&[3, 3, 4], &of_three), bytes(&[3, 4, 4], &of_four)] {
                let poses = from_bytes(&bytes, convention).unwrap();
                assert_eq!(poses.len(), 3);
                for (pose, truth) in poses.iter().zip(&truth) {
                    assert!(pose.centre().distance(truth.centre()) < 1e-6);
                    let turn = pose.rotation().unwrap();
                    assert!(turn.angle_between(truth.rotation().unwrap()) < 1e-6);
                }
            }
        }
    }

    #[test]
    fn what_is_no_rigid_motion_is_refused_with_its_number() {
        let whole = [1.0, 0.0, 0.0, 5.0, 0.0, 1.0, 0.0, 6.0, 0.0, 0.0, 1.0, 7.0];
        let with = |entry: usize, value: f32| {
            let mut changed = whole;
            changed[entry] = value;
            from_bytes(
                &bytes(&[2, 3, 4], &[whole, changed].concat()),
                PoseConvention::WorldToCamera,
            )
        };
        assert_eq!(with(0, 1.0).unwrap()[1].centre, [-5.0, -6.0, -7.0]);
        // A reflection, a shear, a scale, and non-finite values.
        for (entry, value) in [
            (0, -1.0),
            (1, 0.1),
            (5, 1.1),
            (0, f32::NAN),
            (3, f32::INFINITY),
        ] {
            let message = with(entry, value).unwrap_err();
            assert!(message.contains("matrix 1"), "{message}");
        }
        let projective = [&whole[..], &[0.0, 0.0, 0.1, 1.0]].concat();
        let of_shape = |shape: &[usize], values: &[f32]| {
            from_bytes(&bytes(shape, values), PoseConvention::CameraToWorld)
        };
        assert!(of_shape(&[1, 4, 4], &projective).is_err());
        assert!(of_shape(&[3, 4], &whole).is_err());
        assert!(of_shape(&[1, 4, 3], &whole).is_err());
        assert!(of_shape(&[0, 3, 4], &[]).unwrap().is_empty());
    }
}
