//! One result with what lies beside it.

use std::path::Path;

use omnilife_schemas::{
    bootstrap::place,
    frame_scores::FrameScores,
    records::{ResultRecord, TrainingKind},
};

use crate::{
    curve::{self, CurvePoint},
    error::ResultsError,
    scene_facts::SceneFacts,
};

/// A result, where it lies, and facts of its scene.
#[derive(Debug, Clone, Copy)]
pub struct Source<'a> {
    /// The file `result.json`.
    pub file: &'a Path,
    /// The result.
    pub result: &'a ResultRecord,
    /// Facts of its scene, where a dataset is known.
    pub facts: Option<&'a SceneFacts>,
}

impl<'a> Source<'a> {
    /// Returns the id of the video that the scene was cut from.
    pub(crate) fn video(&self) -> &'a str {
        place(&self.result.scene)
    }

    /// Returns the way the method came to its views, as records name it.
    pub(crate) fn training(&self) -> Option<&'static str> {
        self.result.training.map(|kind| match kind {
            TrainingKind::PerScene => "per-scene",
            TrainingKind::WithoutTraining => "without-training",
        })
    }

    /// Returns the table of scores of every view; `None` where there is no such file beside the result.
    ///
    /// # Errors
    /// [`ResultsError::Store`] for a file that cannot be read or is no such table.
    pub(crate) fn views(&self) -> Result<Option<FrameScores>, ResultsError> {
        let path = self.file.with_file_name(&self.result.frames_table);
        if !path.is_file() {
            return Ok(None);
        }
        Ok(Some(FrameScores::read(&path)?))
    }

    /// Returns the points of its curve; none where there is no such file.
    ///
    /// # Errors
    /// Those of [`curve::read`].
    pub(crate) fn curve(&self) -> Result<Vec<CurvePoint>, ResultsError> {
        self.file.parent().map_or(Ok(Vec::new()), curve::read)
    }
}
