//! Places of the vehicle by GPS and IMU, in metres from the first.

use std::path::Path;

use glam::{DMat3, DVec3};
use omnilife_schemas::store::StoreError;

use super::super::{rigid::Rigid, table};

/// Radius of the Earth in the projection of the places, metres.
const EARTH_RADIUS_METRES: f64 = 6_378_137.0;

/// Returns the transform from the IMU to the world in every frame.
///
/// # Errors
/// When the file is missing, or a line has another width or a number that is not finite.
pub(super) fn read(path: &Path) -> Result<Vec<Rigid>, StoreError> {
    poses_of(&table::text(path)?).map_err(|reason| StoreError::malformed(path, reason))
}

/// Reads the text of oxts as [`read`] does.
fn poses_of(text: &str) -> Result<Vec<Rigid>, String> {
    let mut origin = None;
    let lines = table::lines(text).map(|(line, text)| {
        let values: [f64; 30] =
            table::exactly(text.split_whitespace(), line, "values of GPS and IMU")?;
        let [latitude, longitude, altitude, roll, pitch, yaw, ..] = values;
        let (scale, begin) = *origin.get_or_insert_with(|| {
            let scale = latitude.to_radians().cos();
            (scale, mercator(scale, [latitude, longitude, altitude]))
        });
        let rotation = DMat3::from_rotation_z(yaw)
            * DMat3::from_rotation_y(pitch)
            * DMat3::from_rotation_x(roll);
        let place = mercator(scale, [latitude, longitude, altitude]) - begin;
        Rigid::new(rotation, place).ok_or_else(|| {
            format!("line {line} must hold a place on the Earth, got latitude {latitude}")
        })
    });
    lines.collect()
}

/// Returns Mercator coordinates at a scale: x east, y north, z up, metres.
fn mercator(scale: f64, [latitude, longitude, altitude]: [f64; 3]) -> DVec3 {
    let north = (0.25 * std::f64::consts::PI + 0.5 * latitude.to_radians()).tan();
    let [x, y] = [longitude.to_radians(), north.ln()];
    DVec3::new(
        scale * EARTH_RADIUS_METRES * x,
        scale * EARTH_RADIUS_METRES * y,
        altitude,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A step of a hundred thousandth of a degree to the north is 1.113 m, to the east less by the cosine.
    #[test]
    fn oxts_are_metres_from_the_first_place_with_a_heading_from_the_east() {
        let row = |latitude: f64, longitude: f64, yaw: f64| {
            format!(
                "{latitude:.9} {longitude:.9} 110 0 0 {yaw}{}\n",
                " 0".repeat(24)
            )
        };
        let text = row(49.0, 8.0, 0.0) + &row(49.00001, 8.0, 0.5) + &row(49.0, 8.00001, 0.0);
        let Ok(poses) = poses_of(&text) else {
            panic!("three lines are read");
        };
        let step = EARTH_RADIUS_METRES * 1e-5_f64.to_radians();
        assert_eq!(poses[0].translation, DVec3::ZERO);
        assert!(
            poses[1].translation.distance(step * DVec3::Y) < 1e-5,
            "{poses:?}"
        );
        let east = step * 49.0_f64.to_radians().cos();
        assert!(
            poses[2].translation.distance(east * DVec3::X) < 1e-5,
            "{poses:?}"
        );
        let forward = poses[1].rotation * DVec3::X;
        assert!(forward.distance(DVec3::new(0.5_f64.cos(), 0.5_f64.sin(), 0.0)) < 1e-12);
        assert!(
            poses_of(&row(49.0, 8.0, 0.0).replace(" 110", "")).is_err_and(|reason| {
                reason.contains("line 1") && reason.contains("30") && reason.contains("29")
            })
        );
        assert!(poses_of(&row(91.0, 8.0, 0.0)).is_err());
    }
}
