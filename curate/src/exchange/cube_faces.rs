//! A panoramic scene as a perspective one: every frame becomes the six faces of a cube, for trainers without an
//! equirectangular camera.
//!
//! ```text
//! images/front/000000.png ... images/down/000000.png     one folder per face, one name per frame
//! rig_config.json         the faces as a rig of COLMAP (colmap rig_configurator), front first
//! ```
//!
//! A face pixel is a mean of bilinear samples: per side, as many as the panorama has pixels there in the middle of the
//! face. A mask pixel is that of the mask at its centre.

use std::{
    f64::consts::{PI, TAU},
    path::{Path, PathBuf},
};

use glam::{DMat3, DQuat, DVec2, DVec3, dvec2};
use omnilife_schemas::{
    Pose, RgbImage,
    camera::{
        Camera, CameraModel, ErpCamera,
        cube::{CUBE_FACES, CubeFace, face_camera, side_of_equal_resolution},
    },
    interpolation::Edges,
    points::PointCloud,
    rgb::Mask,
    store,
};
use rayon::prelude::*;
use serde::Serialize;

use super::{ExportFrame, ExportScene};
use crate::error::CurateError;

/// Faces and sky of an export.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CubeFaces {
    /// Width and height of a face in pixels.
    pub side: u32,
    /// Points on a far sphere around the cameras, with the colours seen there. Content without points of its own, above
    /// all the sky, has none from structure from motion either.
    pub sky_points: usize,
}

/// Faces are at most this wide.
const LARGEST_SIDE: u32 = 1 << 13;
/// At most this many points of sky.
const MOST_SKY_POINTS: usize = 1 << 20;
/// Samples along a side of a face pixel, at most.
const MOST_SAMPLES: u32 = 8;
/// Radius of the sky, over the distance of the farthest tenth of the points or of the cameras.
const SKY_RADIUS: f64 = 3.0;

/// Draws the faces of every frame into `scratch`, and returns their scene.
///
/// # Errors
/// For a perspective scene, an invalid size, and images that cannot be read or written.
pub(super) fn as_faces(
    scene: &ExportScene,
    faces: CubeFaces,
    scratch: &Path,
) -> Result<ExportScene, CurateError> {
    let Camera::Erp(camera) = scene.camera else {
        return Err(CurateError::input(
            scratch,
            "is to have cube faces of a scene that is perspective already",
        ));
    };
    if !(8..=LARGEST_SIDE).contains(&faces.side) || faces.sky_points > MOST_SKY_POINTS {
        return Err(CurateError::input(
            scratch,
            format!(
                "is to have faces of {} pixels and {} sky points; faces have 8 to {LARGEST_SIDE} \
                 pixels, and there are at most {MOST_SKY_POINTS} sky points",
                faces.side, faces.sky_points
            ),
        ));
    }
    for face in CUBE_FACES {
        store::create_folder(&scratch.join(face.name))?;
    }
    let frames: Result<Vec<Vec<Option<ExportFrame>>>, CurateError> = scene
        .frames
        .par_iter()
        .map(|frame| faces_of(frame, camera, faces.side, scratch))
        .collect();
    let mut points = scene.points.clone();
    add_sky(scene, camera, faces.sky_points, &mut points)?;
    Ok(ExportScene {
        camera: face_camera(faces.side).into(),
        panorama: None,
        frames: frames?.into_iter().flatten().flatten().collect(),
        points,
        has_split: scene.has_split,
        is_rig: true,
        scale: scene.scale,
        source: None,
    })
}

/// Returns the six faces; `None` for those of training frames that show nothing of the scene. Test frames have all
/// six, because methods number the views that they render.
fn faces_of(
    frame: &ExportFrame,
    camera: ErpCamera,
    side: u32,
    scratch: &Path,
) -> Result<Vec<Option<ExportFrame>>, CurateError> {
    let panorama = RgbImage::read(&frame.image)?;
    let mask = frame.mask.as_deref().map(Mask::read).transpose()?;
    let ignored = frame.ignore_mask.as_deref().map(Mask::read).transpose()?;
    // At the resolution of a face, so that thin masks are not lost between its pixels.
    let ignored = ignored.map(|mask| mask.resized_to_any(4 * side as usize, 2 * side as usize));
    let stem = super::stem(&frame.name);
    // Valid poses have a rotation: frames were selected by that.
    let rotation = frame.pose.rotation().unwrap_or_default();
    CUBE_FACES
        .iter()
        .map(|face| {
            let of_face = |mask: &Mask| face_mask(mask, camera, face, side);
            let [mask, ignored] = [&mask, &ignored].map(|mask| mask.as_ref().map(of_face));
            if frame.is_input && ignored.as_ref().is_some_and(Mask::is_full) {
                return Ok(None);
            }
            let write = |mask: Option<Mask>, kind: &str| -> Result<Option<PathBuf>, CurateError> {
                let Some(mask) = mask else {
                    return Ok(None);
                };
                let file = scratch.join(face.name).join(format!("{stem}.{kind}.png"));
                mask.write_png(&file)?;
                Ok(Some(file))
            };
            let name = format!("{}/{stem}.png", face.name);
            let image = scratch.join(&name);
            face_image(&panorama, face, side).write_png(&image)?;
            Ok(Some(ExportFrame {
                name,
                image,
                mask: write(mask, "mask")?,
                ignore_mask: write(ignored, "ignore")?,
                pose: Pose::new(
                    rotation * DQuat::from_mat3(&face.to_camera),
                    frame.pose.centre(),
                ),
                ..frame.clone()
            }))
        })
        .collect()
}

/// Returns the perspective view of a face, `side` pixels square; every pixel is a mean over its area.
pub(crate) fn face_image(panorama: &RgbImage, face: &CubeFace, side: u32) -> RgbImage {
    let camera = ErpCamera {
        width: panorama.width as u32,
        height: panorama.height as u32,
    };
    let of_face = face_camera(side);
    let samples = side_of_equal_resolution(camera.width)
        .div_ceil(side)
        .clamp(1, MOST_SAMPLES);
    let share = 1.0 / (samples * samples) as f32;
    let mut image = RgbImage::black(side as usize, side as usize);
    for (pixel, out) in image.data.as_chunks_mut::<3>().0.iter_mut().enumerate() {
        let corner = corner(pixel, side);
        for sample in 0..samples * samples {
            let within = dvec2(f64::from(sample % samples), f64::from(sample / samples)) + 0.5;
            let direction = of_face.unproject(corner + within / f64::from(samples));
            let Some(place) = camera.project(face.to_camera * direction) else {
                continue;
            };
            let colour = panorama.sample(place, Edges::Around);
            for (sum, value) in out.iter_mut().zip(colour) {
                *sum += share * value;
            }
        }
    }
    image
}

fn face_mask(mask: &Mask, camera: ErpCamera, face: &CubeFace, side: u32) -> Mask {
    let of_face = face_camera(side);
    let data = (0..(side * side) as usize)
        .map(|pixel| {
            let direction = of_face.unproject(corner(pixel, side) + 0.5);
            let place = camera.project(face.to_camera * direction);
            place.map_or(0, |place| {
                // Masks may be of another size than their images.
                let share = place / dvec2(f64::from(camera.width), f64::from(camera.height));
                let at = |share: f64, len: usize| ((share * len as f64) as usize).min(len - 1);
                mask.data[at(share.y, mask.height) * mask.width + at(share.x, mask.width)]
            })
        })
        .collect();
    Mask {
        width: side as usize,
        height: side as usize,
        data,
    }
}

/// Returns the upper left corner of a pixel.
fn corner(pixel: usize, side: u32) -> DVec2 {
    let pixel = pixel as u32;
    dvec2(f64::from(pixel % side), f64::from(pixel / side))
}

/// Adds a shell of points beyond the farthest points of the scene, in the colours of the first training frame; none
/// where that shows nothing of the scene.
fn add_sky(
    scene: &ExportScene,
    camera: ErpCamera,
    count: usize,
    points: &mut PointCloud,
) -> Result<(), CurateError> {
    let Some(frame) = scene.frames.iter().find(|frame| frame.is_input) else {
        return Ok(());
    };
    if count == 0 {
        return Ok(());
    }
    let panorama = RgbImage::read(&frame.image)?;
    let ignored = frame.ignore_mask.as_deref().map(Mask::read).transpose()?;
    let size = [camera.width, camera.height].map(|side| side as usize);
    let ignored = ignored.map(|mask| mask.resized_to_any(size[0], size[1]));
    let shows_scene = |place: DVec2| {
        let [column, row] = [(place.x, size[0]), (place.y, size[1])]
            .map(|(at, length)| (at.max(0.0) as usize).min(length - 1));
        (ignored.as_ref()).is_none_or(|mask| mask.data[row * size[0] + column] == 0)
    };
    let centres: Vec<DVec3> = scene
        .frames
        .iter()
        .map(|frame| frame.pose.centre())
        .collect();
    let middle = centres.iter().sum::<DVec3>() / centres.len() as f64;
    let of_points = points.positions.iter().copied().map(DVec3::from_array);
    let mut distances: Vec<f64> = centres
        .iter()
        .copied()
        .chain(of_points)
        .map(|place| place.distance(middle))
        .collect();
    distances.sort_by(f64::total_cmp);
    let far = distances[distances.len() * 9 / 10];
    let radius = SKY_RADIUS * if far > 0.0 { far } else { 1.0 };
    let to_camera = DMat3::from_quat(frame.pose.rotation().unwrap_or_default()).transpose();
    for index in 0..count {
        let direction = on_sphere(index, count);
        let place = camera.project(to_camera * direction).unwrap_or_default();
        if !shows_scene(place) {
            continue;
        }
        let colour = panorama.sample(place, Edges::Around);
        points
            .positions
            .push((middle + radius * direction).to_array());
        points
            .colours
            .push(colour.map(|value| (value.clamp(0.0, 1.0) * 255.0).round() as u8));
    }
    Ok(())
}

/// Directions spread evenly by the golden angle.
fn on_sphere(index: usize, count: usize) -> DVec3 {
    let height = 1.0 - (2 * index + 1) as f64 / count as f64;
    let longitude = index as f64 * PI * (3.0 - 5.0_f64.sqrt()) % TAU;
    let across = (1.0 - height * height).sqrt();
    DVec3::new(across * longitude.cos(), height, across * longitude.sin())
}

/// A rig as COLMAP's `rig_configurator` reads it.
#[derive(Serialize)]
struct RigConfig {
    cameras: Vec<RigCamera>,
}

#[derive(Serialize)]
struct RigCamera {
    image_prefix: String,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    ref_sensor: bool,
    /// Quaternion (w, x, y, z) from the rig to the camera.
    #[serde(skip_serializing_if = "Option::is_none")]
    cam_from_rig_rotation: Option<[f64; 4]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cam_from_rig_translation: Option<[f64; 3]>,
}

/// Writes `rig_config.json`.
pub(super) fn write_rig(out: &Path) -> Result<PathBuf, CurateError> {
    let cameras = CUBE_FACES.iter().enumerate().map(|(index, face)| {
        let q = DQuat::from_mat3(&face.to_camera).inverse();
        RigCamera {
            image_prefix: format!("{}/", face.name),
            ref_sensor: index == 0,
            cam_from_rig_rotation: (index > 0).then_some([q.w, q.x, q.y, q.z]),
            cam_from_rig_translation: (index > 0).then_some([0.0; 3]),
        }
    });
    let rig = RigConfig {
        cameras: cameras.collect(),
    };
    let path = out.join("rig_config.json");
    super::write_json(&path, &[rig])?;
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a panorama whose pixels have their direction as colour.
    fn panorama(width: u32) -> RgbImage {
        let camera = ErpCamera {
            width,
            height: width / 2,
        };
        let mut image = RgbImage::black(width as usize, width as usize / 2);
        for (pixel, out) in image.data.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let pixel = pixel as u32;
            let centre = dvec2(f64::from(pixel % width), f64::from(pixel / width)) + 0.5;
            *out = (0.5 * (camera.unproject(centre) + 1.0))
                .as_vec3()
                .to_array();
        }
        image
    }

    #[test]
    fn faces_show_their_directions_at_any_resolution() {
        let panorama = panorama(256);
        for side in [16, 82, 200] {
            for face in &CUBE_FACES {
                let image = face_image(&panorama, face, side);
                for (pixel, colour) in image.data.as_chunks::<3>().0.iter().enumerate() {
                    let direction = face_camera(side).unproject(corner(pixel, side) + 0.5);
                    let expected = 0.5 * (face.to_camera * direction + 1.0);
                    let found = DVec3::from_array(colour.map(f64::from));
                    assert!(found.distance(expected) < 0.02, "{} {pixel}", face.name);
                }
            }
        }
    }

    #[test]
    fn sky_is_spread_over_the_sphere() {
        let sum: DVec3 = (0..1000).map(|index| on_sphere(index, 1000)).sum();
        assert!(sum.length() < 5.0, "{sum}");
        assert!((on_sphere(17, 1000).length() - 1.0).abs() < 1e-12);
    }
}
