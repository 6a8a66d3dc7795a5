//! What a user asks of a method.

use omnilife_engine::render::settings::Footprint;
pub use omnilife_engine::step::BackendChoice;
use serde::{Deserialize, Serialize};

/// What a user asks of a method.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MethodRequest {
    /// Steps of the optimizer; schedules are scaled to it.
    pub iterations: u64,
    /// Wall-clock limit in seconds.
    pub budget_seconds: Option<f64>,
    /// Random seed.
    pub seed: u64,
    /// The number of Gaussians never grows above this; the method decides where none is given.
    pub maximum_gaussians: Option<u64>,
    /// Degree of the spherical harmonics, 0 to 3; the method decides where none is given.
    pub sh_degree: Option<usize>,
    /// How a Gaussian's falloff in a pixel is defined.
    pub footprint: Footprint,
    /// Densification thresholds at the equator and at the poles; the method decides where none are
    /// given.
    pub densify_threshold: Option<[f32; 2]>,
    /// Components to use whatever the scene and the plan say; those too that the method does not have
    /// by itself.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub with: Vec<String>,
    /// Components to leave out whatever the scene and the plan say.
    pub without: Vec<String>,
    /// How the others are decided.
    pub plan: PlanChoice,
    /// Iterations from one row of the trace to the next; ten rows where none is given.
    pub trace_every: Option<u64>,
}

impl MethodRequest {
    /// A request that leaves everything else to the method.
    pub fn new(iterations: u64, seed: u64) -> Self {
        Self {
            iterations,
            budget_seconds: None,
            seed,
            maximum_gaussians: None,
            sh_degree: None,
            footprint: Footprint::default(),
            densify_threshold: None,
            with: Vec::new(),
            without: Vec::new(),
            plan: PlanChoice::Auto,
            trace_every: None,
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
