//! What masks say of motion.

use std::fmt;

use omnilife_schemas::mask_survey::INVERTED_SHARE;
use serde::Serialize;

use crate::scene::TrainingScene;

/// How much of the input views masks cover.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MaskEvidence {
    /// Input views.
    pub views: usize,
    /// Those with a mask.
    pub masked_views: usize,
    /// Mean share of the sphere that the masks cover, 0 to 1; `None` without masks.
    pub coverage: Option<f64>,
}

impl MaskEvidence {
    /// Of the input views of a scene.
    pub fn of(scene: &TrainingScene) -> Self {
        let views = &scene.input_views;
        Self {
            views: views.len(),
            masked_views: views.iter().filter(|view| view.mask.is_some()).count(),
            coverage: scene.mask_coverage(),
        }
    }

    /// Whether masks show that something moves. Masks that are empty may have missed it.
    pub fn show_something(&self) -> bool {
        self.coverage.is_some_and(|coverage| coverage > 0.0)
    }

    /// A line for the run's warnings where masks look inverted.
    pub(crate) fn warning(&self) -> Option<String> {
        let coverage = self
            .coverage
            .filter(|&coverage| coverage > INVERTED_SHARE)?;
        Some(format!(
            "the masks cover {:.0} % of the sphere: they look inverted (white is what moves)",
            100.0 * coverage
        ))
    }
}

impl fmt::Display for MaskEvidence {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Some(coverage) = self.coverage else {
            return out.write_str("no input view has a mask");
        };
        write!(
            out,
            "{} of {} input views have masks, which cover {:.2} % of the sphere",
            self.masked_views,
            self.views,
            100.0 * coverage
        )?;
        if coverage > INVERTED_SHARE {
            out.write_str("; they look inverted: white is what moves")?;
        }
        Ok(())
    }
}
