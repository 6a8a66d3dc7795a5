//! Conversion of aggregated costs to inverse distances.

use omnilife_stereo::PathSums;

use crate::stereo::matching::Hypotheses;

/// Inverse distance and confidence of every pixel of a view, row by row.
#[derive(Debug, Clone, PartialEq)]
pub struct SweptDepth {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Inverse distances along the ray, per distance between the two cameras; 0 is infinitely far.
    pub inverse_distances: Vec<f32>,
    /// Confidence of each inverse distance, in [0, 1]; 0 where the other view contradicts it or does not see the
    /// place.
    pub confidences: Vec<f32>,
}

/// Returns the best inverse distance of every pixel.
pub(super) fn best(sums: &PathSums, hypotheses: &Hypotheses) -> SweptDepth {
    let (inverse_distances, confidences) = omnilife_stereo::best(sums)
        .into_iter()
        .map(|best| (hypotheses.inverse_distance(best.steps), best.confidence))
        .unzip();
    SweptDepth {
        width: sums.width,
        height: sums.height,
        inverse_distances,
        confidences,
    }
}
