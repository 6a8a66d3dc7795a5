//! Motion of posed cameras.

use std::path::Path;

use omnilife_schemas::{
    Pose,
    points::PointCloud,
    pose::angle_between,
    records::{PoseSource, Scale, Scene, ValidationStatus},
    statistics::median,
};

use crate::{error::CurateError, motion::pairs::LARGEST_GAP_SECONDS};

/// Frames farther apart than this say nothing about the speed of the camera, seconds.
const LARGEST_SPEED_GAP_SECONDS: f64 = 5.0;
/// Points whose distance is measured at most, per camera.
const DEPTH_SAMPLES: usize = 500;

/// Motion of the cameras of a scene.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct PoseMotion {
    /// Speeds of rotation, degrees per second, between frames that are close enough in time to show it.
    pub(super) turns: Vec<f64>,
    /// Median speed in metres per second, where the scale is known.
    pub(super) metres_per_second: Option<f64>,
    /// Median speed in distances of the scene (median over its points) per second.
    pub(super) depths_per_second: Option<f64>,
}

/// Measures the poses of a scene; `None` where they are known to be unstable.
///
/// # Errors
/// When the scene's points cannot be read.
pub(super) fn measure(folder: &Path, scene: &Scene) -> Result<Option<PoseMotion>, CurateError> {
    if scene.validation.status == ValidationStatus::Unstable {
        return Ok(None);
    }
    let cloud = match &scene.points {
        Some(file) => PointCloud::read_ply(&folder.join(file))?,
        None => PointCloud::default(),
    };
    Ok(Some(of_scene(scene, &cloud)))
}

fn of_scene(scene: &Scene, cloud: &PointCloud) -> PoseMotion {
    let stride = (cloud.len() / DEPTH_SAMPLES).max(1);
    let mut turns = Vec::new();
    let (mut metric, mut relative) = (Vec::new(), Vec::new());
    // Cameras that were only turned have no place.
    let has_places = !matches!(scene.pose_source, PoseSource::Registered { .. });
    for pair in scene.frames.windows(2) {
        let (Some(from), Some(to)) = (&pair[0].pose, &pair[1].pose) else {
            continue;
        };
        let seconds = pair[1].time_seconds - pair[0].time_seconds;
        if seconds <= 0.0 {
            continue;
        }
        if seconds <= LARGEST_GAP_SECONDS {
            turns.extend(turned(from, to).map(|angle| angle.to_degrees() / seconds));
        }
        if !has_places || seconds > LARGEST_SPEED_GAP_SECONDS {
            continue;
        }
        let speed = from.centre().distance(to.centre()) / seconds;
        metric.push(speed);
        let depths: Vec<f64> = cloud
            .positions
            .iter()
            .step_by(stride)
            .map(|&p| glam::DVec3::from_array(p).distance(from.centre()))
            .collect();
        relative.extend(
            median(&depths)
                .filter(|&depth| depth > 0.0)
                .map(|depth| speed / depth),
        );
    }
    PoseMotion {
        turns,
        metres_per_second: median(&metric).filter(|_| scene.scale == Scale::Metres),
        depths_per_second: median(&relative),
    }
}

/// Returns the angle between the rotations of two poses, radians.
fn turned(from: &Pose, to: &Pose) -> Option<f64> {
    Some(angle_between(from.rotation()?, to.rotation()?))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use glam::{DQuat, DVec3};
    use omnilife_schemas::{
        camera::ErpCamera,
        records::{PoseValidation, SceneFrame},
    };

    use super::*;

    /// Returns a scene whose camera walks at 1.5 units and turns by 0.1 radians in a second, seen every `gap` seconds.
    fn walk(gap: f64, scale: Scale) -> Scene {
        let frame = |number: u32| {
            let seconds = gap * f64::from(number);
            let rotation = DQuat::from_rotation_y(0.1 * seconds);
            SceneFrame::new(
                format!("{number}.png"),
                seconds,
                Some(Pose::new(rotation, DVec3::new(0.0, 0.0, 1.5 * seconds))),
            )
        };
        Scene {
            id: "walk/seq-000".to_owned(),
            camera: ErpCamera::new(64, 32).into(),
            scale,
            frames: (0..12).map(frame).collect(),
            points: None,
            pose_source: PoseSource::Given {
                file: "poses.txt".to_owned(),
            },
            validation: PoseValidation::unchecked(12, 12),
            published_split: None,
            objects: BTreeMap::new(),
        }
    }

    #[test]
    fn speeds_of_a_known_walk_come_back() {
        let cloud = PointCloud::default();
        let near = of_scene(&walk(0.2, Scale::Metres), &cloud);
        assert_eq!(near.turns.len(), 11);
        let expected = 0.1_f64.to_degrees();
        assert!(near.turns.iter().all(|turn| (turn - expected).abs() < 1e-9));
        let off = |speed: f64| (speed - 1.5).abs() < 1e-9;
        assert!(near.metres_per_second.is_some_and(off));
        assert_eq!(near.depths_per_second, None);
        // 0.8 s apart: the speed is known, the turns between are not.
        let far = of_scene(&walk(0.8, Scale::Metres), &cloud);
        assert!(far.turns.is_empty() && far.metres_per_second.is_some_and(off));
        let unscaled = of_scene(&walk(0.8, Scale::Arbitrary), &cloud);
        assert_eq!(unscaled.metres_per_second, None);
        let mut unstable = walk(0.2, Scale::Metres);
        unstable.validation.status = ValidationStatus::Unstable;
        let measured = measure(Path::new("."), &unstable);
        assert!(measured.is_ok_and(|motion| motion.is_none()));
    }
}
