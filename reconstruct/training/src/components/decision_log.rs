//! Decisions on the components of a run, in the order in which they are made.

use omnilife_schemas::records::ComponentDecision;

use crate::{components::Decision, request::MethodRequest};

/// Decisions so far, each resolved under what the request says of its component.
#[derive(Debug)]
pub struct DecisionLog<'a> {
    /// What is asked of the method.
    pub request: &'a MethodRequest,
    decisions: Vec<ComponentDecision>,
}

impl<'a> DecisionLog<'a> {
    /// Begins a log without decisions.
    pub fn new(request: &'a MethodRequest) -> Self {
        Self {
            request,
            decisions: Vec::new(),
        }
    }

    /// Resolves and logs a decision on a component; returns true where it is used.
    pub fn decide(&mut self, component: &str, decision: Decision) -> bool {
        self.push(decision.resolved(component, self.request))
    }

    /// Resolves and logs a decision on a component of one part of a model; returns true where it is used.
    pub fn decide_for(&mut self, component: &str, part: &str, decision: Decision) -> bool {
        let mut line = decision.resolved(component, self.request);
        line.component = format!("{component}:{part}");
        self.push(line)
    }

    /// Logs what is decided already; returns true where the component is used.
    pub(crate) fn push(&mut self, decision: ComponentDecision) -> bool {
        let used = decision.used;
        self.decisions.push(decision);
        used
    }

    /// Returns true where a component was decided on and is used.
    pub(crate) fn is_used(&self, component: &str) -> bool {
        let mut decisions = self.decisions.iter();
        decisions.any(|decision| decision.component == component && decision.used)
    }

    /// Returns a line for each component that the request asks for and that is not used.
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

    /// Ends the log.
    pub fn into_decisions(self) -> Vec<ComponentDecision> {
        self.decisions
    }
}
