//! Aids: components that help any method whose Gaussians can have them.
//!
//! They belong neither to a published method nor to one of this project. Scores compare methods only where both use
//! the same aids. So methods of one class have the same aids by default, and records of runs say which they used.
//!
//! [`ALL`] in a request stands for all of them. `--without aids` leaves them out: the bare method. `--with aids` lets
//! the evidence decide on the optional ones too.

use std::collections::BTreeMap;

use omnilife_schemas::records::ComponentDecision;

use super::{
    Supported, denser_points, dropout, exposure_compensation, mask_seeds, pose_refinement,
    short_schedule, static_table, view_dependent_colour,
};

/// Name of all aids together in a request.
pub const ALL: &str = "aids";

/// The aids.
pub const AIDS: &[&str] = &[
    exposure_compensation::ID,
    view_dependent_colour::ID,
    pose_refinement::ID,
    short_schedule::ID,
    dropout::ID,
    denser_points::ID,
    mask_seeds::ID,
    static_table::ID,
];

/// Aids that methods of Gaussians have on request. They need a pilot fit, and their gain depends on the scene.
pub const ON_REQUEST: &[&str] = &[
    exposure_compensation::ID,
    view_dependent_colour::ID,
    pose_refinement::ID,
    dropout::ID,
];

/// Returns true for an aid.
pub fn is_aid(component: &str) -> bool {
    AIDS.contains(&component)
}

impl Supported {
    /// Returns the aids that a method can have, by default or on request.
    pub fn aids(self) -> impl Iterator<Item = &'static str> {
        let all = self.default.iter().chain(self.optional).copied();
        all.filter(|name| is_aid(name))
    }

    /// Returns the aids that a method can have, each with true if a run with these decisions uses it.
    pub fn used_aids(self, plan: &[ComponentDecision]) -> BTreeMap<String, bool> {
        let is_used = |aid: &str| {
            let mut plan = plan.iter();
            plan.any(|decision| decision.component == aid && decision.used)
        };
        let aids = self.aids();
        aids.map(|aid| (aid.to_owned(), is_used(aid))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn aids_are_told_from_other_components_and_said_to_be_used_or_not() {
        let supported = Supported {
            default: &["sky-shell", short_schedule::ID],
            optional: ON_REQUEST,
        };
        assert!(!is_aid("sky-shell") && !is_aid(ALL));
        let decision = |component: &str, used| ComponentDecision {
            component: component.to_owned(),
            used,
            reason: String::new(),
        };
        let plan = [
            decision("sky-shell", true),
            decision(short_schedule::ID, true),
            decision(dropout::ID, false),
        ];
        let used = supported.used_aids(&plan);
        assert_eq!(used.len(), 1 + ON_REQUEST.len());
        for (aid, used) in &used {
            assert_eq!(*used, aid == short_schedule::ID, "{aid}");
        }
    }
}
