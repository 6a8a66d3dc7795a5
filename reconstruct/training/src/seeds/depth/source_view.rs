//! Views with distances from any source.

use omnilife_engine::training_view::TrainingView;
use omnilife_schemas::distances::DistanceImage;

use super::{DistanceView, ScaleFit};
use crate::scene::depth::resized_view;

/// A view with its distances on one grid.
#[derive(Debug, Clone)]
pub struct SourceView {
    /// Camera, colours and mask of the grid's size.
    pub view: TrainingView,
    /// Distances along the rays, normalized units.
    pub distances: DistanceImage,
    /// Confidence of each distance, if the source has it.
    pub confidences: Option<Vec<f32>>,
}

impl SourceView {
    /// Returns the view as input of the lift.
    pub fn as_given(&self) -> DistanceView<'_> {
        DistanceView {
            view: &self.view.view,
            pixels: &self.view.pixels,
            mask: self.view.mask.as_deref(),
            ignored: self.view.ignored.as_deref(),
            distances: &self.distances,
            confidences: self.confidences.as_deref(),
        }
    }
    /// Returns image and distances on the coarser of their grids: a finer one would have samples beyond the
    /// pixels, or distances beyond the measured ones.
    pub fn on_one_grid(view: &TrainingView, distances: DistanceImage) -> Self {
        let camera = &view.view.camera;
        let size = camera.size().min([distances.width, distances.height]);
        Self {
            view: resized_view(view, size),
            distances: distances.resampled(size[0], size[1]),
            confidences: None,
        }
    }
}

/// Applies the factors to the views' distances.
pub fn scaled(views: &mut [SourceView], fit: &ScaleFit) {
    for (view, log_scale) in views.iter_mut().zip(&fit.log_scales) {
        let factor = log_scale.exp() as f32;
        let values = view.distances.values.iter_mut();
        values.for_each(|value| *value *= factor);
    }
}
