//! `result`: the scores of one method on one scene under one protocol.

use std::collections::{BTreeMap, BTreeSet};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    object_results::ObjectResults,
    protocol::Protocol,
    run::{Backend, StageTime},
};
use crate::{frame_scores::FRAME_SCORES_FILE, provenance::Hardware, store::Record};

/// Prefix of every warning of a result about a likely mistake of convention in its predictions, such as another order
/// of channels. The author of the predictions should read these first.
pub const DIAGNOSIS_PREFIX: &str = "check the convention: ";

/// Reason of an [`Unavailable`] metric that scoring was told to leave out.
pub const QUICK_LOOK: &str = "left out for a quick look";

/// `result.json`. Per-frame values are in the Parquet table beside it.
///
/// It is a function of the predictions, their run record, the scene, the protocol and the program:
/// scored again it is the same file. What differs each time, the machine, time and memory of
/// scoring, is in the `scoring.json` beside it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ResultRecord {
    /// Id of the method.
    pub method: String,
    /// Id of the scene.
    pub scene: String,
    /// SHA-256 of what was reconstructed and scored: camera, times, poses and ground truth of the
    /// split's frames. Scenes of one id and different hashes are different scenes.
    pub scene_sha256: String,
    /// Id and version of the protocol, `per-scene/1`.
    pub protocol: String,
    /// Hash of the protocol.
    pub protocol_hash: String,
    /// The protocol itself; records of older versions do not have it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rules: Option<Protocol>,
    /// Width and height of the scored images in pixels.
    pub scored_size: [u32; 2],
    /// Scores of the input views by metric id.
    pub input_views: BTreeMap<String, Summary>,
    /// Scores of the novel views by metric id.
    pub novel_views: BTreeMap<String, Summary>,
    /// Reason for which the run that was to predict the views failed, in one line. Views that it left are not
    /// scored: each of them is among the failures.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run_failure: Option<String>,
    /// Views that could not be scored. [`ResultRecord::is_complete`] says what follows.
    pub failures: Vec<Failure>,
    /// Metrics of the protocol that no view has a value of, and why.
    #[serde(default)]
    pub unavailable: Vec<Unavailable>,
    /// Source of static and dynamic regions, unless it is the scene's own masks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub regions: Option<ScoredRegions>,
    /// CSV file of per-frame values: view, frame, `time_seconds`, one column per metric.
    pub frames_table: String,
    /// Scores of single objects, where the protocol has such metrics and the scene such objects.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub objects: Option<ObjectResults>,
    /// The predictions that were scored; records of older versions do not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub predictions: Option<ScoredPredictions>,
    /// Facts about the run that were stated at scoring and that no record measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub statement: Option<RunStatement>,
    /// The way the method came to its views, where a record or a statement says.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub training: Option<TrainingKind>,
    /// Components that help any method: those that the method can have, each with true where the run used it; records
    /// of older versions and of other programs do not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub aids: Option<BTreeMap<String, bool>>,
    /// Training time in seconds, where a run record or a statement says. A run that failed has none.
    pub training_seconds: Option<f64>,
    /// Primitives of the model (Gaussians, or what else the method is made of), where known.
    #[serde(alias = "gaussians")]
    pub primitives: Option<u64>,
    /// Iterations, where known.
    pub iterations: Option<u64>,
    /// Options of the method that were given, `NAME=VALUE`, where the predictions came with a run record that says.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub options: Vec<String>,
    /// SHA-256 of what the run began with beside images: points, tracks and masks by their names, where the
    /// predictions came with a run record that says.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub run_inputs: BTreeMap<String, String>,
    /// Random seed, where the predictions came with a run record. Results of one method on one
    /// scene that differ by it are repetitions.
    pub seed: Option<u64>,
    /// Backend that computed the predictions, if they came with a run record.
    pub backend: Option<Backend>,
    /// The machine that computed the predictions, where they came with a run record that says.
    #[serde(default)]
    pub hardware: Option<Hardware>,
    /// Time to render all predictions in seconds, where they came with a run record.
    pub rendering_seconds: Option<f64>,
    /// Times of the stages from the video on, if the predictions came with a run record that has them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stages: Vec<StageTime>,
    /// Highest resident memory of the training process in bytes, where known.
    pub peak_memory_bytes: Option<u64>,
    /// Warnings that a reader of the scores should know.
    pub warnings: Vec<String>,
    /// Names and versions of the programs that scored, with the commit, and SHA-256 of the
    /// networks' weights.
    #[serde(default)]
    pub versions: BTreeMap<String, String>,
    /// Names and versions of the programs that made the predictions, where they came with a run
    /// record that says.
    #[serde(default)]
    pub run_versions: BTreeMap<String, String>,
}

impl Record for ResultRecord {
    const SCHEMA: &'static str = "omnilife/result/3";
    const OLDER: &'static [&'static str] = &["omnilife/result/2"];
}

/// The way a method comes to the views of a scene. Methods are ranked among those of one kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum TrainingKind {
    /// It trains a model of each scene with the views that it is given.
    PerScene,
    /// It trains nothing of the scene: feed-forward networks, interpolation, sweeps.
    WithoutTraining,
}

/// The clock of a time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum StatedClock {
    /// Wall-clock time.
    Wall,
    /// CPU time, user and system, of all threads.
    Cpu,
    /// Time on a GPU, as drivers and profilers give it.
    Gpu,
}

/// Facts about a run that its authors state. Numbers among them (`training_seconds`, `iterations`,
/// `peak_memory_bytes`, `primitives`) stand in the result's own fields and in `numbers` by name.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct RunStatement {
    /// Names of the result's fields that hold a stated number instead of a measured one, sorted.
    #[serde(default)]
    pub numbers: Vec<String>,
    /// The clock of the training time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clock: Option<StatedClock>,
    /// Processors, GPUs and memory that it ran on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hardware: Option<String>,
    /// Address of the method's code.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub code: Option<String>,
}

/// The files that a result is of, so that they can be handed in and scored again.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ScoredPredictions {
    /// Folder of the predicted input views when they were scored, relative to the result's folder
    /// where that is possible.
    pub input_views: Option<String>,
    /// The same of the novel views.
    pub novel_views: Option<String>,
    /// Every file that was scored, input views first, in the order of the split.
    pub files: Vec<ScoredFile>,
}

/// A novel or input view as predicted, or its distances.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ScoredFile {
    /// `input` or `novel`.
    pub view: String,
    /// Name in the folder of its kind of view.
    pub file: String,
    /// SHA-256 of its content.
    pub sha256: String,
}

/// Returns whether a metric scores one region of the image, static or dynamic.
pub fn is_of_region(metric: &str) -> bool {
    metric.ends_with("-static") || metric.ends_with("-dynamic")
}

impl ResultRecord {
    /// Makes the result of a method on a scene, without protocol and scores.
    pub fn new(method: &str, scene: &str) -> Self {
        Self {
            method: method.to_owned(),
            scene: scene.to_owned(),
            scene_sha256: String::new(),
            protocol: String::new(),
            protocol_hash: String::new(),
            rules: None,
            scored_size: [0; 2],
            input_views: BTreeMap::new(),
            novel_views: BTreeMap::new(),
            run_failure: None,
            failures: Vec::new(),
            unavailable: Vec::new(),
            regions: None,
            frames_table: FRAME_SCORES_FILE.to_owned(),
            objects: None,
            predictions: None,
            statement: None,
            training: None,
            aids: None,
            training_seconds: None,
            primitives: None,
            iterations: None,
            options: Vec::new(),
            run_inputs: BTreeMap::new(),
            seed: None,
            backend: None,
            hardware: None,
            rendering_seconds: None,
            stages: Vec::new(),
            peak_memory_bytes: None,
            warnings: Vec::new(),
            versions: BTreeMap::new(),
            run_versions: BTreeMap::new(),
        }
    }

    /// Returns the names of the tables beside it.
    pub fn tables(&self) -> impl Iterator<Item = &String> {
        let of_objects = self.objects.iter().map(|objects| &objects.table);
        std::iter::once(&self.frames_table).chain(of_objects)
    }

    /// Returns true where the run succeeded and every view has scores. Any other result is not ranked, marked as
    /// best, compared, averaged over scenes or submitted.
    pub fn is_complete(&self) -> bool {
        self.run_failure.is_none() && self.failures.is_empty()
    }

    /// Returns the metrics of the protocol that scoring was told to leave out. A result without them does not stand for
    /// the whole protocol: it is neither ranked nor submitted.
    pub fn left_out_metrics(&self) -> BTreeSet<&str> {
        let mut metrics = BTreeSet::new();
        for unavailable in &self.unavailable {
            if unavailable.reason == QUICK_LOOK {
                metrics.insert(unavailable.metric.as_str());
            }
        }
        metrics
    }

    /// Returns the reason why the result is not complete, in one line: that of the run's failure, or else of the
    /// first view's. Returns `None` where it is complete.
    pub fn why_incomplete(&self) -> Option<String> {
        if let Some(reason) = &self.run_failure {
            return Some(format!("the run failed: {reason}"));
        }
        let first = self.failures.first()?;
        let (count, view, frame) = (self.failures.len(), &first.view, first.frame);
        let reason = &first.reason;
        Some(match count {
            1 => format!("{view} view {frame} could not be scored: {reason}"),
            _ => format!(
                "{count} views could not be scored, the first {view} view {frame}: {reason}"
            ),
        })
    }

    /// Returns the way the method came to its views: as stated, or as iterations and times show; `None` where neither
    /// says.
    pub fn training_kind(&self) -> Option<TrainingKind> {
        // A sweep for depth takes time but trains nothing on the scene.
        let is_trained = match self.iterations {
            Some(iterations) => iterations > 0,
            None => self.training_seconds.unwrap_or(0.0) > 0.0,
        };
        self.training.or(match (is_trained, &self.backend) {
            (true, _) => Some(TrainingKind::PerScene),
            (false, Some(_)) => Some(TrainingKind::WithoutTraining),
            (false, None) => None,
        })
    }

    /// Returns whether both score regions of the image that were found in different ways: these scores are not
    /// comparable.
    pub fn has_other_regions(&self, other: &Self) -> bool {
        self.regions != other.regions && self.scores_regions() && other.scores_regions()
    }

    /// Returns the aids that both methods can have and one of the two runs used. Scores of such runs do not compare the
    /// methods alone.
    pub fn differing_aids<'a>(&'a self, other: &'a Self) -> Vec<&'a str> {
        let (Some(own), Some(others)) = (&self.aids, &other.aids) else {
            return Vec::new();
        };
        let differs = |(aid, used): &(&String, &bool)| {
            let other = others.get(*aid);
            other.is_some_and(|other| other != *used)
        };
        let differing = own.iter().filter(differs);
        differing.map(|(aid, _)| aid.as_str()).collect()
    }

    /// Returns true where it has scores of static or dynamic regions.
    pub fn scores_regions(&self) -> bool {
        let mut metrics = self.input_views.keys().chain(self.novel_views.keys());
        metrics.any(|metric| is_of_region(metric))
    }
}

/// Source of static and dynamic regions. Scores by regions of different hashes are not of the same pixels.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ScoredRegions {
    /// `tracks`: the boxes of the tracks beside the split.
    pub source: String,
    /// SHA-256 of it.
    pub sha256: String,
}

/// A metric over the views of one kind.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Summary {
    /// Arithmetic mean over the views that have a value.
    pub mean: f64,
    /// Sample standard deviation over these views, the inter-frame standard deviation; `None` for
    /// a single one.
    #[serde(default)]
    pub standard_deviation: Option<f64>,
    /// Views that have a value, at least 1: a metric without values has no summary.
    pub views: u32,
    /// Views that were scored and for which the metric is undefined, such as masked scores where
    /// the mask is empty.
    #[serde(default)]
    pub undefined_views: u32,
    /// Which of two scores is the better one; `None` for a number that is only to be read beside
    /// another.
    pub direction: Option<Direction>,
}

/// A metric that no view of a kind has a value of.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Unavailable {
    /// `input` or `novel`.
    pub view: String,
    /// Id of the metric.
    pub metric: String,
    /// One line.
    pub reason: String,
}

/// Which of two scores of a metric is the better one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Direction {
    /// The higher one.
    HigherIsBetter,
    /// The lower one.
    LowerIsBetter,
}

impl Direction {
    /// Returns whether score `left` is better than score `right`.
    pub fn prefers(self, left: f64, right: f64) -> bool {
        match self {
            Self::HigherIsBetter => left > right,
            Self::LowerIsBetter => left < right,
        }
    }
}

/// A view that could not be scored.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Failure {
    /// `input` or `novel`.
    pub view: String,
    /// Frame of the scene.
    pub frame: u32,
    /// One line.
    pub reason: String,
}
