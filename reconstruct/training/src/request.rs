//! What a user asks of a method.

pub use omnilife_engine::step::BackendChoice;
use serde::{Deserialize, Serialize};

use crate::options::Options;

/// What a user asks of a method.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MethodRequest {
    /// Steps of the optimizer; schedules are scaled to it.
    pub iterations: u64,
    /// Wall-clock limit in seconds.
    pub budget_seconds: Option<f64>,
    /// Random seed.
    pub seed: u64,
    /// Components to use whatever the scene and the plan say; those too that the method does not have
    /// by itself.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub with: Vec<String>,
    /// Components to leave out whatever the scene and the plan say.
    pub without: Vec<String>,
    /// How the others are decided.
    pub plan: PlanChoice,
    /// Iterations from one row of the trace to the next; rows at equal ratios of iterations where none is given.
    pub trace_every: Option<u64>,
    /// What the method alone understands.
    pub options: Options,
}

impl MethodRequest {
    /// A request that leaves everything else to the method.
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

    /// Whether a component is asked for by name.
    pub fn asks_for(&self, component: &str) -> bool {
        self.with.iter().any(|name| name == component)
    }

    /// Whether a component is left out by name.
    pub fn leaves_out(&self, component: &str) -> bool {
        self.without.iter().any(|name| name == component)
    }

    /// Whether a component may be used, whatever the evidence.
    pub fn allows(&self, component: &str) -> bool {
        !self.leaves_out(component)
            && (self.asks_for(component)
                || match &self.plan {
                    PlanChoice::Auto | PlanChoice::Full => true,
                    PlanChoice::Only(names) => names.iter().any(|name| name == component),
                })
    }

    /// Whether the evidence decides on a component.
    pub fn leaves_to_evidence(&self, component: &str) -> bool {
        self.plan == PlanChoice::Auto && !self.leaves_out(component) && !self.asks_for(component)
    }
}

/// How a method's components are decided where a request does not say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DefaultPlan {
    /// The scene's evidence decides: methods of this project, and those without a choice.
    Auto,
    /// All of them, as published: methods of others.
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

/// How components that were neither asked for nor left out by name are decided.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlanChoice {
    /// The scene's evidence decides.
    #[default]
    Auto,
    /// All of the method's own components; every Gaussian at a scene point carries every parameter, as
    /// published. Those of the sky shell stay static.
    Full,
    /// These alone.
    Only(Vec<String>),
}
