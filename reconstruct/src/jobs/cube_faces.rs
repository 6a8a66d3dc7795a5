//! The six faces of a cube, each rendered by the pinhole camera, and panoramas from them. They show the Gaussians of a
//! perspective trainer as that trainer renders them.

use glam::{DQuat, DVec3, dvec2};
use omnilife_engine::camera::{Camera, View};
use omnilife_schemas::{
    Pose, RgbImage, Similarity,
    camera::{
        CameraModel, ErpCamera,
        cube::{CUBE_FACES, face_camera},
    },
    interpolation::Edges,
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
    Ok(faces.map(|faces| stitched(&faces, camera)))
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

/// Samples every pixel from the face that its direction meets, bilinear within the face.
fn stitched(faces: &[RgbImage], camera: ErpCamera) -> RgbImage {
    let (width, height) = (camera.width as usize, camera.height as usize);
    let mut panorama = RgbImage::black(width, height);
    for (pixel, out) in panorama.data.as_chunks_mut::<3>().0.iter_mut().enumerate() {
        let centre = dvec2((pixel % width) as f64, (pixel / width) as f64) + 0.5;
        let direction = camera.unproject(centre);
        // The face whose axis is nearest to the direction.
        let ahead = |index: &usize| direction.dot(CUBE_FACES[*index].to_camera * DVec3::Z);
        let nearest = (0..faces.len()).max_by(|a, b| ahead(a).total_cmp(&ahead(b)));
        let Some(index) = nearest else { continue };
        let face = &faces[index];
        let within = CUBE_FACES[index].to_camera.transpose() * direction;
        if let Some(place) = face_camera(face.width as u32).project(within) {
            *out = face.sample(place, Edges::Repeated);
        }
    }
    panorama
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panorama_of_faces_shows_every_direction_where_it_is() {
        let side = 96;
        let camera = ErpCamera {
            width: 120,
            height: 60,
        };
        let colour = |direction: DVec3| 0.5 * (direction + 1.0);
        let faces = CUBE_FACES.map(|face| {
            let mut image = RgbImage::black(side, side);
            for (pixel, out) in image.data.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                let centre = dvec2((pixel % side) as f64, (pixel / side) as f64) + 0.5;
                let direction = face_camera(side as u32).unproject(centre);
                *out = colour(face.to_camera * direction).as_vec3().to_array();
            }
            image
        });
        let panorama = stitched(&faces, camera);
        for (pixel, found) in panorama.data.as_chunks::<3>().0.iter().enumerate() {
            let centre = dvec2((pixel % 120) as f64, (pixel / 120) as f64) + 0.5;
            let error =
                DVec3::from_array(found.map(f64::from)).distance(colour(camera.unproject(centre)));
            // The outermost half pixel of a face repeats its edge.
            assert!(error < 0.01, "{pixel}: {error}");
        }
    }
}
