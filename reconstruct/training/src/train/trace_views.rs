//! Novel views along the trace, as rendered at each of its rows.
//!
//! Training does not score them. The benchmark does, with the protocol's own metrics, so that a bug in a loss
//! cannot hide in a curve of error against run time.

use std::path::PathBuf;

use omnilife_engine::training_view::TrainingView;
use omnilife_schemas::{RgbImage, store};

use crate::error::ReconstructError;

/// Novel views that are kept at every row of the trace but the last one, whose views are the run's predictions.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TraceViews {
    /// Folder of the rows' folders.
    pub folder: PathBuf,
    /// Frames of the views, as the split numbers them.
    pub frames: Vec<u32>,
}

impl TraceViews {
    /// Returns all of the novel views, or `most` of them, evenly spread.
    pub fn new(folder: PathBuf, novel: &[u32], most: Option<usize>) -> Self {
        let frames = spread(novel, most.unwrap_or(novel.len())).copied();
        Self {
            folder,
            frames: frames.collect(),
        }
    }

    /// Returns the file of a view at a row, relative to the folder.
    pub fn file(iteration: u64, frame: u32) -> String {
        format!("{iteration:06}/{frame:06}.png")
    }

    /// Renders the views of a row and writes them as 8-bit PNG.
    pub(super) fn write(
        &self,
        iteration: u64,
        novel: &[TrainingView],
        mut render: impl FnMut(&TrainingView) -> Result<RgbImage, ReconstructError>,
    ) -> Result<(), ReconstructError> {
        let kept = |view: &&TrainingView| self.frames.contains(&view.frame);
        for view in novel.iter().filter(kept) {
            let path = self.folder.join(Self::file(iteration, view.frame));
            if let Some(folder) = path.parent() {
                store::create_folder(folder)?;
            }
            render(view)?.write_png(&path)?;
        }
        Ok(())
    }
}

/// Returns at most `most` of these, evenly spread: the middles of equal parts.
pub(super) fn spread<T>(all: &[T], most: usize) -> impl Iterator<Item = &T> {
    let count = most.min(all.len());
    (0..count).map(move |part| &all[(2 * part + 1) * all.len() / (2 * count)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_that_are_kept_are_evenly_spread() {
        let novel: Vec<u32> = (0..10).map(|view| 4 + 10 * view).collect();
        let kept = |most| TraceViews::new(PathBuf::new(), &novel, most).frames;
        assert_eq!(kept(None), novel);
        assert_eq!(kept(Some(12)), novel);
        assert_eq!(kept(Some(2)), [24, 74]);
        assert_eq!(kept(Some(0)), [0; 0]);
    }
}
