//! Conversion of a draft to the start of a method of Gaussians.

use crate::{
    components::Draft,
    method::{Findings, PreparedGaussians},
};
use omnilife_engine::model::{Model, pose_corrections::PoseCorrections};

impl PreparedGaussians {
    /// Makes the start of a drafted run from its model, which gets poses to refine if the settings say so.
    pub fn new(draft: Draft<'_>, mut model: Model) -> Self {
        let warnings = draft.warnings();
        if draft.settings.pose_refinement.is_some() {
            let views = draft.scene.input_views.iter();
            let times = views.map(|view| view.view.time_seconds);
            model.poses = Some(PoseCorrections::new(times.collect()));
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
