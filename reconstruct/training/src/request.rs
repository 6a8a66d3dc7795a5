//! A user's request to a method.

pub use omnilife_engine::step::BackendChoice;
use serde::{Deserialize, Serialize};

use crate::{aids, options::Options};

/// A user's request to a method.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MethodRequest {
    /// Steps of the optimizer; schedules are scaled to it.
    pub iterations: u64,
    /// Wall-clock limit in seconds.
    pub budget_seconds: Option<f64>,
    /// Random seed.
    pub seed: u64,
    /// Components to use whatever the scene and the plan say, optional ones included.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub with: Vec<String>,
    /// Components to leave out whatever the scene and the plan say.
    pub without: Vec<String>,
    /// Decision on the others.
    pub plan: PlanChoice,
    /// Iterations from one row of the trace to the next; `None` for rows at equal ratios of CPU time.
    pub trace_every: Option<u64>,
    /// Values of the method's own options.
    pub options: Options,
}

impl MethodRequest {
    /// Returns a request with defaults for the rest.
    pub fn new(iterations: u64, seed: u64) -> Self {
        Self {
            iterations,
            budget_seconds: None,
            seed,
            with: Vec::new(),
            without: Vec::new(),
            plan: PlanChoice::Auto,
            trace_every: None,
            options: Options::default(),
        }
    }

    /// Returns true if a component is requested by name.
    pub fn asks_for(&self, component: &str) -> bool {
        self.with.iter().any(|name| name == component)
    }

    /// Returns true if a component is left out by name, or an aid with all others, unless it is asked for.
    pub fn leaves_out(&self, component: &str) -> bool {
        let is_named = |name: &str| self.without.iter().any(|other| other == name);
        is_named(component)
            || is_named(aids::ALL) && aids::is_aid(component) && !self.asks_for(component)
    }

    /// Returns true if a component may be used, whatever the evidence.
    pub fn allows(&self, component: &str) -> bool {
        !self.leaves_out(component)
            && (self.asks_for(component)
                || match &self.plan {
                    PlanChoice::Auto | PlanChoice::Full => true,
                    PlanChoice::Only(names) => names.iter().any(|name| name == component),
                })
    }

    /// Returns true if the evidence decides on a component.
    pub fn leaves_to_evidence(&self, component: &str) -> bool {
        let with_aids = self.asks_for(aids::ALL) && aids::is_aid(component);
        (self.plan == PlanChoice::Auto || with_aids)
            && !self.leaves_out(component)
            && !self.asks_for(component)
    }
}

/// Default decision on a method's components.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DefaultPlan {
    /// The scene's evidence decides: for methods of this project, and those without a choice.
    Auto,
    /// All of them, as published: for methods of other authors.
    Full,
}

impl From<DefaultPlan> for PlanChoice {
    fn from(plan: DefaultPlan) -> Self {
        match plan {
            DefaultPlan::Auto => Self::Auto,
            DefaultPlan::Full => Self::Full,
        }
    }
}

/// Decision on components that were neither requested nor left out by name.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlanChoice {
    /// The scene's evidence decides.
    #[default]
    Auto,
    /// All of the method's own components. The evidence still decides on sky, denser points, dropout and the static
    /// table, and the length of the schedule on its steps.
    Full,
    /// Only these.
    Only(Vec<String>),
}
