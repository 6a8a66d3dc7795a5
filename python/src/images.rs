//! Files of a scene, read as scoring reads its ground truth.

use std::path::{Path, PathBuf};

use omnilife_schemas::{
    RgbImage,
    distances::DistanceImage,
    image_file::{ImageFile, MOST_PIXELS},
    points::PointCloud,
    rgb::{self, Mask},
};
use pyo3::{prelude::*, types::PyByteArray};

use crate::{background, errors::Failure};

/// Largest number of pixels of an image.
pub(crate) const SIZE_LIMIT: usize = MOST_PIXELS as usize;

/// Bytes of an image with its width and height.
type Image<'py> = (Bound<'py, PyByteArray>, [usize; 2]);
/// Positions (n, 3) f32 and colours (n, 3) u8.
type Points<'py> = (Bound<'py, PyByteArray>, Bound<'py, PyByteArray>);

/// Reads an image as (height, width, 3) u8. It must have the size `expected`; it is resized to `size` by area
/// averaging and rounded to 8 bits, as the ground truth of scores is. Sizes are (width, height).
#[pyfunction]
#[pyo3(signature = (path, expected=None, size=None))]
pub(crate) fn read_image(
    py: Python<'_>,
    path: PathBuf,
    expected: Option<[usize; 2]>,
    size: Option<[usize; 2]>,
) -> PyResult<Image<'_>> {
    let size = checked(size)?;
    let (bytes, size) = background::run(py, move |_| {
        let image = RgbImage::decode(open(&path, expected)?)?;
        let [width, height] = size.unwrap_or([image.width, image.height]);
        Ok((
            image.resized_by_area(width, height).to_rgb8(),
            [width, height],
        ))
    })?;
    Ok((PyByteArray::new(py, &bytes), size))
}

/// Reads a mask as (height, width) u8, 0 or 255. It is resized to the nearest pixels; with `touched` a pixel is
/// marked where any old one that it partly covers is marked. Sizes as in `read_image`.
#[pyfunction]
#[pyo3(signature = (path, expected=None, size=None, touched=false))]
pub(crate) fn read_mask(
    py: Python<'_>,
    path: PathBuf,
    expected: Option<[usize; 2]>,
    size: Option<[usize; 2]>,
    touched: bool,
) -> PyResult<Image<'_>> {
    let size = checked(size)?;
    let (bytes, size) = background::run(py, move |_| {
        let mask = Mask::decode(open(&path, expected)?)?;
        let [width, height] = size.unwrap_or([mask.width, mask.height]);
        let resized = if touched {
            mask.resized_to_any(width, height)
        } else {
            mask.resized_to_nearest(width, height)
        };
        Ok((resized.data, [width, height]))
    })?;
    Ok((PyByteArray::new(py, &bytes), size))
}

/// Reads distances (height, width) f32 from a 16-bit grey PNG or `.npy`, in which a step of 1 means `unit`; 0 where
/// the distance is not known. Resized to the nearest pixels, as the truth of scores is.
#[pyfunction]
#[pyo3(signature = (path, unit, size=None))]
pub(crate) fn read_distances(
    py: Python<'_>,
    path: PathBuf,
    unit: f64,
    size: Option<[usize; 2]>,
) -> PyResult<Image<'_>> {
    let size = checked(size)?;
    let (bytes, size) = background::run(py, move |_| {
        let image = DistanceImage::read(&path, unit, false)?;
        let old = [image.width, image.height];
        let size = size.unwrap_or(old);
        let values = rgb::nearest_pixels(old, size).map(|index| image.values[index]);
        Ok((values.flat_map(f32::to_ne_bytes).collect::<Vec<u8>>(), size))
    })?;
    Ok((PyByteArray::new(py, &bytes), size))
}

/// Reads the points of a PLY file: positions (n, 3) f64 in world units, colours (n, 3) u8.
#[pyfunction]
pub(crate) fn read_points(py: Python<'_>, path: PathBuf) -> PyResult<Points<'_>> {
    let points = background::run(py, move |_| Ok(PointCloud::read_ply(&path)?))?;
    let positions = points.positions.as_flattened();
    let positions: Vec<u8> = positions.iter().flat_map(|v| v.to_ne_bytes()).collect();
    let colours = points.colours.as_flattened();
    Ok((
        PyByteArray::new(py, &positions),
        PyByteArray::new(py, colours),
    ))
}

fn open(path: &Path, expected: Option<[usize; 2]>) -> Result<ImageFile<'_>, Failure> {
    let file = ImageFile::open(path)?;
    Ok(match expected {
        Some(size) => file.expect_size(size)?,
        None => file,
    })
}

fn checked(size: Option<[usize; 2]>) -> Result<Option<[usize; 2]>, Failure> {
    let is_possible = |&[width, height]: &[usize; 2]| {
        let pixels = width.checked_mul(height);
        pixels.is_some_and(|pixels| (1..=SIZE_LIMIT).contains(&pixels))
    };
    match size {
        Some([width, height]) if !is_possible(&[width, height]) => Err(Failure::of_input(format!(
            "images of {width}x{height} pixels, expected 1 to {SIZE_LIMIT} of them"
        ))),
        size => Ok(size),
    }
}
