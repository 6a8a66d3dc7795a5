//! Conversion of a draft to the start of a method of Gaussians.

use crate::{
    components::Draft,
    method::{Findings, PreparedGaussians},
};
use omnilife_engine::model::{
    Model, camera_response::CameraResponse, pose_corrections::PoseCorrections,
};

impl PreparedGaussians {
    /// Makes the start of a drafted run from its model, which gets a camera's response to learn and poses to
    /// refine if the settings say so.
    pub fn new(draft: Draft<'_>, mut model: Model) -> Self {
        let warnings = draft.warnings();
        let views = draft.scene.input_views.iter();
        let times: Vec<f64> = views.map(|view| view.view.time_seconds).collect();
        let (settings, camera) = (&draft.settings, &draft.scene.camera);
        model.response = settings
            .response
            .as_ref()
            .map(|_| CameraResponse::new(times.clone(), camera, settings.exposure.as_ref()));
        if settings.pose_refinement.is_some() {
            model.poses = Some(PoseCorrections::new(times));
        }
        Self {
            model,
            settings: draft.settings,
            findings: Findings {
                plan: draft.plan.into_decisions(),
                evidence: Some(draft.evidence),
                lift: None,
                warnings,
            },
        }
    }
}
