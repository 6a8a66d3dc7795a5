//! COLMAP's binary model: `cameras.bin`, `images.bin`, `points3D.bin`, little endian
//! (<https://colmap.github.io/format.html#binary-file-format>).
//!
//! ```text
//! cameras.bin    u64 count, then u32 id, i32 model, u64 width, u64 height, f64 parameters
//! images.bin     u64 count, then u32 id, f64 qw qx qy qz tx ty tz, u32 camera, name, 0,
//!                u64 features, then f64 x y, u64 point (all bits set: none)
//! points3D.bin   u64 count, then u64 id, f64 x y z, u8 r g b, f64 error,
//!                u64 track, then u32 image, u32 feature
//! ```
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::{
    collections::BTreeMap,
    fs,
    io::Write,
    path::{Path, PathBuf},
};

use glam::{DVec2, DVec3};
use omnilife_schemas::{
    Pose,
    camera::{Camera, ErpCamera},
    points::PointCloud,
    store::{self, StoreError},
};

use super::{
    colmap::{
        ColmapPoint, ImagesByCamera, ModelCamera, ModelParts, image_of, impossible_parameters,
        point_of, unknown_model,
    },
    lens::LensModel,
};

/// Names of the files.
pub(crate) const FILES: [&str; 3] = ["cameras.bin", "images.bin", "points3D.bin"];

/// COLMAP's numbers of the written camera models (`CameraModelId`).
const PINHOLE: i32 = 1;
const EQUIRECTANGULAR: i32 = 17;

pub(super) fn read([cameras, images, points]: &[PathBuf; 3]) -> Result<ModelParts, StoreError> {
    Ok(ModelParts {
        cameras: read_file(cameras, read_cameras)?,
        images: read_file(images, read_images)?,
        points: read_file(points, read_points)?,
    })
}

/// Returns the number of images stated in a model's file.
pub(super) fn image_count(images: &Path) -> Result<usize, StoreError> {
    let bytes = fs::read(images).map_err(|error| StoreError::read(images, error))?;
    let count = Bytes { rest: &bytes }.u64();
    count
        .map(|count| usize::try_from(count).unwrap_or(usize::MAX))
        .map_err(|reason| StoreError::malformed(images, reason))
}

/// Writes a camera, posed images and points without tracks.
///
/// # Errors
/// When a file cannot be written.
pub(crate) fn write(
    folder: &Path,
    camera: &Camera,
    images: &[(&str, Pose)],
    points: &PointCloud,
) -> Result<(), StoreError> {
    let [cameras_file, images_file, points_file] = FILES.map(|name| folder.join(name));
    store::write_with(&cameras_file, |writer| {
        writer.write_all(&1_u64.to_le_bytes())?;
        writer.write_all(&1_u32.to_le_bytes())?;
        let (width, height) = (u64::from(camera.width()), u64::from(camera.height()));
        let (model, parameters) = match camera {
            Camera::Erp(_) => (EQUIRECTANGULAR, vec![width as f64, height as f64]),
            Camera::Pinhole(pinhole) => (
                PINHOLE,
                vec![pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy],
            ),
        };
        writer.write_all(&model.to_le_bytes())?;
        writer.write_all(&width.to_le_bytes())?;
        writer.write_all(&height.to_le_bytes())?;
        numbers(writer, &parameters)
    })?;
    store::write_with(&images_file, |writer| {
        writer.write_all(&(images.len() as u64).to_le_bytes())?;
        for (id, (name, pose)) in (1_u32..).zip(images) {
            // Valid poses have a rotation: frames were selected by that.
            let q = pose.rotation().unwrap_or_default().inverse();
            let t = -(q * pose.centre());
            writer.write_all(&id.to_le_bytes())?;
            numbers(writer, &[q.w, q.x, q.y, q.z, t.x, t.y, t.z])?;
            writer.write_all(&1_u32.to_le_bytes())?;
            writer.write_all(name.as_bytes())?;
            writer.write_all(&[0])?;
            writer.write_all(&0_u64.to_le_bytes())?;
        }
        Ok(())
    })?;
    store::write_with(&points_file, |writer| {
        writer.write_all(&(points.len() as u64).to_le_bytes())?;
        let points = points.positions.iter().zip(&points.colours);
        for (id, (position, colour)) in (1_u64..).zip(points) {
            writer.write_all(&id.to_le_bytes())?;
            numbers(writer, position)?;
            writer.write_all(colour)?;
            // An error of 0 and no track: nothing is known about observations.
            numbers(writer, &[0.0])?;
            writer.write_all(&0_u64.to_le_bytes())?;
        }
        Ok(())
    })
}

fn numbers(writer: &mut dyn Write, values: &[f64]) -> std::io::Result<()> {
    values
        .iter()
        .try_for_each(|value| writer.write_all(&value.to_le_bytes()))
}

/// Unread rest of a file.
pub(super) struct Bytes<'a> {
    rest: &'a [u8],
}

impl<'a> Bytes<'a> {
    pub(super) fn take<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let (head, rest) = (self.rest.split_first_chunk::<N>()).ok_or("ends too early")?;
        self.rest = rest;
        Ok(*head)
    }

    pub(super) fn u32(&mut self) -> Result<u32, String> {
        self.take().map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self) -> Result<u64, String> {
        self.take().map(u64::from_le_bytes)
    }

    pub(super) fn numbers<const N: usize>(&mut self) -> Result<[f64; N], String> {
        let mut numbers = [0.0; N];
        for number in &mut numbers {
            *number = f64::from_le_bytes(self.take()?);
            if !number.is_finite() {
                return Err("holds a number that is not finite".to_owned());
            }
        }
        Ok(numbers)
    }

    /// Reads up to the next zero.
    fn name(&mut self) -> Result<String, String> {
        let mut parts = self.rest.splitn(2, |&byte| byte == 0);
        let (Some(name), Some(rest)) = (parts.next(), parts.next()) else {
            return Err("ends too early".to_owned());
        };
        self.rest = rest;
        let name = std::str::from_utf8(name).map_err(|_| "an image name is not UTF-8")?;
        Ok(name.to_owned())
    }
}

pub(super) fn read_file<T>(
    path: &Path,
    read: impl FnOnce(&mut Bytes<'_>) -> Result<T, String>,
) -> Result<T, StoreError> {
    let bytes = fs::read(path).map_err(|error| StoreError::read(path, error))?;
    let mut bytes = Bytes { rest: &bytes };
    let value = read(&mut bytes).map_err(|reason| StoreError::malformed(path, reason))?;
    match bytes.rest.len() {
        0 => Ok(value),
        left => Err(StoreError::malformed(
            path,
            format!("has {left} bytes more than it says"),
        )),
    }
}

fn read_cameras(
    bytes: &mut Bytes<'_>,
) -> Result<BTreeMap<u32, Result<ModelCamera, String>>, String> {
    let mut cameras = BTreeMap::new();
    for _ in 0..bytes.u64()? {
        let id = bytes.u32()?;
        let camera = read_camera(bytes, id)?.map_err(|reason| format!("camera {id}: {reason}"));
        if cameras.insert(id, camera).is_some() {
            return Err(format!("a second camera has the id {id}"));
        }
    }
    Ok(cameras)
}

/// Reads a camera, or the reason why it cannot be used if an image refers to it.
fn read_camera(bytes: &mut Bytes<'_>, id: u32) -> Result<Result<ModelCamera, String>, String> {
    let number = i32::from_le_bytes(bytes.take()?);
    let mut side = || -> Result<u32, String> {
        let pixels = u32::try_from(bytes.u64()?)
            .ok()
            .filter(|&pixels| pixels > 0);
        pixels.ok_or_else(|| format!("camera {id} has no size"))
    };
    let (width, height) = (side()?, side()?);
    if number == EQUIRECTANGULAR {
        let parameters = bytes.numbers::<2>()?;
        let is_whole = parameters == [width, height].map(f64::from);
        return Ok(if is_whole {
            Ok(ModelCamera::Erp(ErpCamera { width, height }))
        } else {
            Err(format!(
                "its parameters are not those of a whole sphere of {width}x{height}"
            ))
        });
    }
    let model = LensModel::of_number(number)
        .ok_or_else(|| format!("camera {id}: {}", unknown_model(&number.to_string())))?;
    let parameters: Vec<f64> = (0..model.parameters)
        .map(|_| bytes.numbers::<1>().map(|[value]| value))
        .collect::<Result<_, _>>()?;
    Ok(model
        .lens([width, height], &parameters)
        .map(ModelCamera::Perspective)
        .ok_or_else(|| impossible_parameters(model.name)))
}

fn read_images(bytes: &mut Bytes<'_>) -> Result<ImagesByCamera, String> {
    let mut images = BTreeMap::new();
    for _ in 0..bytes.u64()? {
        let id = bytes.u32()?;
        let pose = bytes.numbers()?;
        let camera = bytes.u32()?;
        let name = bytes.name()?;
        let mut observations = Vec::new();
        for _ in 0..bytes.u64()? {
            let [x, y] = bytes.numbers()?;
            match bytes.u64()? {
                u64::MAX => {}
                point => observations.push((DVec2::new(x, y), point)),
            }
        }
        let image =
            image_of(pose, name, observations).map_err(|what| format!("image {id}: {what}"))?;
        if images.insert(id, (camera, image)).is_some() {
            return Err(format!("a second image has the id {id}"));
        }
    }
    Ok(images)
}

fn read_points(bytes: &mut Bytes<'_>) -> Result<BTreeMap<u64, ColmapPoint>, String> {
    let mut points = BTreeMap::new();
    for _ in 0..bytes.u64()? {
        let id = bytes.u64()?;
        let position = DVec3::from_array(bytes.numbers()?);
        let colour = bytes.take::<3>()?;
        let _error = bytes.take::<8>()?;
        let mut track = Vec::new();
        for _ in 0..bytes.u64()? {
            track.push(bytes.u32()?);
            let _feature = bytes.u32()?;
        }
        let point =
            point_of(position, colour, track).map_err(|what| format!("point {id}: {what}"))?;
        if points.insert(id, point).is_some() {
            return Err(format!("a second point has the id {id}"));
        }
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::poses::{colmap::ColmapModel, frame_camera::FrameCamera};

    #[test]
    fn a_file_that_is_cut_off_or_too_long_is_refused() -> Result<(), StoreError> {
        let folder =
            tempfile::tempdir().map_err(|error| StoreError::read(Path::new("."), error))?;
        let pose = Pose::new(DQuat::from_rotation_y(0.3), DVec3::new(1.0, 2.0, 3.0));
        let camera = ErpCamera::new(64, 32);
        let points = PointCloud::of_colour(vec![[1.0, 2.0, 3.0]], [4, 5, 6]);
        write(folder.path(), &camera.into(), &[("a.png", pose)], &points)?;
        let model = ColmapModel::read(folder.path())?;
        assert_eq!(model.camera, FrameCamera::Straight(camera.into()));
        assert_eq!(model.images[&1].name, "a.png");
        assert!((model.images[&1].centre - pose.centre()).length() < 1e-12);
        assert_eq!(model.points[&1].colour, [4, 5, 6]);
        for name in FILES {
            let path = folder.path().join(name);
            let whole = fs::read(&path).map_err(|error| StoreError::read(&path, error))?;
            for changed in [&whole[..whole.len() - 1], &[&whole[..], &[0]].concat()[..]] {
                store::write_bytes(&path, changed)?;
                let error = ColmapModel::read(folder.path())
                    .map(drop)
                    .map_err(|error| error.to_string());
                assert!(error.is_err_and(|line| line.contains(name)), "{name}");
            }
            store::write_bytes(&path, &whole)?;
        }
        Ok(())
    }
}
