//! Scale of a world whose poses leave it open, by known data of the flight.

use glam::DVec3;
use omnilife_schemas::{Pose, camera::Camera, ground_plane::Plane, records::Scale, statistics};
use serde::{Deserialize, Serialize};

use super::PosedSequence;

/// A known quantity of perspective frames over ground.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GroundScale {
    /// Median height of the cameras above the ground, metres.
    Altitude(f64),
    /// Size of a pixel of the frames on the ground straight below, metres, the median of the frames.
    PixelOnGround(f64),
}

impl GroundScale {
    /// Scales poses and points to metres.
    ///
    /// # Errors
    /// The reason: a number that is not positive, poses in metres already, panoramas, or points without a ground.
    pub(super) fn apply(self, posed: &mut PosedSequence) -> Result<(), String> {
        let (Self::Altitude(metres) | Self::PixelOnGround(metres)) = self;
        if !(metres.is_finite() && metres > 0.0) {
            return Err(format!("{metres} metres say nothing of its scale"));
        }
        if posed.scale == Scale::Metres {
            return Err(
                "its poses are in metres: no altitude or pixel size changes that".to_owned(),
            );
        }
        let Camera::Pinhole(camera) = posed.camera.camera() else {
            return Err(
                "its frames are panoramas; the ground below gives the scale of perspective flights"
                    .to_owned(),
            );
        };
        let centres: Vec<DVec3> = posed.poses.iter().flatten().map(Pose::centre).collect();
        let points = posed
            .points
            .as_ref()
            .map_or(&[][..], |cloud| &cloud.positions);
        let points: Vec<DVec3> = points.iter().copied().map(DVec3::from_array).collect();
        let no_ground =
            || "too few of its points lie on a ground that would give the scale".to_owned();
        let (plane, _) = Plane::dominant(&points, &centres).ok_or_else(no_ground)?;
        let heights: Vec<f64> = centres.iter().map(|&centre| plane.height(centre)).collect();
        let height = statistics::median(&heights)
            .filter(|height| *height > 0.0)
            .ok_or_else(no_ground)?;
        let metres_per_unit = match self {
            Self::Altitude(metres) => metres / height,
            Self::PixelOnGround(metres) => metres * camera.fx / height,
        };
        scale_world(posed, metres_per_unit);
        Ok(())
    }
}

fn scale_world(posed: &mut PosedSequence, metres_per_unit: f64) {
    for pose in posed.poses.iter_mut().flatten() {
        if let Some(rotation) = pose.rotation() {
            *pose = Pose::new(rotation, metres_per_unit * pose.centre());
        }
    }
    for point in posed
        .points
        .iter_mut()
        .flat_map(|cloud| &mut cloud.positions)
    {
        *point = point.map(|value| value * metres_per_unit);
    }
    posed.scale = Scale::Metres;
}
