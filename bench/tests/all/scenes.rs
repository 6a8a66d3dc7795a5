//! A small scene, as a record.

use omnilife_schemas::{
    Pose,
    camera::ErpCamera,
    records::{PoseSource, PoseValidation, Scale, Scene, SceneFrame, ValidationStatus},
};

pub(crate) const WIDTH: usize = 32;
pub(crate) const HEIGHT: usize = 16;

/// A scene of `frames` frames; those in `unposed` have no pose.
pub(crate) fn scene(frames: usize, unposed: &[usize]) -> Scene {
    Scene {
        id: "stripes/seq-000".to_owned(),
        camera: ErpCamera::new(WIDTH as u32, HEIGHT as u32).into(),
        scale: Scale::Metres,
        frames: (0..frames)
            .map(|frame| SceneFrame {
                image: format!("frames/{frame:06}.png"),
                time_seconds: 0.1 * frame as f64,
                pose: (!unposed.contains(&frame)).then_some(Pose {
                    rotation_wxyz: [1.0, 0.0, 0.0, 0.0],
                    centre: [frame as f64, 0.0, 0.0],
                }),
                mask: None,
                ignore_mask: None,
                classes: [].into(),
                objects: [].into(),
                boxes: [].into(),
                depth: None,
                depth_prior: None,
                capture: None,
            })
            .collect(),
        points: None,
        pose_source: PoseSource::Given {
            file: "poses.json".to_owned(),
        },
        validation: PoseValidation {
            status: ValidationStatus::Valid,
            registered_frames: (frames - unposed.len()) as u32,
            total_frames: frames as u32,
            measures: [].into(),
            problems: Vec::new(),
        },
        published_split: None,
        objects: [].into(),
    }
}
