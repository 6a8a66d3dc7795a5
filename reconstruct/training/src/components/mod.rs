//! Components: parts of a run that any method may have, one file each, one line in [`COMPONENTS`].
//!
//! A component decides by the [evidence](crate::evidence) whether a scene needs it ([`Decision`]); the user's
//! request and plan may overrule that. A used component changes the [`Draft`] of a run: its settings, or its
//! first Gaussians. Every method lists its default components and its optional ones ([`Supported`]).
//!
//! Two come before all others, which use their points: [`swept_points`] for scenes without points,
//! [`denser_points`] for scenes with points ([`complete_points`]).
//!
//! A new one needs its file, a line in [`COMPONENTS`], and its id in the lists of its methods; one that helps any
//! method is one of the [`aids`]. A test (`reconstruct/tests/all/no_ops.rs`) trains every method with and without
//! each of its components, and with a hundred times its weight. A component that changes no image may be in no plan
//! and in no table.

pub mod aids;
pub mod camera_response;
mod decision;
mod decision_log;
pub mod denser_points;
pub mod draft;
pub mod dropout;
pub mod exposure_compensation;
pub mod mask_seeds;
pub mod pose_refinement;
pub mod short_schedule;
pub mod sky_shell;
pub mod static_table;
pub mod swept_points;
pub mod view_dependent_colour;

pub use decision::Decision;
pub use decision_log::DecisionLog;
pub use draft::{Draft, MotionEvidenceUse};

use omnilife_schemas::records::ComponentDecision;

use crate::{
    evidence::{SceneEvidence, masks::MaskEvidence},
    request::MethodRequest,
    scene::TrainingScene,
};

/// A part of a run that any method may have.
#[derive(Debug, Clone, Copy)]
pub struct Component {
    /// Name on the command line and in records.
    pub id: &'static str,
    /// Full name.
    pub title: &'static str,
    /// Effect and evidence.
    pub description: &'static str,
    /// Turn in the making of a run.
    pub turn: Turn,
    /// Returns true if deciding on it or using it needs a pilot fit.
    pub needs_pilot: fn(&MethodRequest, &MaskEvidence) -> bool,
    /// Decides by the evidence, for a run as drafted so far.
    pub decide: fn(&SceneEvidence, &Draft<'_>) -> Decision,
    /// Applies it to the run.
    pub apply: fn(&mut Draft<'_>),
}

/// Turn of a component in the making of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Turn {
    /// Before Gaussians are placed at the scene's points.
    BeforePoints,
    /// After Gaussians are placed at the scene's points.
    AfterPoints,
}

/// Component: masks supervise the dynamic Gaussians.
pub const DYNAMIC_MASK: &str = "dynamic-mask";
/// Component: no velocities outside the masks.
pub const VELOCITY_REGULARIZATION: &str = "velocity-regularization";
/// Components that learn from masks of moving content.
pub const FED_BY_MASKS: [&str; 3] = [DYNAMIC_MASK, VELOCITY_REGULARIZATION, mask_seeds::ID];

/// The components that a method can have, by id.
#[derive(Debug, Clone, Copy)]
pub struct Supported {
    /// Default components.
    pub default: &'static [&'static str],
    /// Components on request.
    pub optional: &'static [&'static str],
}

/// All components, in the order of their turns: gains before the colours of first Gaussians, and seeds before the
/// sky, which takes its share of the remaining room.
pub const COMPONENTS: &[Component] = &[
    exposure_compensation::COMPONENT,
    camera_response::COMPONENT,
    view_dependent_colour::COMPONENT,
    pose_refinement::COMPONENT,
    short_schedule::COMPONENT,
    dropout::COMPONENT,
    mask_seeds::COMPONENT,
    sky_shell::COMPONENT,
    static_table::COMPONENT,
];

/// Adds the points that a scene lacks, if a method and a request have components for that.
pub fn complete_points(
    scene: &mut TrainingScene,
    supported: Supported,
    request: &MethodRequest,
) -> Option<ComponentDecision> {
    if scene.points.is_empty() {
        swept_points::complete(scene, supported, request)
    } else {
        denser_points::complete(scene, supported, request)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn components_are_unique_and_described() {
        for (index, component) in COMPONENTS.iter().enumerate() {
            let earlier = &COMPONENTS[..index];
            assert!(earlier.iter().all(|other| other.id != component.id));
            assert!(component.title.len() > 4 && component.description.len() > 40);
            let is_name = |c: char| c.is_ascii_lowercase() || c == '-';
            assert!(component.id.chars().all(is_name), "{}", component.id);
        }
        let turns = COMPONENTS.iter().map(|component| component.turn);
        let after = turns.skip_while(|turn| *turn == Turn::BeforePoints);
        assert!(after.into_iter().all(|turn| turn == Turn::AfterPoints));
        for id in aids::AIDS {
            let is_known = COMPONENTS.iter().any(|component| component.id == *id);
            assert!(is_known || *id == denser_points::ID);
        }
    }
}
