//! Initial points for reconstruction of a scene: dense ones beside the split where stereo has made some
//! (`omnilife curate dense`), else those that came with the poses.

use std::path::{Path, PathBuf};

use crate::{
    layout::{DENSE_FILE, DENSE_FOLDER},
    ownership,
    records::{DenseStereo, Scene},
    store::{self, StoreError},
};

/// Location of a scene's points.
#[derive(Debug, Clone, PartialEq)]
pub struct ScenePoints {
    /// Path of the file.
    pub file: PathBuf,
    /// Name in records: relative to the scene, or to the split.
    pub name: String,
    /// Frames that stereo has used for them; empty where they came with the poses.
    pub dense_frames: Vec<u32>,
}

impl ScenePoints {
    /// Returns the points of a scene in `scene_folder` for a split in `split_folder`; `None` without points.
    ///
    /// # Errors
    /// When the record of the dense points cannot be read, is that of another scene or of other poses, or
    /// names a file outside of its folder.
    pub fn find(
        scene: &Scene,
        scene_folder: &Path,
        split_folder: &Path,
    ) -> Result<Option<Self>, StoreError> {
        let folder = split_folder.join(DENSE_FOLDER);
        let record = folder.join(DENSE_FILE);
        if !record.is_file() {
            return Ok(scene.points.as_ref().map(|file| Self {
                file: scene_folder.join(file),
                name: file.clone(),
                dense_frames: Vec::new(),
            }));
        }
        let dense: DenseStereo = store::read_record(&record)?;
        if dense.scene != scene.id {
            let reason = format!("has the points of {}, not of {}", dense.scene, scene.id);
            return Err(StoreError::malformed(&record, reason));
        }
        if dense.geometry_sha256 != scene.geometry_sha256() {
            let reason = "was measured with other poses than the scene has now: make it again (omnilife \
                          curate dense), or remove its folder";
            return Err(StoreError::malformed(&record, reason));
        }
        if dense.ignored_sha256 != scene.ignored_sha256(scene_folder)? {
            let reason = "was measured with other masks of ignored regions than it has now: make \
                          it again (omnilife curate dense), or remove its folder";
            return Err(StoreError::malformed(&record, reason));
        }
        Ok(Some(Self {
            file: ownership::path_inside(&folder, &dense.points)?,
            name: format!("{DENSE_FOLDER}/{}", dense.points),
            dense_frames: dense.frames.iter().map(|frame| frame.frame).collect(),
        }))
    }

    /// Returns a note for readers of scores where stereo has used held-out frames.
    pub fn held_out(&self, novel_frames: &[u32]) -> Option<String> {
        let seen = novel_frames
            .iter()
            .filter(|frame| self.dense_frames.contains(frame))
            .count();
        (seen > 0).then(|| {
            format!(
                "the dense points were made with {seen} of the views that are held out: novel views have \
                 seen them"
            )
        })
    }
}
