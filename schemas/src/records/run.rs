//! `run`: run of one method on one scene.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::poses::Poses;
use crate::{
    camera::Camera, elapsed::Elapsed, pose::Similarity, provenance::Hardware, store::Record,
};

/// `run.json`. Files are relative to its folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RunRecord {
    /// Id of the method.
    pub method: String,
    /// The method's name in tables, where components were asked for or left out by name, or decided
    /// by another plan than the method's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub variant: Option<String>,
    /// Id of the scene.
    pub scene: String,
    /// Hash of the split's protocol.
    pub protocol_hash: String,
    /// Random seed.
    pub seed: u64,
    /// Backend of the run.
    pub backend: Backend,
    /// The machine that computed it; records of older versions do not say.
    #[serde(default)]
    pub hardware: Option<Hardware>,
    /// Values of the method's own options that were given, `NAME=VALUE`; the others have their defaults.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub options: Vec<String>,
    /// Every setting as resolved, defaults included.
    pub configuration: serde_json::Value,
    /// Which components the scene was given, and why.
    pub plan: Vec<ComponentDecision>,
    /// Components that help any method: those that the method can have, each with true where the run used it; records
    /// of older versions and of other programs do not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub aids: Option<BTreeMap<String, bool>>,
    /// Evidence measured on the scene before training; methods that ask for no evidence and
    /// records of older versions have none.
    #[serde(default)]
    pub evidence: Option<serde_json::Value>,
    /// Names and versions of the programs involved, with the commit.
    pub versions: BTreeMap<String, String>,
    /// SHA-256 of every input by name.
    pub inputs: BTreeMap<String, String>,
    /// Iterations done.
    pub iterations: u64,
    /// Primitives of the model at the end: Gaussians, or what else the method is made of.
    #[serde(alias = "gaussians")]
    pub primitives: u64,
    /// Time to decide on components and to place first Gaussians, pilot fit included, wall-clock
    /// seconds; training time includes it. Records of older versions have none, and their training
    /// time is without it.
    #[serde(default)]
    pub planning_seconds: f64,
    /// CPU time of that (user and system, all threads), seconds, where the system tells.
    #[serde(default)]
    pub planning_cpu_seconds: Option<f64>,
    /// Training time in wall-clock seconds, planning included, rendering of predictions not.
    pub training_seconds: f64,
    /// CPU time of training (user and system, all threads), planning included, seconds, where the
    /// system tells.
    #[serde(default)]
    pub training_cpu_seconds: Option<f64>,
    /// Wall-clock time that rendering the trace's novel views took, seconds; training time does not
    /// include it.
    #[serde(default)]
    pub evaluation_seconds: f64,
    /// Rendering time of all predictions in wall-clock seconds.
    pub rendering_seconds: f64,
    /// CPU time of that (user and system, all threads), seconds, where the system tells.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rendering_cpu_seconds: Option<f64>,
    /// Mean time of a group from its given views to its novel ones, rendering included, seconds;
    /// of methods that work group by group.
    #[serde(default)]
    pub seconds_per_group: Option<f64>,
    /// Highest resident memory of the process since it began, bytes, where the system tells. In a
    /// process that did more than this run, that of all its work.
    pub peak_memory_bytes: Option<u64>,
    /// The camera of the trained views; records of older versions have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<Camera>,
    /// Mean direction up of the input views' cameras, in the world.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up: Option<[f64; 3]>,
    /// Times of the first and the last view that were trained with or predicted, seconds; records of older
    /// versions have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clip_seconds: Option<[f64; 2]>,
    /// Times of the stages before the run, from the video to its inputs, as far as records have them;
    /// [`RunRecord::stage_times`] adds those of the run itself.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stages: Vec<StageTime>,
    /// The cameras of these views, in the world, of runs with objects that can be moved: whether a moved one is in any
    /// view. Others, and records of older versions, have none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub views: Option<Poses>,
    /// The similarity under which the scene was trained.
    pub normalization: Similarity,
    /// CSV of where training stood, row by row.
    pub trace: Option<String>,
    /// Novel views that were rendered at the rows of the trace.
    #[serde(default)]
    pub trace_views: Option<TraceViews>,
    /// Ghosts and holes at the end, where the scene knows distances of input views and the model is made of
    /// Gaussians.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub surfaces: Option<SurfaceFaults>,
    /// Predicted views.
    pub predictions: ViewPredictions,
    /// Warnings that a reader of the scores should know.
    pub warnings: Vec<String>,
    /// Changes that were made to the model by hand after training. A run with any is never scored against the
    /// video. [`RunRecord::edited`] is the only way to add one.
    #[serde(default, skip_serializing_if = "Edits::is_empty")]
    pub edits: Edits,
}

/// Changes that were made to a model by hand, in their order, one line each.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Edits(Vec<String>);

impl Edits {
    /// Returns true where the model is as it was trained.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Returns the changes in their order.
    pub fn lines(&self) -> &[String] {
        &self.0
    }
}

impl RunRecord {
    /// Name of the stage that writes a run.
    pub const STAGE: &'static str = "reconstruct";

    /// Returns the record of this run's model after further changes. It names no predictions, trace or measured
    /// surfaces, because those are of the unchanged model. `novel_folder` is the folder into which views may be
    /// rendered.
    pub fn edited(mut self, lines: impl IntoIterator<Item = String>, novel_folder: &str) -> Self {
        self.edits.0.extend(lines);
        self.predictions = ViewPredictions {
            input_views: None,
            novel_views: novel_folder.to_owned(),
        };
        self.trace = None;
        self.trace_views = None;
        self.surfaces = None;
        self
    }
}

impl RunRecord {
    /// Returns the times of all stages from the video to rendered predictions, with planning apart from training.
    pub fn stage_times(&self) -> Vec<StageTime> {
        // Records of older versions have the CPU time of rendering among the stages alone.
        let mut older = self.stages.iter().filter(|stage| stage.stage == RENDERING);
        let older = older.find_map(|stage| stage.took.cpu_seconds);
        let rendering_cpu_seconds = self.rendering_cpu_seconds.or(older);
        let left = |all: f64, part: f64| (all - part).max(0.0);
        let cpu = |all: f64| left(all, self.planning_cpu_seconds.unwrap_or(0.0));
        let own = [
            (PLANNING, self.planning_seconds, self.planning_cpu_seconds),
            (
                TRAINING,
                left(self.training_seconds, self.planning_seconds),
                self.training_cpu_seconds.map(cpu),
            ),
            (RENDERING, self.rendering_seconds, rendering_cpu_seconds),
        ];
        let own = own
            .into_iter()
            .filter(|(_, wall_seconds, _)| *wall_seconds > 0.0);
        let own = own.map(|(stage, wall_seconds, cpu_seconds)| StageTime {
            stage: stage.to_owned(),
            method: None,
            took: Elapsed {
                wall_seconds,
                cpu_seconds,
            },
        });
        // Records of older versions have their own stages among those before.
        let before = self.stages.iter().filter(|stage| !stage.is_of_run());
        before.cloned().chain(own).collect()
    }
}

impl Record for RunRecord {
    const SCHEMA: &'static str = "omnilife/run/2";
    const OLDER: &'static [&'static str] = &["omnilife/run/1"];
}

/// Time of a stage on the way from a video to a model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StageTime {
    /// Its name: `frames`, `poses`, `dense`; of tracks `scale`, `detector`, `distance`, `appearance`, `association`,
    /// `trajectory`; of the run itself `planning`, `training` (without planning), `rendering`.
    pub stage: String,
    /// Which way was taken, where there are several.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub method: Option<String>,
    /// The time of it, when it was last computed.
    #[serde(flatten)]
    pub took: Elapsed,
}

impl StageTime {
    /// Returns whether it is a stage of the run itself, not one that made an input of the run.
    pub fn is_of_run(&self) -> bool {
        RUN_STAGES.contains(&self.stage.as_str())
    }
}

/// Planning, a stage of the run itself.
pub const PLANNING: &str = "planning";
/// Training, a stage of the run itself: steps and density control.
pub const TRAINING: &str = "training";
/// Rendering of predicted views, a stage of the run itself.
pub const RENDERING: &str = "rendering";
const RUN_STAGES: [&str; 3] = [PLANNING, TRAINING, RENDERING];

/// Backend of a run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Backend {
    /// The CPU.
    Cpu {
        /// Worker threads.
        threads: u32,
    },
    /// A GPU.
    Gpu {
        /// Its name as its driver gives it.
        adapter: String,
        /// The interface it is reached through: `vulkan`, `metal` or `dx12`.
        interface: String,
        /// Kind of adapter: `discrete GPU`, `integrated GPU`, `virtual GPU`, `software`,
        /// `unknown kind`.
        device: String,
        /// The driver's name and version, where it tells.
        driver: String,
        /// The limits that the kernels lived within, by their names in WebGPU.
        limits: BTreeMap<String, u64>,
        /// Threads of the smallest subgroup, where sums over pixels were taken in subgroups; none where
        /// they were taken in the memory of workgroups.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        subgroup_size: Option<u32>,
        /// True if gradients of splats were summed over pixels by a thread per splat.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        sums_per_splat: bool,
        /// True if one kernel computed Adam's steps from the gradients by splats.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        fused_adam: bool,
    },
}

/// Decision to use a component of a method or leave it out, with its evidence.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ComponentDecision {
    /// The component.
    pub component: String,
    /// `true` if it was used.
    pub used: bool,
    /// The evidence or the setting that decided.
    pub reason: String,
}

/// Position of Gaussians relative to the scene's known distances (`depth_prior` of its frames), with the factors by
/// which its input views agree best.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SurfaceFaults {
    /// Share of the Gaussians, weighted by opacity, whose centres stand in the free space of two input views
    /// or more, of twenty at most. Free is what lies before a surface by more than 2.5 tolerances: 2 %
    /// of the distance, or three times the views' disagreement.
    pub ghost_share: f64,
    /// Share of the pixels of input views with a known distance, masked ones left out, with an opacity below
    /// a half; of four views at most.
    pub input_hole_share: Option<f64>,
    /// The same of the novel views, where distances of them are known.
    pub novel_hole_share: Option<f64>,
}

/// Novel views along a trace: `<folder>/<iteration, 6 digits>/<frame, 6 digits>.png`. The views of the
/// last iteration are the predictions.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct TraceViews {
    /// Folder of the rows' folders.
    pub folder: String,
    /// The frames that are there at every row, as the split numbers them.
    pub frames: Vec<u32>,
}

/// Files of predictions: `<folder>/<frame, 6 digits>.png`, frame numbers as in the split.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ViewPredictions {
    /// Folder of predicted input views, where the method renders them.
    pub input_views: Option<String>,
    /// Folder of predicted novel views.
    pub novel_views: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planning_is_apart_from_training_and_older_records_repeat_nothing() {
        let record: RunRecord = serde_json::from_value(serde_json::json!({
            "method": "odgs", "scene": "walk", "protocol_hash": "", "seed": 0,
            "backend": {"kind": "cpu", "threads": 2}, "configuration": null, "plan": [], "versions": {}, "inputs": {},
            "iterations": 10, "primitives": 5, "planning_seconds": 2.0, "planning_cpu_seconds": 3.0,
            "training_seconds": 12.0, "training_cpu_seconds": 21.0, "rendering_seconds": 1.5,
            "peak_memory_bytes": null, "normalization": {"offset": [0.0, 0.0, 0.0], "scale": 1.0}, "trace": null,
            "predictions": {"input_views": null, "novel_views": "novel"}, "warnings": [],
            "stages": [
                {"stage": "poses", "method": "sfm", "wall_seconds": 31.5},
                {"stage": "planning", "wall_seconds": 2.0}, {"stage": "training", "wall_seconds": 10.0},
                {"stage": "rendering", "wall_seconds": 1.5, "cpu_seconds": 2.5}
            ]
        }))
        .expect("a record");
        let stages = record.stage_times();
        let times = stages.iter().map(|stage| {
            let took = stage.took;
            (stage.stage.as_str(), took.wall_seconds, took.cpu_seconds)
        });
        let expected = [
            ("poses", 31.5, None),
            (PLANNING, 2.0, Some(3.0)),
            (TRAINING, 10.0, Some(18.0)),
            (RENDERING, 1.5, Some(2.5)),
        ];
        assert_eq!(times.collect::<Vec<_>>(), expected);
    }
}
