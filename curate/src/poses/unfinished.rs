//! Masks that a failed or killed program has left, kept for the next run of the same command on the same frames.
//!
//! They lie in a hidden folder beside the record, which is the program's `{out}` until it has masked every frame.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use omnilife_schemas::{
    lock::FolderLock,
    progress::Progress,
    rgb::Mask,
    store::{self, StoreError},
};

use super::{frame_list::FrameList, masks};
use crate::error::CurateError;

const FOLDER: &str = ".unfinished-masks";
/// File with the command and the hashes of what it sees.
const REQUEST_FILE: &str = "request.txt";

/// Folder of masks that are not complete yet; no other process writes into its parent meanwhile.
pub(super) struct UnfinishedMasks {
    folder: PathBuf,
    _lock: FolderLock,
}

impl UnfinishedMasks {
    /// Opens the folder in `parent`. Masks of another request are removed, and so are images that are not a whole mask
    /// of a frame; a note says how many are kept.
    ///
    /// # Errors
    /// When the folder is being written by another process, or cannot be written.
    pub(super) fn open(
        parent: &Path,
        request: &str,
        frames: &FrameList,
        progress: &dyn Progress,
    ) -> Result<Self, CurateError> {
        let unfinished = Self {
            folder: parent.join(FOLDER),
            _lock: FolderLock::take(parent, progress)?,
        };
        let file = unfinished.folder.join(REQUEST_FILE);
        if store::read_text(&file).is_ok_and(|earlier| earlier == request) {
            let kept = unfinished.keep_masks(frames)?;
            if kept > 0 {
                progress.note(&format!(
                    "{kept} of {} masks that an earlier run of this command left are in {{out}} again",
                    frames.entries.len()
                ));
            }
        } else {
            store::remove(&unfinished.folder)?;
            store::create_folder(&unfinished.folder)?;
            store::write_bytes(&file, request.as_bytes())?;
        }
        store::create_folder(&unfinished.out())?;
        Ok(unfinished)
    }

    /// Returns the folder for the program's masks.
    pub(super) fn out(&self) -> PathBuf {
        self.folder.join("out")
    }

    /// Keeps the masks of a program that failed, with a note, or removes the folder where it left none.
    ///
    /// # Errors
    /// When a file cannot be removed.
    pub(super) fn keep(
        self,
        frames: &FrameList,
        progress: &dyn Progress,
    ) -> Result<(), CurateError> {
        match self.keep_masks(frames)? {
            0 => Ok(store::remove(&self.folder)?),
            kept => {
                progress.note(&format!(
                    "{kept} of {} masks are kept in {}; the same command finds them in {{out}} and may skip them",
                    frames.entries.len(),
                    self.folder.display()
                ));
                Ok(())
            }
        }
    }

    /// Moves complete masks to a folder and removes this one.
    ///
    /// # Errors
    /// When the files cannot be moved.
    pub(super) fn finish(self, to: &Path) -> Result<(), StoreError> {
        store::rename(&self.out(), to).map_err(|error| StoreError::write(to, error))?;
        store::remove(&self.folder)
    }

    /// Removes images that are not a whole mask of a frame; returns the number of masks.
    fn keep_masks(&self, frames: &FrameList) -> Result<usize, CurateError> {
        let out = self.out();
        if !out.is_dir() {
            return Ok(0);
        }
        let is_whole = |file: &PathBuf| {
            let [width, height] = frames.size.map(|side| side as usize);
            Mask::read(file).is_ok_and(|mask| mask.width * height == mask.height * width)
        };
        // Where two images are of one frame, neither can be trusted.
        let found = masks::find_some(&out, &frames.entries, masks::EXTENSIONS).unwrap_or_default();
        let whole: BTreeSet<PathBuf> = found.into_iter().flatten().filter(is_whole).collect();
        for file in masks::files(&out)? {
            if !whole.contains(&file) {
                store::remove(&file)?;
            }
        }
        Ok(whole.len())
    }
}
