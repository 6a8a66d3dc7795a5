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
    /// Components to leave out whatever the scene says.
    pub without: Vec<String>,
    /// How the others are decided.
    pub plan: PlanChoice,
    /// Iterations from one row of the trace to the next; ten rows where none is given.
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
            without: Vec::new(),
            plan: PlanChoice::Auto,
            trace_every: None,
            options: Options::default(),
        }
    }
}

/// How components that were not left out by name are decided.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PlanChoice {
    /// The scene's evidence decides.
    #[default]
    Auto,
    /// All of the method's components, and every Gaussian carries every parameter, as published.
    Full,
    /// These alone.
    Only(Vec<String>),
}
