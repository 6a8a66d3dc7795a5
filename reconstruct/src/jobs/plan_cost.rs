//! Components of a method by the evidence of a scene, and the savings from leaving out the rest.
//!
//! The decisions are the method's own, as a run makes and records them. Here their cost stands beside that of the
//! same method under the plan full: first Gaussians, bytes of their tables, and the work of a step ([`StepWork`]).
//! Times would change with everything else that the machine does. For a GPU there is
//! also its memory.

use std::{collections::BTreeSet, path::Path};

use omnilife_engine::step::{gpu::memory::DevicePlan, settings::TrainSettings};
use omnilife_schemas::records::ComponentDecision;
use serde::Deserialize;

use crate::registry;
use omnilife_training::{
    components::{self, static_table},
    error::ReconstructError,
    learner::{Learner, ModelSize, work::StepWork},
    method::{Method, Prepared},
    request::{BackendChoice, MethodRequest, PlanChoice},
    scene::TrainingScene,
};

/// Cost of a plan before the first step.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PlanCost {
    /// Size of the model at the start of its training.
    pub size: ModelSize,
    /// Mean work of the steps; `None` for models whose work is not counted.
    pub work: Option<StepWork>,
}

/// The decisions on a scene and their cost.
#[derive(Debug, Clone, PartialEq)]
pub struct ScenePlan {
    /// The method.
    pub method: String,
    /// The scene.
    pub scene: String,
    /// Used and left-out components, with the evidence.
    pub decisions: Vec<ComponentDecision>,
    /// Cost of this plan.
    pub planned: PlanCost,
    /// Cost of the plan full; `None` where both are the same.
    pub full: Option<PlanCost>,
    /// Memory of the plan's training on the GPU; `None` for the CPU.
    pub device: Option<DevicePlan>,
}

impl PlanCost {
    fn of(prepared: &Prepared<'_>) -> Self {
        Self {
            size: prepared.learner.size(),
            work: prepared.learner.work(),
        }
    }
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

/// Decides a method's components on a scene, and measures them against all of them on a backend.
///
/// # Errors
/// When the scene cannot be loaded, or the request does not suit the method or the backend.
pub fn plan(
    scene: &Path,
    split: &Path,
    method: &str,
    request: &MethodRequest,
    backend: BackendChoice,
) -> Result<ScenePlan, ReconstructError> {
    let method = registry::find(method)?;
    method.check(request, backend)?;
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
    let prepare = |request: &MethodRequest| method.prepare(&scene, request, backend);
    let (planned, full) = (prepare(request)?, prepare(&full)?);
    let of_full = (!are_the_same(&planned, &full)).then(|| PlanCost::of(&full));
    // Its memory is free before the adapter is tried.
    drop(full);
    let cost = PlanCost::of(&planned);
    let Prepared {
        learner,
        configuration,
        findings,
        ..
    } = planned;
    let device = match backend {
        BackendChoice::Cpu => None,
        BackendChoice::Gpu => Some(device_plan(&scene, learner, &configuration)?),
    };
    Ok(ScenePlan {
        method: method.id.to_owned(),
        scene: scene.id.clone(),
        planned: cost,
        full: of_full,
        decisions: points.into_iter().chain(findings.plan).collect(),
        device,
    })
}

/// Returns the memory of a learner's training on the GPU.
fn device_plan(
    scene: &TrainingScene,
    mut learner: Box<dyn Learner + '_>,
    configuration: &serde_json::Value,
) -> Result<DevicePlan, ReconstructError> {
    if let Some(plan) = learner.device_plan()? {
        return Ok(plan);
    }
    let unknown = |reason: String| ReconstructError::Request { reason };
    let settings = TrainSettings::deserialize(configuration)
        .map_err(|error| unknown(format!("the method's settings: {error}")))?;
    let model = learner.gaussians()?.cloned();
    let model = model.ok_or_else(|| unknown("the method has no Gaussians".to_owned()))?;
    drop(learner);
    Ok(DevicePlan::of(scene.inputs(), model, &settings)?)
}

/// Writes a training's memory on the GPU in a line.
fn on_device(plan: &DevicePlan) -> String {
    let megabytes = |bytes: u64| bytes as f64 / 1e6;
    let held = plan.refusal.as_ref().map_or_else(
        || "the adapter holds them".to_owned(),
        |error| format!("the adapter does not hold them: {error}"),
    );
    let model = plan.gaussians.map_or_else(
        || "the model".to_owned(),
        |gaussians| format!("at most {gaussians} Gaussians"),
    );
    format!(
        "On {} ({}): {model} in {:.1} MB, the largest buffer ({}) in {:.1} of {:.1} MB; {held}\n",
        plan.adapter.name,
        plan.adapter.kind,
        megabytes(plan.buffers.bytes),
        plan.buffers.largest,
        megabytes(plan.buffers.largest_bytes),
        megabytes(plan.largest_allowed)
    )
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
        text += "\n| Plan | Static Gaussians | Moving Gaussians | At most | Trained values | Pixels a step | Tables, MB |\n";
        text += "|---|---:|---:|---:|---:|---:|---:|\n";
        let plans = [("this", Some(&self.planned)), ("full", self.full.as_ref())];
        for (name, cost) in plans {
            if let Some(cost) = cost {
                text += &row(name, cost);
            }
        }
        for (name, cost) in plans {
            if let Some(parts) = cost.and_then(parts) {
                text += &format!("\nPlan {name}, share of the steps: {parts}\n");
            }
        }
        text += "\n";
        if let Some(device) = &self.device {
            text += &on_device(device);
        }
        text + &self.comparison()
    }

    /// Compares this plan with the plan full in a line.
    fn comparison(&self) -> String {
        let Some(full) = &self.full else {
            return "Both plans are the same\n".to_owned();
        };
        let mut compared = vec![format!(
            "tables {}",
            beside(
                self.planned.size.bytes as f64 / full.size.bytes as f64,
                ["smaller", "larger"]
            )
        )];
        if let (Some(work), Some(of_full)) = (&self.planned.work, &full.work) {
            let fewer = ["fewer", "more"];
            let values = work.values as f64 / of_full.values as f64;
            compared.push(format!("trained values {}", beside(values, fewer)));
            let pixels = beside(work.pixels / of_full.pixels, fewer);
            compared.push(format!("pixels a step {pixels}"));
        }
        format!("Beside the full plan: {}\n", compared.join(", "))
    }
}

fn row(name: &str, PlanCost { size, work }: &PlanCost) -> String {
    let of_work = |of: fn(&StepWork) -> u64| {
        work.as_ref()
            .map_or_else(|| "-".to_owned(), |work| of(work).to_string())
    };
    format!(
        "| {name} | {} | {} | {} | {} | {} | {:.1} |\n",
        size.primitives - size.with_times,
        size.with_times,
        of_work(|work| work.most_gaussians),
        of_work(|work| work.values),
        of_work(|work| work.pixels.round() as u64),
        size.bytes as f64 / 1e6
    )
}

/// Writes the parts that not every step has; `None` without any.
fn parts(cost: &PlanCost) -> Option<String> {
    let parts = &cost.work.as_ref()?.parts;
    let words = |(name, share): &(&str, f64)| format!("{name} {:.0} %", 100.0 * share);
    let words: Vec<String> = parts.iter().map(words).collect();
    (!words.is_empty()).then(|| words.join(", "))
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
    use omnilife_engine::device::{
        BufferDemand, GpuError,
        adapters::{AdapterKind, AdapterSummary},
    };

    use super::*;

    #[test]
    fn a_ratio_is_told_in_its_direction() {
        let words = |ratio| beside(ratio, ["smaller", "larger"]);
        assert_eq!(words(0.71), "29 % smaller");
        assert_eq!(words(1.004), "the same");
        assert_eq!(words(1.0131), "1 % larger");
        assert_eq!(words(f64::NAN), "the same");
    }

    fn plan(full: Option<PlanCost>) -> ScenePlan {
        ScenePlan {
            method: "odgs".to_owned(),
            scene: "street".to_owned(),
            decisions: Vec::new(),
            planned: PlanCost {
                size: ModelSize {
                    primitives: 10,
                    with_times: 4,
                    objects: None,
                    bytes: 1_000_000,
                },
                work: Some(StepWork {
                    values: 140,
                    pixels: 32_768.0,
                    most_gaussians: 50,
                    parts: vec![("poses moved", 0.95)],
                }),
            },
            full,
            device: None,
        }
    }

    #[test]
    fn the_cost_of_a_plan_is_counted_beside_that_of_all_components() {
        let mut full = plan(None).planned;
        full.size.bytes = 2_000_000;
        if let Some(work) = &mut full.work {
            work.values = 200;
            work.pixels = 65_536.0;
        }
        let text = plan(Some(full)).text();
        for words in [
            "| this | 6 | 4 | 50 | 140 | 32768 | 1.0 |",
            "| full | 6 | 4 | 50 | 200 | 65536 | 2.0 |",
            "Plan this, share of the steps: poses moved 95 %",
            "tables 50 % smaller, trained values 30 % fewer, pixels a step 50 % fewer",
        ] {
            assert!(text.contains(words), "{words}: {text}");
        }
        // Twice the same: no clock was read.
        assert_eq!(plan(None).text(), plan(None).text());
    }

    #[test]
    fn plans_that_are_the_same_are_not_compared() {
        let text = plan(None).text();
        assert!(text.contains("Both plans are the same"), "{text}");
        assert!(
            !text.contains("| full |") && !text.contains("fewer"),
            "{text}"
        );
    }

    #[test]
    fn work_that_is_not_counted_has_no_number() {
        let mut plan = plan(None);
        plan.planned.work = None;
        let text = plan.text();
        assert!(
            text.contains("| this | 6 | 4 | - | - | - | 1.0 |"),
            "{text}"
        );
    }

    #[test]
    fn what_an_adapter_does_not_hold_is_told_with_the_buffer() {
        let mut plan = DevicePlan {
            adapter: AdapterSummary {
                name: "card".to_owned(),
                backend: "vulkan".to_owned(),
                driver: String::new(),
                kind: AdapterKind::DiscreteGpu,
            },
            gaussians: Some(500),
            buffers: BufferDemand {
                bytes: 3_000_000,
                largest_bytes: 2_000_000,
                largest: "entry sums",
            },
            largest_allowed: 1_000_000,
            refusal: None,
        };
        let text = on_device(&plan);
        assert!(
            text.contains("500 Gaussians in 3.0 MB")
                && text.contains("(entry sums) in 2.0 of 1.0 MB"),
            "{text}"
        );
        assert!(text.contains("the adapter holds them"), "{text}");
        plan.gaussians = None;
        let text = on_device(&plan);
        assert!(text.contains("the model in 3.0 MB"), "{text}");
        plan.refusal = Some(GpuError::OutOfMemory {
            adapter: "card".to_owned(),
            what: "entry sums".to_owned(),
            bytes: 2_000_000,
        });
        let text = on_device(&plan);
        assert!(
            text.contains("does not hold them: the memory of the GPU card"),
            "{text}"
        );
        assert_eq!(text.lines().count(), 1);
    }
}
