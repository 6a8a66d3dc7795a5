//! Calibration of cameras and LiDARs, and poses.

use std::collections::BTreeMap;

use glam::{DMat3, DVec3};
use omnilife_schemas::{camera::PinholeCamera, store::StoreError};

use super::table::Table;
use crate::{
    exchange::driving::{rig::OwnCamera, rigid::Rigid},
    poses::{
        frame_camera::FrameCamera,
        lens::{Distortion, Lens},
    },
};

/// Numbers of a matrix of a transform, row by row.
const MATRIX: usize = 16;
/// Names of the numbers of a camera, without those of its lens.
const INTRINSICS: [&str; 4] = ["f_u", "f_v", "c_u", "c_v"];
const LENS: [&str; 5] = ["k1", "k2", "p1", "p2", "k3"];

/// A camera of the vehicle.
pub(super) struct VehicleCamera {
    pub(super) camera: OwnCamera,
    /// A line on its lens.
    pub(super) remark: Option<String>,
    /// From its frame (x right, y down, z forward) to that of the vehicle.
    pub(super) to_vehicle: Rigid,
}

/// A LiDAR of the vehicle.
pub(super) struct VehicleLidar {
    /// From its frame to that of the vehicle.
    pub(super) to_vehicle: Rigid,
    /// Angles of its beams above its plane, radians, from the lowest; empty if they are even.
    pub(super) beams: Vec<f64>,
    /// Least and greatest angle of even beams, radians.
    pub(super) range: [f64; 2],
}

/// Returns the transform of a 4x4 matrix, row by row.
///
/// # Errors
/// When it is no rigid transform.
pub(super) fn rigid(matrix: [f64; MATRIX]) -> Result<Rigid, String> {
    let [rows @ .., a, b, c, d] = matrix;
    let found = ([a, b, c, d] == [0.0, 0.0, 0.0, 1.0]).then(|| Rigid::from_rows(rows));
    found.flatten().ok_or_else(|| {
        format!("a transform must be a rotation and a translation as a 4x4 matrix, got {matrix:?}")
    })
}

/// Returns the frame of a camera of the vehicle, with x forward and y left, by ours: x right, y down, z forward.
pub(super) fn forward_from_ours() -> Rigid {
    let [forward, left, up] = [DVec3::Z, -DVec3::X, -DVec3::Y];
    Rigid {
        rotation: DMat3::from_cols(forward, left, up).transpose(),
        translation: DVec3::ZERO,
    }
}

/// Reads the cameras by their numbers.
///
/// # Errors
/// When a row is damaged, or a camera has no straight image.
pub(super) fn cameras(table: &Table) -> Result<BTreeMap<i64, VehicleCamera>, StoreError> {
    let column = |name: &str| table.column(&format!("[CameraCalibrationComponent].{name}"));
    let mut numbers = table.column("key.camera_name")?;
    let mut transforms = column("extrinsic.transform")?;
    let [mut widths, mut heights] = [column("width")?, column("height")?];
    let intrinsic = |name: &str| column(&format!("intrinsic.{name}"));
    let mut intrinsics = INTRINSICS
        .into_iter()
        .map(intrinsic)
        .collect::<Result<Vec<_>, _>>()?;
    let mut terms = LENS
        .into_iter()
        .map(intrinsic)
        .collect::<Result<Vec<_>, _>>()?;
    let mut found = BTreeMap::new();
    for row in 0..table.rows {
        let side = |value: i64| u32::try_from(value).ok().filter(|&side| side > 0);
        let (width, height) = (widths.integer(row)?, heights.integer(row)?);
        let numbers_of = intrinsics.iter_mut().map(|column| column.number(row));
        let numbers_of = numbers_of.collect::<Result<Vec<f64>, _>>()?;
        let lens = terms.iter_mut().map(|column| column.number(row));
        let lens = lens.collect::<Result<Vec<f64>, _>>()?;
        let camera = match (side(width), side(height), numbers_of.as_slice()) {
            (Some(width), Some(height), &[fx, fy, cx, cy]) if fx > 0.0 && fy > 0.0 => {
                PinholeCamera {
                    width,
                    height,
                    fx,
                    fy,
                    cx,
                    cy,
                }
            }
            _ => {
                let reason = format!(
                    "a camera must have a size and focal lengths above 0, got {width}x{height}, {numbers_of:?}"
                );
                return Err(table.fault(row, reason));
            }
        };
        let distortion = match lens.as_slice() {
            &[k1, k2, p1, p2, k3] => Distortion {
                radial: [k1, k2, k3, 0.0, 0.0, 0.0],
                tangential: [p1, p2],
                ..Distortion::default()
            },
            _ => Distortion::default(),
        };
        let fault = |reason: String| table.fault(row, reason);
        let shown = FrameCamera::behind(Lens { camera, distortion }).map_err(fault)?;
        let number = numbers.integer(row)?;
        let to_vehicle = rigid(transforms.exactly(row)?).map_err(fault)?;
        let one = VehicleCamera {
            camera: OwnCamera::of(camera, &shown),
            remark: shown.remark(),
            to_vehicle: to_vehicle.after(forward_from_ours()),
        };
        if found.insert(number, one).is_some() {
            return Err(table.fault(row, format!("must be the one row of camera {number}")));
        }
    }
    Ok(found)
}

/// Reads the LiDARs by their numbers.
///
/// # Errors
/// When a row is damaged.
pub(super) fn lidars(table: &Table) -> Result<BTreeMap<i64, VehicleLidar>, StoreError> {
    let column = |name: &str| table.column(&format!("[LiDARCalibrationComponent].{name}"));
    let mut numbers = table.column("key.laser_name")?;
    let mut transforms = column("extrinsic.transform")?;
    let [mut least, mut greatest] = [
        column("beam_inclination.min")?,
        column("beam_inclination.max")?,
    ];
    let mut beams = column("beam_inclination.values")?;
    let mut found = BTreeMap::new();
    for row in 0..table.rows {
        let number = numbers.integer(row)?;
        let beams = beams.numbers(row)?;
        if beams.iter().any(|angle| !angle.is_finite()) {
            return Err(table.fault(row, "inclinations of beams must be finite"));
        }
        let to_vehicle =
            rigid(transforms.exactly(row)?).map_err(|reason| table.fault(row, reason))?;
        let one = VehicleLidar {
            to_vehicle,
            beams,
            range: [least.number(row)?, greatest.number(row)?],
        };
        if found.insert(number, one).is_some() {
            return Err(table.fault(row, format!("must be the one row of LiDAR {number}")));
        }
    }
    Ok(found)
}

/// Reads the poses of the vehicle by the time of the frame, microseconds.
///
/// # Errors
/// When a row is damaged, or a time has two.
pub(super) fn vehicle_poses(table: &Table) -> Result<BTreeMap<i64, Rigid>, StoreError> {
    let mut times = table.column("key.frame_timestamp_micros")?;
    let mut poses = table.column("[VehiclePoseComponent].world_from_vehicle.transform")?;
    let mut found = BTreeMap::new();
    for row in 0..table.rows {
        let time = times.integer(row)?;
        let pose = rigid(poses.exactly(row)?).map_err(|reason| table.fault(row, reason))?;
        if found.insert(time, pose).is_some() {
            return Err(table.fault(row, format!("must be the one pose at {time}")));
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Forward of a camera of the vehicle is its x, and our z; up is its z, and our -y.
    #[test]
    fn axes_of_cameras_are_exchanged_and_other_matrices_are_refused() {
        let ours = forward_from_ours();
        assert_eq!(ours.apply(DVec3::Z), DVec3::X);
        assert_eq!(ours.apply(DVec3::X), -DVec3::Y);
        assert_eq!(ours.apply(DVec3::Y), -DVec3::Z);
        let mut matrix = [0.0; MATRIX];
        for (at, value) in [(0, 1.0), (5, 1.0), (10, 1.0), (15, 1.0), (3, 7.0)] {
            matrix[at] = value;
        }
        let moved = rigid(matrix).map(|one| one.apply(DVec3::Y));
        assert_eq!(moved, Ok(DVec3::new(7.0, 1.0, 0.0)));
        for (at, value) in [(15, 2.0), (12, 1.0), (0, 2.0), (5, f64::NAN)] {
            let mut other = matrix;
            other[at] = value;
            assert!(rigid(other).is_err(), "{at}");
        }
    }
}
