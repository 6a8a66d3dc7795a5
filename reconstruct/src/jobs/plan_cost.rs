//! What a scene gives a method reason for, and what leaving out the rest saves.
//!
//! The decisions are the method's own (`methods/`), as a run makes them and its record keeps them.
//! Here they stand beside the cost of the same method under the plan full: first Gaussians, bytes of
//! their tables, and the time of a step, measured.

use std::path::Path;

use omnilife_schemas::records::ComponentDecision;

use crate::{
    components,
    error::ReconstructError,
    learner::ModelSize,
    methods::{self, Method},
    request::{BackendChoice, MethodRequest, PlanChoice},
    scene::TrainingScene,
    train::timing,
};

/// The decisions on a scene and their cost.
#[derive(Debug, Clone, PartialEq)]
pub struct ScenePlan {
    /// The method.
    pub method: String,
    /// The scene.
    pub scene: String,
    /// What is used and what is left out, with the evidence.
    pub decisions: Vec<ComponentDecision>,
    /// Cost of what is used.
    pub planned: PlanCost,
    /// Cost of the same method under the plan full.
    pub full: PlanCost,
}

/// What a model costs at the beginning of its training.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanCost {
    /// What it is made of, with the bytes of everything that is trained.
    pub size: ModelSize,
    /// Least wall-clock time of a training step, seconds.
    pub step_seconds: f64,
}

/// Steps of each model that are timed.
const TIMED_STEPS: usize = 9;

/// Decides a method's components on a scene.
///
/// # Errors
/// When the scene cannot be loaded, or the request makes no sense for the method.
pub fn decisions(
    scene: &Path,
    split: &Path,
    method: &Method,
    request: &MethodRequest,
) -> Result<Vec<ComponentDecision>, ReconstructError> {
    let mut scene = TrainingScene::load(scene, split, method.camera_extent())?;
    let points = components::complete_points(&mut scene, method.supported(), request);
    let prepared = method.prepare(&scene, request, BackendChoice::Cpu)?;
    Ok(points.into_iter().chain(prepared.plan).collect())
}

/// Decides a method's components on a scene, and measures them against all of them.
///
/// # Errors
/// When the scene cannot be loaded, or the request makes no sense for the method.
pub fn plan(
    scene: &Path,
    split: &Path,
    method: &str,
    request: &MethodRequest,
) -> Result<ScenePlan, ReconstructError> {
    let method = methods::find(method)?;
    method.check(request, BackendChoice::Cpu)?;
    let mut scene = TrainingScene::load(scene, split, method.camera_extent())?;
    let points = components::complete_points(&mut scene, method.supported(), request);
    let full = MethodRequest {
        plan: PlanChoice::Full,
        without: Vec::new(),
        ..request.clone()
    };
    let prepare = |request: &MethodRequest| method.prepare(&scene, request, BackendChoice::Cpu);
    let (mut planned, mut full) = (prepare(request)?, prepare(&full)?);
    let sizes = [planned.learner.size(), full.learner.size()];
    let seconds = timing::step_seconds(
        [&mut *planned.learner, &mut *full.learner],
        (scene.input_views.len(), request.iterations),
        TIMED_STEPS,
    )?;
    let cost = |index: usize| PlanCost {
        size: sizes[index],
        step_seconds: seconds[index],
    };
    Ok(ScenePlan {
        method: method.id.to_owned(),
        scene: scene.id.clone(),
        decisions: points.into_iter().chain(planned.plan).collect(),
        planned: cost(0),
        full: cost(1),
    })
}

impl ScenePlan {
    /// The decisions as a Markdown table, and the cost.
    pub fn text(&self) -> String {
        let mut text = format!("{} on {}\n\n", self.method, self.scene);
        text += "| Component | Used | Evidence |\n|---|---|---|\n";
        for decision in &self.decisions {
            text += &format!(
                "| {} | {} | {} |\n",
                decision.component,
                if decision.used { "yes" } else { "no" },
                decision.reason
            );
        }
        text += "\n| Plan | Static Gaussians | Moving Gaussians | Tables, MB | Step, ms |\n";
        text += "|---|---:|---:|---:|---:|\n";
        for (name, cost) in [("this", &self.planned), ("full", &self.full)] {
            text += &format!(
                "| {name} | {} | {} | {:.1} | {:.1} |\n",
                cost.size.primitives - cost.size.with_times,
                cost.size.with_times,
                cost.size.bytes as f64 / 1e6,
                1e3 * cost.step_seconds
            );
        }
        text += &format!(
            "\nBeside the full plan: tables {}, a step {}\n",
            beside(
                self.planned.size.bytes as f64 / self.full.size.bytes as f64,
                ["smaller", "larger"]
            ),
            beside(
                self.planned.step_seconds / self.full.step_seconds,
                ["shorter", "longer"]
            )
        );
        text
    }
}

/// A ratio in words: `29 % smaller`, `the same`. What a plan leaves out can be what saves memory.
fn beside(ratio: f64, [less, more]: [&str; 2]) -> String {
    let percent = (100.0 * (ratio - 1.0)).round();
    match percent {
        change if change < 0.0 => format!("{:.0} % {less}", -change),
        change if change > 0.0 => format!("{change:.0} % {more}"),
        _ => "the same".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ratio_is_told_in_its_direction() {
        let words = |ratio| beside(ratio, ["smaller", "larger"]);
        assert_eq!(words(0.71), "29 % smaller");
        assert_eq!(words(1.004), "the same");
        assert_eq!(words(1.0131), "1 % larger");
        assert_eq!(words(f64::NAN), "the same");
    }
}
