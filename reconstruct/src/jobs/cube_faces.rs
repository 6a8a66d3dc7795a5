//! The six faces of a cube, each rendered by the pinhole camera, and panoramas from them. They show the Gaussians of a
//! perspective trainer as that trainer renders them.

use glam::DQuat;
use omnilife_engine::camera::{Camera, View};
use omnilife_schemas::{
    Pose, RgbImage, Similarity,
    camera::{
        ErpCamera,
        cube::{CUBE_FACES, face_camera},
    },
    interpolation::panorama_of_faces,
};

use omnilife_training::{error::ReconstructError, models::OpenedModel};

/// Renders the panorama at a pose from faces of `side` pixels; `None` where the pose cannot be used.
pub(super) fn panorama(
    opened: &mut dyn OpenedModel,
    camera: ErpCamera,
    side: u32,
    place: (&Pose, &Similarity, f64),
) -> Result<Option<RgbImage>, ReconstructError> {
    let faces = faces(opened, side, place)?;
    Ok(faces.map(|faces| panorama_of_faces(&faces, camera)))
}

/// Renders the faces of `side` pixels at a pose, in the order of [`CUBE_FACES`]; `None` where the pose cannot be used.
pub(super) fn faces(
    opened: &mut dyn OpenedModel,
    side: u32,
    (pose, normalization, time): (&Pose, &Similarity, f64),
) -> Result<Option<Vec<RgbImage>>, ReconstructError> {
    let Some(rotation) = pose.rotation() else {
        return Ok(None);
    };
    let mut faces = Vec::with_capacity(CUBE_FACES.len());
    for face in CUBE_FACES {
        let to_world = rotation * DQuat::from_mat3(&face.to_camera);
        let of_face = Pose::new(to_world, pose.centre());
        let camera = Camera::Pinhole(face_camera(side));
        let Some(view) = View::new(camera, &of_face, normalization, time) else {
            return Ok(None);
        };
        faces.push(opened.image(&view)?);
    }
    Ok(Some(faces))
}
