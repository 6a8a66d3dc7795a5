//! Components of a method by the evidence of a scene, and the savings from leaving out the rest.
//!
//! The decisions are the method's own, as a run makes and records them. Here they stand beside the cost of the
//! same method under the plan full: first Gaussians, bytes of their tables, and the time of a step. Steps are
//! measured in turns ([`PairedSteps`]) where the plans differ.

use std::{collections::BTreeSet, path::Path};

use omnilife_schemas::records::ComponentDecision;

use crate::registry;
use omnilife_training::{
    components::{self, static_table},
    error::ReconstructError,
    learner::ModelSize,
    method::{Method, Prepared},
    request::{BackendChoice, MethodRequest, PlanChoice},
    scene::TrainingScene,
    train::timing::{MedianRange, PairedSteps},
};

/// The decisions on a scene and their cost.
#[derive(Debug, Clone, PartialEq)]
pub struct ScenePlan {
    /// The method.
    pub method: String,
    /// The scene.
    pub scene: String,
    /// Used and left-out components, with the evidence.
    pub decisions: Vec<ComponentDecision>,
    /// Size of the model at the start of its training.
    pub planned: ModelSize,
    /// Its size under the plan full.
    pub full: ModelSize,
    /// Times of steps under this plan and under the plan full; `None` where both are the same.
    pub steps: Option<PairedSteps>,
}

/// Decides a method's components on a scene.
///
/// # Errors
/// When the scene cannot be loaded, or the request does not suit the method.
pub fn decisions(
    scene: &Path,
    split: &Path,
    method: &Method,
    request: &MethodRequest,
) -> Result<Vec<ComponentDecision>, ReconstructError> {
    let mut scene = TrainingScene::load(scene, split, method.camera_extent())?;
    let points = components::complete_points(&mut scene, method.supported(), request);
    let prepared = method.prepare(&scene, request, BackendChoice::Cpu)?;
    Ok(points.into_iter().chain(prepared.findings.plan).collect())
}

/// Decides a method's components on a scene, and measures them against all of them.
///
/// # Errors
/// When the scene cannot be loaded, or the request does not suit the method.
pub fn plan(
    scene: &Path,
    split: &Path,
    method: &str,
    request: &MethodRequest,
) -> Result<ScenePlan, ReconstructError> {
    let method = registry::find(method)?;
    method.check(request, BackendChoice::Cpu)?;
    let mut scene = TrainingScene::load(scene, split, method.camera_extent())?;
    let points = components::complete_points(&mut scene, method.supported(), request);
    let full = MethodRequest {
        plan: PlanChoice::Full,
        without: match request.plan {
            PlanChoice::Full => Vec::new(),
            // Every Gaussian at a scene point carries every parameter.
            PlanChoice::Auto | PlanChoice::Only(_) => vec![static_table::ID.to_owned()],
        },
        ..request.clone()
    };
    let prepare = |request: &MethodRequest| method.prepare(&scene, request, BackendChoice::Cpu);
    let (mut planned, mut full) = (prepare(request)?, prepare(&full)?);
    let [planned_size, full_size] = [planned.learner.size(), full.learner.size()];
    let steps = if are_the_same(&planned, &full) {
        None
    } else {
        Some(PairedSteps::measure(
            [&mut *planned.learner, &mut *full.learner],
            (scene.input_views.len(), request.iterations),
        )?)
    };
    Ok(ScenePlan {
        method: method.id.to_owned(),
        scene: scene.id.clone(),
        decisions: points.into_iter().chain(planned.findings.plan).collect(),
        planned: planned_size,
        full: full_size,
        steps,
    })
}

/// Returns true for plans that use the same components with the same settings on first models of one size.
fn are_the_same(left: &Prepared<'_>, right: &Prepared<'_>) -> bool {
    let used = |prepared: &Prepared<'_>| -> BTreeSet<String> {
        let decisions = prepared
            .findings
            .plan
            .iter()
            .filter(|decision| decision.used);
        decisions
            .map(|decision| decision.component.clone())
            .collect()
    };
    used(left) == used(right)
        && left.configuration == right.configuration
        && left.learner.size() == right.learner.size()
}

impl ScenePlan {
    /// Returns the decisions as a Markdown table, and the cost.
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
        let seconds = self.steps.as_ref().map_or([None; 2], PairedSteps::seconds);
        let plans = [("this", self.planned), ("full", self.full)];
        for ((name, size), seconds) in plans.into_iter().zip(seconds) {
            text += &format!(
                "| {name} | {} | {} | {:.1} | {} |\n",
                size.primitives - size.with_times,
                size.with_times,
                size.bytes as f64 / 1e6,
                milliseconds(seconds)
            );
        }
        text + "\n" + &self.comparison()
    }

    /// Compares this plan with the plan full in a line.
    fn comparison(&self) -> String {
        let Some(steps) = &self.steps else {
            return "Both plans are the same: no step was measured\n".to_owned();
        };
        format!(
            "Beside the full plan: tables {}; {}\n",
            beside(
                self.planned.bytes as f64 / self.full.bytes as f64,
                ["smaller", "larger"]
            ),
            steps_beside(steps.ratio(), steps.count())
        )
    }
}

/// Writes the time of a step for a table, with its range: `36.2 (35.1 to 40.9)`.
fn milliseconds(seconds: Option<MedianRange>) -> String {
    seconds.map_or_else(
        || "not measured".to_owned(),
        |MedianRange {
             least,
             median,
             most,
         }| {
            let [least, median, most] = [least, median, most].map(|seconds| 1e3 * seconds);
            format!("{median:.1} ({least:.1} to {most:.1})")
        },
    )
}

/// Compares a step of one plan with one of another by the ratio of their times. The text gives the direction with
/// its range, or no difference where the range has both directions.
fn steps_beside(ratio: Option<MedianRange>, pairs: usize) -> String {
    let Some(ratio) = ratio else {
        return "no step was measured".to_owned();
    };
    let percent = |ratio: f64| 100.0 * (ratio - 1.0).abs();
    if !ratio.excludes(1.0) || percent(ratio.median) < 0.5 {
        return format!(
            "no difference of their steps was measured (ratio {:.2} to {:.2} in {pairs} pairs)",
            ratio.least, ratio.most
        );
    }
    let ends = [ratio.least, ratio.most].map(percent);
    format!(
        "a step {} ({:.0} to {:.0} % in {pairs} pairs)",
        beside(ratio.median, ["shorter", "longer"]),
        ends[0].min(ends[1]),
        ends[0].max(ends[1])
    )
}

/// Writes a ratio in words: `29 % smaller`, `the same`. Left-out components can save memory.
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

    fn steps(least: f64, median: f64, most: f64) -> String {
        let ratio = MedianRange {
            least,
            median,
            most,
        };
        steps_beside(Some(ratio), 15)
    }

    #[test]
    fn steps_have_a_direction_only_where_their_whole_range_has_it() {
        assert_eq!(
            steps(0.7, 0.8, 0.95),
            "a step 20 % shorter (5 to 30 % in 15 pairs)"
        );
        assert_eq!(
            steps(1.1, 1.25, 2.0),
            "a step 25 % longer (10 to 100 % in 15 pairs)"
        );
        for (least, median, most) in [
            (0.64, 1.94, 2.1),
            (0.5, 0.64, 1.0),
            (1.0, 1.0, 1.0),
            (0.995, 0.998, 0.999),
            (f64::NAN, f64::NAN, f64::NAN),
        ] {
            let words = steps(least, median, most);
            assert!(
                !words.contains("shorter") && !words.contains("longer"),
                "{words}"
            );
        }
    }

    #[test]
    fn plans_that_are_the_same_are_not_compared() {
        let size = ModelSize {
            primitives: 10,
            with_times: 4,
            objects: None,
            bytes: 1_000_000,
        };
        let plan = ScenePlan {
            method: "odgs".to_owned(),
            scene: "street".to_owned(),
            decisions: Vec::new(),
            planned: size,
            full: size,
            steps: None,
        };
        let text = plan.text();
        assert!(text.contains("plans are the same"), "{text}");
        assert!(
            text.contains("| this | 6 | 4 | 1.0 | not measured |"),
            "{text}"
        );
        assert!(!text.contains(" %") && !text.contains("shorter"), "{text}");
    }
}
