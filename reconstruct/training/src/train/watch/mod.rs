//! Views of a training while it learns: a page in the run's folder, and event files for TensorBoard.
//!
//! They are brought up to date at rows of the trace. Scalars cost some microseconds. The page and rendered views
//! wait at a row before the last one while they have taken more than [`MOST_SHARE`] of the training so far. Their
//! time counts as evaluation.

pub mod page;
mod tensorboard;

use std::{
    path::PathBuf,
    time::{Duration, Instant},
};

use omnilife_engine::training_view::TrainingView;
use omnilife_schemas::{RgbImage, store::StoreError};

use self::{
    page::{Page, PageState},
    tensorboard::{EventFile, PngImage},
};
use super::{checkpoint::LoopState, trace_views::TraceViews};
use crate::{error::ReconstructError, learner::Learner, scene::TrainingScene};

/// Share of the training's time beyond which the page and the views for TensorBoard wait for a later row.
pub const MOST_SHARE: f64 = 0.02;
/// Largest width of views for TensorBoard, pixels.
const MOST_WIDTH: usize = 512;

/// Requested views of a training.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct WatchFiles {
    /// The page.
    pub page: Option<Page>,
    /// Folder that gets an event file for TensorBoard.
    pub tensorboard: Option<PathBuf>,
}

/// Views of a training, with the time that they have taken.
#[derive(Debug, Default)]
pub(super) struct Watch {
    page: Option<Page>,
    events: Option<(PathBuf, EventFile)>,
    spent: Duration,
}

pub(super) struct WatchedRow<'a> {
    /// State of the loop, whose trace ends with the row.
    pub(super) state: &'a LoopState,
    /// Iterations of the whole run.
    pub(super) iterations: u64,
    /// Novel views that are written at rows before the last one.
    pub(super) trace_views: Option<&'a TraceViews>,
    /// True at the end of the training.
    pub(super) is_last: bool,
}

impl Watch {
    /// Starts the views of a training after so many iterations: an event file begins.
    pub(super) fn begin(files: &WatchFiles, iterations_done: u64) -> Result<Self, StoreError> {
        let first = match iterations_done {
            0 => 0,
            done => done + 1,
        };
        let events = files.tensorboard.as_ref().map(|folder| {
            EventFile::create(folder, first).map(|events| (folder.to_owned(), events))
        });
        Ok(Self {
            page: files.page.clone(),
            events: events.transpose()?,
            spent: Duration::ZERO,
        })
    }

    /// Shows a row; renders views where there is time for it.
    pub(super) fn show(
        &mut self,
        row: &WatchedRow<'_>,
        scene: &TrainingScene,
        learner: &mut dyn Learner,
    ) -> Result<(), ReconstructError> {
        let begun = Instant::now();
        let has_time = row.is_last || is_affordable(self.spent, row.state.training);
        if let Some((folder, events)) = &mut self.events
            && let Some(point) = row.state.trace.last()
        {
            let mut images = Vec::new();
            if has_time {
                for (tag, views) in [
                    ("views/input", &scene.input_views),
                    ("views/novel", &scene.novel_views),
                ] {
                    if let Some(view) = middle(views) {
                        let image = small_image(learner, view)?;
                        let failed = |source| StoreError::write(folder.as_path(), source);
                        images.push((tag, PngImage::new(&image).map_err(failed)?));
                    }
                }
            }
            let of_row = (point.known()).map(|(column, value)| (format!("trace/{column}"), value));
            let of_arrays = (point.refused.iter())
                .map(|(array, count)| (format!("refused/{array}"), *count as f64));
            events.add(point.iteration, of_row.chain(of_arrays), &images)?;
        }
        if let Some(page) = &self.page
            && has_time
        {
            page.write(
                &row.state.trace,
                PageState::Learning {
                    iterations: row.iterations,
                },
                row.image(page).as_deref(),
            )?;
        }
        self.spent += begun.elapsed();
        Ok(())
    }

    /// Shows that a training ended before its last row.
    pub(super) fn stop(&self, row: &WatchedRow<'_>) {
        if let Some(page) = &self.page {
            let image = row.image(page);
            // The reason of the training's end is what the user is told.
            drop(page.write(&row.state.trace, PageState::Stopped, image.as_deref()));
        }
    }
}

impl WatchedRow<'_> {
    /// Returns the latest novel view along the trace, relative to the folder of the page.
    fn image(&self, page: &Page) -> Option<String> {
        let kept = self.trace_views?;
        // The views of the last row are rendered after the training.
        let row = self
            .state
            .trace
            .iter()
            .nth_back(usize::from(self.is_last))?;
        let frame = middle(&kept.frames)?;
        let file = kept.folder.join(TraceViews::file(row.iteration, *frame));
        let relative = file.strip_prefix(page.file.parent()?).ok()?;
        Some(relative.to_str()?.to_owned())
    }
}

/// Returns true while the page and the views have taken a small enough share of the training.
fn is_affordable(spent: Duration, training: Duration) -> bool {
    spent <= training.mul_f64(MOST_SHARE)
}

/// Returns the view in the middle of a list.
pub fn middle<T>(views: &[T]) -> Option<&T> {
    views.get(views.len() / 2)
}

fn small_image(
    learner: &mut dyn Learner,
    view: &TrainingView,
) -> Result<RgbImage, ReconstructError> {
    let image = learner.image(&view.view)?;
    let width = image.width.min(MOST_WIDTH);
    let height = (image.height * width / image.width.max(1)).max(1);
    Ok(image.resized_by_area(width, height))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_and_the_views_wait_beyond_two_percent() {
        let affordable = |spent, training| {
            is_affordable(
                Duration::from_millis(spent),
                Duration::from_millis(training),
            )
        };
        assert!(affordable(0, 0) && affordable(19, 1_000));
        assert!(!affordable(1, 0) && !affordable(21, 1_000));
    }

    #[test]
    fn the_middle_of_a_list_is_one_of_it() {
        assert_eq!(middle::<u32>(&[]), None);
        assert_eq!(
            (middle(&[4]), middle(&[4, 9]), middle(&[4, 9, 14])),
            (Some(&4), Some(&9), Some(&9))
        );
    }
}
