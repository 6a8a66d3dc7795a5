//! True distances of imported frames: from another tool's file to one of the scene.
//!
//! A scene gets f32 arrays of distances along the rays, which keep the float values of a file. Infinite distances, and
//! those of a data set's sky, are unknown.
#![cfg_attr(
    not(test),
    deny(clippy::indexing_slicing, clippy::arithmetic_side_effects)
)]

use std::path::{Path, PathBuf};

use image::{DynamicImage, Rgba};
use omnilife_schemas::{
    camera::Camera,
    distances::DistanceImage,
    image_file::ImageFile,
    layout::DEPTH_FOLDER,
    npy,
    records::{DepthImage, DistanceConvention},
    store::{self, StoreError},
};

use super::{ForeignFrame, ForeignScene, left_out};
use crate::error::CurateError;

/// True distances of a frame, in another tool's file of the frame's size.
#[derive(Debug, Clone)]
pub struct ForeignDistance {
    /// The file.
    pub file: PathBuf,
    /// The meaning of its bytes.
    pub encoding: DistanceEncoding,
    /// Distance that a value of 1 stands for, in units of the world frame.
    pub unit: f64,
    /// Line that a distance is measured along.
    pub convention: DistanceConvention,
    /// File values from which on they stand for the sky; infinite if none does.
    pub sky_from: f64,
}

/// The bytes of a file of distances.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DistanceEncoding {
    /// 16-bit grey PNG, or a `.npy` of f32 or f64 (rows, columns).
    Values,
    /// PNG whose blue, green, red and alpha bytes, in this order, are those of a little-endian f32: an array of
    /// f32 that `OpenCV` has written as one of four bytes a pixel.
    FloatInBgra,
}

/// Returns a line on frames without distances if others have them.
pub(super) fn missing(scene: &ForeignScene) -> Option<String> {
    let without = scene.frames.iter().filter(|frame| frame.distance.is_none());
    let names: Vec<String> = without
        .map(|frame| super::file_name(&frame.image.to_string_lossy()))
        .collect();
    if names.len() == scene.frames.len() {
        return None;
    }
    left_out::line(&names, "frames without distances")
}

/// Writes the distances of a frame along its rays into the folder of a scene. `name` is that of the frame's image
/// there.
///
/// # Errors
/// When the file is damaged, not of the frame's size, or has a negative or NaN value. Also when the frame's lens is
/// removed by resampling.
pub(super) fn import(
    scene: &ForeignScene,
    frame: &ForeignFrame,
    name: &str,
    out: &Path,
) -> Result<Option<DepthImage>, CurateError> {
    let Some(given) = &frame.distance else {
        return Ok(None);
    };
    if scene.camera.lens().is_some() {
        let reason = "has distances of a frame whose lens is taken out, which they have as well";
        return Err(CurateError::input(&given.file, reason));
    }
    let distances = along_rays(given, &scene.camera.camera())?;
    store::create_folder(&out.join(DEPTH_FOLDER))?;
    let file = format!("{DEPTH_FOLDER}/{}.npy", super::stem(name));
    let shape = [distances.height, distances.width];
    npy::write_f32(&out.join(&file), &shape, &distances.values)?;
    Ok(Some(DepthImage { file, unit: 1.0 }))
}

/// Returns distances along the rays of a camera, in units of the world frame; 0 if unknown.
fn along_rays(given: &ForeignDistance, camera: &Camera) -> Result<DistanceImage, StoreError> {
    let is_panorama = matches!(camera, Camera::Erp(_));
    let mut image = match given.encoding {
        DistanceEncoding::Values => {
            DistanceImage::read_if_any(&given.file, given.unit, is_panorama)?
        }
        DistanceEncoding::FloatInBgra => float_in_bgra(&given.file, given.unit, is_panorama)?,
    };
    let (size, expected) = ([image.width, image.height], camera.size());
    if size != expected {
        let ([width, height], [expected_width, expected_height]) = (size, expected);
        let reason = format!("is {width}x{height}, its image {expected_width}x{expected_height}");
        return Err(StoreError::malformed(&given.file, reason));
    }
    let sky_from = (given.sky_from * given.unit) as f32;
    for value in &mut image.values {
        if *value >= sky_from {
            *value = 0.0;
        }
    }
    Ok(image.along_rays(given.convention, camera))
}

/// Reads a PNG whose four bytes of a pixel are those of a float.
fn float_in_bgra(path: &Path, unit: f64, wraps: bool) -> Result<DistanceImage, StoreError> {
    let file = ImageFile::open(path)?;
    let [width, height] = file.size();
    let DynamicImage::ImageRgba8(image) = file.decode()? else {
        let reason = "must be a PNG of four bytes a pixel, those of its distance";
        return Err(StoreError::malformed(path, reason));
    };
    let mut values = Vec::with_capacity(image.len().div_ceil(4));
    for (column, row, &Rgba([red, green, blue, alpha])) in image.enumerate_pixels() {
        let value = f32::from_le_bytes([blue, green, red, alpha]);
        if value.is_nan() || value < 0.0 {
            let reason = format!("the distance at row {row}, column {column} is {value}");
            return Err(StoreError::malformed(path, reason));
        }
        let distance = (f64::from(value) * unit) as f32;
        values.push(if distance.is_normal() { distance } else { 0.0 });
    }
    Ok(DistanceImage {
        width,
        height,
        wraps,
        values,
    })
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a failed set-up step fails the test")]

    use omnilife_schemas::camera::{ErpCamera, PinholeCamera};

    use super::*;

    const PANORAMA: ErpCamera = ErpCamera {
        width: 4,
        height: 2,
    };

    fn given(file: PathBuf, encoding: DistanceEncoding) -> ForeignDistance {
        ForeignDistance {
            file,
            encoding,
            unit: 1.0,
            convention: DistanceConvention::Ray,
            sky_from: f64::INFINITY,
        }
    }

    #[test]
    fn steps_of_grey_and_arrays_become_distances() {
        let folder = tempfile::tempdir().unwrap();
        let png = folder.path().join("a.png");
        let grey: image::ImageBuffer<image::Luma<u16>, Vec<u16>> =
            image::ImageBuffer::from_raw(4, 2, vec![0, 1, 2, 3, 40_000, 50_000, 60_000, 65_535])
                .unwrap();
        grey.save(&png).unwrap();
        let millimetres = ForeignDistance {
            unit: 0.001,
            sky_from: 60_000.0,
            ..given(png, DistanceEncoding::Values)
        };
        let found = along_rays(&millimetres, &PANORAMA.into()).unwrap();
        // Distances from 60 m on are unknown.
        assert_eq!(
            found.values,
            [0.0, 0.001, 0.002, 0.003, 40.0, 50.0, 0.0, 0.0]
        );
        let array = folder.path().join("a.npy");
        let values = [0.0, f32::INFINITY, 0.1, 1e9, 3.5, 1e10, 2.0, 1.0];
        npy::write_f32(&array, &[2, 4], &values).unwrap();
        let with_sky = ForeignDistance {
            sky_from: 1e10,
            ..given(array, DistanceEncoding::Values)
        };
        let found = along_rays(&with_sky, &PANORAMA.into()).unwrap();
        assert_eq!(found.values, [0.0, 0.0, 0.1, 1e9, 3.5, 0.0, 2.0, 1.0]);
    }

    /// A wall at z = 2 is further away at the edge of the image.
    #[test]
    fn distances_along_the_axis_become_those_along_the_ray() {
        let folder = tempfile::tempdir().unwrap();
        let array = folder.path().join("z.npy");
        npy::write_f32(&array, &[1, 3], &[2.0; 3]).unwrap();
        let camera = PinholeCamera {
            width: 3,
            height: 1,
            fx: 1.0,
            fy: 1.0,
            cx: 1.5,
            cy: 0.5,
        };
        let wall = ForeignDistance {
            convention: DistanceConvention::Z,
            ..given(array, DistanceEncoding::Values)
        };
        let found = along_rays(&wall, &camera.into()).unwrap().values;
        let expected = [8.0_f32.sqrt(), 2.0, 8.0_f32.sqrt()];
        for (found, expected) in found.iter().zip(expected) {
            assert!(
                (found - expected).abs() < 1e-6,
                "{found}, expected {expected}"
            );
        }
    }

    #[test]
    fn floats_in_pixels_come_back_to_the_bit_and_no_others_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let values = [
            0.1_f32,
            1.0 / 3.0,
            7.25e-3,
            9876.543,
            0.0,
            f32::INFINITY,
            2.0,
            5e4,
        ];
        let write = |name: &str, values: &[f32]| {
            let bytes = values.iter().flat_map(|value| {
                let [blue, green, red, alpha] = value.to_le_bytes();
                [red, green, blue, alpha]
            });
            let path = folder.path().join(name);
            image::RgbaImage::from_raw(4, 2, bytes.collect())
                .unwrap()
                .save(&path)
                .unwrap();
            given(path, DistanceEncoding::FloatInBgra)
        };
        let found = along_rays(&write("good.png", &values), &PANORAMA.into()).unwrap();
        let mut expected = values;
        expected[5] = 0.0;
        assert_eq!(found.values, expected);
        for (name, bad) in [("nan.png", f32::NAN), ("negative.png", -1.0)] {
            let mut changed = values;
            changed[6] = bad;
            let error = along_rays(&write(name, &changed), &PANORAMA.into()).unwrap_err();
            assert!(error.to_string().contains("row 1, column 2"), "{error}");
        }
        let rgb = folder.path().join("rgb.png");
        image::RgbImage::new(4, 2).save(&rgb).unwrap();
        assert!(along_rays(&given(rgb, DistanceEncoding::FloatInBgra), &PANORAMA.into()).is_err());
        let larger = ErpCamera {
            width: 8,
            height: 4,
        };
        assert!(along_rays(&write("small.png", &values), &larger.into()).is_err());
    }
}
