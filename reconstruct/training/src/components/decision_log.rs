//! Decisions on the components of a run, in the order in which they are made.

use omnilife_schemas::records::ComponentDecision;

use crate::{components::Decision, request::MethodRequest};

/// Decisions so far, each resolved under the request.
#[derive(Debug)]
pub struct DecisionLog<'a> {
    /// The request.
    pub request: &'a MethodRequest,
    decisions: Vec<ComponentDecision>,
}

impl<'a> DecisionLog<'a> {
    /// Starts a log without decisions.
    pub fn new(request: &'a MethodRequest) -> Self {
        Self {
            request,
            decisions: Vec::new(),
        }
    }

    /// Resolves and logs a decision on a component; returns true if it is used.
    pub fn decide(&mut self, component: &str, decision: Decision) -> bool {
        self.push(decision.resolved(component, self.request))
    }

    /// Resolves and logs a decision on a component of one part of a model; returns true if it is used.
    pub fn decide_for(&mut self, component: &str, part: &str, decision: Decision) -> bool {
        let mut line = decision.resolved(component, self.request);
        line.component = format!("{component}:{part}");
        self.push(line)
    }

    /// Logs a resolved decision; returns true if the component is used.
    pub(crate) fn push(&mut self, decision: ComponentDecision) -> bool {
        let used = decision.used;
        self.decisions.push(decision);
        used
    }

    /// Returns true if a component was decided on and is used.
    pub(crate) fn is_used(&self, component: &str) -> bool {
        let mut decisions = self.decisions.iter();
        decisions.any(|decision| decision.component == component && decision.used)
    }

    /// Returns a line for each requested component that is not used.
    pub(crate) fn refusals(&self) -> impl Iterator<Item = String> {
        let refused = |decision: &&ComponentDecision| {
            !decision.used && self.request.asks_for(&decision.component)
        };
        self.decisions.iter().filter(refused).map(|decision| {
            format!(
                "{} was asked for and is not used: {}",
                decision.component, decision.reason
            )
        })
    }

    /// Returns the decisions.
    pub fn into_decisions(self) -> Vec<ComponentDecision> {
        self.decisions
    }
}
