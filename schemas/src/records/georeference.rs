//! `georeference`: place of a scene on the Earth, by positions that a drone or camera recorded.

use glam::{DQuat, DVec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::store::Record;

/// `georeference.json`. East, north and up are metres from the origin: `enu = metres_per_unit R x_world + offset`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Georeference {
    /// Id of the scene.
    pub scene: String,
    /// Name of the file of telemetry, or `exif`.
    pub source: String,
    /// Reference of the heights: `abs_alt`, `rel_alt`, `barometer`, `gps` or `exif`.
    pub heights: String,
    /// Origin of east, north and up.
    pub origin: GeoPoint,
    /// The origin in UTM.
    pub utm: UtmPoint,
    /// Metres in a unit of the world.
    pub metres_per_unit: f64,
    /// Rotation from the world to east, north and up, as a quaternion (w, x, y, z).
    pub rotation_wxyz: [f64; 4],
    /// East, north and up of the world's origin, metres.
    pub offset: [f64; 3],
    /// Distances between the cameras and their recorded positions, of those that were used.
    pub residuals: GeoResiduals,
    /// Recorded positions of the frames.
    pub fixes: Vec<GeoFix>,
}

impl Record for Georeference {
    const SCHEMA: &'static str = "omnilife/georeference/1";
}

impl Georeference {
    /// Returns east, north and up of a direction of the world, in its own length.
    pub fn direction(&self, world: DVec3) -> DVec3 {
        let [w, x, y, z] = self.rotation_wxyz;
        DQuat::from_xyzw(x, y, z, w) * world
    }

    /// Returns east, north and up of a world point, metres.
    pub fn enu(&self, world: DVec3) -> DVec3 {
        self.metres_per_unit * self.direction(world) + DVec3::from_array(self.offset)
    }
}

/// Point on the ellipsoid WGS 84.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GeoPoint {
    /// Degrees, north positive.
    pub latitude_degrees: f64,
    /// Degrees, east positive.
    pub longitude_degrees: f64,
    /// Metres above the reference of the heights.
    pub altitude_metres: f64,
}

/// Point in UTM.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct UtmPoint {
    /// Zone, 1 to 60.
    pub zone: u8,
    /// True on the northern hemisphere.
    pub is_north: bool,
    /// Metres.
    pub easting: f64,
    /// Metres.
    pub northing: f64,
}

/// Residuals in metres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GeoResiduals {
    /// Number of positions that were used.
    pub used: u32,
    /// Number of positions that were left out as mistakes.
    pub rejected: u32,
    /// Median.
    pub median_metres: f64,
    /// Quantile of 0.9.
    pub p90_metres: f64,
    /// Maximum.
    pub largest_metres: f64,
}

/// Recorded position of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GeoFix {
    /// Number of the frame in the scene.
    pub frame: u32,
    /// The position.
    pub point: GeoPoint,
    /// Distance from the camera, metres.
    pub residual_metres: f64,
    /// False where it was left out as a mistake.
    pub is_used: bool,
}
