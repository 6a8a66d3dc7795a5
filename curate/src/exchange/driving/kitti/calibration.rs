//! Calibration of a sequence: cameras, LiDAR and IMU to each other.

use std::{collections::BTreeMap, path::Path, str::SplitWhitespace};

use glam::{DMat3, DVec3};
use omnilife_schemas::{camera::PinholeCamera, store::StoreError};

use super::super::{rigid::Rigid, table};

/// Names of the matrices other than those of cameras, and their names in older files.
const RECTIFICATION: [&str; 2] = ["R_rect", "R0_rect"];
const LIDAR_TO_CAMERA: [&str; 2] = ["Tr_velo_cam", "Tr_velo_to_cam"];
const IMU_TO_LIDAR: [&str; 2] = ["Tr_imu_velo", "Tr_imu_to_velo"];
/// Place of a pixel's centre in the image, pixels; in the files it is 0.
const PIXEL_CENTRE: f64 = 0.5;

/// The calibration of a sequence.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Calibration {
    /// Cameras P0 to P3.
    pub(super) cameras: Vec<Projection>,
    /// From the LiDAR to the rectified frame of camera 0.
    pub(super) rectified_from_lidar: Rigid,
    /// From the IMU to the LiDAR.
    pub(super) lidar_from_imu: Rigid,
}

/// A projection `K [I | t]` of the rectified frame of camera 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Projection {
    focal: [f64; 2],
    principal: [f64; 2],
    /// Place of the camera in that frame.
    place: DVec3,
}

impl Projection {
    /// Reads the rows of its matrix; `None` for other matrices.
    fn from_rows(rows: [f64; 12]) -> Option<Self> {
        let [fx, skew, cx, a, zero_x, fy, cy, b, zero_u, zero_v, one, z] = rows;
        let is_plain = [skew, zero_x, zero_u, zero_v, one - 1.0] == [0.0; 5];
        let (x, y) = ((a - cx * z) / fx, (b - cy * z) / fy);
        let place = -DVec3::new(x, y, z);
        (is_plain && fx > 0.0 && fy > 0.0 && place.is_finite()).then_some(Self {
            focal: [fx, fy],
            principal: [cx, cy],
            place,
        })
    }

    /// Returns the camera with images of this width and height, and its place.
    pub(super) fn sized(&self, [width, height]: [usize; 2]) -> (PinholeCamera, DVec3) {
        let ([fx, fy], [cx, cy]) = (self.focal, self.principal);
        let camera = PinholeCamera {
            width: width as u32,
            height: height as u32,
            fx,
            fy,
            cx: cx + PIXEL_CENTRE,
            cy: cy + PIXEL_CENTRE,
        };
        (camera, self.place)
    }
}

impl Calibration {
    /// Reads a file.
    ///
    /// # Errors
    /// When it is missing or lacks a matrix, or one has another size, a number that is not finite, or is not of its
    /// kind.
    pub(super) fn read(path: &Path) -> Result<Self, StoreError> {
        Self::from_text(&table::text(path)?).map_err(|reason| StoreError::malformed(path, reason))
    }

    /// Reads the text of a file as [`Calibration::read`] does.
    fn from_text(text: &str) -> Result<Self, String> {
        let mut found = BTreeMap::new();
        for (line, text) in table::lines(text) {
            let mut words = text.split_whitespace();
            let name = words.next().unwrap_or_default().trim_end_matches(':');
            found.insert(name, (line, words));
        }
        let mut rows = |names: &[&str]| {
            let of_name = names.iter().find_map(|name| found.remove(*name));
            of_name.ok_or_else(|| format!("must hold {}, got none", names.join(" or ")))
        };
        let rigid = |(line, words): (usize, SplitWhitespace<'_>), what: &str| {
            let rows = table::exactly(words, line, "numbers, a 3x4 matrix")?;
            Rigid::from_rows(rows).ok_or_else(|| {
                format!("line {line} must hold a rotation and a translation ({what}), got others")
            })
        };
        let mut cameras = Vec::new();
        for name in ["P0", "P1", "P2", "P3"] {
            let (line, words) = rows(&[name])?;
            let of_camera = table::exactly(words, line, "numbers, a 3x4 matrix")?;
            cameras.push(Projection::from_rows(of_camera).ok_or_else(|| {
                format!("line {line} must hold the projection {name} as K [I | t] without skew, got others")
            })?);
        }
        let (line, words) = rows(&RECTIFICATION)?;
        let [a, b, c, d, e, f, g, h, i] = table::exactly(words, line, "numbers, a 3x3 matrix")?;
        let rotation = DMat3::from_cols_array(&[a, d, g, b, e, h, c, f, i]);
        let rectification = Rigid::new(rotation, DVec3::ZERO).ok_or_else(|| {
            format!("line {line} must hold the rotation R_rect, got another matrix")
        })?;
        let camera_from_lidar = rigid(rows(&LIDAR_TO_CAMERA)?, "Tr_velo_cam")?;
        Ok(Self {
            cameras,
            rectified_from_lidar: rectification.after(camera_from_lidar),
            lidar_from_imu: rigid(rows(&IMU_TO_LIDAR)?, "Tr_imu_velo")?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// In the form of the tracking devkit: no colon after the last three names.
    const TEXT: &str = "P0: 700 0 600 0 0 700 180 0 0 0 1 0\n\
                        P1: 700 0 600 -378 0 700 180 0 0 0 1 0\n\
                        P2: 700 0 600 42 0 700 180 0.7 0 0 1 0.01\n\
                        P3: 700 0 600 -336 0 700 180 0.7 0 0 1 0.01\n\
                        R_rect 0 -1 0 1 0 0 0 0 1\n\
                        Tr_velo_cam 0 -1 0 0.1 0 0 -1 0.2 1 0 0 0.3\n\
                        Tr_imu_velo 1 0 0 -0.8 0 1 0 0.3 0 0 1 -0.8\n";

    #[test]
    fn a_lidar_point_is_where_the_product_of_the_matrices_has_it() {
        let Ok(calibration) = Calibration::from_text(TEXT) else {
            panic!("a sound file is read");
        };
        let point = DVec3::new(10.0, 2.0, -1.0);
        // R_rect Tr_velo_cam x by hand: camera (-2 + 0.1, 1 + 0.2, 10 + 0.3), then x and y are turned.
        let rectified = calibration.rectified_from_lidar.apply(point);
        assert!(rectified.distance(DVec3::new(-1.2, -1.9, 10.3)) < 1e-12);
        // P2 by hand.
        let z = 10.3 + 0.01;
        let expected = [
            (700.0 * -1.2 + 600.0 * 10.3 + 42.0) / z + 0.5,
            (700.0 * -1.9 + 180.0 * 10.3 + 0.7) / z + 0.5,
        ];
        let (camera, place) = calibration.cameras[2].sized([1242, 375]);
        let local = rectified - place;
        let found = [
            camera.fx * local.x / local.z + camera.cx,
            camera.fy * local.y / local.z + camera.cy,
        ];
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-9, "{found}, {expected}");
        }
        let older = TEXT
            .replace("R_rect ", "R0_rect: ")
            .replace("Tr_velo_cam ", "Tr_velo_to_cam: ")
            .replace("Tr_imu_velo ", "Tr_imu_to_velo: ");
        assert_eq!(Calibration::from_text(&older), Ok(calibration));
    }

    #[test]
    fn missing_short_and_unsound_matrices_are_refused_by_name_or_line() {
        for (from, to, told) in [
            ("P3:", "Q3:", "P3"),
            (
                "Tr_velo_cam",
                "Tr_cam_velo",
                "Tr_velo_cam or Tr_velo_to_cam",
            ),
            (" 42 ", " ", "line 3 must hold 12"),
            (" 42 ", " inf ", "\"inf\""),
            (" 42 ", " 42 9 ", "got 13"),
            ("R_rect 0", "R_rect 1", "R_rect"),
            ("P1: 700 0", "P1: 700 3", "P1"),
            ("P0: 700", "P0: -700", "P0"),
        ] {
            let found = Calibration::from_text(&TEXT.replace(from, to));
            assert!(
                found.as_ref().is_err_and(|reason| reason.contains(told)),
                "{to}: {found:?}"
            );
        }
    }
}
