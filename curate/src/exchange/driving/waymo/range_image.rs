//! Range images of LiDARs as points.
//!
//! Rows are beams from the highest to the lowest, columns azimuths from +180 to -180 degrees about the z axis of the
//! vehicle (`compute_range_image_polar` and `compute_range_image_cartesian` of `utils/range_image_utils.py`). A range of
//! 0 and less has no return.

use std::f64::consts::PI;

use glam::{DMat3, DVec3};

use super::calibration::VehicleLidar;
use crate::exchange::driving::rigid::Rigid;

/// Channels of a range image: range, intensity, elongation, and a mark of zones without labels.
const CHANNELS: usize = 4;
/// Numbers of a pixel's pose: roll, pitch, yaw (radians), x, y, z.
const POSE: usize = 6;

/// Values of an image by rows, columns and channels.
pub(super) struct RangeImage<'a> {
    pub(super) values: &'a [f64],
    pub(super) shape: [f64; 3],
}

impl RangeImage<'_> {
    /// Returns rows and columns.
    ///
    /// # Errors
    /// Unless it has these channels, and as many values as its shape.
    fn size(&self, channels: usize) -> Result<[usize; 2], String> {
        let [rows, columns, last] = self.shape.map(|side| side as usize);
        let all = rows
            .checked_mul(columns)
            .and_then(|pixels| pixels.checked_mul(last));
        if last == channels && all == Some(self.values.len()) {
            return Ok([rows, columns]);
        }
        Err(format!(
            "must be an image of {channels} channels, got {} values of the shape {:?}",
            self.values.len(),
            self.shape
        ))
    }
}

impl VehicleLidar {
    /// Returns the angle of a row above the plane of the LiDAR, radians.
    fn beam(&self, row: usize, rows: usize) -> Option<f64> {
        let from_lowest = rows.checked_sub(row)?.checked_sub(1)?;
        if self.beams.is_empty() {
            let [least, greatest] = self.range;
            return Some(least + (from_lowest as f64 + 0.5) / rows as f64 * (greatest - least));
        }
        self.beams.get(from_lowest).copied()
    }

    /// Returns the points of a range image in the frame of the vehicle at `vehicle`, its pose in the world, metres.
    /// `poses` has the pose of the vehicle in the world for each pixel; without it, all are at `vehicle`.
    ///
    /// # Errors
    /// When the images differ in size from each other or from the beams, or hold values that are not finite.
    pub(super) fn points(
        &self,
        image: &RangeImage<'_>,
        poses: Option<&RangeImage<'_>>,
        vehicle: Rigid,
    ) -> Result<Vec<DVec3>, String> {
        let [rows, columns] = image.size(CHANNELS)?;
        if !self.beams.is_empty() && self.beams.len() != rows {
            return Err(format!(
                "must have a row for each of {} beams, got {rows}",
                self.beams.len()
            ));
        }
        if let Some(poses) = poses
            && poses.size(POSE)? != [rows, columns]
        {
            return Err(format!(
                "must have a pose for each of {rows}x{columns} pixels"
            ));
        }
        let forward = self.to_vehicle.rotation.x_axis;
        // The columns count the azimuth in the frame of the vehicle.
        let correction = forward.y.atan2(forward.x);
        let from_world = vehicle.inverse();
        let mut points = Vec::new();
        for (pixel, channels) in image.values.chunks_exact(CHANNELS).enumerate() {
            let Some(&range) = channels.first().filter(|range| **range > 0.0) else {
                // NaN compares false.
                if channels.first().is_some_and(|range| range.is_nan()) {
                    return Err(format!("ranges must be finite, got NaN of pixel {pixel}"));
                }
                continue;
            };
            let [row, column] = [pixel.checked_div(columns), pixel.checked_rem(columns)];
            let (Some(row), Some(column)) = (row, column) else {
                continue;
            };
            let Some(up) = self.beam(row, rows) else {
                continue;
            };
            let turn = 1.0 - 2.0 * (column as f64 + 0.5) / columns as f64;
            let around = PI * turn - correction;
            let ray = DVec3::new(up.cos() * around.cos(), up.cos() * around.sin(), up.sin());
            let mut point = self.to_vehicle.apply(range * ray);
            let begin = pixel.saturating_mul(POSE);
            let pose = poses.and_then(|poses| poses.values.get(begin..begin.saturating_add(POSE)));
            if let Some(&[roll, pitch, yaw, x, y, z]) = pose {
                let turn = DMat3::from_rotation_z(yaw)
                    * DMat3::from_rotation_y(pitch)
                    * DMat3::from_rotation_x(roll);
                point = from_world.apply(turn * point + DVec3::new(x, y, z));
            }
            if !point.is_finite() {
                return Err(format!(
                    "points must be finite, got {point} of pixel {pixel}"
                ));
            }
            points.push(point);
        }
        Ok(points)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;

    const STILL: Rigid = Rigid {
        rotation: DMat3::IDENTITY,
        translation: DVec3::ZERO,
    };

    fn lidar(beams: &[f64], turn: f64) -> VehicleLidar {
        VehicleLidar {
            to_vehicle: Rigid {
                rotation: DMat3::from_rotation_z(turn),
                translation: DVec3::new(0.0, 0.0, 2.0),
            },
            beams: beams.to_vec(),
            range: [-0.4, 0.4],
        }
    }

    fn found(lidar: &VehicleLidar, ranges: &[f64], shape: [f64; 3]) -> Result<Vec<DVec3>, String> {
        let values: Vec<f64> = ranges
            .iter()
            .flat_map(|&range| [range, 0.1, 0.2, 0.0])
            .collect();
        let image = RangeImage {
            values: &values,
            shape,
        };
        lidar.points(&image, None, STILL)
    }

    /// Four columns look to the left behind, left, right and right behind: 135, 45, -45 and -135 degrees of the vehicle,
    /// however the LiDAR is turned.
    #[test]
    fn columns_turn_to_the_right_and_the_first_row_is_the_highest() {
        for turn in [0.0, 1.1] {
            let one = lidar(&[-0.5, 0.5], turn);
            let ranges = [0.0, 2.0, -1.0, 0.0, 0.0, 0.0, 4.0, 0.0];
            let points = found(&one, &ranges, [2.0, 4.0, 4.0]).unwrap_or_default();
            let [high, low] = &points[..] else {
                panic!("two pixels have returns: {points:?}");
            };
            let quarter = FRAC_PI_2 / 2.0;
            let ray = |up: f64, around: f64| {
                DVec3::new(up.cos() * around.cos(), up.cos() * around.sin(), up.sin())
            };
            let at = DVec3::new(0.0, 0.0, 2.0);
            assert!(
                high.distance(at + 2.0 * ray(0.5, quarter)) < 1e-12,
                "{high}"
            );
            assert!(
                low.distance(at + 4.0 * ray(-0.5, -quarter)) < 1e-12,
                "{low}"
            );
        }
    }

    #[test]
    fn even_beams_are_in_the_middles_of_equal_parts() {
        let one = lidar(&[], 0.0);
        let points = found(&one, &[1.0, 1.0, 1.0, 1.0], [4.0, 1.0, 4.0]).unwrap_or_default();
        let up: Vec<f64> = points.iter().map(|point| (point.z - 2.0).asin()).collect();
        for (found, expected) in up.iter().zip([0.3, 0.1, -0.1, -0.3]) {
            assert!((found - expected).abs() < 1e-12, "{up:?}");
        }
        assert_eq!(up.len(), 4);
    }

    /// A pixel is seen after the vehicle went 1 m on and turned to the left by a quarter.
    #[test]
    fn pixels_with_poses_are_where_the_vehicle_was() {
        let one = lidar(&[0.0], 0.0);
        let values = [3.0, 0.0, 0.0, 0.0];
        let image = RangeImage {
            values: &values,
            shape: [1.0, 1.0, 4.0],
        };
        let pose = [0.0, 0.0, FRAC_PI_2, 11.0, 0.0, 0.0];
        let poses = RangeImage {
            values: &pose,
            shape: [1.0, 1.0, 6.0],
        };
        let vehicle = Rigid {
            translation: DVec3::new(10.0, 0.0, 0.0),
            ..STILL
        };
        let points = one
            .points(&image, Some(&poses), vehicle)
            .unwrap_or_default();
        // Straight ahead of the vehicle then.
        assert!(
            points[0].distance(DVec3::new(1.0, 3.0, 2.0)) < 1e-12,
            "{points:?}"
        );
    }

    #[test]
    fn images_of_other_sizes_and_values_that_are_not_finite_are_refused() {
        let one = lidar(&[0.0, 0.1], 0.0);
        assert!(
            found(&one, &[1.0], [1.0, 1.0, 4.0]).is_err_and(|reason| reason.contains("2 beams"))
        );
        assert!(
            found(&one, &[1.0, 1.0], [2.0, 2.0, 4.0])
                .is_err_and(|reason| reason.contains("8 values"))
        );
        assert!(
            found(&one, &[1.0, 1.0], [2.0, 1.0, 6.0])
                .is_err_and(|reason| reason.contains("channels"))
        );
        assert!(
            found(&one, &[f64::NAN, 1.0], [2.0, 1.0, 4.0])
                .is_err_and(|reason| reason.contains("NaN"))
        );
        assert!(found(&one, &[f64::INFINITY, 1.0], [2.0, 1.0, 4.0]).is_err());
    }
}
