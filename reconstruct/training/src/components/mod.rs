//! Components: parts of a run that any method may have, one file each, one line in [`COMPONENTS`].
//!
//! A component says by the [evidence](crate::evidence) whether a scene gives reason for it ([`Decision`]);
//! the user's request and plan may overrule that. Where it is used, it changes the [`Draft`] of a run: its
//! settings, or its first Gaussians. Every method names the components that it has by itself and those
//! that it can be asked for ([`Supported`]).
//!
//! Two go before all others, because these look at the points that they give: [`swept_points`] where a scene
//! has none, [`denser_points`] where it has some ([`complete_points`]).
//!
//! To add one: its file, a line in [`COMPONENTS`], and its id in the lists of the methods that can have it.

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
    /// What it does, and on what evidence.
    pub description: &'static str,
    /// When it takes its turn.
    pub turn: Turn,
    /// Whether a pilot fit is needed, to decide on it or to use it.
    pub needs_pilot: fn(&MethodRequest, &MaskEvidence) -> bool,
    /// What the evidence says of it for a run as drafted so far.
    pub decide: fn(&SceneEvidence, &Draft<'_>) -> Decision,
    /// Puts it into the run.
    pub apply: fn(&mut Draft<'_>),
}

/// When a component takes its turn in the making of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Turn {
    /// Before there are Gaussians at the scene's points.
    BeforePoints,
    /// After that.
    AfterPoints,
}

/// The components that a method can have, by id.
#[derive(Debug, Clone, Copy)]
pub struct Supported {
    /// Those that it has by itself.
    pub default: &'static [&'static str],
    /// Those that it has where they are asked for.
    pub optional: &'static [&'static str],
}

/// All components, in the order in which they take their turn: gains go before the colours of first
/// Gaussians, and seeds before the sky, which takes its share of what they leave.
pub const COMPONENTS: &[Component] = &[
    exposure_compensation::COMPONENT,
    view_dependent_colour::COMPONENT,
    pose_refinement::COMPONENT,
    short_schedule::COMPONENT,
    dropout::COMPONENT,
    mask_seeds::COMPONENT,
    sky_shell::COMPONENT,
    static_table::COMPONENT,
];

/// Components without an effect on what a Gaussian is: any trained method can be asked for them.
pub const OF_ANY_METHOD: &[&str] = &[
    exposure_compensation::ID,
    view_dependent_colour::ID,
    pose_refinement::ID,
    short_schedule::ID,
    dropout::ID,
    denser_points::ID,
];

/// Gives a scene the points that it lacks, as far as a method and a request have components for that.
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
        for id in OF_ANY_METHOD {
            let is_known = COMPONENTS.iter().any(|component| component.id == *id);
            assert!(is_known || *id == denser_points::ID);
        }
    }
}
