//! Rays and projections, by the reference camera models of the project.

use glam::{DMat3, DVec2, DVec3};
use omnilife_schemas::{
    Pose,
    camera::{Camera, CameraModel},
};
use pyo3::{prelude::*, types::PyByteArray};
use rayon::prelude::*;

use crate::{
    background,
    errors::Failure,
    images::SIZE_LIMIT,
    records::{from_text, text},
};

/// Returns the unit directions through the centres of all pixels, (height, width, 3) f64, on the axes of the camera.
/// With the rotation from the camera to the world (rows), they are on the axes of the world.
#[pyfunction]
#[pyo3(signature = (camera, rotation=None))]
pub(crate) fn rays<'py>(
    py: Python<'py>,
    camera: &str,
    rotation: Option<[[f64; 3]; 3]>,
) -> PyResult<Bound<'py, PyByteArray>> {
    let camera: Camera = from_text(camera)?;
    let [width, height] = camera.size();
    if width
        .checked_mul(height)
        .is_none_or(|pixels| pixels > SIZE_LIMIT)
    {
        let message = format!("a camera of {width}x{height} pixels has more than {SIZE_LIMIT}");
        return Err(Failure::of_input(message).into());
    }
    let turn = rotation.map_or(DMat3::IDENTITY, |rows| {
        DMat3::from_cols_array_2d(&rows).transpose()
    });
    let directions = background::run(py, move |_| {
        let mut directions = vec![0_u8; 24 * width * height];
        let rows = directions.par_chunks_exact_mut((24 * width).max(1));
        rows.enumerate().for_each(|(row, directions)| {
            for (column, direction) in directions.chunks_exact_mut(24).enumerate() {
                let pixel = DVec2::new(column as f64 + 0.5, row as f64 + 0.5);
                let ray = camera.unproject(pixel);
                let ray = if rotation.is_some() { turn * ray } else { ray };
                write(&ray.to_array(), direction);
            }
        });
        Ok(directions)
    })?;
    Ok(PyByteArray::new(py, &directions))
}

/// Returns the image coordinates in pixels, (n, 2) f64, of points (n, 3) f64 on the axes of the camera; NaN where the
/// camera does not see the point.
#[pyfunction]
pub(crate) fn project<'py>(
    py: Python<'py>,
    camera: &str,
    points: &[u8],
) -> PyResult<Bound<'py, PyByteArray>> {
    let camera: Camera = from_text(camera)?;
    let pixels = map(points, |point: [f64; 3]| {
        let pixel = camera.project(DVec3::from_array(point));
        pixel.unwrap_or(DVec2::NAN).to_array()
    });
    Ok(PyByteArray::new(py, &pixels))
}

/// Returns the unit directions on the axes of the camera, (n, 3) f64, of image coordinates in pixels (n, 2) f64.
#[pyfunction]
pub(crate) fn unproject<'py>(
    py: Python<'py>,
    camera: &str,
    pixels: &[u8],
) -> PyResult<Bound<'py, PyByteArray>> {
    let camera: Camera = from_text(camera)?;
    let directions = map(pixels, |pixel: [f64; 2]| {
        camera.unproject(DVec2::from_array(pixel)).to_array()
    });
    Ok(PyByteArray::new(py, &directions))
}

/// Returns the camera with images of another size, as JSON.
#[pyfunction]
pub(crate) fn resized(camera: &str, size: [u32; 2]) -> PyResult<String> {
    let camera: Camera = from_text(camera)?;
    let [width, height] = size;
    if width == 0 || height == 0 {
        return Err(Failure::of_input(format!("a camera of {width}x{height} pixels")).into());
    }
    Ok(text(&camera.resized(width, height))?)
}

/// Returns the matrix, by rows, of a rotation from the camera to the world.
#[pyfunction]
pub(crate) fn rotation_matrix(rotation_wxyz: [f64; 4]) -> PyResult<[[f64; 3]; 3]> {
    let pose = Pose {
        rotation_wxyz,
        centre: [0.0; 3],
    };
    let rotation = pose.rotation().ok_or_else(|| {
        Failure::of_input(format!(
            "the quaternion must be a rotation, got {rotation_wxyz:?}"
        ))
    })?;
    Ok(DMat3::from_quat(rotation).transpose().to_cols_array_2d())
}

/// Maps rows of `N` numbers to rows of `M` by a function.
fn map<const N: usize, const M: usize>(
    rows: &[u8],
    function: impl Fn([f64; N]) -> [f64; M],
) -> Vec<u8> {
    let rows = rows.chunks_exact(8 * N);
    let mut mapped = vec![0; 8 * M * rows.len()];
    for (row, mapped) in rows.zip(mapped.chunks_exact_mut(8 * M)) {
        let mut numbers = [0.0; N];
        for (number, bytes) in numbers.iter_mut().zip(row.as_chunks::<8>().0) {
            *number = f64::from_ne_bytes(*bytes);
        }
        write(&function(numbers), mapped);
    }
    mapped
}

fn write(numbers: &[f64], bytes: &mut [u8]) {
    for (number, bytes) in numbers.iter().zip(bytes.as_chunks_mut::<8>().0) {
        *bytes = number.to_ne_bytes();
    }
}
