//! A result with the files beside it.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use omnilife_schemas::{
    bootstrap::place,
    frame_scores::FrameScores,
    ownership::is_inside,
    records::{ResultRecord, TrainingKind},
};

use crate::{
    curve::{self, CurvePoint},
    error::ResultsError,
    scene_facts::SceneFacts,
};

/// A result, its file, and facts of its scene.
#[derive(Debug, Clone)]
pub struct Source<'a> {
    /// The file `result.json`.
    pub file: &'a Path,
    /// The result.
    pub result: &'a ResultRecord,
    /// Facts of its scene, if a dataset is known.
    pub facts: Option<&'a SceneFacts>,
    /// Random seed of the run, as text: not every table can hold a number of 64 bits.
    pub(crate) seed: Option<String>,
    /// True if other results of the scene have regions by other tracks, so that its scores by region are not
    /// comparable.
    pub(crate) has_other_regions: bool,
}

impl<'a> Source<'a> {
    /// Returns a result as a source, with a dataset's facts of its scene.
    pub fn new(file: &'a Path, result: &'a ResultRecord, facts: Option<&'a SceneFacts>) -> Self {
        Self {
            file,
            result,
            facts,
            seed: result.seed.map(|seed| seed.to_string()),
            has_other_regions: false,
        }
    }

    /// Returns the id of the video that the scene was cut from.
    pub(crate) fn video(&self) -> &'a str {
        place(&self.result.scene)
    }

    /// Returns the kind of training of the method, as named in records.
    pub(crate) fn training(&self) -> Option<&'static str> {
        self.result.training_kind().map(|kind| match kind {
            TrainingKind::PerScene => "per-scene",
            TrainingKind::WithoutTraining => "without-training",
        })
    }

    /// Returns the table of scores of every view; `None` without such a file beside the result, and for a failed run.
    ///
    /// # Errors
    /// [`ResultsError::Store`] for a file that cannot be read or is another table, [`ResultsError::Impossible`] for a
    /// name that leads out of the folder.
    pub(crate) fn views(&self) -> Result<Option<FrameScores>, ResultsError> {
        if self.result.run_failure.is_some() {
            return Ok(None);
        }
        if !is_inside(&self.result.frames_table) {
            return Err(ResultsError::Impossible {
                path: self.file.to_owned(),
                reason: format!(
                    "{:?} must be a relative path inside its folder",
                    self.result.frames_table
                ),
            });
        }
        let path = self.file.with_file_name(&self.result.frames_table);
        if !path.is_file() {
            return Ok(None);
        }
        Ok(Some(FrameScores::read(&path)?))
    }

    /// Returns the points of its curve; none without such a file.
    ///
    /// # Errors
    /// Those of [`curve::read`].
    pub(crate) fn curve(&self) -> Result<Vec<CurvePoint>, ResultsError> {
        let folder = self.file.parent();
        folder.map_or(Ok(Vec::new()), |folder| curve::read(folder, self.result))
    }
}

/// Returns the scenes, each behind the hash of its protocol, whose results have regions by different tracks:
/// their scores by region do not compare.
pub fn scenes_of_other_regions<'a>(
    results: impl IntoIterator<Item = &'a ResultRecord>,
) -> BTreeSet<(&'a str, &'a str)> {
    let mut first: BTreeMap<(&str, &str), &ResultRecord> = BTreeMap::new();
    let mut scenes = BTreeSet::new();
    for result in results.into_iter().filter(|result| result.scores_regions()) {
        let scene = (result.protocol_hash.as_str(), result.scene.as_str());
        if first
            .entry(scene)
            .or_insert(result)
            .has_other_regions(result)
        {
            scenes.insert(scene);
        }
    }
    scenes
}
