//! A small scene, as a record.

use omnilife_schemas::{
    Pose,
    camera::ErpCamera,
    records::{PoseValidation, Scale, Scene, SceneFrame, ValidationStatus},
};

pub(crate) const WIDTH: usize = 32;
pub(crate) const HEIGHT: usize = 16;

/// A scene of `frames` frames; those in `unposed` have no pose.
pub(crate) fn scene(frames: usize, unposed: &[usize]) -> Scene {
    Scene {
        scale: Scale::Metres,
        validation: PoseValidation {
            status: ValidationStatus::Valid,
            registered_frames: (frames - unposed.len()) as u32,
            total_frames: frames as u32,
            measures: [].into(),
            problems: Vec::new(),
        },
        ..Scene::given(
            "stripes/seq-000",
            ErpCamera::new(WIDTH as u32, HEIGHT as u32),
            (0..frames)
                .map(|frame| {
                    SceneFrame::new(
                        format!("frames/{frame:06}.png"),
                        0.1 * frame as f64,
                        (!unposed.contains(&frame)).then_some(Pose {
                            rotation_wxyz: [1.0, 0.0, 0.0, 0.0],
                            centre: [frame as f64, 0.0, 0.0],
                        }),
                    )
                })
                .collect(),
        )
    }
}
