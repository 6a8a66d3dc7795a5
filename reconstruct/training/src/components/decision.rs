//! Decision on a component: by its requirements, the request, the plan and the evidence, in this order.

use omnilife_schemas::records::ComponentDecision;

use crate::{
    components::aids,
    evidence::SceneEvidence,
    request::{MethodRequest, PlanChoice},
};

/// Decision on a component by the evidence.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Decision {
    used: bool,
    reason: String,
    overruled_by: Precedence,
}

/// Precedence over the evidence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Precedence {
    RequestAndPlan,
    /// A request, and a plan that names components; not the plan full.
    RequestAndNames,
    Request,
    Nothing,
}

impl Decision {
    /// Returns a decision with its reason, for components that neither request nor plan decide.
    pub fn new(used: bool, reason: impl Into<String>) -> Self {
        Self {
            used,
            reason: reason.into(),
            overruled_by: Precedence::RequestAndPlan,
        }
    }

    /// Returns the decision on a component for dynamic scenes.
    pub fn of_motion(evidence: &SceneEvidence) -> Self {
        Self::new(evidence.moves(), evidence.motion_reason())
    }

    /// Returns a decision against a component whose evidence was not gathered.
    pub fn not_looked_for() -> Self {
        Self::new(false, "its evidence was not looked for")
    }

    /// Returns a decision against a component that has nothing to do in this scene: used on request alone, and
    /// under a plan that names it.
    pub fn no_case(why: &str) -> Self {
        Self::new(false, format!("no case: {why}")).even_if_full()
    }

    /// Returns a decision against a component that no default plan has: used on request alone, and under a plan
    /// that names it.
    pub fn on_request(why: &str) -> Self {
        Self::new(false, format!("on request alone: {why}")).even_if_full()
    }

    /// Returns a decision against a component that the scene or the run cannot have, whatever request and plan
    /// say.
    pub fn without(missing: &str) -> Self {
        Self::new(false, format!("cannot be without {missing}")).settled()
    }

    /// Returns the decision, unless an input is missing.
    #[must_use]
    pub fn unless(self, missing: Option<&str>) -> Self {
        missing.map_or(self, Self::without)
    }

    /// Returns the decision without the plan's influence.
    #[must_use]
    pub fn whatever_the_plan(mut self) -> Self {
        self.overruled_by = Precedence::Request;
        self
    }

    /// Returns the decision without the influence of the plan full: for what adds nothing to a model that the
    /// evidence gives no reason for.
    #[must_use]
    pub fn even_if_full(mut self) -> Self {
        self.overruled_by = Precedence::RequestAndNames;
        self
    }

    /// Returns the decision without the influence of request and plan.
    #[must_use]
    pub fn settled(mut self) -> Self {
        self.overruled_by = Precedence::Nothing;
        self
    }

    /// Returns the decision under a request, for the record.
    pub(crate) fn resolved(self, component: &str, request: &MethodRequest) -> ComponentDecision {
        let Self {
            used,
            reason,
            overruled_by,
        } = self;
        let by_plan = || match &request.plan {
            _ if overruled_by == Precedence::Request => None,
            PlanChoice::Auto => None,
            PlanChoice::Full if overruled_by == Precedence::RequestAndNames => None,
            // Whoever asks for all aids leaves each to the evidence.
            PlanChoice::Full if request.asks_for(aids::ALL) && aids::is_aid(component) => None,
            PlanChoice::Full => Some((true, "the plan is full")),
            PlanChoice::Only(_) if request.allows(component) => Some((true, "named in the plan")),
            PlanChoice::Only(_) => Some((false, "not named in the plan")),
        };
        let overruled = if overruled_by == Precedence::Nothing {
            None
        } else if request.leaves_out(component) {
            Some((false, "left out on request"))
        } else if request.asks_for(component) {
            Some((true, "asked for"))
        } else {
            by_plan()
        };
        let (used, reason) = match overruled {
            Some((used, why)) => (used, format!("{why}; {reason}")),
            None => (used, reason),
        };
        ComponentDecision {
            component: component.to_owned(),
            used,
            reason,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(plan: PlanChoice, with: &[&str], without: &[&str]) -> MethodRequest {
        let owned = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
        MethodRequest {
            plan,
            with: owned(with),
            without: owned(without),
            ..MethodRequest::new(1, 0)
        }
    }

    #[test]
    fn a_request_goes_before_the_plan_and_the_plan_before_the_evidence() {
        let only = |name: &str| PlanChoice::Only(vec![name.to_owned()]);
        for evidence in [true, false] {
            let used = |plan, with: &[&str], without: &[&str]| {
                let request = request(plan, with, without);
                let decision = Decision::new(evidence, "3 masks");
                let decision = decision.resolved("masks", &request);
                assert!(decision.reason.ends_with("3 masks"));
                decision.used
            };
            assert_eq!(used(PlanChoice::Auto, &[], &[]), evidence);
            assert!(used(PlanChoice::Auto, &["masks"], &[]));
            assert!(used(PlanChoice::Full, &[], &[]));
            assert!(!used(PlanChoice::Full, &[], &["masks"]));
            assert!(used(only("masks"), &[], &[]));
            assert!(!used(only("others"), &[], &[]));
            assert!(used(only("others"), &["masks"], &[]));
        }
        let without = request(PlanChoice::Auto, &[], &["masks"]);
        let decision = Decision::new(true, "3 masks").resolved("masks", &without);
        assert_eq!(decision.reason, "left out on request; 3 masks");
    }

    #[test]
    fn what_a_component_needs_goes_before_everything() {
        let full = request(PlanChoice::Full, &["a"], &[]);
        let evidence = || Decision::new(true, "evidence");
        let decision = evidence().unless(Some("masks")).resolved("a", &full);
        assert_eq!(
            (decision.used, &*decision.reason),
            (false, "cannot be without masks")
        );
        assert!(evidence().unless(None).resolved("b", &full).used);
    }

    #[test]
    fn the_plan_full_asks_for_no_aid_that_the_evidence_is_against() {
        let points = || Decision::new(false, "no bare surface").even_if_full();
        let full = request(PlanChoice::Full, &[], &[]);
        assert!(!points().resolved("points", &full).used);
        let named = request(PlanChoice::Only(vec!["points".to_owned()]), &[], &[]);
        assert!(points().resolved("points", &named).used);
        let asked = request(PlanChoice::Full, &["points"], &[]);
        assert!(points().resolved("points", &asked).used);

        let poses = || Decision::new(false, "poses are exact");
        let aided = request(PlanChoice::Full, &[aids::ALL], &[]);
        assert!(poses().resolved("poses", &aided).used);
        assert!(!poses().resolved("pose-refinement", &aided).used);
        let bare = request(PlanChoice::Auto, &[], &[aids::ALL]);
        let used = || Decision::new(true, "poses are off");
        assert!(!used().resolved("pose-refinement", &bare).used);
        assert!(used().resolved("poses", &bare).used);
    }

    #[test]
    fn where_no_plan_has_a_say_a_request_still_has() {
        let sky = || Decision::new(false, "no sky").whatever_the_plan();
        let full = request(PlanChoice::Full, &[], &[]);
        assert!(!sky().resolved("sky", &full).used);
        let asked = request(PlanChoice::Full, &["sky"], &[]);
        assert!(sky().resolved("sky", &asked).used);
    }

    #[test]
    fn what_has_no_case_or_no_default_is_used_by_name_alone() {
        let only = |name: &str| PlanChoice::Only(vec![name.to_owned()]);
        for decision in [
            Decision::no_case("one shard is enough"),
            Decision::on_request("it changes nothing"),
        ] {
            let used = |plan, with: &[&str]| {
                let request = request(plan, with, &[]);
                decision.clone().resolved("a", &request).used
            };
            assert!(!used(PlanChoice::Auto, &[]) && !used(PlanChoice::Full, &[]));
            assert!(!used(only("b"), &[]));
            assert!(used(PlanChoice::Auto, &["a"]) && used(only("a"), &[]));
        }
        let request = request(PlanChoice::Auto, &[], &[]);
        let line = Decision::no_case("one shard is enough").resolved("a", &request);
        assert_eq!(line.reason, "no case: one shard is enough");
    }
}
