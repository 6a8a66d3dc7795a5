//! Number of views that are scored at once.

use crate::{
    job::ScoringJob,
    lpips::{Backbone, Lpips},
    metrics::Need,
};

/// Bytes per pixel of a view's data beside networks: prediction, ground truth and the view before it in 8 bits, both
/// images in f64, the map of SSIM, cube faces, masks and depth.
const BYTES_PER_PIXEL: usize = 12 + 48 + 8 + 36 + 12;

/// Returns as many views as fit into `memory_bytes`, at least one and at most one per thread.
pub(crate) fn views_together(job: &ScoringJob, memory_bytes: u64) -> usize {
    let size = job.size.map(|side| side as usize);
    let mut of_view = size[0] * size[1] * BYTES_PER_PIXEL;
    let (mut of_networks, mut of_features) = (0, 0);
    for need in job.computed().flat_map(|metric| metric.needs) {
        // Networks of a view run one after the other.
        if let Need::Network(backbone) = need
            && let Ok(network) = Lpips::published(*backbone)
        {
            of_networks = of_networks.max(network.memory_bytes(size));
            if *backbone == Backbone::Alex {
                // For both images of the view, and its share of those of the view before.
                of_features = 3 * network.features_bytes(size);
            }
        }
    }
    of_view += of_networks + of_features;
    let fitting = memory_bytes / (of_view.max(1) as u64);
    usize::try_from(fitting)
        .unwrap_or(usize::MAX)
        .clamp(1, rayon::current_num_threads())
}
