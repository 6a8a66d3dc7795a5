//! The poses of the views in a model.

use std::path::Path;

use omnilife_engine::model::Model;
use omnilife_schemas::{
    Pose,
    camera::Camera,
    records::{PosedFrame, Poses},
    store::{self, StoreError},
};

use crate::scene::TrainingScene;

/// Name of the refined poses in a run's folder: those of the input views, and the assumed ones of the novel
/// views.
pub const REFINED_POSES_FILE: &str = "refined-poses.json";

/// Writes the poses of all views of the split, in world units and in order of time.
pub(super) fn write(folder: &Path, scene: &TrainingScene, model: &Model) -> Result<(), StoreError> {
    let path = folder.join(REFINED_POSES_FILE);
    store::write_record(&path, &refined_poses(scene, model))
}

/// Returns the model's poses of all views of the split, in world units and in order of time.
fn refined_poses(scene: &TrainingScene, model: &Model) -> Poses {
    let views = scene.input_views.iter().chain(&scene.novel_views);
    let mut frames: Vec<PosedFrame> = views
        .filter_map(|view| {
            let view = model.corrected(&view.view);
            let centre = scene.normalization.restore(view.centre.as_dvec3());
            let pose = Pose::from_matrix(view.rotation.transpose().as_dmat3(), centre)?;
            Some(PosedFrame::new(view.time_seconds, pose))
        })
        .collect();
    frames.sort_by(|one, other| one.time_seconds.total_cmp(&other.time_seconds));
    Poses::new(
        scene.scale,
        match scene.camera {
            Camera::Erp(_) => None,
            camera @ Camera::Pinhole(_) => Some(camera),
        },
        frames,
    )
}
