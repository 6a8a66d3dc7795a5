//! Which components a run has: by request, by plan, by what the scene gives reason for.

use omnilife_schemas::records::ComponentDecision;

pub(crate) mod pose_refinement;

use crate::request::MethodRequest;
use crate::request::PlanChoice;

/// Decides components and writes the decisions down.
#[derive(Debug)]
pub(crate) struct Components<'r> {
    request: &'r MethodRequest,
    /// The decisions so far.
    pub(crate) plan: Vec<ComponentDecision>,
}

impl<'r> Components<'r> {
    pub(crate) fn new(request: &'r MethodRequest, plan: Vec<ComponentDecision>) -> Self {
        Self { request, plan }
    }

    /// Whether a component is used. Where neither request nor plan decide, `evidence` does; what it
    /// says stands in the record either way.
    pub(crate) fn decide(&mut self, component: &str, evidence: (bool, String)) -> bool {
        let is_named = |names: &[String]| names.iter().any(|name| name == component);
        let (by_evidence, reason) = evidence;
        let (used, reason) = if is_named(&self.request.without) {
            (false, format!("left out on request; {reason}"))
        } else {
            match &self.request.plan {
                PlanChoice::Auto => (by_evidence, reason),
                PlanChoice::Full => (true, format!("the plan is full; {reason}")),
                PlanChoice::Only(names) if is_named(names) => {
                    (true, format!("named in the plan; {reason}"))
                }
                PlanChoice::Only(_) => (false, format!("not named in the plan; {reason}")),
            }
        };
        self.record(component, used, reason);
        used
    }

    /// [`Components::decide`] for what cannot be without something else: `missing` says what, where it
    /// is not there.
    pub(crate) fn decide_with(
        &mut self,
        component: &str,
        missing: Option<&str>,
        evidence: (bool, String),
    ) -> bool {
        match missing {
            None => self.decide(component, evidence),
            Some(missing) => {
                self.record(component, false, format!("cannot be without {missing}"));
                false
            }
        }
    }

    /// Adds what was found out about a component later on.
    pub(crate) fn add_reason(&mut self, component: &str, reason: &str) {
        for decision in &mut self.plan {
            if decision.component == component {
                decision.reason += &format!("; {reason}");
            }
        }
    }

    /// Writes a decision down that was made elsewhere.
    pub(crate) fn record(&mut self, component: &str, used: bool, reason: String) {
        self.plan.push(ComponentDecision {
            component: component.to_owned(),
            used,
            reason,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decided(plan: PlanChoice, without: &[&str], evidence: bool) -> ComponentDecision {
        let request = MethodRequest {
            plan,
            without: without.iter().map(|&name| name.to_owned()).collect(),
            ..MethodRequest::new(1, 0)
        };
        let mut components = Components::new(&request, Vec::new());
        let used = components.decide("masks", (evidence, "3 masks".to_owned()));
        assert_eq!(components.plan[0].used, used);
        components.plan.remove(0)
    }

    #[test]
    fn what_a_component_needs_goes_before_everything() {
        let request = MethodRequest {
            plan: PlanChoice::Full,
            ..MethodRequest::new(1, 0)
        };
        let mut components = Components::new(&request, Vec::new());
        let evidence = (true, "evidence".to_owned());
        assert!(!components.decide_with("a", Some("masks"), evidence.clone()));
        assert!(components.decide_with("b", None, evidence));
        assert_eq!(components.plan[0].reason, "cannot be without masks");
    }

    #[test]
    fn a_request_goes_before_the_plan_and_the_plan_before_the_evidence() {
        for evidence in [true, false] {
            assert_eq!(decided(PlanChoice::Auto, &[], evidence).used, evidence);
            assert!(decided(PlanChoice::Full, &[], evidence).used);
            assert!(!decided(PlanChoice::Full, &["masks"], evidence).used);
            let only = |name: &str| PlanChoice::Only(vec![name.to_owned()]);
            assert!(decided(only("masks"), &[], evidence).used);
            assert!(!decided(only("others"), &[], evidence).used);
        }
        let decision = decided(PlanChoice::Auto, &["masks"], true);
        assert_eq!(decision.reason, "left out on request; 3 masks");
    }
}
