//! Aids of a method and of a run.

use std::collections::BTreeMap;

use omnilife_schemas::records::ComponentDecision;

use super::{
    Supported, camera_response, dropout, exposure_compensation, pose_refinement,
    view_dependent_colour,
};
pub use crate::aids::{AIDS, ALL, BY_NAME, is_aid};

/// Aids that methods of Gaussians have on request, because their gain depends on the scene.
pub const ON_REQUEST: &[&str] = &[
    exposure_compensation::ID,
    camera_response::ID,
    view_dependent_colour::ID,
    pose_refinement::ID,
    dropout::ID,
];

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
    use crate::components::{denser_points, mask_seeds, short_schedule, static_table};

    #[test]
    fn aids_are_components() {
        let own = [
            short_schedule::ID,
            denser_points::ID,
            mask_seeds::ID,
            static_table::ID,
        ];
        let all: Vec<&str> = own.iter().chain(ON_REQUEST).copied().collect();
        assert_eq!(all.len(), AIDS.len());
        assert!(all.iter().all(|aid| is_aid(aid)));
    }

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
