//! Facts of a still image that its camera wrote into the file.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// When and where a still was taken, as far as its file says. Nothing of it is taken for a pose.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Capture {
    /// Local time, ISO 8601, with fractions and the offset from UTC where the camera wrote them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time: Option<String>,
    /// Degrees, north positive.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub latitude_degrees: Option<f64>,
    /// Degrees, east positive.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub longitude_degrees: Option<f64>,
    /// Metres above sea level.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub altitude_metres: Option<f64>,
    /// Direction that the camera looked in, degrees clockwise from north.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub direction_degrees: Option<f64>,
    /// Heading, pitch and roll of the panorama's middle, degrees (GPano). The pixels are as they are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pose_degrees: Option<[f64; 3]>,
}

impl Capture {
    /// Returns true where the file says nothing.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}
